"""How near `track` comes to the truth of simulations and of a rig, how honest its standard deviation is, and laws that hold
whatever the motion: mounting, order of the sensors, and the origin of time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imufast import (
    Complementary,
    Imu,
    JointCalibration,
    JointCenter,
    Mekf,
    RelativeOrientation,
    TrackStatus,
    calibrate_joint,
    simulate_ball_joint,
    simulate_hinge,
    track,
)
from imufast.simulate import PairSimulation
from numpy.typing import NDArray
from track_cases import FILTERS, METHODS, apart_deg, back, sound, times

Array = NDArray[np.float64]
SEEDS = range(20)
SKIP_S = 5.0
"""Causal filters need so long to settle, s."""


@cache
def simulated(kind: str, seed: int) -> tuple[PairSimulation, JointCalibration]:
    sim: PairSimulation
    if kind == "hinge":
        sim = simulate_hinge(seed=seed, duration_s=40.0, rate_hz=100.0)
    else:
        sim = simulate_ball_joint(seed=seed, duration_s=40.0)
    return sim, calibrate_joint(sim.imu1, sim.imu2)


@cache
def found(kind: str, seed: int, method: str) -> RelativeOrientation:
    sim, calibration = simulated(kind, seed)
    return track(sim.imu1, sim.imu2, calibration, method)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def errors_deg(kind: str, seed: int, method: str) -> Array:
    return apart_deg(found(kind, seed, method).q_12, simulated(kind, seed)[0].q_12)


# Measured over 20 seeds: complementary 0.2 to 1.6 deg, mekf 0.2 to 1.0 deg, smoother 0.1 to 0.5 deg; hinges the larger.
WORST = {
    ("hinge", "complementary"): 2.0,
    ("hinge", "mekf"): 1.6,
    ("hinge", "smoother"): 0.8,
    ("ball", "complementary"): 0.7,
    ("ball", "mekf"): 0.6,
    ("ball", "smoother"): 0.4,
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_errors_are_small(kind: str, method: str) -> None:
    for seed in SEEDS:
        assert found(kind, seed, method).status is TrackStatus.TRACKED
        sound(found(kind, seed, method), simulated(kind, seed)[0].imu1)
        assert rms(errors_deg(kind, seed, method)) < WORST[kind, method], seed


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_the_smoother_is_better_than_the_filters_on_average(kind: str) -> None:
    mean = {method: np.mean([rms(errors_deg(kind, seed, method)) for seed in SEEDS]) for method in METHODS}
    assert mean["smoother"] < mean["mekf"]
    assert mean["smoother"] < mean["complementary"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_no_error_is_beyond_what_the_standard_deviation_allows(kind: str, method: str) -> None:
    for seed in SEEDS:
        assert (errors_deg(kind, seed, method) / found(kind, seed, method).angle_std_deg).max() < 5.0, seed


@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_the_smoothers_standard_deviation_is_honest_on_average(kind: str) -> None:
    ratio = [np.mean((errors_deg(kind, s, "smoother") / found(kind, s, "smoother").angle_std_deg) ** 2) for s in SEEDS]
    assert 0.5 < np.mean(ratio) < 2.0


def test_the_smoothers_covariance_is_that_of_the_errors() -> None:
    nees = []
    for seed in SEEDS:
        result, truth = found("ball", seed, "smoother"), simulated("ball", seed)[0].q_12
        assert result.covariance is not None
        error = times(back(result.q_12), truth)
        vector = 2.0 * np.sign(error[:, :1]) * error[:, 1:]
        nees.append(np.mean(np.einsum("ni,nij,nj->n", vector, np.linalg.inv(result.covariance), vector)) / 3.0)
        np.testing.assert_allclose(
            np.degrees(np.sqrt(np.trace(result.covariance, axis1=1, axis2=2))), result.angle_std_deg, rtol=1e-9
        )
    assert 0.5 < np.mean(nees) < 2.0


@pytest.mark.parametrize("method", FILTERS)
@pytest.mark.parametrize("kind", ["hinge", "ball"])
def test_the_filters_standard_deviation_is_not_too_small_on_average(kind: str, method: str) -> None:
    settled = slice(int(SKIP_S * 100), None)
    ratio = [np.mean((errors_deg(kind, s, method) / found(kind, s, method).angle_std_deg)[settled] ** 2) for s in SEEDS]
    # The covariance is careful: measured 0.2 to 0.9.
    assert 0.05 < np.mean(ratio) < 2.0


@pytest.mark.parametrize("method", FILTERS)
def test_biases_that_nobody_knows_are_within_the_standard_deviation(method: str) -> None:
    # 0.5 deg/s a channel, as `gyr_bias_std` of a calibration without rest says.
    for seed in range(4):
        biases = np.random.default_rng(seed).normal(0.0, 0.0087, (2, 3))
        sim = simulate_ball_joint(seed=seed, duration_s=40.0, gyr_bias1=biases[0], gyr_bias2=biases[1])
        result = track(sim.imu1, sim.imu2, calibrate_joint(sim.imu1, sim.imu2), method)
        assert (apart_deg(result.q_12, sim.q_12) / result.angle_std_deg).max() < 4.0


# The complementary filter's speed has a limit, and biases of several times their standard deviation come near it.
@pytest.mark.parametrize(("method", "most"), [("mekf", 1.4), ("complementary", 4.0)])
def test_biases_that_a_calibration_leaves_open_are_counted(method: str, most: float) -> None:
    squares: list[float] = []
    trusting: list[float] = []
    for seed in range(8):
        biases = np.random.default_rng(seed).normal(0.0, 0.0087, (2, 3))
        sim = simulate_ball_joint(seed=seed, duration_s=40.0, gyr_bias1=biases[0], gyr_bias2=biases[1])
        found = calibrate_joint(sim.imu1, sim.imu2)
        zero = np.zeros(3)
        for std, values in ((0.0087, squares), (0.0, trusting)):
            calibration = replace(found, gyr_bias1=zero, gyr_bias2=zero, gyr_bias_std=std, relative_gyr_bias_std=None)
            result = track(sim.imu1, sim.imu2, calibration, method)
            values.append(float(np.mean((apart_deg(result.q_12, sim.q_12) / result.angle_std_deg)[500:] ** 2)))
    assert 0.2 < np.mean(squares) < most
    assert np.mean(trusting) > 2.0 * np.mean(squares)


def test_the_smoother_finds_biases_and_stays_honest() -> None:
    for seed in range(4):
        biases = np.random.default_rng(seed).normal(0.0, 0.0087, (2, 3))
        sim = simulate_ball_joint(seed=seed, duration_s=40.0, gyr_bias1=biases[0], gyr_bias2=biases[1])
        result = track(sim.imu1, sim.imu2)
        assert (apart_deg(result.q_12, sim.q_12) / result.angle_std_deg).max() < 5.0
        assert rms(apart_deg(result.q_12, sim.q_12)) < 0.5


def matrix(q: Array) -> Array:
    columns = [times(times(q, np.array([0.0, *e])), back(q))[1:] for e in np.eye(3)]
    return np.stack(columns, axis=1)


def remounted(calibration: JointCalibration, turn1: Array, turn2: Array) -> JointCalibration:
    """The calibration of sensors that are turned in their mountings."""
    center = calibration.center
    assert center is not None
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = turn1, turn2
    new = JointCenter(
        turn1 @ center.in_sensor1,
        turn2 @ center.in_sensor2,
        both @ center.covariance @ both.T,
        center.undetermined @ both.T,
    )
    return JointCalibration(
        center=new,
        gyr_bias1=turn1 @ calibration.gyr_bias1,
        gyr_bias2=turn2 @ calibration.gyr_bias2,
        acc_bias1=turn1 @ calibration.acc_bias1,
        acc_bias2=turn2 @ calibration.acc_bias2,
        acc_bias_covariance=both @ calibration.acc_bias_covariance @ both.T,
        gyr_bias_std=calibration.gyr_bias_std,
        relative_gyr_bias_std=calibration.relative_gyr_bias_std,
        noise=calibration.noise,
    )


def rotated(imu: Imu, turn: Array) -> Imu:
    return Imu(imu.gyr @ turn.T, imu.acc @ turn.T, imu.rate_hz)


def random_turn(rng: np.random.Generator) -> Array:
    q = rng.normal(size=4)
    return np.asarray(q / np.linalg.norm(q))


VARIANTS: list[Any] = [*METHODS, Mekf.as_published(), Mekf(outliers="reject"), Complementary(bias_gain=0.01)]


@pytest.mark.parametrize("method", VARIANTS, ids=str)
@pytest.mark.parametrize("which", [(True, False), (False, True), (True, True)])
def test_another_mounting_turns_the_result_along(method: Any, which: tuple[bool, bool]) -> None:
    rng = np.random.default_rng(3)
    sim, calibration = simulated("ball", 1)
    one = np.array([1.0, 0.0, 0.0, 0.0])
    q1, q2 = (random_turn(rng) if turned else one for turned in which)
    turn1, turn2 = matrix(q1), matrix(q2)
    imus = rotated(sim.imu1, turn1), rotated(sim.imu2, turn2)
    # With a known start: the closed form prefers the shortest rotation by a billionth.
    filters = method in FILTERS or not isinstance(method, str)
    start: dict[str, Any] = {"start": sim.q_12[0]} if filters else {}
    before = track(sim.imu1, sim.imu2, calibration, method, **start)
    if filters:
        start["start"] = times(times(q1, sim.q_12[0]), back(q2))
    after = track(*imus, remounted(calibration, turn1, turn2), method, **start)
    expected = times(times(q1, before.q_12), back(q2))
    limit = 1e-9 if filters else 1e-6
    assert np.radians(apart_deg(expected, after.q_12)).max() < limit
    np.testing.assert_allclose(after.angle_std_deg, before.angle_std_deg, rtol=1e-6)
    if before.covariance is not None:
        assert after.covariance is not None
        np.testing.assert_allclose(after.covariance, turn2 @ before.covariance @ turn2.T, atol=1e-6 * before.covariance.max())


@pytest.mark.parametrize("method", METHODS)
def test_another_mounting_with_the_closed_form_start(method: str) -> None:
    rng = np.random.default_rng(4)
    sim, calibration = simulated("ball", 2)
    q1, q2 = random_turn(rng), random_turn(rng)
    turn1, turn2 = matrix(q1), matrix(q2)
    before = track(sim.imu1, sim.imu2, calibration, method)
    after = track(rotated(sim.imu1, turn1), rotated(sim.imu2, turn2), remounted(calibration, turn1, turn2), method)
    assert np.radians(apart_deg(times(times(q1, before.q_12), back(q2)), after.q_12)).max() < 1e-6


def test_another_mounting_without_a_calibration() -> None:
    rng = np.random.default_rng(5)
    sim, _ = simulated("hinge", 2)
    q1, q2 = random_turn(rng), random_turn(rng)
    before = track(sim.imu1, sim.imu2)
    after = track(rotated(sim.imu1, matrix(q1)), rotated(sim.imu2, matrix(q2)))
    assert np.radians(apart_deg(times(times(q1, before.q_12), back(q2)), after.q_12)).max() < 1e-6


@pytest.mark.parametrize("method", METHODS)
def test_the_sensors_in_the_other_order_give_the_inverse(method: str) -> None:
    sim, calibration = simulated("ball", 3)
    center = calibration.center
    assert center is not None
    swapped = replace(
        remounted(calibration, np.eye(3), np.eye(3)),
        center=JointCenter(center.in_sensor2, center.in_sensor1, np.roll(center.covariance, 3, axis=(0, 1))),
        gyr_bias1=calibration.gyr_bias2,
        gyr_bias2=calibration.gyr_bias1,
        acc_bias1=calibration.acc_bias2,
        acc_bias2=calibration.acc_bias1,
        acc_bias_covariance=np.roll(calibration.acc_bias_covariance, 3, axis=(0, 1)),
    )
    one, other = track(sim.imu1, sim.imu2, calibration, method), track(sim.imu2, sim.imu1, swapped, method)
    apart = apart_deg(back(other.q_12), one.q_12)
    # The filters treat the sensors differently: gravity, gates and the drift live in frame 2.
    assert apart.max() < (0.01 if method == "smoother" else 2.0)
    assert rms(apart) < (0.005 if method == "smoother" else 0.5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("shift_s", [-3.0, 1024.0, 1.7e9])
def test_the_origin_of_time_changes_nothing(method: str, shift_s: float) -> None:
    sim, calibration = simulated("ball", 4)
    first, second = (Imu(i.gyr, i.acc, time_s=i.time_s + shift_s) for i in (sim.imu1, sim.imu2))
    before, after = track(sim.imu1, sim.imu2, calibration, method), track(first, second, calibration, method)
    # Times of day in seconds are good to a quarter of a microsecond.
    assert apart_deg(before.q_12, after.q_12).max() < (0.01 if shift_s > 1e6 else 1e-7)
    np.testing.assert_array_equal(after.time_s, first.time_s)
    assert after.starting_s == pytest.approx(before.starting_s, abs=1e-5)


@pytest.mark.parametrize("method", FILTERS)
def test_filters_look_no_further_ahead_than_their_delay(method: str) -> None:
    sim, calibration = simulated("ball", 5)
    whole, cut = (track(sim.imu1[:n], sim.imu2[:n], calibration, method) for n in (4000, 2500))
    np.testing.assert_array_equal(whole.q_12[:2498], cut.q_12[:2498])
    np.testing.assert_array_equal(whole.angle_std_deg[:2498], cut.angle_std_deg[:2498])


@pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")
@pytest.mark.parametrize("name", ["1D_01", "1D_02", "2D_01", "2D_02", "3D_01", "3D_02"])
def test_a_rig_is_tracked_without_a_word(shared_data: Path, name: str) -> None:
    path = shared_data / "two_imu_joint" / f"{name}.npz"
    if not path.is_file():
        pytest.skip(f"the real recording {path.name} is missing (set IMUFAST_DATA)")
    with np.load(path) as arrays:
        a = dict(arrays)
    first, second = (Imu(a[f"gyr{i}"], a[f"acc{i}"], float(a["rate_hz"]), name=f"{i}") for i in (1, 2))
    valid = a["reference_valid"]
    worst = {"complementary": 3.0, "mekf": 3.0, "smoother": 2.0}
    for method in METHODS:
        result = track(first, second, method=method)
        sound(result, first)
        assert result.status is TrackStatus.TRACKED
        assert rms(apart_deg(result.q_12, a["q_12_reference"])[valid]) < worst[method]
