"""Laws of the streaming calibration: how samples are cut, stored or typed changes nothing, and bad blocks leave no trace."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    HingeCalibration,
    HingeCalibrator,
    HingeSettings,
    Imu,
    InputError,
    SettingsError,
    Verdict,
    calibrate_hinge,
    simulate_hinge,
)
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL: dict[str, Any] = {"max_samples": 120, "n_consistent": 4}
VARIANTS: dict[str, HingeSettings] = {
    "default": HingeSettings(),
    "small": HingeSettings(**SMALL),
    "raw": HingeSettings(lowpass_hz=None, step_s=0.7, **SMALL),
    "random": HingeSettings(starts="random", random_starts=2, seed=3, **SMALL),
    "published": HingeSettings.as_published(),
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


@cache
def data(kind: str) -> Samples:
    """About 30 s at 50 Hz, float32 numbers so that they can be typed otherwise without loss."""
    if kind in ("even", "timed"):
        sim = simulate_hinge("mixed", duration_s=30, seed=1)
    elif kind == "gaps":
        sim = simulate_hinge(["mixed", "free"], duration_s=17, seed=2, packet_loss=0.01, burst_length=6.0, transition_s=9.3)
    else:
        steps = np.random.default_rng(3).uniform(0.5, 1.5, 1500) / 50.0
        sim = simulate_hinge("mixed", time_s=np.cumsum(steps), seed=3)
    arrays = [a.astype(np.float32).astype(np.float64) for a in (sim.gyr1, sim.acc1, sim.gyr2, sim.acc2)]
    time = None if kind == "even" else 1234.5 + sim.time_s
    return Samples(arrays[0], arrays[1], arrays[2], arrays[3], time)


KINDS = ("even", "timed", "gaps", "irregular")


def bits(value: object) -> object:
    """Plain and comparable, arrays by their bytes."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if is_dataclass(value) and not isinstance(value, (type, HingeSettings)):
        # The chosen times are given offline only.
        return {f.name: bits(getattr(value, f.name)) for f in fields(value) if f.name not in ("gyr_time_s", "acc_time_s")}
    if isinstance(value, tuple):
        return [bits(v) for v in value]
    return repr(value)


def calibrator(variant: str) -> HingeCalibrator:
    return HingeCalibrator(50.0, settings=VARIANTS[variant], keep_steps=None)


@cache
def whole(kind: str, variant: str) -> tuple[Any, bytes]:
    """Result and state after one push of everything."""
    stream = calibrator(variant)
    return bits(stream.push(*data(kind))), stream.state()


def push_cut(stream: HingeCalibrator, samples: Samples, sizes: list[int]) -> HingeCalibration:
    """Push in blocks of the given sizes over and over; 0 is an empty block, -1 a single (3,) sample."""
    at, turn = 0, 0
    while at < len(samples.gyr1):
        size = sizes[turn % len(sizes)]
        result = stream.push(*(samples.rows(at) if size == -1 else samples.rows(slice(at, at + size))))
        at, turn = at + abs(size), turn + 1
    return result


def test_the_examples_have_what_they_are_meant_to_have() -> None:
    for kind in KINDS:
        result = calibrate_hinge(*imus(kind))
        assert result.verdict is Verdict.HINGE
        assert result.accepted
    time = data("gaps").time_s
    assert time is not None
    assert (np.diff(time) > 0.05).sum() > 5
    assert np.diff(time).max() > 9.0


def imus(kind: str) -> tuple[Imu, Imu]:
    d = data(kind)
    how: dict[str, Any] = {"rate_hz": 50.0} if d.time_s is None else {"time_s": d.time_s}
    return Imu(d.gyr1, d.acc1, **how), Imu(d.gyr2, d.acc2, **how)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(KINDS),
    variant=st.sampled_from(list(VARIANTS)),
    sizes=st.lists(st.integers(-1, 300), min_size=1, max_size=12).filter(lambda sizes: sum(map(abs, sizes)) > 20),
)
def test_any_cutting_gives_the_same_bits(kind: str, variant: str, sizes: list[int]) -> None:
    stream = calibrator(variant)
    result = push_cut(stream, data(kind), sizes)
    assert (bits(result), stream.state()) == whole(kind, variant)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sizes", [[-1], [1], [50], [49, 51, 1], [100000]])
