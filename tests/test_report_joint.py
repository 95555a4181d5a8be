"""The report of joint calibrations and joint centres: every kind has its page and twin, in words that hold."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast.report import joint_words, report_json, write_report
from imufast.report.center_figure import center_picture, residual_picture
from imufast.report.joint_words import ALONG_AXIS, undetermined_words
from test_report import Page, Pair, simulated, written

S = np.sqrt(0.5)


@pytest.fixture(scope="module")
def hinge_pair() -> Pair:
    return simulated()


@pytest.fixture(scope="module")
def ball_pair() -> Pair:
    s = imufast.simulate_ball_joint("random", duration_s=40, rate_hz=50, seed=1)
    return s.imu1, s.imu2


@pytest.fixture(scope="module")
def hinge(hinge_pair: Pair) -> imufast.JointCalibration:
    return imufast.calibrate_joint(*hinge_pair)


@pytest.fixture(scope="module")
def ball(ball_pair: Pair) -> imufast.JointCalibration:
    return imufast.calibrate_joint(*ball_pair)


def by_hand() -> imufast.JointCalibration:
    axis = imufast.JointAxis(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.6, 0.8]))
    center = imufast.JointCenter(np.array([0.2, 0.01, 0.0]), np.array([-0.15, 0.0, 0.02]))
    return imufast.JointCalibration(axis=axis, center=center)


@pytest.fixture(scope="module")
def results(
    hinge: imufast.JointCalibration,
    ball: imufast.JointCalibration,
    hinge_pair: Pair,
    ball_pair: Pair,
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[str, tuple[Any, Pair | None]]:
    still, path = simulated("stationary", duration_s=20), tmp_path_factory.mktemp("saved") / "cal.json"
    hinge.save(path)
    published = imufast.CenterSettings.as_published()
    rates = ball_pair[0].gyr, np.gradient(ball_pair[0].gyr, 0.02, axis=0), ball_pair[0].acc
    rates2 = ball_pair[1].gyr, np.gradient(ball_pair[1].gyr, 0.02, axis=0), ball_pair[1].acc
    assert hinge.center is not None
    return {
        "hinge": (hinge, hinge_pair),
        "hinge without recording": (hinge, None),
        "ball": (ball, ball_pair),
        "ball asked of a hinge": (imufast.calibrate_joint(*hinge_pair, "ball"), hinge_pair),
        "hinge asked of a ball": (imufast.calibrate_joint(*ball_pair, "hinge"), ball_pair),
        "still": (imufast.calibrate_joint(*still), still),
        "ball asked of stillness": (imufast.calibrate_joint(*still, "ball"), still),
        "loaded": (imufast.JointCalibration.load(path), None),
        "by hand": (by_hand(), None),
        "by hand, with recording": (by_hand(), hinge_pair),
        "by hand, nothing": (imufast.JointCalibration(), None),
        "by hand, biases": (imufast.JointCalibration(acc_bias1=np.array([0.1, 0.0, 0.0])), None),
        "by hand, accepted": (replace(by_hand(), verdict=imufast.Verdict.HINGE, accepted=True), None),
        "by hand, centre in the sensor": (
            imufast.JointCalibration(center=imufast.JointCenter(np.zeros(3), np.zeros(3))),
            None,
        ),
        "by hand, not finite": (
            imufast.JointCalibration(center=imufast.JointCenter(np.ones(3), np.ones(3), np.full((6, 6), 1e9))),
            None,
        ),
        "moved": (
            replace(hinge, hinge=replace(hinge.hinge, mounting_changed_at_s=(9.0,))),  # type: ignore[type-var]
            hinge_pair,
        ),
        "centre": (imufast.estimate_joint_center(*ball_pair), ball_pair),
        "centre of a hinge": (imufast.estimate_joint_center(*hinge_pair), None),
        "centre as published": (imufast.estimate_joint_center(*ball_pair, method="ss", settings=published), None),
        "centre from moments": (imufast.fit_joint_center(*rates, *rates2), None),
        "centre of stillness": (imufast.estimate_joint_center(*still), still),
    }


@pytest.mark.parametrize("kind", range(21))
def test_every_result_has_a_sound_page_and_twin(results: dict[str, Any], kind: int, tmp_path: Path) -> None:
    result, pair = list(results.values())[kind]
    plain = report_json(result, recording=pair)
    text = written(tmp_path, result, recording=pair)
    page = Page(text)
    assert not page.open
    for said in (plain["headline"], plain["acceptance"], plain["advice"]):
        assert said in page.text
    assert len(text) < 450_000
    assert "e+0" not in page.text
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(page.tags)
    assert "http" not in text.replace("http-equiv", "")
    references = [value for name, value in page.attributes if name in ("href", "xlink:href", "src")]
    assert all(value.startswith("#") for value in references)
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    assert {value[1:] for value in references} | set(re.findall(r"url\(#([^)]+)\)", text)) <= set(ids)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert (plain["schema"], plain["schema_version"]) == ("imufast.joint-report", 1)
    # The same names whatever the kind, those of the hinge's own report.
    hinge_report = report_json(imufast.HingeCalibrator(50.0).result())
    assert plain.keys() == hinge_report.keys()
    assert (hinge_report["schema"], hinge_report["center"]) == ("imufast.hinge-report", None)


def test_the_page_of_a_hinge_has_axis_and_centre(hinge: imufast.JointCalibration, hinge_pair: Pair, tmp_path: Path) -> None:
    page = Page(written(tmp_path, hinge, recording=hinge_pair))
    assert hinge.center is not None
    distance = 1e3 * float(np.linalg.norm(hinge.center.in_sensor1))
    for said in (
        "The axis in either sensor's frame",
        "The joint centre as either sensor sees it",
        f"{distance:.0f} mm away",
        ALONG_AXIS,
        "Accelerometer bias: x ",
        "The box is a symbol of 47 × 30 × 13 mm",
        "the size of a common sensor, not the shape of these",
        "% of what is left without lever arms",
        "The centre is a functional one",
        "can lie centimetres from the centre of the bones",
        "Settings of the joint centre",
    ):
        assert said in page.text, said
    # Two axes, two centres, residuals, timeline.
    assert page.tags.count("svg") == 6


def test_the_page_of_a_ball_joint_has_no_axis(ball: imufast.JointCalibration, ball_pair: Pair, tmp_path: Path) -> None:
    page = Page(written(tmp_path, ball, recording=ball_pair))
    assert "Accepted · ball joint" in page.text
    assert "The joint is no hinge but turns about one point" in page.text
    assert "The axis in either sensor's frame" not in page.text
    assert "What the motion does not tell" not in page.text
    assert "What tells a hinge" in page.text
    assert page.tags.count("svg") == 4
    plain = report_json(ball, recording=ball_pair)
    assert (plain["axis1"], plain["verdict"], plain["excitation"]["about_axis"]) == (None, "BALL_JOINT", False)


def test_the_twin_has_the_numbers_of_the_centre(hinge: imufast.JointCalibration, hinge_pair: Pair) -> None:
    plain, estimate = report_json(hinge, recording=hinge_pair), hinge.estimate
    assert estimate is not None
    assert hinge.center is not None
    center = plain["center"]
    assert center["in_sensor2_m"] == hinge.center.in_sensor2.tolist()
    assert center["covariance_m2"] == hinge.center.covariance.tolist()
    assert center["determined_std_m"] == hinge.center.determined_std.tolist()
    assert center["undetermined"] == hinge.center.undetermined.tolist()
    assert (center["status"], center["method"]) == ("PARTLY_DETERMINED", "sa")
    assert center["residual_std_m_s2"] == estimate.residual_std
    assert center["residuals"]["residual_m_s2"] == estimate.residuals.tolist()
    assert center["residuals"]["time_s"] == estimate.residual_time_s.tolist()
    assert center["settings"]["lowpass_hz"] == 2.25
    assert plain["acc_bias1_m_s2"] == hinge.acc_bias1.tolist()
    assert plain["noise"]["link_std"] == estimate.residual_std
    few = report_json(hinge, max_points=100)["center"]["residuals"]
    assert (few["count"], len(few["time_s"])) == (len(estimate.residuals), 100)


def test_calibrations_without_evidence_say_so(results: dict[str, Any], tmp_path: Path) -> None:
    loaded, hand = results["loaded"][0], results["by hand"][0]
    page = Page(written(tmp_path, loaded))
    assert "Accepted · hinge" in page.text
    assert "The evidence is not at hand" in page.text
    assert "Over the recording" in page.text
    assert ALONG_AXIS in page.text
    page = Page(written(tmp_path, hand))
    assert "Not accepted · made by hand" in page.text
    assert "A calibration made by hand" in page.text
    assert page.text.count("as given, without a bound") == 2
    assert page.text.count("as given, without uncertainty") == 2
    assert "none given" in page.text
    assert "+0.100" in Page(written(tmp_path, results["by hand, biases"][0])).text


def test_a_centre_alone_is_told_by_its_status(results: dict[str, Any], tmp_path: Path) -> None:
    page = Page(written(tmp_path, results["centre"][0]))
    assert "Joint centre alone · determined" in page.text
    assert "The joint centre is known." in page.text
    plain = report_json(results["centre"][0])
    assert (plain["verdict"], plain["accepted"], plain["title"]) == (None, None, "Joint centre")
    still = report_json(results["centre of stillness"][0])
    assert still["headline"] == "The motion does not tell where the joint centre is"


def test_words_for_what_is_open() -> None:
    names = "thigh", "shank"
    axis = imufast.JointAxis(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.6, 0.8]))
    along = np.array([[0.0, S, 0.0, 0.0, 0.6 * S, 0.8 * S]])
    assert undetermined_words(along, axis, names) == undetermined_words(-along, axis, names) == [ALONG_AXIS]
    assert undetermined_words(along, None, names) == [
        "both centres together, thigh along y while shank along (0, 0.6, 0.8), as along the axis of a hinge"
    ]
    mostly = np.array([[0.95, -np.sqrt(1 - 0.95**2), 0.0, 0.0, 0.0, 0.0]])
    assert undetermined_words(mostly, axis, names) == ["thigh, mostly along x"]
    assert undetermined_words(np.eye(6)[[5, 0]], None, names) == ["shank, along z", "thigh, along x"]
    assert undetermined_words(np.eye(6)[[0, 1, 2]], None, names) == ["the whole centre as seen from thigh"]
    assert undetermined_words(np.eye(6)[[0, 1, 2, 4]], None, names) == [
        "the whole centre as seen from thigh",
        "1 further of the 6 directions of both centres",
    ]
    assert undetermined_words(np.eye(6)[[0, 1, 4]], None, names) == ["3 of the 6 directions of both centres"]
    assert undetermined_words(np.zeros((0, 6)), None, names) == []


def test_names_in_words_are_escaped(ball_pair: Pair, hinge_pair: Pair, tmp_path: Path) -> None:
    evil = "<b onclick=x>&'"
    imus = [imufast.Imu(imu.gyr, imu.acc, rate_hz=50, name=f"{evil}{i}") for i, imu in enumerate(hinge_pair)]
    result = imufast.calibrate_joint(imus[0], imus[1], "ball")
    text = written(tmp_path, result, recording=imus)
    assert "<b" not in text.replace("<body", "")
    assert f"both centres together, {evil}0 " in Page(text).text


def test_both_pictures_have_one_scale_and_residuals_are_drawn(ball: imufast.JointCalibration) -> None:
    plain = report_json(ball)
    first, second = center_picture(plain, 1), center_picture(plain, 2)
    assert first is not None
    assert second is not None
    # The side of the housing that is seen head-on is as long in both.
    widths = [_box_width(picture) for picture in (first, second)]
    assert widths[0] == pytest.approx(widths[1], abs=0.02)
    assert residual_picture(plain) is not None
    plain["center"] = None
    assert center_picture(plain, 1) is None
    assert residual_picture(plain) is None


def _box_width(picture: str) -> float:
    """Of the first face of the housing, points."""
    match = re.search(r'<path d="(M[^"]+z)\s*"[^>]*fill: #eeeeee', picture)
    assert match
    x = [float(value) for value in re.findall(r"[ML] (-?[\d.]+) ", match[1])]
    return max(x) - min(x)


def test_mounting_is_told_with_the_centre(results: dict[str, Any]) -> None:
    said = joint_words.mounting(results["moved"][0])
    assert said.startswith("The mounting of a sensor was seen to have changed at")
    assert said.endswith("The joint centre is that of the time since.")


def test_other_things_are_refused(tmp_path: Path) -> None:
    for wrong in (None, 7, imufast.JointCenter(np.zeros(3), np.zeros(3))):
        with pytest.raises(imufast.InputError, match="result must be a JointCalibration"):
            write_report(wrong, tmp_path / "x.html")  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
