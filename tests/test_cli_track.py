"""The command `imufast track`: what is printed, written and refused."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import imufast
import numpy as np
import pytest
from test_cli import run, save, write_csv


@pytest.fixture(scope="module")
def hinge() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=30, rate_hz=50, seed=2)


def off_deg(q: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.asarray(np.degrees(2.0 * np.arccos(np.clip(np.abs((q * truth).sum(axis=1)), 0.0, 1.0))))


@pytest.mark.parametrize("method", ["auto", "mekf", "complementary"])
def test_two_files_become_orientations_near_the_truth(tmp_path: Path, hinge: imufast.HingeSimulation, method: str) -> None:
    files = write_csv(tmp_path / "thigh.csv", hinge.imu1), write_csv(tmp_path / "shank.csv", hinge.imu2)
    out = tmp_path / "q.csv"
    result = run("track", *files, "--method", method, "--out", out)
    assert result.exit_code == 0, result.output
    name = {"auto": "smoother"}.get(method, method)
    for said in (
        f"status: TRACKED, method {name}, shank as seen from thigh",
        "The relative orientation is known",
        "samples: 1500 in 30 s at 50 Hz; gaps: none",
        "calibration of this recording itself: hinge, accepted; joint centre",
        f"orientations: {out}",
    ):
        assert said in result.stdout, said
    assert re.search(r"Standard deviation: \d\.?\d*° in the median, at most \d\.?\d*° for 95 % of the time", result.stdout)
    assert ("No start is needed" if name == "smoother" else "The start was found after") in result.stdout
    rows = np.loadtxt(out, delimiter=",", skiprows=2)
    assert rows.shape == (1500, 6)
    assert np.median(off_deg(rows[:, 1:5], hinge.q_12)) < 2.0
    assert result.stderr == ""


def test_a_saved_calibration_is_used_and_told(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path, saved = save(tmp_path / "pair.npz", hinge), tmp_path / "cal.json"
    assert run("calibrate", path, "--save", saved).exit_code == 0
    out = tmp_path / "q.csv"
    result = run("track", path, "--calibration", saved, "--method", "mekf", "--out", out)
    assert result.exit_code == 0, result.output
    assert f"calibration from {saved}: hinge, accepted" in result.stdout
    expected = imufast.track(hinge.imu1, hinge.imu2, imufast.JointCalibration.load(saved), "mekf")
    np.testing.assert_allclose(np.loadtxt(out, delimiter=",", skiprows=2)[:, 1:5], expected.q_12, atol=1e-9)
    by_hand = tmp_path / "hand.json"
    imufast.JointCalibration().save(by_hand)
    told = run("track", path, "--calibration", by_hand)
    assert "made by hand" in told.stdout
    assert "not accepted" not in told.stdout


def test_stillness_is_not_observable(tmp_path: Path) -> None:
    path = save(tmp_path / "still.npz", imufast.simulate_hinge("stationary", duration_s=20, rate_hz=50))
    for method in ("smoother", "mekf"):
        out = tmp_path / f"{method}.csv"
        result = run("track", path, "--method", method, "--out", out)
        assert result.exit_code == 3, result.output
        assert "status: NOT_OBSERVABLE" in result.stdout
        assert "Do not use these orientations" in result.stdout
        assert "it was not accepted: the joint has moved for" in result.stdout
        assert "status NOT_OBSERVABLE" in out.read_text("utf-8").splitlines()[0]


def test_gaps_restarts_and_contradictions_are_told(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    keep = np.ones(1500, dtype=bool)
    keep[700:800] = False
    arrays = {name: getattr(hinge, name)[keep] for name in ("gyr1", "acc1", "gyr2", "acc2")}
    np.savez(tmp_path / "gaps.npz", time_s=np.arange(1500)[keep] / 50.0, **arrays)
    result = run("track", tmp_path / "gaps.npz", "--method", "mekf")
    assert result.exit_code == 0, result.output
    assert "the filter started anew once" in result.stdout
    assert "gaps: 1, 100 samples missing" in result.stdout
    assert "where no gap made it" not in result.stdout


def test_report_numbers_and_parquet_are_written(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path = save(tmp_path / "pair.npz", hinge)
    outputs = tmp_path / "q.parquet", tmp_path / "r.html", tmp_path / "r.json"
    result = run("track", path, "--out", outputs[0], "--report", outputs[1], "--json", outputs[2])
    assert result.exit_code == 0, result.output
    assert [line.split(": ")[0] for line in result.stdout.splitlines()[-3:]] == ["orientations", "numbers", "report"]
    assert all(output.stat().st_size > 1000 for output in outputs)
    assert json.loads(outputs[2].read_text("utf-8"))["schema"] == "imufast.orientation-report"


def test_wrong_input_is_refused_before_the_work(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path, cal = save(tmp_path / "pair.npz", hinge), tmp_path / "cal.csv"
    imufast.JointCalibration().save(cal)
    before = path.read_bytes(), cal.read_bytes()
    for arguments, said in (
        (["--out", path], "--out '"),
        (["--out", tmp_path / "q.txt"], "must end in .csv, .parquet or .sto"),
        (["--out", tmp_path / "q"], "must end in .csv, .parquet or .sto"),
        (["--calibration", cal, "--out", cal], "would replace the calibration"),
        (["--calibration", tmp_path / "none.json"], "cannot be read as a calibration"),
        (["--calibration", path], "cannot be read as a calibration"),
        (["--out", tmp_path / "a.csv", "--json", tmp_path / "a.csv"], "would replace"),
        (["--out", tmp_path], "is a folder"),
        (["--out", tmp_path / "none" / "q.csv"], "there is no folder"),
        (["--sensors", "sensor1", "hip"], "there is no 'hip'"),
    ):
        result = run("track", path, *arguments)
        assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1), result.output
        assert said in result.stderr, result.stderr
    assert run("track", path, "--method", "magic").exit_code == 2
    assert (path.read_bytes(), cal.read_bytes()) == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cal.csv", "pair.npz"]


def test_names_from_files_do_not_steer_the_terminal(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    evil = "a\x1b[31m[red]"
    arrays = {f"{name}.{kind}": getattr(hinge, f"{kind}{i}") for i, name in ((1, evil), (2, "b")) for kind in ("gyr", "acc")}
    np.savez(tmp_path / "evil.npz", rate_hz=50.0, **arrays)
    result = run("track", tmp_path / "evil.npz")
    assert result.exit_code == 0, result.output
    assert "\x1b" not in result.output
    assert "[red]" in result.stdout


def test_without_extras_it_still_tracks(tmp_path: Path, hinge: imufast.HingeSimulation) -> None:
    path = save(tmp_path / "pair.npz", hinge)
    script = (
        "import sys\nfor m in ('matplotlib', 'jinja2', 'pyarrow'): sys.modules[m] = None\nfrom imufast.cli import main; main()"
    )
    command = [sys.executable, "-c", script, "track", str(path)]

    def call(*more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*command, *more], check=False, capture_output=True, text=True, cwd=tmp_path)

    assert call("--out", "q.csv", "--json", "r.json").returncode == 0
    refused = call("--out", "q.parquet")
    assert (refused.returncode, refused.stderr) == (2, "error: a Parquet file needs pyarrow: pip install 'imufast[io]'\n")
    refused = call("--report", "r.html")
    assert refused.returncode == 2
    assert "imufast[report]" in refused.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["pair.npz", "q.csv", "r.json"]


def test_the_demo_ends_with_tracking_beside_the_truth(tmp_path: Path) -> None:
    result = run("demo", "--report", tmp_path / "demo.html")
    told = re.search(r"off by (\d\.\d+)° rms, (\d\.\d+)° at worst; stated (\d\.\d+)°", result.stdout)
    assert told, result.stdout
    off, worst, stated = (float(value) for value in told.groups())
    assert off < 2.0 * stated < 2.0
    assert off < worst < 2.0