def test_single_samples_and_even_blocks_give_the_same_bits(kind: str, sizes: list[int]) -> None:
    stream = calibrator("small")
    result = push_cut(stream, data(kind), sizes)
    assert (bits(result), stream.state()) == whole(kind, "small")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_whole_recording_is_calibrated_as_a_stream_sees_it(kind: str, variant: str) -> None:
    imu1, imu2 = imus(kind)
    # With irregular time the recording's own rate, one over its median step, is not quite 50 Hz.
    stream = HingeCalibrator(imu1.rate_hz, settings=VARIANTS[variant], keep_steps=None)
    offline = calibrate_hinge(imu1, imu2, settings=VARIANTS[variant])
    assert bits(offline) == bits(stream.push(*data(kind)))
    if kind in ("even", "timed") and not VARIANTS[variant].lowpass_hz:
        assert set(offline.gyr_time_s) | set(offline.acc_time_s) <= set(imu1.time_s)
    assert max(len(offline.gyr_time_s), len(offline.acc_time_s)) <= VARIANTS[variant].max_samples


def test_rate_and_even_time_say_the_same() -> None:
    gyr1, acc1, gyr2, acc2, _ = data("even")
    timed = calibrator("default").push(gyr1, acc1, gyr2, acc2, np.arange(len(gyr1)) / 50.0)
    assert bits(timed) == whole("even", "default")[0]


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    kind=st.sampled_from(KINDS),
    variant=st.sampled_from(list(VARIANTS)),
    cuts=st.lists(st.integers(0, 1400), min_size=1, max_size=3).map(sorted),
)
def test_a_stream_saved_and_restored_goes_on_as_if_nothing_had_happened(kind: str, variant: str, cuts: list[int]) -> None:
    stream, at = calibrator(variant), 0
    for cut in cuts:
        stream.push(*data(kind).rows(slice(at, cut)))
        stream, before, at = HingeCalibrator.restore(stream.state()), stream, cut
        assert stream.state() == before.state()
        assert bits(stream.result()) == bits(before.result())
    result = stream.push(*data(kind).rows(slice(at, None)))
    assert (bits(result), stream.state()) == whole(kind, variant)


def test_reading_the_result_or_the_state_changes_nothing() -> None:
    stream = calibrator("small")
    for at in range(0, 1500, 75):
        stream.push(*data("even").rows(slice(at, at + 75)))
        assert stream.state() == stream.state()
        assert bits(stream.result()) == bits(stream.result())
    assert stream.state() == whole("even", "small")[1]


def test_memory_stays_what_it_is_over_hours() -> None:
    # 12 h at 50 Hz in ten minutes' blocks, each the same motion: measured 282 to 373 kB, the first after the first block.
    sim = simulate_hinge("mixed", duration_s=600, seed=1)
    stream = HingeCalibrator(50.0, keep_steps=60)
    sizes = []
    for _ in range(72):
        result = stream.push(sim.gyr1, sim.acc1, sim.gyr2, sim.acc2)
        sizes.append(len(stream.state()))
        assert len(result.history) == 60
    assert result.history[-1].time_s == 72 * 600 - 1
    assert max(sizes[36:]) < 1.03 * max(sizes[:36])
    assert max(sizes) < 450_000


def test_a_stream_that_nobody_asks_forgets_its_steps_and_offline_keeps_all() -> None:
    d = data("even")
    short = HingeCalibrator(50.0, keep_steps=5, **SMALL).push(*d)
    all_steps = calibrate_hinge(*imus("even"), **SMALL).history
    assert [step.time_s for step in all_steps] == [float(k) for k in range(1, 30)]
    assert bits(short.history) == bits(all_steps[-5:])


