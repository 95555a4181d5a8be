"""Laws of the joint centre: mounting, order and cutting change nothing, time may be irregular, and memory is bounded."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple

import imufast
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    CenterEstimate,
    CenterSettings,
    CenterStatus,
    Imu,
    JointCenter,
    JointCenterEstimator,
    estimate_joint_center,
    simulate_ball_joint,
)
from numpy.typing import NDArray
from reference import center as reference

Array = NDArray[np.float64]
fit: Any = imufast.fit_joint_center  # called with unpacked arrays
PUBLISHED = CenterSettings.as_published()
VARIANTS: dict[str, CenterSettings] = {
    "default": CenterSettings(),
    "small": CenterSettings(max_samples=40),
    "raw": CenterSettings(lowpass_hz=None, max_samples=200),
    "published": PUBLISHED,
    "gated": CenterSettings(least_rate=1.2, lowpass_hz=4.0, robust=True),
}


class Samples(NamedTuple):
    """A recording as `push` takes it; `time_s` None: by the rate."""

    gyr1: Array
    acc1: Array
    gyr2: Array
    acc2: Array
    time_s: Array | None

    def rows(self, rows: slice | int) -> tuple[Any, ...]:
        return tuple(None if a is None else a[rows] for a in self)

    def imus(self) -> tuple[Imu, Imu]:
        how: dict[str, Any] = {"rate_hz": 100.0} if self.time_s is None else {"time_s": self.time_s}
        return Imu(self.gyr1, self.acc1, **how), Imu(self.gyr2, self.acc2, **how)


TRUTH: dict[str, Array] = {}


@cache
def data(kind: str) -> Samples:
    biases: dict[str, Any] = {"acc_bias1": (0.1, -0.15, 0.05), "gyr_bias1": (0.01, 0.0, -0.01)}
    if kind in ("even", "timed"):
        sim = simulate_ball_joint(seed=1, duration_s=20.0, **biases)
    elif kind == "gaps":
        sim = simulate_ball_joint(
            ("random", "stationary", "S5", "random"),
            duration_s=8.0,
            transition_s=7.3,
            seed=2,
            packet_loss=0.01,
            burst_length=6.0,
            **biases,
        )
    else:
        steps = np.random.default_rng(3).uniform(0.5, 1.5, 1800) / 100.0
        sim = simulate_ball_joint(time_s=np.cumsum(steps), seed=3, **biases)
    TRUTH[kind] = np.concatenate([sim.joint_in_sensor1, sim.joint_in_sensor2])
    return Samples(sim.gyr1, sim.acc1, sim.gyr2, sim.acc2, None if kind == "even" else 1234.5 + sim.time_s)


KINDS = ("even", "timed", "gaps", "irregular")


def stacked(center: CenterEstimate) -> Array:
    return np.concatenate([center.in_sensor1, center.in_sensor2])


def bits(value: object) -> object:
    """Plain and comparable, arrays by their bytes."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if is_dataclass(value) and not isinstance(value, (type, CenterSettings)):
        return {f.name: bits(getattr(value, f.name)) for f in fields(value)}
    return repr(value)


def estimator(kind: str, variant: str, method: str = "sa") -> JointCenterEstimator:
    return JointCenterEstimator(data(kind).imus()[0].rate_hz, method=method, settings=VARIANTS[variant])


@cache
def whole(kind: str, variant: str, method: str = "sa") -> Any:
    return bits(estimate_joint_center(*data(kind).imus(), method, settings=VARIANTS[variant]))


@settings(max_examples=20, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(KINDS),
    variant=st.sampled_from(list(VARIANTS)),
    method=st.sampled_from(["ss", "sa"]),
    sizes=st.lists(st.integers(-1, 300), min_size=1, max_size=12).filter(lambda sizes: sum(map(abs, sizes)) > 20),
)
def test_any_cutting_gives_the_bits_of_the_whole(kind: str, variant: str, method: str, sizes: list[int]) -> None:
    stream, samples, at, turn = estimator(kind, variant, method), data(kind), 0, 0
    while at < len(samples.gyr1):
        size = sizes[turn % len(sizes)]
        stream.push(*(samples.rows(at) if size == -1 else samples.rows(slice(at, at + size))))
        if turn % 7 == 3:
            stream.result()  # reading changes nothing
        at, turn = at + abs(size), turn + 1
    assert bits(stream.result()) == whole(kind, variant, method)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("variant", VARIANTS)
def test_one_push_of_all_gives_the_bits_of_the_whole(kind: str, variant: str) -> None:
    stream = estimator(kind, variant)
    stream.push(*data(kind))
    assert bits(stream.result()) == whole(kind, variant)


