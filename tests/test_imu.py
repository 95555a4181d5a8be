"""Imu and Recording: what they accept, what they keep, and what a gap is."""

from __future__ import annotations

import pickle
from typing import Any

import imufast
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

GRAVITY = [0.0, 0.0, 9.81]


def signals(rows: int, seed: int = 0) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, 3)), rng.normal(scale=0.1, size=(rows, 3)) + GRAVITY


def test_arrays_that_fit_are_viewed_and_their_owner_may_still_write() -> None:
    gyr, acc = signals(50)
    imu = imufast.Imu(gyr, acc, 100.0)
    assert np.shares_memory(imu.gyr, gyr)
    assert np.shares_memory(imu.acc, acc)
    assert gyr.flags.writeable
    assert not imu.gyr.flags.writeable
    assert not imu.time_s.flags.writeable


@pytest.mark.parametrize(
    "convert", [np.float32, np.asfortranarray, lambda x: x[::1][:, ::1].tolist(), lambda x: x.astype(">f8")]
)
def test_any_layout_and_number_type_gives_the_same_samples(convert: Any) -> None:
    gyr, acc = (np.round(x * 64) / 64 for x in signals(40))  # exact in float32
    imu = imufast.Imu(convert(gyr), convert(acc), rate_hz=50)
    np.testing.assert_array_equal(imu.gyr, gyr)
    np.testing.assert_array_equal(imu.acc, acc)
    assert imu.gyr.dtype == np.float64
    assert imu.gyr.flags.c_contiguous


def test_it_cannot_be_changed() -> None:
    imu = imufast.Imu(*signals(5), rate_hz=100.0)
    with pytest.raises(AttributeError):
        imu.rate_hz = 3.0  # type: ignore[misc]
    with pytest.raises(AttributeError):
        imu.color = "red"  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="read-only"):
        imu.gyr[0, 0] = 1.0


def test_time_from_a_rate_and_back() -> None:
    imu = imufast.Imu(*signals(201), rate_hz=100.0)
    np.testing.assert_allclose(imu.time_s, np.arange(201) / 100, rtol=1e-15)
    assert imu.duration_s == pytest.approx(2.0)
    again = imufast.Imu(imu.gyr, imu.acc, time_s=imu.time_s + 7.0)
    assert again.rate_hz == pytest.approx(100.0)
    assert (imu.lost, len(imu.gaps), imu.segments()) == (0, 0, [(0, 201)])


def test_a_rate_that_contradicts_the_times_warns_here() -> None:
    time = np.arange(20) / 100
    with pytest.warns(imufast.ImufastWarning, match="contradicts time_s") as caught:
        imu = imufast.Imu(*signals(20), rate_hz=128, time_s=time)
    assert caught[0].filename == __file__
    assert imu.rate_hz == pytest.approx(100.0)
    imufast.Imu(*signals(20), rate_hz=101, time_s=time)


def test_one_lost_sample_is_a_gap_and_two_are_a_break() -> None:
    kept = np.delete(np.arange(30), [5, 12, 13, 20, 21, 22])
    gyr, acc = signals(30)
    imu = imufast.Imu(gyr[kept], acc[kept], time_s=kept / 50)
    assert imu.lost == 6
    np.testing.assert_array_equal(imu.gaps, [[5, 1], [11, 2], [17, 3]])
    assert imu.segments() == [(0, 11), (11, 17), (17, 24)]


@given(st.lists(st.integers(1, 9), min_size=12, max_size=60), st.floats(0.5, 2000), st.floats(-1e5, 1e5))
@settings(max_examples=60, deadline=None)
def test_gaps_count_exactly_what_is_missing(extra: list[int], rate: float, start: float) -> None:
    """Every third step may be longer: the median step stays one sample."""
    steps = [step if k % 3 == 0 else 1 for k, step in enumerate(extra)]
    counts = np.concatenate([[0], np.cumsum(steps)])
    gyr, acc = signals(len(counts))
    with pytest.warns(imufast.ImufastWarning) if rate < 1.99 else _quiet():
        imu = imufast.Imu(gyr, acc, time_s=start + counts / rate) if abs(rate - 2) > 0.02 else imufast.Imu(gyr, acc, 100)
    if abs(rate - 2) > 0.02:
        assert imu.lost == sum(steps) - len(steps)
        pieces = imu.segments()
        assert [piece[0] for piece in pieces[1:]] == [k + 1 for k, step in enumerate(steps) if step > 2]
        assert (pieces[0][0], pieces[-1][1]) == (0, len(counts))


