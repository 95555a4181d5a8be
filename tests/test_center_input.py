"""What is no input is refused by name, every setting changes something, and nothing panics."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass, fields
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    BallJointSimulation,
    CenterSettings,
    CenterStatus,
    Imu,
    InputError,
    JointCenterEstimator,
    SettingsError,
    estimate_joint_center,
    fit_joint_center,
    simulate_ball_joint,
)
from numpy.typing import NDArray

Array = NDArray[np.float64]
fit: Any = fit_joint_center  # called with what its types forbid


@cache
def sim() -> BallJointSimulation:
    return simulate_ball_joint(
        ("stationary", "random"), duration_s=12.0, seed=1, acc_bias1=(0.2, 0.1, -0.1), gyr_bias2=(0.01, 0.02, 0.0)
    )


def moments() -> dict[str, Array]:
    s = sim()
    names = ("gyr1", "gyr_dot1", "acc1", "gyr2", "gyr_dot2", "acc2")
    return dict(zip(names, (s.gyr1, s.gyr_rate1_true, s.acc1, s.gyr2, s.gyr_rate2_true, s.acc2), strict=True))


@dataclass
class Axis:
    axis1: Any
    axis2: Any


BAD_CALLS: dict[str, tuple[dict[str, Any], Any, str]] = {
    "unknown method": ({"method": "gn"}, SettingsError, "method"),
    "method in capitals": ({"method": "SA"}, SettingsError, "method"),
    "method None": ({"method": None}, SettingsError, "method"),
    "unknown setting": ({"cutoff": 3.0}, SettingsError, "cutoff"),
    "settings a dict": ({"settings": {"robust": True}}, SettingsError, "settings"),
    "ls without q_12": ({"method": "ls"}, InputError, "q_12"),
    "sa with q_12": ({"method": "sa", "q_12": "good"}, InputError, "q_12"),
    "axis none": ({"axis": 3}, InputError, "axis1"),
    "axis not found": ({"axis": Axis(None, None)}, InputError, "axis1"),
    "axis not unit": ({"axis": Axis(np.ones(3), np.array([1.0, 0.0, 0.0]))}, InputError, "axis1"),
    "axis NaN": ({"axis": Axis(np.array([1.0, 0.0, 0.0]), np.full(3, np.nan))}, InputError, "axis2"),
    "axis of shape": ({"axis": Axis(np.eye(3)[:1], np.eye(3)[:1])}, InputError, "axis1"),
}


@pytest.mark.parametrize("case", BAD_CALLS)
def test_a_bad_call_is_refused_by_name(case: str) -> None:
    keywords, error, named = BAD_CALLS[case]
    keywords = {name: sim().q_12 if isinstance(value, str) and value == "good" else value for name, value in keywords.items()}
    with pytest.raises(error, match=named):
        estimate_joint_center(sim().imu1, sim().imu2, **keywords)
    with pytest.raises(error, match=named):
        fit(**moments(), **keywords)


BAD_QUATERNIONS: dict[str, Any] = {
    "too few": lambda q: q[:-1],
    "three numbers": lambda q: q[:, :3],
    "not unit": lambda q: 1.1 * q,
    "zero": lambda q: 0.0 * q,
    "NaN": lambda q: np.where(np.arange(len(q))[:, None] == 7, np.nan, q),
    "text": lambda q: "identity",
    "one": lambda q: q[0],
}


@pytest.mark.parametrize("how", BAD_QUATERNIONS)
def test_bad_quaternions_are_refused_by_name(how: str) -> None:
    bad = BAD_QUATERNIONS[how](sim().q_12)
    with pytest.raises(InputError, match="q_12"):
        estimate_joint_center(sim().imu1, sim().imu2, "ls", q_12=bad)
    with pytest.raises(InputError, match="q_12"):
        fit(**moments(), method="ls", q_12=bad)


def test_what_are_no_two_imus_is_refused() -> None:
    imu1, imu2 = sim().imu1, sim().imu2
    with pytest.raises(InputError, match="imu2"):
        estimate_joint_center(imu1, imu2.gyr)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="imu1"):
        estimate_joint_center(None, imu2)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"samples|time"):
        estimate_joint_center(imu1[:100], imu2)
    with pytest.raises(InputError, match="time"):
        estimate_joint_center(imu1[:100], imu2[1:101])
    with pytest.raises(InputError, match="at least 4"):
        estimate_joint_center(imu1[:3], imu2[:3])


BAD_ARRAYS: dict[str, Any] = {
    "NaN": lambda a: np.where(np.arange(len(a))[:, None] == 3, np.nan, a),
    "infinite": lambda a: np.where(np.arange(len(a))[:, None] == 3, np.inf, a),
    "too short": lambda a: a[:-1],
    "four columns": lambda a: np.hstack([a, a[:, :1]]),
    "flat": lambda a: a.ravel(),
    "a cube": lambda a: a[None],
    "text": lambda a: "values",
    "None": lambda a: None,
    "empty": lambda a: a[:0],
}


@pytest.mark.parametrize("name", ["gyr1", "gyr_dot1", "acc1", "gyr2", "gyr_dot2", "acc2"])
@pytest.mark.parametrize("how", BAD_ARRAYS)
def test_bad_moments_are_refused_by_name(name: str, how: str) -> None:
    with pytest.raises(InputError, match=rf"\b{name}\b|gyr1"):
        fit(**moments() | {name: BAD_ARRAYS[how](moments()[name])})


@pytest.mark.parametrize("time_s", [[0.0, 1.0], np.zeros((2424, 1)), "now", np.arange(5000.0)[::-1]])
def test_bad_times_are_refused_by_name(time_s: Any) -> None:
    with pytest.raises(InputError, match="time_s"):
        fit(**moments(), time_s=time_s)


def test_moments_too_few_are_refused() -> None:
    few = {name: array[:3] for name, array in moments().items()}
    with pytest.raises(InputError, match="at least 4"):
        fit(**few)
    with pytest.raises(InputError):
        fit(**{name: array[:0] for name, array in moments().items()})


BAD_SETTINGS: list[tuple[str, Any]] = [
    *(("lowpass_hz", v) for v in (-1.0, np.nan, np.inf, "5", True, 0.001)),
    *(("derivative", v) for v in ("five", None, 5)),
    *(("least_rate", v) for v in (-0.1, np.nan, None, 1e9)),
    *(("acc_bias_std", v) for v in (-0.1, np.nan, np.inf, "0.3")),
    *(("lever_std", v) for v in (0.0, -1.0, np.nan, None)),
    *(("robust", v) for v in (1, None, "yes")),
    *(("minimum_norm", v) for v in (1, None)),
    *(("max_samples", v) for v in (0, 19, 100.5, -5, None, True, 10**12)),
    *(("bias_from_rest", v) for v in (0, None)),
    *(("undetermined_std", v) for v in (0.0, -1.0, np.nan, None)),
    *(("max_iterations", v) for v in (0, 1.5, None, 10**9)),
]


@pytest.mark.parametrize(("name", "value"), BAD_SETTINGS)
def test_a_setting_out_of_its_range_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(SettingsError, match=name):
        CenterSettings(**{name: value})
    with pytest.raises(SettingsError, match=name):
        estimate_joint_center(sim().imu1, sim().imu2, **{name: value})
    with pytest.raises(SettingsError, match=name):
        JointCenterEstimator(100.0, **{name: value})


def test_settings_are_frozen() -> None:
    with pytest.raises(FrozenInstanceError):
        CenterSettings().robust = True  # type: ignore[misc]


# Another value of each setting, and with which method and which settings beside it that must show.
CHANGES: dict[str, tuple[Any, str, dict[str, Any]]] = {
    "lowpass_hz": (4.0, "sa", {}),
    "derivative": ("three-point", "ss", {"lowpass_hz": None}),
    "least_rate": (1.2, "sa", {}),
    "acc_bias_std": (0.01, "sa", {}),
    "lever_std": (0.01, "sa", {}),
    "robust": (True, "ss", {}),
    "max_samples": (25, "sa", {}),
    "bias_from_rest": (False, "sa", {}),
    "undetermined_std": (1e-5, "sa", {}),
    "minimum_norm": (False, "sa", {}),
    "max_iterations": (1, "sa", {}),
    "gyr_bias_std": (0.1, "sa", {"bias_from_rest": False}),
    "gyr_bias_rest_std": (0.1, "sa", {}),
}


@pytest.mark.parametrize("name", [f.name for f in fields(CenterSettings)])
def test_every_setting_changes_something(name: str) -> None:
    value, method, beside = CHANGES[name]
    # Only where a direction is open does the smallest centre differ from any other.
    data = simulate_ball_joint(duration_s=30.0, dof=1, seed=1) if name == "minimum_norm" else sim()
    plain = estimate_joint_center(data.imu1, data.imu2, method, **beside)
    changed = estimate_joint_center(data.imu1, data.imu2, method, **beside | {name: value})

    def numbers(center: Any) -> list[Any]:
        return [center.in_sensor1.tolist(), center.covariance.tolist(), center.undetermined.tolist(), center.status]

    assert numbers(plain) != numbers(changed)


@pytest.mark.parametrize(
    ("rate_hz", "keywords", "error", "named"),
    [
        (0.0, {}, InputError, "rate_hz"),
        (-1.0, {}, InputError, "rate_hz"),
        (float("nan"), {}, InputError, "rate_hz"),
        (float("inf"), {}, InputError, "rate_hz"),
        ("100", {}, InputError, "rate_hz"),
        (True, {}, InputError, "rate_hz"),
        (1e8, {}, InputError, "rate_hz"),
        (100.0, {"method": "ls"}, SettingsError, "ls"),
        (100.0, {"method": "gn"}, SettingsError, "method"),
        (100.0, {"settings": {}}, SettingsError, "settings"),
        (100.0, {"axis": 1}, InputError, "axis"),
    ],
)
def test_what_is_no_stream_is_refused_by_name(rate_hz: Any, keywords: dict[str, Any], error: Any, named: str) -> None:
    with pytest.raises(error, match=named):
        JointCenterEstimator(rate_hz, **keywords)


GOOD = np.ones((5, 3)) * [0.1, 0.2, 9.0]


def changed(value: float) -> Array:
    bad: Array = GOOD.copy()
    bad[-1, -1] = value
    return bad


BAD_BLOCKS: dict[str, tuple[dict[str, Any], str]] = {
    **{f"{name} NaN": ({name: changed(np.nan)}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} infinite": ({name: changed(-np.inf)}, name) for name in ("gyr1", "acc2")},
    **{f"{name} absurd": ({name: changed(1e12)}, name) for name in ("acc1", "gyr2")},
    **{f"{name} too short": ({name: GOOD[:4]}, name) for name in ("acc1", "gyr2", "acc2")},
    **{f"{name} transposed": ({name: GOOD.T}, name) for name in ("gyr1", "acc2")},
    **{f"{name} a cube": ({name: GOOD[None]}, name) for name in ("gyr1", "gyr2")},
    **{f"{name} text": ({name: "five"}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} None": ({name: None}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} ragged": ({name: [[1.0, 2.0, 3.0], [1.0]]}, name) for name in ("gyr1", "acc2")},
    "time goes back at once": ({"time_s": 0.5 + np.arange(5) / 100}, "time_s"),
    "time stands still within": ({"time_s": np.array([1.02, 1.04, 1.04, 1.08, 1.1])}, "time_s"),
    "time NaN": ({"time_s": np.array([1.02, 1.04, np.nan, 1.08, 1.1])}, "time_s"),
    "time too short": ({"time_s": 1.02 + np.arange(4) / 100}, "time_s"),
    "time text": ({"time_s": "now"}, "time_s"),
    "time forgotten": ({"time_s": None}, "time_s"),
}


@pytest.mark.parametrize("case", BAD_BLOCKS)
def test_a_bad_block_is_refused_by_name_and_leaves_no_trace(case: str) -> None:
    changes, named = BAD_BLOCKS[case]
    s = simulate_ball_joint(seed=2, duration_s=4.0)
    streams = [JointCenterEstimator(100.0, lowpass_hz=None) for _ in range(2)]
    for stream in streams:
        stream.push(s.gyr1[:101], s.acc1[:101], s.gyr2[:101], s.acc2[:101], s.time_s[:101])
    good: dict[str, Any] = dict.fromkeys(("gyr1", "acc1", "gyr2", "acc2"), GOOD) | {"time_s": 1.02 + np.arange(5) / 100}
    with pytest.raises(InputError, match=rf"\b{named}\b"):
        streams[0].push(**good | changes)
    for stream in streams:
        stream.push(s.gyr1[101:], s.acc1[101:], s.gyr2[101:], s.acc2[101:], s.time_s[101:])
    one, other = (stream.result() for stream in streams)
    np.testing.assert_array_equal(one.in_sensor1, other.in_sensor1)
    np.testing.assert_array_equal(one.covariance, other.covariance)
    assert one.n_samples == other.n_samples


numbers = st.floats(-1e6, 1e6, allow_nan=False) | st.sampled_from([0.0, 1e-300, 1e-12, 1.0, 9.81, 1e8, -1e8])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    count=st.integers(4, 40),
    values=st.lists(numbers, min_size=1, max_size=30),
    method=st.sampled_from(["ss", "sa", "ls"]),
    chosen=st.sampled_from([CenterSettings(), CenterSettings.as_published(), CenterSettings(robust=True)]),
    repeat=st.booleans(),
)
def test_any_finite_numbers_give_a_status(
    count: int, values: list[float], method: str, chosen: CenterSettings, repeat: bool
) -> None:
    rows = np.resize(np.array(values), (6, count, 3))
    if repeat:
        rows = np.repeat(rows[:, :1], count, axis=1)
    how: dict[str, Any] = {"q_12": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))} if method == "ls" else {}
    center = fit(*rows, method, settings=chosen, **how)
    assert isinstance(center.status, CenterStatus)
    assert np.isfinite(center.in_sensor1).all()
    assert np.isfinite(center.in_sensor2).all()
    assert center.undetermined.shape == (len(center.undetermined), 6)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    count=st.integers(0, 400),
    size=st.sampled_from([0.0, 1e-9, 1.0, 1e3, 1e8]),
    seed=st.integers(0, 1000),
    variant=st.sampled_from([CenterSettings(), CenterSettings.as_published(), CenterSettings(max_samples=20, lowpass_hz=30.0)]),
    timed=st.booleans(),
)
def test_any_stream_of_finite_numbers_gives_a_status(
    count: int, size: float, seed: int, variant: CenterSettings, timed: bool
) -> None:
    rng = np.random.default_rng(seed)
    arrays: Any = [size * rng.normal(size=(count, 3)) for _ in range(4)]
    time = np.cumsum(rng.exponential(0.01, count)) if timed else None
    stream: Any = JointCenterEstimator(100.0, settings=variant)
    stream.push(*arrays, time)
    center = stream.result()
    assert isinstance(center.status, CenterStatus)
    assert np.isfinite(center.in_sensor1).all()
    assert np.isfinite(center.in_sensor2).all()


def test_wrong_units_do_not_pass_for_a_good_centre() -> None:
    # Rates in deg/s that say they are rad/s.
    s = simulate_ball_joint(seed=3, duration_s=20.0)
    center = fit_joint_center(
        np.degrees(s.gyr1), np.degrees(s.gyr_rate1_true), s.acc1, np.degrees(s.gyr2), np.degrees(s.gyr_rate2_true), s.acc2
    )
    assert center.status is CenterStatus.NOT_IDENTIFIABLE


def test_imus_with_stated_units_give_the_same_centre() -> None:
    s = simulate_ball_joint(seed=3, duration_s=20.0)
    other: Any = (Imu(np.degrees(g), a / 9.80665, 100.0, units="deg/s, g") for g, a in ((s.gyr1, s.acc1), (s.gyr2, s.acc2)))
    one, two = estimate_joint_center(s.imu1, s.imu2), estimate_joint_center(*other)
    np.testing.assert_allclose(one.in_sensor1, two.in_sensor1, atol=1e-5)
    np.testing.assert_allclose(one.in_sensor2, two.in_sensor2, atol=1e-5)
