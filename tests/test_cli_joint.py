"""The command line on joint centres: what is printed, saved and refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast.cli.app import app
from test_cli import run, save


@pytest.fixture(scope="module")
def hinge() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=40, rate_hz=50, seed=2)


@pytest.fixture(scope="module")
def ball() -> imufast.BallJointSimulation:
    return imufast.simulate_ball_joint("random", duration_s=40, rate_hz=50, seed=1)


def save_ball(path: Path, s: imufast.BallJointSimulation) -> Path:
    np.savez(path, gyr1=s.gyr1, acc1=s.acc1, gyr2=s.gyr2, acc2=s.acc2, rate_hz=50.0)
    return path


def centres(text: str) -> list[np.ndarray]:
    """The rows of the table of centres: x, y, z, distance and standard deviation, mm."""
    table = text[text.index("Joint centre of") :]
    number = r" +(-?\d+\.\d+)"
    return [np.array([float(x) for x in row]) for row in re.findall(r"sensor[12]" + 5 * number, table)]


def test_a_hinge_has_its_axis_and_its_centre_without_the_place_along_it(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    result = run("calibrate", save(tmp_path / "pair.npz", hinge))
    assert result.exit_code == 0, result.output
    assert "verdict: HINGE, accepted" in result.stdout
    assert "Axis of sensor1 and sensor2" in result.stdout
    assert "its place along the hinge axis; no motion of a hinge tells it" in result.stdout
    assert re.search(r"residual: 0\.0\d+ m/s² at the joint centre", result.stdout)
    rows = centres(result.stdout)
    assert len(rows) == 2
    for row, truth, axis in zip(
        rows, (hinge.joint_in_sensor1, hinge.joint_in_sensor2), (hinge.axis1, hinge.axis2), strict=True
    ):
        off = row[:3] - 1e3 * truth
        across = off - axis * (axis @ off)
        assert np.linalg.norm(across) < max(3.0, 4.0 * row[4])
        assert row[3] == pytest.approx(np.linalg.norm(row[:3]), abs=0.2)


def test_a_ball_joint_is_told_with_its_centre(tmp_path: Path, ball: imufast.BallJointSimulation) -> None:
    path = save_ball(tmp_path / "ball.npz", ball)
    result = run("calibrate", path)
    assert result.exit_code == 0, result.output
    assert "verdict: BALL_JOINT, accepted" in result.stdout
    assert "There is no hinge axis" in result.stdout
    assert "Axis of" not in result.stdout
    assert "not told by the motion" not in result.stdout
    for row, truth in zip(centres(result.stdout), (ball.joint_in_sensor1, ball.joint_in_sensor2), strict=True):
        assert np.linalg.norm(row[:3] - 1e3 * truth) < max(3.0, 4.0 * row[4])
    asked = run("calibrate", path, "--joint", "ball")
    assert asked.exit_code == 0
    assert "misfit" not in asked.stdout
    assert run("calibrate", path, "--joint", "hinge").exit_code == 4


def test_a_hinge_is_no_ball_joint(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    result = run("calibrate", save(tmp_path / "pair.npz", hinge), "--joint", "ball")
    assert result.exit_code == 3
    assert "the motion leaves 1 of 6 directions of the joint centre open" in result.stdout
    assert "as along the axis of a hinge" in result.stdout
    assert "If it is a hinge, calibrate it as one" in result.stdout


def test_stillness_has_no_centre(tmp_path: Path) -> None:
    path = save(tmp_path / "still.npz", imufast.simulate_hinge("stationary", duration_s=20, rate_hz=50))
    for joint in ("auto", "hinge", "ball"):
        result = run("calibrate", path, "--joint", joint)
        assert result.exit_code == 3
        assert "Joint centre of sensor1 and sensor2: not found" in result.stdout
        assert "it says next to nothing of it" in result.stdout


def test_save_writes_a_calibration_that_loads(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path, saved, numbers = save(tmp_path / "pair.npz", hinge), tmp_path / "cal.json", tmp_path / "out.json"
    result = run("calibrate", path, "--save", saved, "--json", numbers)
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-2:] == [f"calibration: {saved}", f"numbers: {numbers}"]
    loaded = imufast.JointCalibration.load(saved)
    twin = json.loads(numbers.read_text("utf-8"))
    assert (loaded.verdict.value, loaded.accepted) == (twin["verdict"], twin["accepted"]) == ("HINGE", True)
    assert loaded.axis is not None
    assert loaded.center is not None
    assert twin["axis1"] == loaded.axis.axis1.tolist()
    assert twin["center"]["in_sensor1_m"] == loaded.center.in_sensor1.tolist()
    assert twin["center"]["undetermined_words"] == ["its place along the hinge axis; no motion of a hinge tells it"]
    # Also where nothing is accepted: what it says is then just that.
    still = save(tmp_path / "still.npz", imufast.simulate_hinge("stationary", duration_s=20, rate_hz=50))
    assert run("calibrate", still, "--save", saved).exit_code == 3
    assert not imufast.JointCalibration.load(saved).accepted


def test_saving_over_inputs_and_outputs_is_refused(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path = save(tmp_path / "pair.npz", hinge)
    before = path.read_bytes()
    for arguments, said in (
        (["--save", path], "would replace the recording"),
        (["--save", tmp_path / "same", "--json", tmp_path / "same"], "--save '"),
        (["--save", tmp_path], "is a folder"),
        (["--save", tmp_path / "none" / "cal.json"], "there is no folder"),
    ):
        result = run("calibrate", path, *arguments)
        assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1)
        assert said in result.stderr
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["pair.npz"]


def test_settings_of_the_axis_are_not_taken_and_ignored(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path = save(tmp_path / "pair.npz", hinge)
    for option in ("--lowpass", "--max-error", "--n-consistent"):
        result = run("calibrate", path, "--joint", "ball", option, 3)
        assert result.exit_code == 2
        assert "--joint ball leaves out" in result.stderr
    assert run("calibrate", path, "--joint", "knee").exit_code == 2


def test_demo_shows_axis_and_centre_beside_the_truth(tmp_path: Path) -> None:
    result = run("demo", "--report", tmp_path / "demo.html")
    assert result.exit_code == 0, result.output
    beside = result.stdout[result.stdout.index("Beside the truth") :]
    rows = [(float(off), float(std)) for off, std in re.findall(r"(\d+\.\d+) mm +(\d+\.\d+) mm", beside)]
    assert len(rows) == 2
    assert all(off < max(1.0, 3.0 * std) and std < 3.0 for off, std in rows)
    assert "moved along the axis" in beside
    assert "The joint centre as either sensor sees it" in (tmp_path / "demo.html").read_text("utf-8")


def test_help_names_the_new_options() -> None:
    text = run("calibrate", "--help").stdout
    assert "[auto|hinge|ball]" in text
    assert "--save CAL.json" in text
    assert "calibrate" in app.commands