@pytest.mark.parametrize("kind", ["timed", "gaps", "irregular"])
@pytest.mark.parametrize("method", ["ss", "sa"])
def test_gaps_and_irregular_time_still_tell_the_centre(kind: str, method: str) -> None:
    center = estimate_joint_center(*data(kind).imus(), method)
    assert center.status is CenterStatus.CONVERGED
    assert np.linalg.norm(stacked(center) - TRUTH[kind]) < 0.015


def test_a_stretch_of_nonsense_time_between_two_halves_does_not_join_them() -> None:
    # Two halves an hour apart, and the second one's rates start elsewhere: any derivative across would show.
    sims = [simulate_ball_joint(seed=4, duration_s=15.0), simulate_ball_joint(seed=4, duration_s=15.0)]
    samples = [np.concatenate([getattr(s, name) for s in sims]) for name in ("gyr1", "acc1", "gyr2", "acc2")]
    time = np.concatenate([sims[0].time_s, 3600.0 + sims[1].time_s])
    for chosen in (CenterSettings(bias_from_rest=False), PUBLISHED):
        one = estimate_joint_center(sims[0].imu1, sims[0].imu2, "ss", settings=chosen)
        both = estimate_joint_center(
            Imu(samples[0], samples[1], time_s=time), Imu(samples[2], samples[3], time_s=time), "ss", settings=chosen
        )
        assert both.n_samples == 2 * one.n_samples
        assert both.cost == pytest.approx(2.0 * one.cost, rel=1e-3)
        np.testing.assert_allclose(stacked(both), stacked(one), atol=2e-3)


def rotation(seed: int) -> Array:
    q = np.random.default_rng(seed).normal(size=(1, 4))
    return np.asarray(reference.rotation_matrices(q / np.linalg.norm(q))[0])


def near_covariance(one: Array, other: Array) -> None:
    np.testing.assert_allclose(one, other, rtol=0.02, atol=0.02 * np.abs(other).max())


@pytest.mark.parametrize("variant", ["default", "raw", "published", "gated"])
@pytest.mark.parametrize("method", ["ss", "sa"])
def test_the_centre_turns_with_the_mounting(variant: str, method: str) -> None:
    samples = data("timed")
    base = estimate_joint_center(*samples.imus(), method, settings=VARIANTS[variant])
    R1, R2 = rotation(1), rotation(2)
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = R1, R2
    turned = samples._replace(
        gyr1=samples.gyr1 @ R1.T, acc1=samples.acc1 @ R1.T, gyr2=samples.gyr2 @ R2.T, acc2=samples.acc2 @ R2.T
    )
    center = estimate_joint_center(*turned.imus(), method, settings=VARIANTS[variant])
    np.testing.assert_allclose(stacked(center), both @ stacked(base), atol=2e-5)
    near_covariance(center.covariance, both @ base.covariance @ both.T)
    np.testing.assert_allclose(center.acc_bias1, R1 @ base.acc_bias1, atol=2e-4)
    near_covariance(center.acc_bias_covariance, both @ base.acc_bias_covariance @ both.T)
    assert center.status is base.status


@pytest.mark.parametrize("variant", ["default", "raw", "published", "gated"])
@pytest.mark.parametrize("method", ["ss", "sa"])
def test_swapping_the_sensors_swaps_the_centres(variant: str, method: str) -> None:
    imu1, imu2 = data("timed").imus()
    base = estimate_joint_center(imu1, imu2, method, settings=VARIANTS[variant])
    center = estimate_joint_center(imu2, imu1, method, settings=VARIANTS[variant])
    np.testing.assert_allclose(center.in_sensor1, base.in_sensor2, atol=2e-5)
    np.testing.assert_allclose(center.in_sensor2, base.in_sensor1, atol=2e-5)
    np.testing.assert_allclose(center.acc_bias1, base.acc_bias2, atol=2e-4)
    near_covariance(np.roll(center.covariance, (3, 3), (0, 1)), base.covariance)
    assert center.cost == pytest.approx(base.cost, rel=1e-4)


@pytest.mark.parametrize("method", ["ss", "sa", "ls"])
def test_the_order_of_moments_that_are_given_does_not_matter(method: str) -> None:
    sim = simulate_ball_joint(seed=5, duration_s=10.0)
    moments = reference.Moments(sim.gyr1, sim.gyr_rate1_true, sim.acc1, sim.gyr2, sim.gyr_rate2_true, sim.acc2)
    order = np.random.default_rng(1).permutation(len(sim.time_s))
    how = [{"q_12": q} if method == "ls" else {} for q in (sim.q_12, sim.q_12[order])]
    one = fit(*moments, method, **how[0])
    other = fit(*(a[order] for a in moments), method, **how[1])
    np.testing.assert_allclose(stacked(one), stacked(other), atol=2e-5)
    assert one.cost == pytest.approx(other.cost, rel=1e-5)


