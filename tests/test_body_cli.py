"""`imufast body`: what is printed, written and refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from body_cases import found, simulated
from imufast.cli import body as command
from imufast.cli import show
from test_cli import run

SEGMENTS = ("pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left", "shank_left", "foot_left")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All sensors in one archive, a leg's in two files, and placements for either."""
    truth, where = simulated(), tmp_path_factory.mktemp("body")

    def save(name: str, segments: tuple[str, ...]) -> None:
        arrays = {f"{s}.{kind}": getattr(truth, kind)[s] for s in segments for kind in ("gyr", "acc")}
        np.savez(where / name, rate_hz=50.0, **arrays)

    save("all.npz", SEGMENTS)
    save("upper.npz", ("pelvis", "thigh_right"))
    save("lower.npz", ("shank_right",))
    (where / "all.toml").write_text("[placement]\n" + "".join(f'{s} = "{s}"\n' for s in SEGMENTS))
    lines = ("pelvis = 'pelvis'", "thigh_right = { file = 'upper.npz', sensor = 'thigh_right' }")
    (where / "leg.toml").write_text("\n".join(["[placement]", *lines, "shank_right = { file = 'lower.npz' }"]))
    return where


def test_a_body_from_one_archive_with_all_its_outputs(folder: Path, tmp_path: Path) -> None:
    names = ("b.mot", "b.json", "b.html", "b.gif")
    outputs = [tmp_path / name for name in names]
    options = zip(("--out", "--json", "--report", "--animate"), outputs, strict=True)
    result = run(
        *("body", folder / "all.npz", "--placement", folder / "all.toml", "--height", "1.75", "--span", "8:9"),
        *("--names", "knee_angle_r=-knee_angle_r,knee_angle_l=-knee_angle_l"),
        *(part for option in options for part in option),
    )
    assert result.exit_code == 0, result.output
    for said in ("Pelvis and legs are known", "status: CONVERGED", "right knee", "known", "left femur: ", "between the hips: "):
        assert said in result.stdout, said
    written = [line.split(": ")[0] for line in result.stdout.splitlines()[-4:]]
    assert written == ["angles", "numbers", "report", "animation"]
    plain = json.loads(outputs[1].read_text("utf-8"))
    assert plain["schema"] == "imufast.body-report"
    assert plain["own_measures"]
    assert plain["anthropometry"]["femur_m"][0] == pytest.approx(0.394 * 1.75 / 1.69)
    head, _, rows = outputs[0].read_text("utf-8").partition("endheader\n")
    assert "knee_angle_r is minus right knee flexion" in head
    assert len(rows.splitlines()) == 1 + len(found().time_s)


def test_the_placement_names_the_files(folder: Path, tmp_path: Path) -> None:
    result = run("body", "--placement", folder / "leg.toml", "--out", tmp_path / "leg.csv")
    assert result.exit_code in (0, 4), result.output
    assert "status: " in result.stdout
    assert "2 joints" in result.stdout
    assert "hip_flexion_r_deg" in (tmp_path / "leg.csv").read_text("utf-8")
    given = run("body", folder / "upper.npz", folder / "lower.npz", "--placement", folder / "leg.toml")
    assert given.exit_code == result.exit_code
    assert given.stdout in result.stdout


def test_a_subject_who_stands_still_gets_3_and_files_that_say_so(tmp_path: Path) -> None:
    import imufast

    still = imufast.simulate_lower_body("standing", seed=1, duration_s=12.0, rate_hz=50.0)
    arrays = {f"{s}.{kind}": getattr(still, kind)[s] for s in SEGMENTS for kind in ("gyr", "acc")}
    np.savez(tmp_path / "still.npz", rate_hz=50.0, **arrays)
    (tmp_path / "p.toml").write_text("[placement]\n" + "".join(f'{s} = "{s}"\n' for s in SEGMENTS))
    result = run("body", tmp_path / "still.npz", "--placement", tmp_path / "p.toml", "--out", tmp_path / "b.mot")
    assert result.exit_code == 3, result.output
    assert "open: " in result.stdout
    assert "undetermined: hip_right" in (tmp_path / "b.mot").read_text("utf-8")


