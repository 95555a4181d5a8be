"""The command line: what people see, exit codes, and that nothing from a file steers the terminal."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import replace
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


@pytest.fixture
def pair_npz(tmp_path: Path, simulation: imufast.HingeSimulation) -> Path:
    s, path = simulation, tmp_path / "pair.npz"
    np.savez(path, gyr1=s.gyr1, acc1=s.acc1, gyr2=s.gyr2, acc2=s.acc2, rate_hz=50.0)
    return path


def write_csv(path: Path, imu: imufast.Imu, header: str = "time_s,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z") -> Path:
    rows = np.column_stack([imu.time_s, imu.gyr, imu.acc])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture
def pair_csv(tmp_path: Path, simulation: imufast.HingeSimulation) -> tuple[Path, Path]:
    return write_csv(tmp_path / "thigh.csv", simulation.imu1), write_csv(tmp_path / "shank.csv", simulation.imu2)


def test_demo_ends_beside_the_truth() -> None:
    result = run("demo")
    assert result.exit_code == 0, result.output
    assert "CONVERGED" in result.stdout
    errors = [float(x) for x in re.findall(r"(\d+\.\d+)°\s+\d+\.\d+°", result.stdout)]
    assert len(errors) == 2
    assert max(errors) < 0.1
    assert result.stderr == ""


def test_demo_writes_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("demo").exit_code == 0
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
        assert abs(axis @ truth) == pytest.approx(1.0, abs=1e-4)
        assert float(row[4]) < 1.0
    for words in ("95 % of cases", "status: CONVERGED", "residuals", "samples used: 1500 of 1500"):
        assert words in result.stdout


def test_calibrate_takes_one_file_with_two_sensors(pair_npz: Path) -> None:
    result = run("calibrate", pair_npz)
    assert result.exit_code == 0
    assert "Hinge axis of sensor1 and sensor2" in result.stdout
    turned = run("calibrate", pair_npz, "--sensors", "sensor2", "sensor1")
    assert "Hinge axis of sensor2 and sensor1" in turned.stdout


def test_lowpass_changes_the_result_and_is_checked(pair_npz: Path) -> None:
    raw, smooth = run("calibrate", pair_npz), run("calibrate", pair_npz, "--lowpass", "4")
    assert smooth.exit_code == 0
    assert raw.stdout != smooth.stdout
    wrong = run("calibrate", pair_npz, "--lowpass", "-4")
    assert wrong.exit_code == 2
    assert "lowpass_hz" in wrong.stderr


def test_not_identifiable_is_exit_code_3(pair_npz: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def undetermined(imu1: imufast.Imu, imu2: imufast.Imu, **settings: Any) -> imufast.HingeAxis:
        found = imufast.estimate_hinge_axis(imu1, imu2, **settings)
        return replace(found, status=imufast.SolveStatus.NOT_IDENTIFIABLE, bound95_deg=np.full(2, np.inf))

    monkeypatch.setattr("imufast.cli.app.estimate_hinge_axis", undetermined)
    result = run("calibrate", pair_npz)
    assert result.exit_code == 3
    assert "status: NOT_IDENTIFIABLE: the motion does not determine the axis" in result.stdout
    assert "unknown" in result.stdout


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
    s, path = simulation, tmp_path / "g.npz"
    np.savez(path, gyr1=s.gyr1, acc1=s.acc1 / 9.80665, gyr2=s.gyr2, acc2=s.acc2 / 9.80665, rate_hz=50.0)
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
    assert "Hinge axis of thigh and shank" in result.stdout


def test_info_shows_each_sensor_and_the_offset(pair_npz: Path) -> None:
    result = run("info", pair_npz)
    assert result.exit_code == 0
    for words in ("sensor1", "sensor2", "pair.npz", "npz", "1500", "29.98 s at 50 Hz", "no gaps", "time offset", "samples)"):
        assert words in result.stdout
    assert result.stderr == ""


def test_an_offset_above_half_a_sample_is_warned_of(tmp_path: Path) -> None:
    s, path = imufast.simulate_hinge("mixed", rate_hz=50, clock_offset_s=0.03), tmp_path / "late.npz"
    np.savez(path, gyr1=s.gyr1, acc1=s.acc1, gyr2=s.gyr2, acc2=s.acc2, rate_hz=50.0)
    for command in ("info", "calibrate"):
        result = run(command, path)
        assert result.exit_code == 0
        assert "warning: sensor2 is +1.5" in result.stderr
    assert "late against" in run("info", path).stdout


def test_warnings_are_lines(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    s, path = simulation, tmp_path / "stuck.npz"
    np.savez(path, gyr1=np.repeat(s.gyr1[::8], 8, 0)[:1500], acc1=np.repeat(s.acc1[::8], 8, 0)[:1500], rate_hz=50.0)
    result = run("info", path)
    assert result.exit_code == 0
    assert result.stderr.startswith("warning: ")
    assert "ImufastWarning" not in result.stderr


def test_files_that_do_not_belong_together_are_shown_one_by_one(tmp_path: Path, simulation: imufast.HingeSimulation) -> None:
    early = write_csv(tmp_path / "early.csv", simulation.imu1.between(0, 5))
    late = write_csv(tmp_path / "late.csv", simulation.imu1.between(10, 15))
    result = run("info", early, late)
    assert result.exit_code == 0
    assert "early" in result.stdout
    assert "late" in result.stdout
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
