"""`track_many` is `track` one by one: the same bits, whatever shares the lanes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from imufast import (
    Complementary,
    Imu,
    InputError,
    JointCalibration,
    JointCenter,
    Mekf,
    RelativeOrientation,
    SettingsError,
    Smoother,
    TrackStatus,
    calibrate_joint,
    simulate_ball_joint,
    simulate_hinge,
    track,
    track_many,
)
from track_cases import apart_deg, ball, known, sound

SETTINGS: list[Any] = [
    "mekf",
    "complementary",
    Mekf(precision="single"),
    Complementary(precision="single", bias_gain=0.01, beta_extra=1.0),
    Mekf.as_published("none"),
    Mekf(outliers="reject"),
    Complementary.as_published(),
]
Joint = tuple[tuple[Imu, Imu], JointCalibration]


@cache
def even() -> list[Joint]:
    """Mixed lengths, all at a rate whose step is a binary number."""
    seconds = (10.0, 3.0, 20.0, 12.0, 0.5, 11.0, 25.0, 10.0, 14.0, 6.0, 9.0)
    sims: list[Any] = [simulate_ball_joint(seed=k, duration_s=s, rate_hz=128.0) for k, s in enumerate(seconds)]
    sims += [simulate_hinge("stationary", seed=3, duration_s=10.0, rate_hz=128.0)]
    sims += [simulate_hinge(seed=k, duration_s=12.0, rate_hz=64.0) for k in range(5)]
    return [((s.imu1, s.imu2), calibrate_joint(s.imu1, s.imu2)) for s in sims]


@cache
def mixed() -> list[Joint]:
    """Rates, irregular time, gaps and losses."""
    rates = ((10.0, 100.0), (20.0, 50.0), (2.0, 1000.0), (30.0, 100.0), (0.1, 100.0), (10.0, 200.0), (11.0, 60.0))
    sims: list[Any] = [simulate_ball_joint(seed=k, duration_s=s, rate_hz=r) for k, (s, r) in enumerate(rates)]
    sims += [simulate_ball_joint(seed=30, duration_s=20.0, packet_loss=0.02)]
    sims += [simulate_ball_joint(time_s=np.cumsum(np.random.default_rng(0).uniform(0.005, 0.015, 1500)), seed=31)]
    sims += [simulate_ball_joint(("random", "random"), duration_s=8.0, transition_s=5.0, seed=32)]
    return [((s.imu1, s.imu2), calibrate_joint(s.imu1, s.imu2)) for s in sims]


def many(joints: list[Joint], method: Any) -> list[RelativeOrientation]:
    return track_many([pair for pair, _ in joints], [calibration for _, calibration in joints], method)


def bits(found: RelativeOrientation) -> tuple[object, ...]:
    rest = found.status, found.method, found.restarts, found.starting_s, found.why
    return found.q_12.tobytes(), found.angle_std_deg.tobytes(), found.time_s.tobytes(), *rest


@pytest.mark.parametrize("method", SETTINGS, ids=str)
def test_lanes_give_the_bits_of_one_by_one(method: Any) -> None:
    for found, (pair, calibration) in zip(many(even(), method), even(), strict=True):
        assert bits(found) == bits(track(*pair, calibration, method))


@pytest.mark.parametrize("method", SETTINGS[:3], ids=str)
def test_any_rate_gives_the_bits_of_one_by_one(method: Any) -> None:
    for found, (pair, calibration) in zip(many(mixed(), method), mixed(), strict=True):
        assert bits(found) == bits(track(*pair, calibration, method))


@pytest.mark.parametrize("method", SETTINGS[:4], ids=str)
def test_any_rate_gives_the_same_to_rounding(method: Any) -> None:
    for found, (pair, calibration) in zip(many(mixed(), method), mixed(), strict=True):
        sound(found, pair[0])
        alone = track(*pair, calibration, method)
        assert apart_deg(found.q_12, alone.q_12).max() < 1e-9
        np.testing.assert_array_equal(found.angle_std_deg, alone.angle_std_deg)
        assert found.status is alone.status
        assert found.starting_s == pytest.approx(alone.starting_s)


@cache
def contradicted() -> Joint:
    """A mounting that changes in the middle, and a centre that was guessed wrongly."""
    sim = simulate_ball_joint(seed=5, duration_s=60.0, rate_hz=128.0)
    half, turn = len(sim.gyr2) // 2, np.diag([-1.0, 1.0, -1.0])
    gyr2, acc2 = sim.gyr2.copy(), sim.acc2.copy()
    gyr2[half:], acc2[half:] = gyr2[half:] @ turn, acc2[half:] @ turn
    return (sim.imu1, Imu(gyr2, acc2, 128.0)), JointCalibration(center=JointCenter(np.zeros(3), np.zeros(3)))


@pytest.mark.parametrize("method", SETTINGS[:2])
@pytest.mark.parametrize("count", [1, 3, 9])
def test_restarts_in_the_lanes_are_those_of_one_by_one(method: str, count: int) -> None:
    joint = contradicted()
    alone = track(*joint[0], joint[1], method)
    assert alone.restarts >= 1
    for found in many([joint] * count, method):
        assert found.q_12.tobytes() == alone.q_12.tobytes()
        assert found.angle_std_deg.tobytes() == alone.angle_std_deg.tobytes()


@pytest.mark.parametrize("method", SETTINGS[:2])
def test_restarts_in_the_lanes_are_counted_and_told(method: str) -> None:
    joint = contradicted()
    alone = track(*joint[0], joint[1], method)
    for found in many([joint] * 2, method):
        assert found.restarts == alone.restarts
        assert found.why == alone.why


def test_the_smoother_runs_one_by_one() -> None:
    joints = even()[:3]
    for found, (pair, calibration) in zip(many(joints, Smoother()), joints, strict=True):
        assert bits(found) == bits(track(*pair, calibration, "smoother"))


def test_nothing_is_tracked_of_nothing() -> None:
    for method in ("mekf", "complementary", "smoother"):
        assert track_many([], [], method) == []


def test_a_generator_will_do() -> None:
    joints = [even()[0], even()[2]]
    found = track_many((p for p, _ in joints), (c for _, c in joints))  # type: ignore[arg-type]
    assert [f.status for f in found] == [TrackStatus.TRACKED] * 2


def test_wrong_lists_are_refused() -> None:
    pair, calibration = (ball().imu1, ball().imu2), known()
    with pytest.raises(InputError, match="pairs has 1 entries but calibrations 2"):
        track_many([pair], [calibration, calibration])
    with pytest.raises(InputError, match="calibrations must hold a JointCalibration"):
        track_many([pair], [None])  # type: ignore[list-item]
    with pytest.raises(InputError, match="calibration must be"):
        track_many([pair], ["joint.json"])  # type: ignore[list-item]
    with pytest.raises(InputError, match="same gyr data"):
        track_many([(pair[0], pair[0])], [calibration])
    with pytest.raises(SettingsError, match="method must be one of"):
        track_many([pair], [calibration], "kalman")


@pytest.mark.parametrize("pairs", [None, 3, [1], [(1,)], [(1, 2, 3)], [None]])
def test_what_are_no_pairs_is_refused(pairs: Any) -> None:
    with pytest.raises(InputError, match="pairs"):
        track_many(pairs, [known()])
