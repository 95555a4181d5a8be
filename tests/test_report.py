"""The report: self-contained, escaped, whole or not at all, small, and the same numbers as its JSON twin."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast.report import report_json, words, write_json, write_report
from imufast.report.hinge_content import MOST_EVENTS
from imufast.report.joint_words import Result
from imufast.report.thin import thin_steps

Pair = tuple[imufast.Imu, imufast.Imu]


class Page(HTMLParser):
    """Tags, attributes and text of a page, and whether every tag is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open[-1:] != ["style"]:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


def simulated(motion: str = "mixed", **options: Any) -> Pair:
    s = imufast.simulate_hinge(motion, **{"duration_s": 40, "rate_hz": 50, "seed": 1} | options)
    return s.imu1, s.imu2


@pytest.fixture(scope="module")
def pair() -> Pair:
    return simulated()


@pytest.fixture(scope="module")
def result(pair: Pair) -> imufast.HingeCalibration:
    return imufast.calibrate_hinge(*pair)


@pytest.fixture(scope="module")
def results(pair: Pair, result: imufast.HingeCalibration) -> dict[str, tuple[imufast.HingeCalibration, Pair | None]]:
    still, loose = simulated("stationary"), simulated("free", dof=2)
    worn = simulated("walking", soft_tissue=imufast.SoftTissue())
    return {
        "hinge": (result, pair),
        "without recording": (result, None),
        "approximate": (imufast.calibrate_hinge(*worn), worn),
        "not a hinge": (imufast.calibrate_hinge(*loose), loose),
        "still": (imufast.calibrate_hinge(*still), still),
        "short": (imufast.calibrate_hinge(pair[0][:20], pair[1][:20]), (pair[0][:20], pair[1][:20])),
        "nothing": (imufast.HingeCalibrator(50.0).result(), None),
        "published": (imufast.calibrate_hinge(*pair, settings=imufast.HingeSettings.as_published()), pair),
        "changed": (
            replace(result, accepted=False, verdict=imufast.Verdict.MOUNTING_CHANGED, mounting_changed_at_s=(9.0,)),
            pair,
        ),
        "changed, accepted anew": (replace(result, mounting_changed_at_s=(4.0, 9.0)), pair),
        "in doubt": (replace(result, verdict=imufast.Verdict.NOT_ENOUGH_INFORMATION, why=("why not",)), None),
    }


def written(folder: Path, result: Result, **options: Any) -> str:
    write_report(result, folder / "report.html", **options)
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", range(11))
def test_every_result_has_a_sound_page_and_twin(results: dict[str, Any], kind: int, tmp_path: Path) -> None:
    result, pair = list(results.values())[kind]
    plain = report_json(result, recording=pair)
    text = written(tmp_path, result, recording=pair)
    page = Page(text)
    assert not page.open
    assert plain["headline"] in page.text
    assert plain["acceptance"] in page.text
    assert ("Accepted ·" in page.text) == result.accepted
    assert len(text) < 400_000
    # Nothing is fetched, nothing runs, and no id stands for two things.
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(page.tags)
    assert "http" not in text.replace("http-equiv", "")
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    references = [value for name, value in page.attributes if name in ("href", "xlink:href", "src")]
    assert all(value.startswith("#") for value in references)
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    used = {value[1:] for value in references} | set(re.findall(r"url\(#([^)]+)\)", text))
    assert used <= set(ids)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain


def test_the_page_says_what_was_found(result: imufast.HingeCalibration, pair: Pair, tmp_path: Path) -> None:
    assert result.accepted_at_s is not None
    assert result.bound95_deg is not None
    page = Page(written(tmp_path, result, recording=pair, title="Knee of patient 7", warnings=["the left strap was loose"]))
    for said in (
        "Knee of patient 7",
        "the left strap was loose",
        f"Accepted since {result.accepted_at_s:g} s after the start",
        f"± {result.bound95_deg[0]:.2g}°",
        "not cover its distance from an anatomical axis",
        "max_error_approximate_deg 12",
        "sensor1 and sensor2 · 40 s at 50 Hz, 2000 samples",
    ):
        assert said in page.text
    assert page.tags.count("svg") == 3


def test_the_same_result_gives_the_same_bytes(result: imufast.HingeCalibration, pair: Pair, tmp_path: Path) -> None:
    assert written(tmp_path, result, recording=pair) == written(tmp_path, result, recording=pair)


def test_text_from_files_is_escaped(result: imufast.HingeCalibration, pair: Pair, tmp_path: Path) -> None:
    evil = "<script>alert('x')</script>&\"'>"
    imus = tuple(imufast.Imu(imu.gyr, imu.acc, rate_hz=50, name=f"{evil}{i}") for i, imu in enumerate(pair))
    why = replace(
        result, accepted=False, why=(evil,), history=(*result.history, replace(result.history[-1], accepted=False, why=(evil,)))
    )
    text = written(tmp_path, why, recording=imus, title=evil + "$x_1$", warnings=[evil, "\udcff not UTF-8"])
    page = Page(text)
    assert "<script" not in text
    assert page.text.count(evil) >= 7