def test_the_recording_may_start_at_any_time_and_drops_nothing_at_its_ends() -> None:
    sim = simulate_ball_joint(seed=6, duration_s=10.0)
    for variant in ("published", "default"):
        one, other = (
            estimate_joint_center(
                Imu(sim.gyr1, sim.acc1, time_s=start + sim.time_s),
                Imu(sim.gyr2, sim.acc2, time_s=start + sim.time_s),
                settings=VARIANTS[variant],
            )
            for start in (0.0, 86400.0)
        )
        assert one.n_samples == other.n_samples
        np.testing.assert_allclose(stacked(one), stacked(other), atol=2e-4)


def test_memory_and_time_stay_bounded_over_hours() -> None:
    sim = simulate_ball_joint(seed=7, duration_s=300.0)
    stream = JointCenterEstimator(100.0, max_samples=500)
    for _ in range(24):  # two hours
        stream.push(sim.gyr1, sim.acc1, sim.gyr2, sim.acc2)
        center = stream.result()
        assert center.n_samples <= 500
    assert center.n_samples >= 200
    assert center.status is CenterStatus.CONVERGED
    assert np.linalg.norm(stacked(center) - np.concatenate([sim.joint_in_sensor1, sim.joint_in_sensor2])) < 0.01


def test_an_empty_or_nearly_empty_stream_has_a_status_too() -> None:
    samples = data("even")
    stream = JointCenterEstimator(100.0)
    for count in (0, 1, 3, 50, 100, 200):
        stream.push(*samples.rows(slice(0, count)))
        center = stream.result()
        assert center.status is not CenterStatus.CONVERGED
        assert np.isfinite(stacked(center)).all()
        assert np.isfinite(center.determined_std).all()


def test_single_samples_and_many_dtypes_are_taken() -> None:
    samples = data("even")
    whole_stream, lists = estimator("even", "raw"), estimator("even", "raw")
    whole_stream.push(*samples.rows(slice(0, 150)))
    for k in range(150):
        row: Any = [None if a is None else a[k].tolist() for a in samples]
        lists.push(*row)
    assert bits(whole_stream.result()) == bits(lists.result())


def test_results_are_frozen_short_to_print_and_survive_pickling() -> None:
    center = estimate_joint_center(*data("even").imus())
    with pytest.raises(FrozenInstanceError):
        center.status = CenterStatus.STALLED  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        center.in_sensor1 = np.zeros(3)  # type: ignore[misc]
    assert len(repr(center)) < 1500
    again = pickle.loads(pickle.dumps(center))
    assert bits(again) == bits(center)
    assert isinstance(again, CenterEstimate)
    assert again.settings == center.settings
    plain = JointCenter(np.array([0.1, 0.0, 0.0]), np.array([-0.1, 0.0, 0.0]))
    assert bits(pickle.loads(pickle.dumps(plain))) == bits(plain)
    np.testing.assert_array_equal(plain.determined_std, np.zeros(2))
    assert len(repr(plain)) < 300


def test_the_default_is_the_same_as_naming_it() -> None:
    imus = data("even").imus()
    assert bits(estimate_joint_center(*imus)) == bits(estimate_joint_center(*imus, "sa", settings=CenterSettings()))
    assert bits(estimate_joint_center(*imus)) == bits(estimate_joint_center(*imus))


@pytest.mark.parametrize("method", ["ss", "sa", "ls"])
def test_rows_stored_otherwise_are_the_same_numbers(method: str) -> None:
    sim = simulate_ball_joint(seed=8, duration_s=5.0)
    arrays = (sim.gyr1, sim.gyr_rate1_true, sim.acc1, sim.gyr2, sim.gyr_rate2_true, sim.acc2)
    how: dict[str, Any] = {"q_12": sim.q_12} if method == "ls" else {}
    strange: dict[str, Any] = {"q_12": np.asfortranarray(sim.q_12)} if method == "ls" else {}
    base = fit(*arrays, method, **how)
    assert bits(fit(*(np.asfortranarray(a) for a in arrays), method, **strange)) == bits(base)
    assert bits(fit(*(a.tolist() for a in arrays), method, **how)) == bits(base)
    assert bits(fit(*(np.repeat(a, 2, axis=0)[::2] for a in arrays), method, **how)) == bits(base)