TYPED: dict[str, Callable[[Array], Any]] = {
    "float32": lambda a: a.astype(np.float32),
    "lists": lambda a: a.tolist(),
    "big-endian": lambda a: a.astype(">f8"),
    "Fortran order": np.asfortranarray,
    "every second row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "backwards in memory": lambda a: np.ascontiguousarray(a[::-1])[::-1],
    "columns of a table": lambda a: np.hstack([a, a])[:, a.shape[1] :],
    "read-only": lambda a: np.frombuffer(a.tobytes()).reshape(a.shape),
    "objects": lambda a: a.astype(object),
}


@pytest.mark.parametrize("how", TYPED)
def test_how_numbers_are_stored_does_not_matter(how: str) -> None:
    stream = calibrator("small")
    gyr1, acc1, gyr2, acc2 = (TYPED[how](a) for a in data("even")[:4])
    result = stream.push(gyr1, acc1, gyr2, acc2)
    assert (bits(result), stream.state()) == whole("even", "small")


@pytest.mark.parametrize("how", [how for how in TYPED if how != "float32"])  # which would be another time
def test_how_times_are_stored_does_not_matter(how: str) -> None:
    stream = calibrator("small")
    gyr1, acc1, gyr2, acc2, time_s = data("gaps")
    assert time_s is not None
    column = TYPED[how](time_s[:, None])
    stored = [row[0] for row in column] if isinstance(column, list) else column[:, 0]
    result = stream.push(gyr1, acc1, gyr2, acc2, stored)
    assert (bits(result), stream.state()) == whole("gaps", "small")


@pytest.mark.parametrize("how", TYPED)
def test_single_samples_may_be_stored_in_any_way_too(how: str) -> None:
    samples, stream, plain = data("timed"), calibrator("small"), calibrator("small")
    assert samples.time_s is not None
    for k in range(120):
        gyr1, acc1, gyr2, acc2 = (TYPED[how](a[k : k + 1])[0] for a in samples[:4])
        stream.push(gyr1, acc1, gyr2, acc2, float(samples.time_s[k]))
        plain.push(*samples.rows(k))
    assert stream.state() == plain.state()


GOOD = np.ones((5, 3)) * [0.1, 0.2, 9.0]


def with_nan(value: float) -> Array:
    bad: Array = GOOD.copy()
    bad[-1, -1] = value
    return bad


