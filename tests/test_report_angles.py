"""Joint angles in the report and as a figure: sound pages, true numbers, the same bytes every time."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast import InputError, report_json, write_figure, write_json, write_report
from test_report import Page

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def hinge() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=40, rate_hz=50, seed=1)


@pytest.fixture(scope="module")
def rel(hinge: imufast.HingeSimulation) -> imufast.RelativeOrientation:
    return imufast.track(hinge.imu1, hinge.imu2, imufast.calibrate_joint(hinge.imu1, hinge.imu2))


@pytest.fixture(scope="module")
def angles(rel: imufast.RelativeOrientation) -> dict[str, imufast.JointAngles]:
    axis = rel.calibration.axis
    assert axis is not None
    frame1, frame2 = (
        imufast.segment_frame(
            "left", flexion_axis=axis, sensor=sensor, joint="knee", proximal=np.cross(vector, [0.2, 0.7, 0.4])
        )
        for sensor, vector in ((1, axis.axis1), (2, axis.axis2))
    )
    one = imufast.hinge_angle(rel, axis, flexion="axis")
    three = imufast.joint_angles(rel, frame1, frame2)
    lock = three.gimbal_lock.copy()
    lock[300:500] = True
    keep = np.ones(len(rel), dtype=bool)
    keep[700:900] = False
    gaps = replace(
        three,
        time_s=three.time_s[keep] + 1.7e9,
        angles_deg=three.angles_deg[keep],
        std_deg=three.std_deg[keep],
        gimbal_lock=lock[keep],
        status=imufast.AngleStatus.GIMBAL_LOCK,
        why=("near <b>90",),
    )
    return {"one": one, "three": three, "gaps": gaps}


@pytest.mark.parametrize("kind", ["one", "three"])
def test_the_page_shows_what_the_twin_holds(
    rel: imufast.RelativeOrientation, angles: dict[str, imufast.JointAngles], kind: str, tmp_path: Path
) -> None:
    found = angles[kind]
    plain = report_json(rel, angles=found, max_points=500)
    told = plain["angles"]
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    write_report(rel, tmp_path / "r.html", angles=found)
    text = (tmp_path / "r.html").read_text("utf-8")
    page = Page(text)
    assert not page.open
    for said in (told["headline"], told["band"], told["known"][1:], "soft tissue", *told["titles"], plain["title"]):
        assert said in page.text, said
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    references = [value for name, value in page.attributes if name in ("href", "xlink:href", "src")]
    assert {value[1:] for value in references} | set(re.findall(r"url\(#([^)]+)\)", text)) <= set(ids)
    assert len(text) < 600_000
    np.testing.assert_allclose(told["highest_deg"], found.angles_deg.max(axis=0))
    at = np.array(told["lowest_at_s"])
    for k in range(len(found.names)):
        assert found.angles_deg[np.searchsorted(found.time_s, at[k]), k] == told["lowest_deg"][k]
    # Thinned, extremes kept.
    assert told["kept"] < told["samples"] == len(rel)
    np.testing.assert_allclose(np.max(told["angles_deg"], axis=1), told["highest_deg"])
    whole = report_json(rel, angles=found, max_points=None)["angles"]
    np.testing.assert_array_equal(np.transpose(whole["angles_deg"]), found.angles_deg)
    np.testing.assert_array_equal(np.transpose(whole["std_deg"]), found.std_deg)


def test_without_angles_the_report_is_as_it_was(rel: imufast.RelativeOrientation) -> None:
    assert report_json(rel)["angles"] is None
    assert report_json(rel)["title"] == "Relative orientation"
    assert report_json(rel).keys() == report_json(rel, angles=None).keys()


def test_gaps_locks_and_clock_times(
    angles: dict[str, imufast.JointAngles], rel: imufast.RelativeOrientation, tmp_path: Path
) -> None:
    found = angles["gaps"]
    keep = np.ones(len(rel), dtype=bool)
    keep[700:900] = False
    shown = replace(rel, time_s=found.time_s, q_12=rel.q_12[keep], angle_std_deg=rel.angle_std_deg[keep], covariance=None)
    told = report_json(shown, angles=found)["angles"]
    assert told["gaps_s"]["count"] == 1
    assert told["gaps_s"]["total_s"] == pytest.approx(4.02, abs=1e-3)
    assert told["gimbal_lock_s"]["spans"][0] == pytest.approx([found.time_s[300], found.time_s[499]])
    write_report(shown, tmp_path / "r.html", angles=found)
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "Purple: gimbal lock" in text
    assert "<b>90" not in text
    write_figure(found, tmp_path / "k.svg", title="cost $5 & <b>")
    assert "<b>" not in (tmp_path / "k.svg").read_text("utf-8")


@pytest.mark.parametrize("name", ["k.png", "k.svg"])
def test_a_figure_is_a_picture_and_the_same_every_time(
    angles: dict[str, imufast.JointAngles], name: str, tmp_path: Path
) -> None:
    write_figure(angles["three"], tmp_path / name, title="Left knee")
    first = (tmp_path / name).read_bytes()
    assert first.startswith(b"\x89PNG") if name.endswith("png") else first.startswith(b"<?xml")
    assert 10_000 < len(first) < 3_000_000
    write_figure(angles["three"], tmp_path / name, title="Left knee")
    assert (tmp_path / name).read_bytes() == first
    write_figure(angles["one"], tmp_path / name)
    assert (tmp_path / name).read_bytes() != first


def test_wrong_arguments_are_refused(
    rel: imufast.RelativeOrientation, angles: dict[str, imufast.JointAngles], tmp_path: Path
) -> None:
    for call, said in (
        (lambda: write_figure(angles["one"], tmp_path / "k.pdf"), r"must end in \.png or \.svg"),
        (lambda: write_figure(rel, tmp_path / "k.png"), "angles must be JointAngles"),  # type: ignore[arg-type]
        (lambda: write_figure(angles["one"], tmp_path / "k.png", title=3), "title must be a text"),  # type: ignore[arg-type]
        (lambda: report_json(rel, angles=3), "angles must be JointAngles"),  # type: ignore[arg-type]
        (lambda: report_json(rel.calibration, angles=angles["one"]), "go with a RelativeOrientation"),
        (lambda: write_json(rel, tmp_path / "k.json", angles=angles["gaps"]), "angles are not of this relative orientation"),
    ):
        with pytest.raises(InputError, match=said):
            call()
    assert not list(tmp_path.iterdir())
