"""The report of relative orientations: sound pages, true numbers, nothing from a file taken as markup."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast.report import orientation_words, report_json, write_json, write_report
from imufast.report.link import heading_plain, joint_acc, residual_plain
from test_report import Page, Pair

Tracked = tuple[imufast.RelativeOrientation, Pair | None]


@pytest.fixture(scope="module")
def hinge() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=40, rate_hz=50, seed=1)


@pytest.fixture(scope="module")
def known(hinge: imufast.HingeSimulation) -> imufast.JointCalibration:
    return imufast.calibrate_joint(hinge.imu1, hinge.imu2)


@pytest.fixture(scope="module")
def results(hinge: imufast.HingeSimulation, known: imufast.JointCalibration) -> dict[str, Tracked]:
    pair = hinge.imu1, hinge.imu2
    still = imufast.simulate_hinge("stationary", duration_s=20, rate_hz=50)
    ball = imufast.simulate_ball_joint("random", duration_s=40, rate_hz=50, seed=1)
    keep = np.ones(2000, dtype=bool)
    keep[[600, 601, 1990]] = False
    keep[1000:1100] = False
    times = hinge.imu1.time_s[keep] + 1.7e9
    gaps = (
        imufast.Imu(hinge.gyr1[keep], hinge.acc1[keep], time_s=times),
        imufast.Imu(hinge.gyr2[keep], hinge.acc2[keep], time_s=times),
    )
    short = pair[0][:8], pair[1][:8]
    smoothed = imufast.track(*pair, known)
    return {
        "smoother": (smoothed, pair),
        "smoother without recording": (smoothed, None),
        "mekf": (imufast.track(*pair, known, "mekf"), pair),
        "complementary": (imufast.track(*pair, known, "complementary"), pair),
        "self-calibrating": (imufast.track(*pair), pair),
        "nothing known": (imufast.track(*pair, imufast.JointCalibration(), "mekf"), pair),
        "ball": (imufast.track(ball.imu1, ball.imu2, method="mekf"), (ball.imu1, ball.imu2)),
        "still": (imufast.track(still.imu1, still.imu2), (still.imu1, still.imu2)),
        "still, filter": (imufast.track(still.imu1, still.imu2, method="mekf"), (still.imu1, still.imu2)),
        "gaps": (imufast.track(*gaps, known, "mekf"), gaps),
        "short": (imufast.track(*short, known), short),
        "start known": (imufast.track(*pair, known, "mekf", start=hinge.q_12[0]), pair),
        "stalled": (replace(smoothed, status=imufast.TrackStatus.STALLED, why=("why <b>not</b>",)), pair),
        "overflow": (replace(smoothed, q_12=np.full((2000, 4), np.nan), status=imufast.TrackStatus.NUMERICAL_ERROR), pair),
    }


@pytest.mark.parametrize("kind", range(14))
def test_every_result_has_a_sound_page_and_twin(results: dict[str, Tracked], kind: int, tmp_path: Path) -> None:
    rel, pair = list(results.values())[kind]
    plain = report_json(rel, recording=pair)
    write_report(rel, tmp_path / "report.html", recording=pair)
    text = (tmp_path / "report.html").read_text("utf-8")
    page = Page(text)
    assert not page.open
    for said in ("headline", "certainty", "advice", "start", "calibration_words"):
        assert plain[said] in page.text
    assert len(text) < 400_000
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(page.tags)
    assert "http" not in text.replace("http-equiv", "")
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    references = [value for name, value in page.attributes if name in ("href", "xlink:href", "src")]
    assert all(value.startswith("#") for value in references)
    ids = [value for name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    assert {value[1:] for value in references} | set(re.findall(r"url\(#([^)]+)\)", text)) <= set(ids)
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    assert (plain["schema"], plain["schema_version"]) == ("imufast.orientation-report", 1)
    assert plain.keys() == report_json(results["smoother"][0]).keys()
    assert "<b>not" not in text


def test_the_angle_about_the_axis_is_the_hinge_angle(results: dict[str, Tracked], hinge: imufast.HingeSimulation) -> None:
    curve = report_json(results["smoother"][0], max_points=None)["curve"]
    assert (curve["about_axis"], curve["band"], curve["kept"]) == (True, "about_axis", 2000)
    truth = np.degrees(hinge.angle_rad - hinge.angle_rad.mean())
    angle = np.array(curve["angle_deg"])
    angle *= np.sign(angle @ truth)
    assert np.abs(angle - truth).max() < 1.5
    # The spread about one axis is part of the whole.
    assert np.all(np.array(curve["band_std_deg"]) <= np.array(curve["angle_std_deg"]) + 1e-12)
    assert report_json(results["mekf"][0])["curve"]["band"] == "whole"


def test_without_an_axis_it_is_the_angle_away_from_the_mean(results: dict[str, Tracked]) -> None:
    rel = results["ball"][0]
    curve = report_json(rel, max_points=None)["curve"]
    assert not curve["about_axis"]
    angle = np.radians(curve["angle_deg"])
    assert (angle >= 0.0).all()
    # Turning all of it by one rotation changes nothing.
    turned = replace(rel, q_12=rel.q_12 @ np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0])
    np.testing.assert_allclose(np.radians(report_json(turned, max_points=None)["curve"]["angle_deg"]), angle, atol=1e-9)


def test_long_recordings_are_thinned_with_extremes(results: dict[str, Tracked]) -> None:
    rel = results["mekf"][0]
    whole, thin = (report_json(rel, max_points=most)["curve"] for most in (None, 100))
    assert thin["kept"] == len(thin["time_s"]) <= 100
    for name in ("angle_deg", "angle_std_deg"):
        assert (min(thin[name]), max(thin[name])) == (min(whole[name]), max(whole[name]))
    assert thin["time_s"][0] == whole["time_s"][0]
    assert thin["time_s"][-1] == whole["time_s"][-1]
    assert len(report_json(rel)["curve"]["time_s"]) <= 2000


def test_gaps_and_starts_are_told(results: dict[str, Tracked], tmp_path: Path) -> None:
    rel, pair = results["gaps"]
    plain = report_json(rel, recording=pair)
    assert plain["gaps_s"]["count"] == 3
    np.testing.assert_allclose(plain["gaps_s"]["spans"][1], rel.time_s[0] + np.array([19.98, 22.0]), atol=1e-5)
    assert plain["restarts"] == 1
    spans = plain["starts_s"]["spans"]
    assert plain["starts_s"]["count"] == 2
    assert spans[0] == [rel.time_s[0], pytest.approx(rel.time_s[0] + rel.starting_s, abs=1e-6)]
    assert spans[1][0] == pytest.approx(rel.time_s[0] + 22.0, abs=1e-5)
    write_report(rel, tmp_path / "r.html", recording=pair)
    page = Page((tmp_path / "r.html").read_text("utf-8"))
    assert "Grey: samples are missing" in page.text
    assert "Purple: the filter looks for its start" in page.text
    assert "the filter started anew once" in page.text
    assert "times count from 1700000000 s" in page.text
    whole = report_json(results["smoother"][0])
    assert (whole["gaps_s"]["count"], whole["starts_s"]["count"]) == (0, 0)


def test_the_joint_feels_the_same_from_both_sensors(hinge: imufast.HingeSimulation) -> None:
    s, zero = hinge, np.zeros(3)
    acc1 = joint_acc(s.imu1, s.joint_in_sensor1, zero, zero)
    acc2 = joint_acc(s.imu2, s.joint_in_sensor2, zero, zero)
    w, v = s.q_12[:, :1], s.q_12[:, 1:]
    turned = acc2 + 2.0 * np.cross(v, np.cross(v, acc2) + w * acc2)
    raw = s.acc1 - (s.acc2 + 2.0 * np.cross(v, np.cross(v, s.acc2) + w * s.acc2))
    assert np.median(np.abs(acc1 - turned)) < 0.1 * np.median(np.abs(raw))


def test_residual_and_heading_tell_good_from_bad(results: dict[str, Tracked], hinge: imufast.HingeSimulation) -> None:
    rel, pair = results["smoother"]
    assert pair is not None
    good = residual_plain(rel, *pair)
    assert good is not None
    assert good["robust_std_m_s2"] == pytest.approx(rel.link_std, rel=0.3)
    assert sum(good["histogram"]["counts"]) == 3 * (2000 - 9)
    # Twenty degrees about the vertical or any other axis tear the two apart.
    turn = np.array([[0.985, -0.174, 0.0, 0.0], [0.174, 0.985, 0.0, 0.0], [0.0, 0.0, 0.985, 0.174], [0.0, 0.0, -0.174, 0.985]])
    bad = residual_plain(replace(rel, q_12=rel.q_12 @ turn.T), *pair)
    assert bad is not None
    assert bad["robust_std_m_s2"] > 10.0 * good["robust_std_m_s2"]
    seen = heading_plain(rel, pair[0], good["robust_std_m_s2"])
    assert seen is not None
    assert seen["shown_share"] == 1.0
    still = results["still"]
    assert still[1] is not None
    unseen = heading_plain(still[0], still[1][0], good["robust_std_m_s2"])
    assert unseen is not None
    assert unseen["shown_share"] == 0.0


def test_horizontal_acceleration_is_that_of_the_joint() -> None:
    # A sensor swung to and fro while it spins about the vertical; the joint is in it.
    time = np.arange(3000) / 100.0
    turn = 1.5 * time
    horizontal = 2.0 * np.sin(2.0 * np.pi * 0.7 * time)
    acc = np.stack([horizontal * np.cos(turn), -horizontal * np.sin(turn), np.full(3000, 9.81)], axis=1)
    gyr = np.tile([0.0, 0.0, 1.5], (3000, 1)) + 1e-9 * np.random.default_rng(1).normal(size=(3000, 3))
    imu = imufast.Imu(gyr, acc, rate_hz=100.0)
    rel = imufast.RelativeOrientation(
        time_s=imu.time_s,
        q_12=np.tile([1.0, 0.0, 0.0, 0.0], (3000, 1)),
        angle_std_deg=np.ones(3000),
        status=imufast.TrackStatus.TRACKED,
        calibration=imufast.JointCalibration(
            gyr_bias_std=0.0, center=imufast.JointCenter(np.zeros(3), np.zeros(3), np.zeros((6, 6)), np.zeros((0, 6)))
        ),
        method=imufast.Mekf(),
    )
    found = heading_plain(rel, imu, None)
    assert found is not None
    # The mean over 0.2 s takes a little off.
    np.testing.assert_allclose(found["horizontal_acc_rms_m_s2"], np.sqrt(2.0) * np.sinc(0.7 * 0.2), rtol=0.02)


def test_names_titles_and_warnings_are_escaped(known: imufast.JointCalibration, tmp_path: Path) -> None:
    evil = "<b onclick=x>&'"
    s = imufast.simulate_hinge("mixed", duration_s=12, rate_hz=50, seed=1)
    imus = [imufast.Imu(i.gyr, i.acc, rate_hz=50, name=f"{evil}{n}") for n, i in enumerate((s.imu1, s.imu2))]
    rel = replace(imufast.track(imus[0], imus[1], known), why=(evil,))
    write_report(rel, tmp_path / "r.html", recording=imus, title=evil, warnings=[evil])
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "<b" not in text.replace("<body", "")
    assert Page(text).text.count(evil) >= 7


def test_another_recording_is_refused(results: dict[str, Tracked], tmp_path: Path) -> None:
    for recording in (results["still"][1], results["gaps"][1], results["ball"][1] and [i[1:] for i in results["ball"][1]]):
        with pytest.raises(imufast.InputError, match="recording is not the one that was tracked"):
            write_report(results["smoother"][0], tmp_path / "r.html", recording=recording)
    assert not list(tmp_path.iterdir())


def test_words(results: dict[str, Tracked]) -> None:
    rel = results["mekf"][0]
    assert "where no gap made it" not in orientation_words.advice(rel)
    assert "where no gap made it" in orientation_words.advice(replace(rel, restarts=2))
    assert orientation_words.start(replace(rel, restarts=2)).endswith("; the filter started anew 2 times.")
    assert orientation_words.start(results["start known"][0]) == "The start was known at once."
    assert orientation_words.start(results["still, filter"][0]) == "The filter found no start in the whole recording."
    vague = replace(rel, angle_std_deg=np.full(2000, 30.0))
    assert orientation_words.vague_share(vague) == 1.0
    assert "not known" in orientation_words.certainty(replace(rel, angle_std_deg=np.full(2000, np.nan)))
    assert [orientation_words.degrees(x) for x in (0.428, 12.4, 180.0, np.inf)] == ["0.43°", "12°", "180°", "unknown"]


def test_the_twin_is_written(results: dict[str, Any], tmp_path: Path) -> None:
    rel, pair = results["smoother"]
    write_json(rel, tmp_path / "r.json", recording=pair)
    plain = json.loads((tmp_path / "r.json").read_text("utf-8"))
    assert plain == report_json(rel, recording=pair)
    assert plain["calibration"]["verdict"] == "HINGE"
    assert plain["angle_std_median_deg"] == float(np.median(rel.angle_std_deg))
    assert plain["settings"]["window_s"] == 0.2
