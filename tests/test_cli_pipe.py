"""A reader who goes away (`| head -1`) takes no file away: commands write before they print."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import imufast
import numpy as np
import pytest
from test_cli import run, save


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    sim = imufast.simulate_hinge("mixed", duration_s=30, rate_hz=50, seed=2)
    return save(tmp_path_factory.mktemp("pipe") / "pair.npz", sim)


def with_nobody_reading(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command, its stdout a pipe that is closed at the other end."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-c", "from imufast.cli import main; main()", *map(str, arguments)]
    try:
        return subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    finally:
        os.close(writer)


@pytest.mark.skipif(os.name != "posix", reason="closed pipes are told otherwise elsewhere")
def test_calibrate_writes_before_it_prints(tmp_path: Path, pair: Path) -> None:
    saved, numbers, page = tmp_path / "x.json", tmp_path / "n.json", tmp_path / "r.html"
    result = with_nobody_reading("calibrate", pair, "--save", saved, "--json", numbers, "--report", page)
    assert result.returncode != 0  # the pipe did break
    assert imufast.JointCalibration.load(saved).accepted
    assert json.loads(numbers.read_text("utf-8"))["verdict"] == "HINGE"
    assert page.read_text("utf-8").rstrip().endswith("</html>")
    assert "Traceback" not in result.stderr
    assert sorted(p.name for p in tmp_path.iterdir()) == ["n.json", "r.html", "x.json"]


@pytest.mark.skipif(os.name != "posix", reason="closed pipes are told otherwise elsewhere")
@pytest.mark.parametrize("angles", [False, True])
def test_track_writes_before_it_prints(tmp_path: Path, pair: Path, angles: bool) -> None:
    out, saved, numbers, page, figure = (tmp_path / name for name in ("q.csv", "x.json", "n.json", "r.html", "f.svg"))
    more = ("--angles", "--figure", figure) if angles else ()
    given = ("--out", out, "--save", saved, "--json", numbers, "--report", page, *more)
    result = with_nobody_reading("track", pair, *given)
    assert result.returncode != 0
    assert len(np.loadtxt(out, delimiter=",", skiprows=2)) == 1500
    assert imufast.JointCalibration.load(saved).center is not None
    assert json.loads(numbers.read_text("utf-8"))["status"] == "TRACKED"
    assert page.read_text("utf-8").rstrip().endswith("</html>")
    assert figure.exists() == angles
    assert "Traceback" not in result.stderr


@pytest.mark.skipif(os.name != "posix", reason="closed pipes are told otherwise elsewhere")
def test_demo_writes_before_it_prints(tmp_path: Path) -> None:
    page = tmp_path / "r.html"
    assert with_nobody_reading("demo", "--report", page).returncode != 0
    assert page.read_text("utf-8").rstrip().endswith("</html>")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_behind_stdout_is_one_line(tmp_path: Path, pair: Path) -> None:
    saved = tmp_path / "x.json"
    command = [sys.executable, "-c", "from imufast.cli import main; main()", "calibrate", str(pair), "--save", str(saved)]
    with Path("/dev/full").open("w") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1] == "imufast: stdout cannot be written: No space left on device"
    assert "Traceback" not in result.stderr
    assert imufast.JointCalibration.load(saved).accepted


def test_what_was_found_is_told_even_where_writing_fails(tmp_path: Path, pair: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise imufast.InputError("path cannot be written: No space left on device")

    monkeypatch.setattr("imufast.cli.outputs.write_json", full)
    saved = tmp_path / "x.json"
    result = run("calibrate", pair, "--save", saved, "--json", tmp_path / "n.json")
    assert result.exit_code == 2
    assert "verdict: HINGE, accepted" in result.stdout
    assert result.stdout.splitlines()[-1] == f"calibration: {saved}"
    assert "No space left on device" in result.stderr
