"""Innovation health: what a filter did not foresee, against what it says of that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast import BallJointSimulation, Complementary, JointCalibration, JointCenter, Mekf, SensorNoise, track
from imufast.report import report_json, write_report
from imufast.report.innovations import innovations_plain, limit_of_links, normalised_squares
from imufast.report.link import joint_acc
from imufast.smoother import Smoother
from numpy.typing import NDArray
from test_report import Page
from track_cases import back, times

Array = NDArray[np.float64]
GYR_STD, ACC_STD = 0.004, 0.05


@cache
def simulated(seed: int = 1) -> tuple[BallJointSimulation, JointCalibration]:
    """A joint whose sensors have white noise alone, and all that there is to know of it."""
    sim = imufast.simulate_ball_joint(seed=seed, duration_s=40.0, gyr_noise=GYR_STD, acc_noise=ACC_STD)
    noise = SensorNoise(GYR_STD, GYR_STD, ACC_STD, ACC_STD, 100.0)
    center = JointCenter(sim.joint_in_sensor1, sim.joint_in_sensor2, np.zeros((6, 6)), np.zeros((0, 6)))
    return sim, JointCalibration(center=center, gyr_bias_std=1e-5, noise=noise)


def squares_of(method: Mekf | Complementary, calibration: JointCalibration | None = None) -> tuple[Array, Array]:
    sim, known = simulated()
    return normalised_squares(track(sim.imu1, sim.imu2, calibration or known, method), sim.imu1, sim.imu2)


@pytest.mark.parametrize("method", [Mekf(adapt=False, outliers="none"), Mekf(), Mekf(precision="single"), Complementary()])
def test_of_a_filter_that_is_right_they_are_chi_squared(method: Mekf | Complementary) -> None:
    innovation, squares = squares_of(method)
    seen = np.isfinite(squares)
    assert seen.mean() > 0.85
    np.testing.assert_array_equal(np.isfinite(innovation).all(axis=1), seen)
    assert not seen[:2].any()
    assert (squares[seen] >= 0.0).all()
    # χ² of three: mean 3, median 2.37, 5 % beyond 7.81.
    assert 2.2 < squares[seen].mean() < 3.8
    assert 1.7 < np.median(squares[seen]) < 3.0
    assert 0.02 < (squares[seen] > 7.815).mean() < 0.09


def test_innovations_are_what_the_gyroscopes_did_not_foresee() -> None:
    sim, known = simulated()
    rel = track(sim.imu1, sim.imu2, known, "mekf")
    innovation, _ = normalised_squares(rel, sim.imu1, sim.imu2)
    # An oracle: turn by the gyroscopes from the sample before, and compare accelerations; differentiated more coarsely.
    zero = np.zeros(3)
    acc1 = joint_acc(sim.imu1, sim.joint_in_sensor1, zero, zero)
    acc2 = joint_acc(sim.imu2, sim.joint_in_sensor2, zero, zero)

    def step(gyr: Array) -> Array:
        half = 0.5 * 0.5 * 0.01 * (gyr[1:] + gyr[:-1])
        q = np.hstack([np.ones((len(half), 1)), half])
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))

    q = times(times(back(step(sim.gyr1)), rel.q_12[:-1]), step(sim.gyr2))
    w, v = q[:, :1], -q[:, 1:]
    turned = acc1[1:] + 2.0 * np.cross(v, np.cross(v, acc1[1:]) + w * acc1[1:])
    expected = turned - acc2[1:]
    good = np.isfinite(innovation[1:]).all(axis=1)
    assert np.corrcoef(innovation[1:][good].ravel(), expected[good].ravel())[0, 1] > 0.9
    assert np.median(np.abs(innovation[1:][good] - expected[good])) < 0.5 * np.median(np.abs(expected[good]))


def test_a_wrong_calibration_shows() -> None:
    known = simulated()[1]
    assert known.center is not None
    wrong = replace(known, center=JointCenter(known.center.in_sensor1 + 0.05, known.center.in_sensor2))
    fixed = Mekf(adapt=False, outliers="none")
    good, bad = (squares_of(fixed, calibration)[1] for calibration in (known, wrong))
    assert np.nanmean(bad) > 3.0 * np.nanmean(good)
    sim = simulated()[0]
    told = innovations_plain(track(sim.imu1, sim.imu2, wrong, fixed), (sim.imu1, sim.imu2))
    assert told is not None
    assert "contradict each other" in told["words"]
    assert told["worst_mean"] > 3.0 * told["nominal"]


def test_gaps_and_starts_have_none_and_a_known_start_is_used() -> None:
    sim, known = simulated()
    rows = (sim.time_s < 20.0) | (sim.time_s > 23.0)
    pair = [imufast.Imu(g[rows], a[rows], time_s=sim.time_s[rows]) for g, a in ((sim.gyr1, sim.acc1), (sim.gyr2, sim.acc2))]
    rel = track(pair[0], pair[1], known, "mekf")
    _, squares = normalised_squares(rel, pair[0], pair[1])
    starting = np.zeros(len(rel), dtype=bool)
    for since, to in rel.starts_s:
        starting |= (rel.time_s >= since) & (rel.time_s < to)
    assert rel.restarts == 1
    assert not np.isfinite(squares[starting]).any()
    assert np.isfinite(squares[~starting]).mean() > 0.95
    given = track(sim.imu1, sim.imu2, known, "mekf", start=sim.q_12[0], start_std_deg=1.0)
    assert np.isfinite(normalised_squares(given, sim.imu1, sim.imu2)[1][2:-2]).all()


def test_the_smoothers_residuals_stand_for_innovations() -> None:
    sim, known = simulated()
    rel = track(sim.imu1, sim.imu2, known)
    assert rel.link_squares is not None
    assert rel.link_time_s is not None
    assert rel.link_trust is not None
    assert len(rel.link_squares) == len(rel.link_time_s)
    assert (np.diff(rel.link_time_s) > 0.0).all()
    assert 0.0 < rel.link_trust <= 1.0
    told = innovations_plain(rel, None)
    assert told is not None
    assert told["kind"] == "residual"
    # Its scale is that of its own residuals; what the unknowns fit is missing.
    assert 1.5 < told["mean"] < 3.5
    assert told["beyond_limit95"] < 0.1
    assert innovations_plain(track(sim.imu1, sim.imu2, known, "mekf"), None) is None
    assert innovations_plain(track(sim.imu1[:20], sim.imu2[:20], known), None) is None


@pytest.mark.parametrize(("tail", "expected"), [(0.5, 137089.4), (2.0, 57.4929), (4.0, 19.7741), (50.0, 8.3700), (1e6, 7.8148)])
def test_the_limit_of_students_t(tail: float, expected: float) -> None:
    # 3 F⁻¹(0.95; 3, ν), from scipy.stats.
    assert limit_of_links(tail) == pytest.approx(expected, rel=3e-3)
    assert Smoother(tail=tail).tail == tail


@pytest.mark.parametrize("method", ["mekf", "complementary", "smoother"])
def test_the_report_tells_it_in_words_and_figure(method: str, tmp_path: Path) -> None:
    sim, known = simulated()
    pair = sim.imu1, sim.imu2
    rel = track(*pair, known, method)
    told = report_json(rel, recording=pair)["innovations"]
    assert (told["nominal"], told["kind"]) == (3.0, "residual" if method == "smoother" else "innovation")
    seen = [value for value in told["mean_over_time"] if value is not None]
    assert max(seen) == pytest.approx(told["worst_mean"])
    assert abs(np.mean(seen) - told["mean"]) < 0.5
    write_report(rel, tmp_path / "r.html", recording=pair)
    page = Page((tmp_path / "r.html").read_text("utf-8"))
    assert "Does it err as much as it says?" in page.text
    assert told["words"] in page.text
    alone = report_json(rel)["innovations"]
    assert (alone is None) == (method != "smoother")