# Times of a good block of five after 1.0 s: 1.02 and so on.
BAD_BLOCKS: dict[str, tuple[dict[str, Any], str]] = {
    **{f"{name} NaN": ({name: with_nan(np.nan)}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} infinite": ({name: with_nan(-np.inf)}, name) for name in ("gyr1", "acc2")},
    **{f"{name} absurd": ({name: with_nan(1e12)}, name) for name in ("acc1", "gyr2")},
    **{f"{name} too short": ({name: GOOD[:4]}, name) for name in ("acc1", "gyr2", "acc2")},
    **{f"{name} one sample": ({name: GOOD[0]}, name) for name in ("acc1", "acc2")},
    **{f"{name} transposed": ({name: GOOD.T}, name) for name in ("gyr1", "acc2")},
    **{f"{name} four columns": ({name: np.ones((5, 4))}, name) for name in ("gyr1", "acc1")},
    **{f"{name} a cube": ({name: GOOD[None]}, name) for name in ("gyr1", "gyr2")},
    **{f"{name} text": ({name: "five samples"}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} None": ({name: None}, name) for name in ("gyr1", "acc1", "gyr2", "acc2")},
    **{f"{name} ragged": ({name: [[1.0, 2.0, 3.0], [1.0]]}, name) for name in ("gyr1", "acc2")},
    "time goes back at once": ({"time_s": 0.5 + np.arange(5) / 50}, "time_s"),
    "time stands still at once": ({"time_s": 1.0 + np.arange(5) / 50}, "time_s"),
    "time goes back within": ({"time_s": np.array([1.02, 1.04, 1.03, 1.08, 1.1])}, "time_s"),
    "time stands still within": ({"time_s": np.array([1.02, 1.04, 1.04, 1.08, 1.1])}, "time_s"),
    "time NaN": ({"time_s": np.array([1.02, 1.04, np.nan, 1.08, 1.1])}, "time_s"),
    "time infinite": ({"time_s": np.array([1.02, 1.04, 1.06, 1.08, np.inf])}, "time_s"),
    "time too short": ({"time_s": 1.02 + np.arange(4) / 50}, "time_s"),
    "time a number": ({"time_s": 1.02}, "time_s"),
    "time text": ({"time_s": "now"}, "time_s"),
    "time forgotten": ({"time_s": None}, "time_s"),
}


@pytest.mark.parametrize("case", BAD_BLOCKS)
def test_a_bad_block_is_refused_by_name_and_leaves_no_trace(case: str) -> None:
    changes, named = BAD_BLOCKS[case]
    stream, untouched = calibrator("small"), calibrator("small")
    timed = data("even")._replace(time_s=np.arange(1500) / 50.0)
    for s in (stream, untouched):
        s.push(*timed.rows(slice(0, 51)))
    before = stream.state()
    good: dict[str, Any] = dict.fromkeys(("gyr1", "acc1", "gyr2", "acc2"), GOOD) | {"time_s": 1.02 + np.arange(5) / 50}
    with pytest.raises(InputError, match=rf"\b{named}\b"):
        stream.push(**good | changes)
    assert stream.state() == before
    for s in (stream, untouched):
        s.push(*timed.rows(slice(51, 400)))
    assert stream.state() == untouched.state()


def test_time_cannot_come_later_than_the_samples_before_it() -> None:
    stream = calibrator("small")
    stream.push(*data("even").rows(slice(0, 60)))
    before = stream.state()
    with pytest.raises(InputError, match="time_s must be given with every call or with none"):
        stream.push(GOOD, GOOD, GOOD, GOOD, time_s=10.0 + np.arange(5) / 50)
    assert stream.state() == before


def test_a_refused_first_block_decides_nothing() -> None:
    stream = calibrator("small")
    with pytest.raises(InputError, match="time_s"):
        stream.push(GOOD, GOOD, GOOD, GOOD, time_s=np.zeros(5))
    with pytest.raises(InputError, match="gyr2"):
        stream.push(GOOD, GOOD, with_nan(np.nan), GOOD)
    result = stream.push(*data("gaps"))
    assert (bits(result), stream.state()) == whole("gaps", "small")


@pytest.mark.parametrize(
    ("rate_hz", "keywords", "error", "named"),
    [
        (0.0, {}, InputError, "rate_hz"),
        (-50.0, {}, InputError, "rate_hz"),
        (float("nan"), {}, InputError, "rate_hz"),
        (float("inf"), {}, InputError, "rate_hz"),
        ("50", {}, InputError, "rate_hz"),
        (True, {}, InputError, "rate_hz"),
        (50.0, {"keep_steps": 0}, InputError, "keep_steps"),
        (50.0, {"keep_steps": 2.0}, InputError, "keep_steps"),
        (50.0, {"n_min": 3}, SettingsError, "n_min"),
        (50.0, {"settings": {"n_consistent": 3}}, SettingsError, "settings"),
    ],
)
def test_what_is_no_stream_is_refused_by_name(rate_hz: Any, keywords: dict[str, Any], error: Any, named: str) -> None:
    with pytest.raises(error, match=named):
        HingeCalibrator(rate_hz, **keywords)


def test_a_rate_beyond_the_low_pass_is_refused_as_all_input_is() -> None:
    with pytest.raises(InputError, match="rate_hz"):
        HingeCalibrator(5e6)


@pytest.mark.parametrize("rate_hz", [np.int64(50), np.float32(50.0)])
def test_a_rate_of_numpy_is_a_rate(rate_hz: Any) -> None:
    assert HingeCalibrator(rate_hz).result().verdict is Verdict.NOT_ENOUGH_INFORMATION


def test_more_steps_than_memory_can_count_are_refused() -> None:
    with pytest.raises(InputError, match="keep_steps"):
        HingeCalibrator(50.0, keep_steps=10**30)