def test_the_twin_has_the_numbers(result: imufast.HingeCalibration, pair: Pair, tmp_path: Path) -> None:
    write_json(result, tmp_path / "out.json", recording=pair, title="T", warnings=["w"])
    plain = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert (plain["schema"], plain["schema_version"], plain["verdict"]) == ("imufast.hinge-report", 1, "HINGE")
    assert plain["axis1"] == result.axis1.tolist()  # type: ignore[union-attr]
    assert plain["bound95_deg"] == result.bound95_deg.tolist()  # type: ignore[union-attr]
    assert plain["accepted_at_s"] == result.accepted_at_s
    assert plain["warnings"] == ["w"]
    assert plain["settings"]["max_error_deg"] == 3.0
    history = plain["history"]
    assert history["steps"] == history["kept"] == len(result.history) == len(history["time_s"])
    assert history["misfit"] == [step.misfit for step in result.history]
    assert history["change_deg"] == [step.change_deg for step in result.history]
    assert [event["time_s"] for event in plain["events"] if event["text"] == "hinge, accepted"] == [result.accepted_at_s]
    assert plain["gyr_samples"]["count"] == len(result.gyr_time_s)
    assert all(check["met"] for check in plain["checks"])


def test_what_is_not_finite_is_null(result: imufast.HingeCalibration, tmp_path: Path) -> None:
    nan = np.full(2, math.nan)
    steps = (*result.history, replace(result.history[-1], bound95_deg=nan, misfit=math.inf, change_deg=math.nan))
    broken = replace(
        result, bound95_deg=nan, misfit=math.nan, history=steps, settings=imufast.HingeSettings(rate_scale=math.inf)
    )
    plain = report_json(broken)
    assert plain["bound95_deg"] == [None, None]
    assert plain["history"]["misfit"][-1] is None
    assert plain["settings"]["rate_scale"] is None
    text = Page(written(tmp_path, broken)).text
    assert "unknown bound" in text
    assert "rate_scale no limit" in text


def test_published_acceptance_is_told_by_its_own_numbers(results: dict[str, Any]) -> None:
    result = results["published"][0]
    plain = report_json(result)
    assert "μ + 2σ" in plain["checks"][2]["name"]
    assert plain["checks"][1]["met"] is None
    assert plain["checks"][2]["value"] == pytest.approx(max(result.history[-1].published_bound_deg))


def long_history(result: imufast.HingeCalibration, count: int) -> Iterator[imufast.HingeStep]:
    last, rng = result.history[-1], np.random.default_rng(0)
    for i, (bound, change, misfit) in enumerate(rng.uniform(0.5, 1.0, (count, 3)).tolist()):
        yield replace(
            last,
            time_s=6.0 * (i + 1),
            moving_s=1.8 * i,
            bound95_deg=np.array([bound, 0.4]) if i != 12_345 else np.array([7.0, 0.4]),
            change_deg=change,
            misfit=0.02 * misfit,
            accepted=i > 1000 and i % 5000 > 2,
        )


def test_a_week_fits_into_three_megabytes(result: imufast.HingeCalibration, tmp_path: Path) -> None:
    week = replace(result, history=tuple(long_history(result, 7 * 14_400)), gyr_time_s=np.arange(50_000.0))
    assert len(written(tmp_path, week)) < 1_500_000
    plain = report_json(week)
    assert plain["history"]["steps"] == 100_800
    assert plain["history"]["kept"] <= 2000
    assert max(plain["history"]["bound95_1_deg"]) == 7.0
    assert plain["gyr_samples"]["count"] == 50_000
    assert len(plain["gyr_samples"]["time_s"]) == 2000
    assert len(plain["events"]) <= MOST_EVENTS + 1
    assert len(report_json(week, max_points=None)["history"]["time_s"]) == 100_800


def test_thinning_keeps_order_ends_and_turns(result: imufast.HingeCalibration) -> None:
    steps = list(long_history(result, 20_000))
    few = thin_steps(steps, 500)
    assert len(few) <= 500
    times = [step.time_s for step in few]
    assert times == sorted(set(times))
    assert (few[0], few[-1]) == (steps[0], steps[-1])
    turns = {steps[i].time_s for i in range(1, len(steps)) if steps[i].accepted != steps[i - 1].accepted}
    assert turns <= set(times)
    assert thin_steps(steps[:500], 500) == steps[:500]


