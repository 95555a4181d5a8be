"""`imufast track --angles`: what is printed, written and refused."""

from __future__ import annotations

import json
from pathlib import Path

import imufast
import numpy as np
import pytest
from test_cli import run, save, write_csv


@pytest.fixture(scope="module")
def knee() -> imufast.HingeSimulation:
    """Standing still for 3 s, then walking."""
    motions = imufast.Motion("stationary", duration_s=3.0), imufast.Motion("walking", duration_s=30.0)
    return imufast.simulate_hinge(motions, rate_hz=50, seed=1)


@pytest.fixture(scope="module")
def files(knee: imufast.HingeSimulation, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("knee")
    return write_csv(folder / "thigh.csv", knee.imu1), write_csv(folder / "shank.csv", knee.imu2)


def rows_of(path: Path) -> np.ndarray:
    lines = path.read_text("utf-8").splitlines()
    return np.array([[float(x) for x in line.split("\t")] for line in lines[lines.index("endheader") + 2 :]])


def test_two_files_become_a_knee_angle(tmp_path: Path, knee: imufast.HingeSimulation, files: tuple[Path, Path]) -> None:
    out = tmp_path / "knee.mot"
    result = run("track", *files, "--angles", "--out", out)
    assert result.exit_code == 0, result.output
    for said in (
        "The joint angle is known",
        "Hinge angle: ",
        "zero: mean of the recording",
        "which way is flexion was not told",
    ):
        assert said in result.stdout, said
    assert f"angles: {out}" in result.stdout
    rows = rows_of(out)
    truth = np.degrees(knee.angle_rad)
    off = min(float(np.std(sign * rows[:, 1] - truth)) for sign in (1.0, -1.0))
    assert off < 1.0
    np.testing.assert_allclose(rows[:, 0], knee.time_s, atol=1e-6)


def test_all_that_can_be_told_of_a_hinge(tmp_path: Path, knee: imufast.HingeSimulation, files: tuple[Path, Path]) -> None:
    outputs = [tmp_path / name for name in ("k.sto", "k.png", "cal.json", "k.html", "k.json")]
    options = zip(("--out", "--figure", "--save", "--report", "--json"), outputs, strict=True)
    arguments = [part for option in options for part in option]
    result = run("track", *files, "--angles", "--zero", "0:3", "--zero-deg", "3", "--flexion", "excursion", *arguments)
    assert result.exit_code == 0, result.output
    assert "zero: mean of 0 to 3 s after the start, set to 3 degrees; positive: flexion" in result.stdout
    assert "not told" not in result.stdout
    written = [line.split(": ")[0] for line in result.stdout.splitlines()[-5:]]
    assert written == ["angles", "figure", "calibration", "numbers", "report"]
    rows = rows_of(outputs[0])
    start = knee.time_s <= 3.0
    assert rows[start, 1].mean() == pytest.approx(3.0, abs=1e-6)
    truth = np.degrees(knee.angle_rad)
    np.testing.assert_allclose(rows[:, 1] - 3.0, truth - truth[start].mean(), atol=2.5)
    assert (rows[:, 2] > 0.0).all()
    # The calibration that is saved has its axis turned: flexion stays positive with it.
    again = run("track", *files, "--calibration", outputs[2], "--angles", "--flexion", "axis", "--out", tmp_path / "b.mot")
    assert again.exit_code == 0, again.output
    assert np.corrcoef(rows_of(tmp_path / "b.mot")[:, 1], rows[:, 1])[0, 1] > 0.999
    plain = json.loads(outputs[4].read_text("utf-8"))
    assert plain["angles"]["names"] == ["flexion"]
    assert plain["title"] == "Joint angle"


def test_three_angles_from_a_standing_pose(tmp_path: Path, files: tuple[Path, Path]) -> None:
    out = tmp_path / "three.mot"
    pose = ("--standing", "0:1", "--joint", "knee")
    # The simulated person does not stand upright: only the words and files are looked at.
    names = ("--names=-knee_angle_r,a,b", "--figure", tmp_path / "three.svg")
    result = run("track", *files, "--angles", *pose, "--side", "right", "--flexion", "excursion", *names, "--out", out)
    assert result.exit_code == 0, result.output
    for said in ("Adduction: ", "Internal rotation: ", "side: right; joint: knee; convention ISB", "positive: clinical"):
        assert said in result.stdout, said
    assert rows_of(out).shape[1] == 4
    assert "time\tknee_angle_r\ta\tb" in out.read_text("utf-8")
    other = run("track", *files, "--angles", *pose, "--axis-towards", "0,0,1", "--convention", "McGrath")
    assert other.exit_code == 0, other.output
    assert "Rotation about x: " in other.stdout


def test_orientations_for_opensense(tmp_path: Path, files: tuple[Path, Path]) -> None:
    out = tmp_path / "q.sto"
    result = run("track", *files, "--out", out, "--names", "femur_r_imu,tibia_r_imu", "--save", tmp_path / "cal.json")
    assert result.exit_code == 0, result.output
    assert "time\tfemur_r_imu\ttibia_r_imu" in out.read_text("utf-8")
    imufast.JointCalibration.load(tmp_path / "cal.json")


def test_a_joint_that_is_no_hinge_has_no_angle(tmp_path: Path) -> None:
    ball = save(tmp_path / "ball.npz", imufast.simulate_hinge("mixed", duration_s=30, rate_hz=50, dof=3))
    out, by_hand = tmp_path / "k.mot", tmp_path / "hand.json"
    imufast.JointCalibration().save(by_hand)
    for more, code, verdict in (((), 4, "ball joint"), (("--calibration", by_hand), 3, "made by hand")):
        result = run("track", ball, "--angles", "--out", out, "--report", tmp_path / "r.html", *more)
        assert result.exit_code == code, result.output
        assert "No joint angles: the calibration has no hinge axis" in result.stdout
        assert f"its verdict: {verdict}" in result.stdout
        assert not out.exists()
        assert (tmp_path / "r.html").exists()


def test_stillness_shows_no_angle_and_its_file_says_so(tmp_path: Path) -> None:
    path = save(tmp_path / "still.npz", imufast.simulate_hinge("stationary", duration_s=20, rate_hz=50))
    result = run("track", path, "--angles", "--out", tmp_path / "k.mot")
    assert result.exit_code == 3, result.output
    assert "hence no angle" in result.stdout
    assert "status: NOT_OBSERVABLE" in (tmp_path / "k.mot").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--zero", "0:2"), "--zero: this asks for joint angles; add --angles"),
        (("--flexion", "axis", "--side", "left"), "--flexion, --side: these ask for joint angles"),
        (("--out", "k.mot"), "a .mot file holds joint angles; add --angles"),
        (("--angles", "--out", "k.txt"), "must end in .mot, .sto, .csv or .parquet"),
        (("--angles", "--figure", "k.pdf"), "must end in .png or .svg"),
        (("--angles", "--names", "a"), "--names are for the columns of --out"),
        (("--angles", "--names", "a,b", "--out", "k.mot"), "--names must be 1 name"),
        (("--angles", "--side", "left"), "add --standing START:STOP"),
        (("--angles", "--standing", "0:2"), "three angles need --joint, --side, --flexion or --axis-towards too"),
        (("--angles", "--standing", "0:2", "--joint", "knee", "--signs", "consistent"), "need --flexion or --axis-towards too"),
        (
            ("--angles", "--standing", "0:2", "--joint", "hip", "--side", "left", "--flexion", "1:2", "--zero", "0:1"),
            "--zero is of the hinge angle alone",
        ),
        (("--angles", "--flexion", "up"), "--flexion must look like 0:2"),
        (("--angles", "--flexion", "axis"), "--flexion axis needs --calibration"),
        (("--angles", "--zero", "2:1"), "--zero must look like 0:2"),
        (("--angles", "--zero", "nan:nan"), "--zero must look like 0:2"),
        (("--angles", "--axis-towards", "1,2"), "--axis-towards must be three numbers"),
        (("--angles", "--axis-towards", "0,0,1", "--flexion", "1:2"), "both say which way is positive"),
        (("--angles", "--zero", "900:901"), "zero: there is no sample from 900 to 901 s"),
        (("--angles", "--figure", "a.png", "--out", "b.mot", "--report", "a.png"), "would replace what --report writes"),
    ],
)
def test_wrong_options_are_refused_by_name(
    tmp_path: Path, files: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("track", *files, *arguments)
    assert result.exit_code == 2, result.output
    assert said in result.stderr, result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())
