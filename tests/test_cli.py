"""The command line: what people see, exit codes, and that nothing from a file steers the terminal."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from click.testing import CliRunner, Result
from imufast.cli import main
from imufast.cli.app import app
from imufast.cli.show import plain, quietest_acc


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert "Traceback" not in result.output
    return result


@pytest.fixture(scope="module")
def simulation() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=30, rate_hz=50, seed=2)


def save(path: Path, s: imufast.HingeSimulation, **instead: Any) -> Path:
    arrays = {name: getattr(s, name) for name in ("gyr1", "acc1", "gyr2", "acc2")} | instead
    np.savez(path, rate_hz=50.0, **arrays)
    return path


@pytest.fixture
def pair_npz(tmp_path: Path, simulation: imufast.HingeSimulation) -> Path:
    return save(tmp_path / "pair.npz", simulation)


def write_csv(path: Path, imu: imufast.Imu, header: str = "time_s,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z") -> Path:
    rows = np.column_stack([imu.time_s, imu.gyr, imu.acc])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture
def pair_csv(tmp_path: Path, simulation: imufast.HingeSimulation) -> tuple[Path, Path]:
    return write_csv(tmp_path / "thigh.csv", simulation.imu1), write_csv(tmp_path / "shank.csv", simulation.imu2)


def test_demo_ends_beside_the_truth_and_with_the_path_of_its_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("demo")
    assert result.exit_code == 0, result.output
    assert "verdict: HINGE, accepted" in result.stdout
    beside = result.stdout[result.stdout.index("Beside the truth") :]
    rows = re.findall(r"(\d+\.\d+)° +(\d+\.\d+)°", beside)
    assert len(rows) == 2
    assert all(float(off) < 0.2 < float(bound) < 3.0 for off, bound in rows)
    assert result.stderr == ""
    assert result.stdout.splitlines()[-1] == "report: imufast-demo.html"
    assert [path.name for path in tmp_path.iterdir()] == ["imufast-demo.html"]
    assert run("demo", "--report", "other.html").stdout.splitlines()[-1] == "report: other.html"


def test_demo_without_the_extra_report_still_runs(tmp_path: Path) -> None:
    script = "import sys; sys.modules['matplotlib'] = None; from imufast.cli import main; main()"
    command = [sys.executable, "-c", script, "demo"]
    plain_demo = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path)
    assert plain_demo.returncode == 0, plain_demo.stderr
    assert "Beside the truth" in plain_demo.stdout
    assert "pip install 'imufast[report]'" in plain_demo.stdout
    asked = subprocess.run([*command, "--report", "x.html"], check=False, capture_output=True, text=True, cwd=tmp_path)
    assert asked.returncode == 2
    assert asked.stderr.splitlines() == ["error: a report needs matplotlib: pip install 'imufast[report]'"]
    assert not list(tmp_path.iterdir())


def test_version() -> None:
    result = run("--version")
    assert result.exit_code == 0
    assert re.fullmatch(r"imufast \d+\.\d+\.\d+\S*\n", result.stdout)


def test_calibrate_prints_both_axes_of_two_files(pair_csv: tuple[Path, Path], simulation: imufast.HingeSimulation) -> None:
    result = run("calibrate", *pair_csv)
    assert result.exit_code == 0, result.output
    for name, truth in (("thigh", simulation.axis1), ("shank", simulation.axis2)):
        row = re.search(rf"{name} +(-?\d\.\d+) +(-?\d\.\d+) +(-?\d\.\d+) +(\d+\.\d+)°", result.stdout)
        assert row, result.stdout
        axis = np.array([float(x) for x in row.groups()[:3]])
        assert np.degrees(np.arccos(np.clip(abs(axis @ truth), 0.0, 1.0))) < float(row[4]) < 3.0
    for words in ("95 % of cases", "verdict: HINGE, accepted", "Accepted since", "misfit to a hinge: 0.0", "up to 0.25"):
        assert words in result.stdout
    assert result.stderr == ""


def test_calibrate_takes_one_file_with_two_sensors(pair_npz: Path) -> None:
    result = run("calibrate", pair_npz)
    assert result.exit_code == 0
    assert "Axis of sensor1 and sensor2" in result.stdout
    assert "Axis of sensor2 and sensor1" in run("calibrate", pair_npz, "--sensors", "sensor2", "sensor1").stdout


def test_options_change_the_result_and_are_checked(pair_npz: Path) -> None:
    usual = run("calibrate", pair_npz)
    for option, value, exit_code, wrong, name in (
        ("--lowpass", 0, 0, -4, "lowpass_hz"),
        ("--max-error", 0.6, 3, 0, "max_error_deg"),
        ("--n-consistent", 1000, 3, 0, "n_consistent"),
    ):
        chosen = run("calibrate", pair_npz, option, value)
        assert chosen.exit_code == exit_code, chosen.output
        assert chosen.stdout != usual.stdout
        refused = run("calibrate", pair_npz, option, wrong)
        assert refused.exit_code == 2
        assert name in refused.stderr


def slipped(path: Path, duration_s: float, slip_at_s: float) -> Path:
    """A hinge whose first sensor turns by 20° within its strap, all at once."""
    s = imufast.simulate_hinge("mixed", duration_s=duration_s, rate_hz=50, seed=1)
    c, d = np.cos(np.radians(20.0)), np.sin(np.radians(20.0))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -d], [0.0, d, c]])
    after = (s.time_s >= slip_at_s)[:, None]
    return save(path, s, gyr1=np.where(after, s.gyr1 @ turn.T, s.gyr1), acc1=np.where(after, s.acc1 @ turn.T, s.acc1))


def test_still_sensors_are_exit_code_3(tmp_path: Path) -> None:
    path = save(tmp_path / "still.npz", imufast.simulate_hinge("stationary", duration_s=40, rate_hz=50))
    result = run("calibrate", path)
    assert result.exit_code == 3
    for said in ("Not enough motion to tell", "verdict: NOT_ENOUGH_INFORMATION, not accepted", "Not accepted: the joint has"):
        assert said in result.stdout


@pytest.mark.parametrize("dof", [2, 3])
def test_other_joints_are_exit_code_4(tmp_path: Path, dof: Any) -> None:
    s = imufast.simulate_hinge("free", dof=dof, duration_s=40, rate_hz=50)
    path = save(tmp_path / "joint.npz", s)
    result = run("calibrate", path, "--joint", "hinge", "--json", tmp_path / "joint.json")
    assert result.exit_code == 4
    assert "The joint is not a hinge" in result.stdout
    assert re.search(r"Not accepted: misfit 0\.\d+ is above 0\.25\.", result.stdout)
    assert json.loads((tmp_path / "joint.json").read_text("utf-8"))["verdict"] == "NOT_A_HINGE"
    # Without that word they are what they are: joints with a centre.
    told = run("calibrate", path)
    assert told.exit_code == 0, told.output
    assert "verdict: BALL_JOINT, accepted" in told.stdout


def test_a_slipped_strap_is_exit_code_5_accepted_anew_or_not(tmp_path: Path) -> None:
    late = run("calibrate", slipped(tmp_path / "late.npz", 94.0, 75.0), "--report", tmp_path / "late.html")
    assert late.exit_code == 5
    assert "The mounting of a sensor was seen to have changed at" in late.stdout
    assert "A sensor has moved on its segment" in (tmp_path / "late.html").read_text("utf-8")
    early = run("calibrate", slipped(tmp_path / "early.npz", 150.0, 75.0))
    assert early.exit_code == 5
    assert ("HINGE, accepted" in early.stdout) == ("the new mounting has been calibrated" in early.stdout)


def test_outputs_are_written_and_say_the_same(pair_npz: Path, tmp_path: Path) -> None:
    page, numbers = tmp_path / "out.html", tmp_path / "out.json"
    result = run("calibrate", pair_npz, "--report", page, "--json", numbers)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-2:] == [f"numbers: {numbers}", f"report: {page}"]
    twin = json.loads(numbers.read_text("utf-8"))
    assert (twin["verdict"], twin["sensors"]) == ("HINGE", ["sensor1", "sensor2"])
    assert twin["headline"] in page.read_text("utf-8")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.html", "out.json", "pair.npz"]


def test_outputs_that_cannot_be_are_refused_before_the_work(pair_npz: Path, tmp_path: Path) -> None:
    before = pair_npz.read_bytes()
    for arguments, words in (
        (["--report", tmp_path / "none" / "out.html"], "there is no folder"),
        (["--json", tmp_path], "is a folder"),
        (["--report", pair_npz], "would replace the recording"),
        (["--report", tmp_path / "same", "--json", tmp_path / "same"], "would replace what --report writes"),
    ):
        result = run("calibrate", pair_npz, *arguments)
        assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1)
        assert words in result.stderr
    assert pair_npz.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["pair.npz"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["calibrate", "{npz}", "--sensors", "sensor1", "knee"], "there is no 'knee'; there are sensor1, sensor2"),
        (["calibrate", "{npz}", "--sensors", "sensor1", "sensor1"], "two different sensors"),
        (["calibrate", "{csv}"], "give the other one's file too"),
        (["calibrate", "missing.txt", "{csv}"], "there is no such file"),
        (["info", "missing.txt"], "there is no such file"),
        (["calibrate", "{npz}", "--units", "furlongs"], "furlongs"),
        (["calibrate", "{npz}", "--rate", "-5"], "rate_hz"),
        (["calibrate", "{csv}", "--columns", "gyr"], "--columns must look like"),
        (["calibrate", "{csv}", "--columns", "gyr=a,,c"], "--columns must look like"),
        (["calibrate", "{csv}", "--columns", "{{not json"], "--columns is not valid JSON"),
        (["calibrate", "{npz}", "--format", "xsens_mt_manager"], "pair.npz"),
    ],
)
def test_wrong_input_is_one_line_and_exit_code_2(
    arguments: list[str], words: str, pair_npz: Path, pair_csv: tuple[Path, Path]
) -> None:
    result = run(*(a.format(npz=pair_npz, csv=pair_csv[0]) for a in arguments))
    assert result.exit_code == 2
    lines = result.stderr.splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("error: ")
    assert words in lines[0]


@pytest.mark.parametrize("arguments", [["calibrate"], ["info"], ["fly"], ["calibrate", "x", "--format", "mp3"], ["demo", "x"]])
def test_usage_errors_are_exit_code_2(arguments: list[str]) -> None:
    assert run(*arguments).exit_code == 2


def test_units_that_gravity_contradicts_are_named(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    s = simulation
    path = save(tmp_path / "g.npz", s, acc1=s.acc1 / 9.80665, acc2=s.acc2 / 9.80665)
    wrong = run("calibrate", path)
    assert wrong.exit_code == 2
    assert "in g" in wrong.stderr or "'g'" in wrong.stderr
    assert run("calibrate", path, "--units", "g").exit_code == 0


def test_columns_by_key_and_by_json(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    header = "t,wx,wy,wz,fx,fy,fz"
    files = [write_csv(tmp_path / f"{n}.csv", i, header) for n, i in (("a", simulation.imu1), ("b", simulation.imu2))]
    by_key = run("calibrate", *files, "--columns", "gyr=wx,wy,wz", "--columns", "acc=fx,fy,fz", "--columns", "time_s=t")
    mapping = {"gyr": ["wx", "wy", "wz"], "acc": ["fx", "fy", "fz"], "time_s": "t"}
    by_json = run("calibrate", *files, "--columns", json.dumps(mapping))
    assert by_key.exit_code == by_json.exit_code == 0, by_key.output
    assert by_key.stdout == by_json.stdout


def test_columns_of_several_sensors_in_one_file(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    s, path = simulation, tmp_path / "both.csv"
    names = [f"{place}{k}" for place in "ab" for k in range(6)]
    rows = np.column_stack([s.gyr1, s.acc1, s.gyr2, s.acc2])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    keys = ["thigh.gyr=a0,a1,a2", "thigh.acc=a3,a4,a5", "shank.gyr=b0,b1,b2", "shank.acc=b3,b4,b5"]
    result = run("calibrate", path, "--rate", 50, *(x for key in keys for x in ("--columns", key)))
    assert result.exit_code == 0, result.output
    assert "Axis of thigh and shank" in result.stdout


def test_info_shows_each_sensor_and_the_offset(pair_npz: Path) -> None:
    result = run("info", pair_npz)
    for words in ("sensor1", "sensor2", "pair.npz", "npz", "1500", "29.98 s at 50 Hz", "no gaps", "time offset", "samples)"):
        assert words in result.stdout
    assert result.stderr == ""


def test_an_offset_above_half_a_sample_is_warned_of(tmp_path: Path) -> None:
    path = save(tmp_path / "late.npz", imufast.simulate_hinge("mixed", rate_hz=50, clock_offset_s=0.03))
    for command in ("info", "calibrate"):
        result = run(command, path)
        assert result.exit_code == 0
        assert "warning: sensor2 is +1.5" in result.stderr
    run("calibrate", path, "--json", tmp_path / "late.json")
    assert json.loads((tmp_path / "late.json").read_text("utf-8"))["warnings"][0].startswith("sensor2 is +1.5")
    assert "late against" in run("info", path).stdout


def test_warnings_are_lines(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    s, path = simulation, tmp_path / "stuck.npz"
    np.savez(path, gyr1=np.repeat(s.gyr1[::8], 8, 0)[:1500], acc1=np.repeat(s.acc1[::8], 8, 0)[:1500], rate_hz=50.0)
    result = run("info", path)
    assert result.stderr.startswith("warning: ")
    assert "ImufastWarning" not in result.stderr


def test_files_that_do_not_belong_together_are_shown_one_by_one(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    early = write_csv(tmp_path / "early.csv", simulation.imu1.between(0, 5))
    late = write_csv(tmp_path / "late.csv", simulation.imu1.between(10, 15))
    result = run("info", early, late)
    assert result.exit_code == 0
    assert "early" in result.stdout
    assert "cannot be joined" in result.stderr
    assert run("calibrate", early, late).exit_code == 2


def test_text_from_files_is_neither_markup_nor_terminal_control(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    s, evil = simulation, "[bold]x[/nonsense]:smile:\x1b[31mred"
    path = tmp_path / "evil.npz"
    arrays: dict[str, Any] = {f"{evil}.gyr": s.gyr1, f"{evil}.acc": s.acc1, "b.gyr": s.gyr2, "b.acc": s.acc2, "rate_hz": 50.0}
    np.savez(path, **arrays)
    for arguments in (["info", path], ["calibrate", path], ["calibrate", path, "--sensors", "b", "c\x1b[31m"]):
        result = run(*arguments)
        assert "\x1b" not in result.output
        assert "[bold]" in result.output
    broken = tmp_path / "broken.csv"
    broken.write_text("a\x1b]0;title\x07,[red]b\n1,2\n")
    result = run("info", broken)
    assert result.exit_code == 2
    assert "\x1b" not in result.output
    assert "\x07" not in result.output


def test_plain_keeps_letters_and_drops_control() -> None:
    assert plain("größe °/s\tx\r\ny\x00\x9b") == "größe °/s x  y\ufffd\ufffd"


def test_quietest_acc_is_gravity_in_the_quiet(simulation: imufast.HingeSimulation) -> None:
    assert quietest_acc(simulation.imu1) == pytest.approx(9.81, abs=0.5)
    assert quietest_acc(simulation.imu1[:1]) > 0


def test_real_mt_manager_files(shared_data: Path) -> None:
    folder = shared_data / "formats" / "xsens_mt_manager"
    files = sorted(folder.glob("MT_012005D6_031-000_*.txt"))
    result = run("info", *files)
    assert result.exit_code == 0, result.output
    for words in ("00B421AF", "00B4227B", "xsens_mt_manager", "3369", "100 Hz"):
        assert words in result.stdout
    without_rate = run("info", folder / "MT2022_ACC_GYRO_ROT_EULER_TAB_00B42D4F.txt")
    assert without_rate.exit_code == 2
    assert "--rate" in without_rate.stderr


def test_files_without_gyroscope_are_refused_with_the_reason(shared_data: Path) -> None:
    for file in sorted((shared_data / "formats" / "movella_dot").glob("*.csv")):
        result = run("info", file)
        assert result.exit_code == 2
        assert "gyroscope" in result.stderr


def test_importing_imufast_needs_neither_click_nor_rich() -> None:
    script = "import sys, imufast, imufast.sync; sys.exit(bool({'click', 'rich'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


@pytest.mark.parametrize("missing", ["click", "rich"])
def test_missing_extra_is_named(missing: str) -> None:
    script = f"import sys; sys.modules[{missing!r}] = None; from imufast.cli import main; main()"
    result = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True, text=True)
    assert result.returncode == 2
    assert "pip install 'imufast[cli]'" in result.stderr
    assert "Traceback" not in result.stderr


def test_entry_point(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["imufast", "--help"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0
    assert "calibrate" in capsys.readouterr().out
