"""The documents: their Python runs, their links lead somewhere, and their numbers name the script that printed them."""

from __future__ import annotations

import re
from pathlib import Path

import imufast
import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
IDS = [path.name for path in DOCUMENTS]


def write_recordings(folder: Path) -> None:
    s = imufast.simulate_hinge("mixed", duration_s=40, rate_hz=100)
    for name, imu in (("thigh", s.imu1), ("shank", s.imu2)):
        header = "time_s,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z"
        rows = np.column_stack([imu.time_s, imu.gyr, imu.acc])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")


@pytest.mark.parametrize("path", DOCUMENTS, ids=IDS)
def test_python_in_documents_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_recordings(tmp_path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    text = path.read_text(encoding="utf-8")
    for block in re.finditer(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        line = text[: block.start()].count("\n") + 1
        exec(compile("\n" * line + block[1], str(path), "exec"), names)  # noqa: S102


@pytest.mark.parametrize(
    ("name", "count", "written"),
    [
        ("tutorial-knee.md", 2, {"knee.mot", "knee.png", "knee.html", "three.sto"}),
        ("lower-body.md", 2, {"body.mot", "body.html", "body.gif"}),
    ],
)
def test_the_commands_of_a_tutorial_run(
    name: str, count: int, written: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    app = pytest.importorskip("imufast.cli.app").app
    from click.testing import CliRunner

    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    first = re.search(r"^```python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert first is not None
    exec(compile(first[1], name, "exec"), {})  # noqa: S102
    commands = re.findall(r"^imufast (.+)$", text, re.MULTILINE)
    assert len(commands) == count
    for command in commands:
        done = CliRunner().invoke(app, command.split())
        assert done.exit_code == 0, done.output
    assert written <= {file.name for file in tmp_path.iterdir()}


def test_the_placement_in_the_document_means_something(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "lower-body.md").read_text(encoding="utf-8")
    block = re.search(r"^```toml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    assert block is not None
    (tmp_path / "placement.toml").write_text(block[1], encoding="utf-8")
    placement = imufast.body.read_placement(tmp_path / "placement.toml")
    assert [file.name for file in placement.files] == ["right.csv", "right.npz"]
    known = placement.anthropometry()
    assert known is not None
    assert (known.femur_m, known.tibia_m) == ((0.42, 0.015), (0.43, 0.01))


@pytest.mark.parametrize("path", DOCUMENTS, ids=IDS)
def test_links_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", path.read_text(encoding="utf-8")):
        assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", DOCUMENTS, ids=IDS)
def test_named_scripts_and_make_targets_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    for script in re.findall(r"`((?:benches|scripts|tests)/[\w/]+\.py)", text):
        assert (ROOT / script).is_file(), script
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in re.findall(r"`make ([\w-]+)`", text):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_the_commands_in_readme_exist() -> None:
    app = pytest.importorskip("imufast.cli.app").app
    blocks = re.findall(r"^```.*?^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    commands = set(re.findall(r"^imufast (\w+)", "\n".join(blocks), re.MULTILINE))
    assert commands
    assert commands <= set(app.commands)


@pytest.mark.parametrize("path", DOCUMENTS, ids=IDS)
def test_settings_in_the_documents_have_their_true_defaults(path: Path) -> None:
    # A table of settings belongs to the class that was named last before it.
    text = path.read_text(encoding="utf-8")
    kinds = "`(AxisSettings|HingeSettings|CenterSettings|Smoother|Mekf|Complementary)`"
    for table in re.finditer(r"^\| setting \| default \|.*\n(?:\|.*\n)+", text, re.MULTILINE):
        kind = re.findall(kinds, text[: table.start()])[-1]
        rows = re.findall(r"^\| `(\w+)` \| (.+?) \|", table[0], re.MULTILINE)
        assert rows
        for name, stated in rows:
            value = getattr(getattr(imufast, kind)(), name)
            words = "none" if value is None else {True: "yes", False: "no"}[value] if isinstance(value, bool) else None
            plain = words or (f'`"{value}"`' if isinstance(value, str) else f"{value:g}")
            assert stated == plain, f"{kind}.{name}"


@pytest.mark.parametrize("name", ["hinge-axis.md", "joint-centre.md", "tracking.md"])
def test_the_settings_of_the_estimators_are_documented(name: str) -> None:
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    assert re.search(r"^\| setting \| default \|", text, re.MULTILINE)


def test_verdicts_in_the_documents_are_all_and_have_their_limits() -> None:
    settings = imufast.HingeSettings()
    for document in (ROOT / "README.md", ROOT / "docs" / "calibration.md"):
        text = document.read_text(encoding="utf-8")
        rows = dict(re.findall(r"^\| `([A-Z_]+)` \| (.+?) \|", text, re.MULTILINE))
        assert set(rows) == {verdict.value for verdict in imufast.Verdict}
    limits = (settings.hinge_misfit, settings.approximate_misfit)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"| `HINGE` | up to {limits[0]:g} |" in readme
    assert f"| `APPROXIMATE_HINGE` | {limits[0]:g} to {limits[1]:g} |" in readme
    assert f"| `NOT_A_HINGE` | above {limits[1]:g} |" in readme
    assert f"below {settings.max_error_deg:g}° in ten estimates" in readme
    assert f"accepted below {settings.max_error_approximate_deg:g}°" in readme
    assert settings.n_consistent == 10


def test_numbers_of_the_readme_were_printed() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    measured = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (.+?) \| (.+?) \| (.+?) \| `(benches/[\w/]+\.py)` \|$", readme, re.MULTILINE)
    assert rows
    for what, ours, peers, script in rows:
        printed = measured.partition(f"Printed by `{script}`:")[2].partition("\nPrinted by `")[0]
        cells = set(re.findall(r"\| ([-+]?[\d.]+) (?=\|)", printed))
        for number in re.findall(r"\d[\d.]*", f"{ours} {peers}"):
            assert number in cells, f"{what}: {number} is not in what {script} printed"