def test_progress_is_told_and_a_stop_is_honoured(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from collections.abc import Callable, Iterator
    from contextlib import contextmanager

    from click.testing import CliRunner

    told: list[str] = []

    @contextmanager
    def working(doing: str, *, quick: bool = False) -> Iterator[Callable[[str], None]]:
        def tell(text: str) -> None:
            told.append(text)
            if "iteration 2" in text:
                raise KeyboardInterrupt

        yield tell

    monkeypatch.setattr(show, "working", working)
    arguments = ["body", folder / "all.npz", "--placement", folder / "all.toml", "--out", tmp_path / "b.mot"]
    from imufast.cli.app import app

    result = CliRunner().invoke(app, [str(part) for part in arguments])
    assert result.exit_code == 1
    assert "Aborted" in result.output
    assert "iteration 1, cost " in told[0]
    assert "promised fall" in told[0]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--placement", "none.toml"), "placement 'none.toml': there is no such file"),
        (("--placement", "all.npz"), "is no TOML"),
        (("--placement", "all.toml", "--height", "178"), "--height must be between 0.8 and 2.5, got 178"),
        (("--placement", "all.toml", "--out", "b.txt"), "--out 'b.txt' must end in .mot, .sto, .csv or .parquet"),
        (("--placement", "all.toml", "--animate", "b.avi"), "--animate 'b.avi' must end in .gif, .mp4 or .rrd"),
        (("--placement", "all.toml", "--report", "no/b.html"), "--report 'no/b.html' cannot be written"),
        (("--placement", "all.toml", "--out", "all.toml"), "--out 'all.toml' would replace the placement 'all.toml'"),
        (("--placement", "all.toml", "--json", "all.npz"), "--json 'all.npz' would replace the recording 'all.npz'"),
        (("--placement", "all.toml", "--names", "knee_angle_r=a"), "--names are for the columns of --out"),
        (("--placement", "all.toml", "--out", "b.mot", "--names", "knee"), "--names must look like knee_angle_r="),
        (("--placement", "all.toml", "--out", "b.mot", "--names", "knee=a"), "--names: there is no column 'knee'"),
        (("--placement", "all.toml", "--span", "0:2"), "--span is what --animate shows"),
        (("--placement", "all.toml", "--span", "2", "--animate", "b.gif"), "--span must look like 0:20"),
        (("--placement", "all.toml", "--span", "0:900", "--animate", "b.gif"), "--span must lie within the recording, 0:"),
        (
            ("--placement", "leg.toml"),
            "[placement] thigh_right is in file 'upper.npz', which was not read; read: all.npz",
        ),
        (
            ("--placement", "odd.toml"),
            "odd.toml: [placement] pelvis = 'lumbar' names no sensor; there are 'pelvis', 'thigh_right'",
        ),
        (("--placement", "twice.toml"), "placement uses sensor 'pelvis' for pelvis and thigh_right"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_the_work(
    arguments: tuple[str, ...], said: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    (folder / "odd.toml").write_text("[placement]\npelvis = 'lumbar'\nthigh_right = 'thigh_right'\n")
    (folder / "twice.toml").write_text("[placement]\npelvis = 'pelvis'\nthigh_right = 'pelvis'\n")
    before = sorted(folder.iterdir())
    result = run("body", "all.npz", *arguments)
    assert result.exit_code == 2, result.output
    assert said in result.stderr
    assert result.stdout == ""
    assert sorted(folder.iterdir()) == before


def test_no_files_at_all(folder: Path) -> None:
    result = run("body", "--placement", folder / "all.toml")
    assert result.exit_code == 2
    assert "no FILES: give the recording's, or name them in all.toml" in result.stderr
    assert "--placement" in run("body", folder / "all.npz").stderr
    assert command.body.name == "body"