class _quiet:  # noqa: N801
    def __enter__(self) -> None: ...
    def __exit__(self, *_: object) -> None: ...


def test_slices_keep_the_recordings_own_time_and_rate() -> None:
    imu = imufast.Imu(*signals(100), rate_hz=50.0, name="thigh")
    part = imu[10:20]
    assert (len(part), part.name, part.rate_hz) == (10, "thigh", 50.0)
    assert part.time_s[0] == imu.time_s[10]
    assert np.shares_memory(part.gyr, imu.gyr)
    np.testing.assert_array_equal(imu.between(0.2, 0.4).gyr, part.gyr)
    np.testing.assert_array_equal(imu.between(None, 0.2).acc, imu.acc[:10])
    assert len(imu[-1:]) == 1


@pytest.mark.parametrize(
    ("units", "gyr_factor", "acc_factor"),
    [
        ("deg/s", np.pi / 180, 1.0),
        ("°/s, m/s²", np.pi / 180, 1.0),
        ("dps, g", np.pi / 180, 9.80665),
        ("mG", 1.0, 9.80665e-3),
        ("rad/s; m/s^2", 1.0, 1.0),
        ("SI", 1.0, 1.0),
        ({"gyr": "deg/s", "acc": "g"}, np.pi / 180, 9.80665),
        ({"acc": "m/(s^2)"}, 1.0, 1.0),
    ],
)
def test_units_convert(units: Any, gyr_factor: float, acc_factor: float) -> None:
    gyr, acc = signals(10)
    imu = imufast.Imu(gyr / gyr_factor, acc / acc_factor, 100.0, units=units)
    np.testing.assert_allclose(imu.gyr, gyr, rtol=1e-14)
    np.testing.assert_allclose(imu.acc, acc, rtol=1e-14)


def test_pickle_and_repr() -> None:
    imu = imufast.Imu(*signals(10), rate_hz=100.0, name="shank")
    again = pickle.loads(pickle.dumps(imu))
    np.testing.assert_array_equal(again.gyr, imu.gyr)
    assert not again.gyr.flags.writeable
    assert repr(again) == repr(imu) == "Imu('shank', 10 samples, 100 Hz, 0 to 0.09 s)"


def test_a_recording_is_a_mapping_on_one_time_base() -> None:
    thigh = imufast.Imu(*signals(30), rate_hz=100.0)
    shank = imufast.Imu(*signals(30, seed=1), time_s=np.arange(30) / 100)
    rec = imufast.Recording({"thigh": thigh, "shank": shank})
    assert list(rec) == ["thigh", "shank"]
    assert (rec["thigh"].name, rec["shank"].name) == ("thigh", "shank")
    assert rec["shank"].time_s is rec.time_s
    assert [imu.name for imu in rec.pair()] == ["thigh", "shank"]
    assert [imu.name for imu in rec.pair("shank", "thigh")] == ["shank", "thigh"]
    part = rec.between(0.1, 0.2)
    assert (len(part), len(part.time_s)) == (2, 10)
    assert "thigh" in repr(rec)
    assert rec.info == {}
    assert "pelvis" not in rec
    with pytest.raises(KeyError, match=r"'pelvis'.*'thigh', 'shank'"):
        rec["pelvis"]


anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.binary(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=2), inner, max_size=2),
    max_leaves=8,
)
array = hnp.arrays(
    hnp.scalar_dtypes() | st.sampled_from([np.dtype(np.float64)] * 3),
    st.tuples(st.integers(0, 4), st.just(3)) | hnp.array_shapes(max_dims=3, max_side=4),
)


@given(anything | array, anything | array, anything | st.floats(), anything | array, anything, anything)
@settings(max_examples=300, deadline=None)
@pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")
def test_no_input_gets_through_but_as_an_imufast_error(gyr: Any, acc: Any, rate: Any, time: Any, name: Any, units: Any) -> None:
    for arguments in (
        {"gyr": gyr, "acc": acc, "rate_hz": rate, "time_s": time, "name": name, "units": units},
        {"gyr": gyr, "acc": gyr, "rate_hz": rate},
        {"gyr": np.ones((3, 3)), "acc": np.ones((3, 3)), "rate_hz": rate, "time_s": time, "name": name},
        {"gyr": gyr, "acc": acc, "rate_hz": 100.0, "units": units},
    ):
        try:
            imu = imufast.Imu(**arguments)
        except imufast.ImufastError:
            continue
        assert len(imu) == len(imu.time_s) > 0
        assert np.isfinite(imu.time_s).all()
        assert imu.segments()[-1][1] == len(imu)
        assert imu.lost >= 0