def test_excitation_is_the_rate_of_the_joint(pair: Pair, result: imufast.HingeCalibration) -> None:
    simulation = imufast.simulate_hinge("mixed", duration_s=40, rate_hz=50, seed=1)
    plain = report_json(result, recording=simulation.recording)
    curve = plain["excitation"]
    assert curve["about_axis"]
    true_rms = math.sqrt(float(np.mean(simulation.angle_rate**2)))
    assert math.sqrt(np.mean(np.square(curve["rms_rad_s"]))) == pytest.approx(true_rms, rel=0.02)
    assert max(curve["peak_rad_s"]) == pytest.approx(float(np.abs(simulation.angle_rate).max()), rel=0.02)
    with_gap = [imufast.Imu(i.gyr, i.acc, time_s=i.time_s + 20.0 * (i.time_s > 20.0)) for i in pair]
    assert None in report_json(result, recording=with_gap)["excitation"]["rms_rad_s"]


def test_times_of_a_clock_are_told_from_the_start(pair: Pair) -> None:
    late = tuple(imufast.Imu(imu.gyr, imu.acc, time_s=imu.time_s + 1.6e9, name=imu.name) for imu in pair)
    usual, clock = imufast.calibrate_hinge(*pair), imufast.calibrate_hinge(*late)
    assert report_json(clock, recording=late)["acceptance"] == report_json(usual, recording=pair)["acceptance"]
    assert report_json(clock)["start_s"] == pytest.approx(1.6e9, abs=2.0)


@pytest.mark.parametrize(
    ("options", "words_"),
    [
        ({"recording": "x"}, "recording"),
        ({"recording": [1, 2]}, "imu1"),
        ({"title": 7}, "title"),
        ({"warnings": "one text"}, "warnings"),
    ],
)
def test_wrong_arguments_are_named(
    result: imufast.HingeCalibration, tmp_path: Path, options: dict[str, Any], words_: str
) -> None:
    with pytest.raises(imufast.InputError, match=words_):
        write_report(result, tmp_path / "x.html", **options)
    with pytest.raises(imufast.InputError, match="max_points"):
        report_json(result, max_points=3)
    assert not list(tmp_path.iterdir())


def test_files_are_whole_or_not_there(
    result: imufast.HingeCalibration, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path, said in ((tmp_path / "no" / "x.json", "no folder"), (tmp_path, "folder"), (7, "path"), ("a\0b", "path")):
        with pytest.raises(imufast.InputError, match=said):
            write_json(result, path)  # type: ignore[arg-type]
    target = tmp_path / "x.json"
    target.write_text("before", encoding="utf-8")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("os.fsync", full)
        with pytest.raises(imufast.InputError, match="No space left"):
            write_json(result, target)
    assert target.read_text(encoding="utf-8") == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["x.json"]
    link = tmp_path / "link.json"
    link.symlink_to(target)
    write_json(result, link)
    assert link.is_symlink()
    assert json.loads(target.read_text(encoding="utf-8"))["verdict"] == "HINGE"


def test_durations_are_for_people() -> None:
    said = {
        0.04: "0 s",
        12.0: "12 s",
        15.5: "15.5 s",
        119.96: "120 s",
        200.0: "3 min 20 s",
        7199.6: "120 min",
        7500.0: "2 h 5 min",
    }
    assert {seconds: words.duration(seconds) for seconds in said} == said
    assert words.duration(604_800.0) == "7 d"
    assert words.duration(-3.0) == "−3 s"
    assert words.duration(math.nan) == "–"


@pytest.mark.parametrize("missing", ["matplotlib", "jinja2"])
def test_missing_extra_is_named(missing: str, tmp_path: Path) -> None:
    script = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "import imufast\n"
        "from imufast.report import write_json, write_report\n"
        "result = imufast.HingeCalibrator(50.0).result()\n"
        "write_json(result, 'x.json')\n"
        "try: write_report(result, 'x.html')\n"
        "except imufast.ImufastError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout == f"a report needs {missing}: pip install 'imufast[report]'\n"
    assert [path.name for path in tmp_path.iterdir()] == ["x.json"]


def test_importing_reports_needs_neither_matplotlib_nor_jinja2() -> None:
    script = "import sys, imufast, imufast.report; sys.exit(bool({'matplotlib', 'jinja2'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_drawing_leaves_no_state_behind(tmp_path: Path) -> None:
    script = (
        "import sys, imufast, matplotlib\n"
        "from imufast.report import write_report\n"
        "state = lambda: {name: matplotlib.rcParams[name] for name in matplotlib.rcParams if name != 'backend'}\n"
        "before = state()\n"
        "s = imufast.simulate_hinge('mixed', duration_s=20, rate_hz=50)\n"
        "write_report(imufast.calibrate_hinge(s.imu1, s.imu2), 'x.html')\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
        "assert state() == before\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, cwd=tmp_path)
