"""The border between Python and Rust: whatever arrives, an answer or an ordinary exception, never a panic, abort or hang."""

from __future__ import annotations

import subprocess
import sys
import time
import warnings
from typing import Any

import imufast
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from imufast import _core
from numpy.typing import NDArray

Array = NDArray[np.float64]
# What Python code expects from wrong arguments; a Rust panic is none of these (its class derives from BaseException).
ORDINARY = (ValueError, TypeError, OverflowError)
STATUSES = {status.value for status in imufast.SolveStatus}


def arguments(**changes: Any) -> list[Any]:
    """Good arguments of `hinge_axis`, some exchanged."""
    rng = np.random.default_rng(0)
    values: dict[str, Any] = {name: rng.standard_normal((40, 3)) for name in ("gyr1", "acc1", "gyr2", "acc2")}
    values |= {"time_s": np.arange(40) / 50.0, "gyr_index": None, "acc_index": None}
    values |= {"weight_ratio": 50.0, "starts": None, "max_iterations": 100}
    assert changes.keys() <= values.keys()
    return list((values | changes).values())


GOOD = np.random.default_rng(1).standard_normal((40, 3))
WRONG_VECTORS: dict[str, Any] = {
    "four columns": np.zeros((40, 4)),
    "two columns": np.zeros((40, 2)),
    "transposed": np.zeros((3, 40)),
    "flat": np.zeros(120),
    "cube": np.zeros((4, 10, 3)),
    "no axis": np.array(1.0),
    "float32": GOOD.astype(np.float32),
    "int64": GOOD.astype(np.int64),
    "complex": GOOD.astype(complex),
    "objects": GOOD.astype(object),
    "other byte order": GOOD.astype(GOOD.dtype.newbyteorder()),
    "every second row": np.repeat(GOOD, 2, axis=0)[::2],
    "backwards": GOOD[::-1],
    "columns cut out": np.zeros((40, 5))[:, 1:4],
    "broadcast": np.broadcast_to(np.zeros(3), (40, 3)),
    "too short": GOOD[:39],
    "too long": np.zeros((41, 3)),
    "a list": GOOD.tolist(),
    "None": None,
    "a string": "gyr",
    "a number": 1.0,
}


@pytest.mark.parametrize("which", ["gyr1", "acc1", "gyr2", "acc2"])
@pytest.mark.parametrize("case", WRONG_VECTORS)
def test_arrays_that_are_not_contiguous_float64_rows_are_refused(case: str, which: str) -> None:
    with pytest.raises(ORDINARY):
        _core.hinge_axis(*arguments(**{which: WRONG_VECTORS[case]}))
    g1, a1, g2, a2, t = arguments(**{which: WRONG_VECTORS[case]})[:5]
    with pytest.raises(ORDINARY):
        _core.condition(g1, a1, g2, a2, t, 50.0, 4.0)


@pytest.mark.parametrize("case", ["four columns", "every second row", "too short"])
def test_the_message_names_the_array_and_what_arrived(case: str) -> None:
    with pytest.raises(ValueError, match=r"acc2"):
        _core.hinge_axis(*arguments(acc2=WRONG_VECTORS[case]))


@pytest.mark.parametrize("which", ["gyr1", "acc1", "gyr2", "acc2"])
def test_an_array_in_fortran_order_is_refused(which: str) -> None:
    with pytest.raises(ValueError, match=rf"{which} must be a C-contiguous float64 array"):
        _core.hinge_axis(*arguments(**{which: np.asfortranarray(GOOD)}))
    g1, a1, g2, a2, t = arguments(**{which: np.asfortranarray(GOOD)})[:5]
    with pytest.raises(ValueError, match=which):
        _core.condition(g1, a1, g2, a2, t, 50.0, 4.0)
    with pytest.raises(ValueError, match=which):
        _core.select_samples(g1, a1, g2, a2, t, 50.0, 20, 0.1, 1.0)


def test_starts_in_fortran_order_are_refused() -> None:
    starts = np.asfortranarray(np.random.default_rng(3).standard_normal((2, 2, 3)))
    with pytest.raises(ValueError, match="starts must be a C-contiguous float64 array"):
        _core.hinge_axis(*arguments(starts=starts))


WRONG_OTHERS: dict[str, tuple[dict[str, Any], str | None]] = {
    "time too short": ({"time_s": np.arange(39.0)}, "time_s"),
    "time strided": ({"time_s": np.arange(80.0)[::2]}, "time_s"),
    "time of integers": ({"time_s": np.arange(40)}, None),
    "time a table": ({"time_s": np.zeros((40, 1))}, None),
    "time None": ({"time_s": None}, None),
    "index at the end": ({"gyr_index": np.array([0, 40])}, "gyr_index holds 40, outside the 40 samples"),
    "index negative": ({"acc_index": np.array([-1])}, "acc_index holds -1"),
    "index the smallest": ({"acc_index": np.array([-(2**63)])}, "acc_index"),
    "index the largest": ({"gyr_index": np.array([2**63 - 1])}, "gyr_index"),
    "index int32": ({"gyr_index": np.array([1], np.int32)}, None),
    "index float": ({"gyr_index": np.array([1.0])}, None),
    "index strided": ({"gyr_index": np.arange(20)[::2]}, "gyr_index"),
    "index a table": ({"gyr_index": np.array([[1]])}, None),
    "weight a string": ({"weight_ratio": "50"}, None),
    "weight None": ({"weight_ratio": None}, None),
    "starts swapped": ({"starts": np.ones((4, 3, 2))}, "starts"),
    "starts none": ({"starts": np.ones((0, 2, 3))}, "starts"),
    "starts flat": ({"starts": np.ones((2, 3))}, None),
    "starts float32": ({"starts": np.ones((1, 2, 3), np.float32)}, None),
    "starts strided": ({"starts": np.ones((4, 2, 3))[::2]}, "starts"),
    "iterations negative": ({"max_iterations": -1}, None),
    "iterations a float": ({"max_iterations": 10.0}, None),
    "iterations huge": ({"max_iterations": 2**70}, None),
}


@pytest.mark.parametrize("case", WRONG_OTHERS)
def test_other_wrong_arguments_are_refused(case: str) -> None:
    changes, message = WRONG_OTHERS[case]
    with pytest.raises(ORDINARY, match=message):
        _core.hinge_axis(*arguments(**changes))


@pytest.mark.parametrize("axis", [[1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [], None, "xyz", 1.0, [1.0, "a", 0.0]])
def test_an_axis_has_three_numbers(axis: Any) -> None:
    with pytest.raises(ORDINARY):
        _core.hinge_residuals(GOOD, GOOD, axis, [1.0, 0.0, 0.0])
    with pytest.raises(ORDINARY):
        _core.hinge_residuals(GOOD, GOOD, [1.0, 0.0, 0.0], axis)


@pytest.mark.parametrize("p", [[[1.0]], [[1.0, 0.0]], [[1.0, 0.0], [0.0]], [1.0, 0.0, 0.0, 1.0], None])
def test_a_tangent_covariance_has_two_by_two_numbers(p: Any) -> None:
    with pytest.raises(ORDINARY):
        _core.angular_deviation(p)


def test_residuals_are_those_of_eq_24() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.standard_normal((2, 100, 3))
    axis1, axis2 = rng.standard_normal((2, 3))
    # Axes of any length are taken as directions.
    got = _core.hinge_residuals(first, second, axis1.tolist(), axis2.tolist())
    unit1, unit2 = axis1 / np.linalg.norm(axis1), axis2 / np.linalg.norm(axis2)
    expected = np.linalg.norm(np.cross(first, unit1), axis=1) - np.linalg.norm(np.cross(second, unit2), axis=1)
    np.testing.assert_allclose(got, expected, atol=1e-14)
    with pytest.raises(ValueError, match="gyr1 has 100 samples but gyr2 has 99"):
        _core.hinge_residuals(first, second[:99], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])


def test_the_module_tells_how_it_was_built() -> None:
    assert _core.build_profile in ("release", "debug")


def test_a_fit_is_read_only() -> None:
    fit = _core.hinge_axis(*arguments())
    assert fit.status in STATUSES
    with pytest.raises(AttributeError):
        fit.cost = 0.0  # type: ignore[misc]
    with pytest.raises(TypeError):
        _core.HingeFit()


def test_read_only_arrays_are_read() -> None:
    frozen = GOOD.copy()
    frozen.flags.writeable = False
    assert _core.hinge_axis(*arguments(gyr1=frozen)).cost == _core.hinge_axis(*arguments(gyr1=frozen.copy())).cost


def test_nothing_at_all_is_not_identifiable() -> None:
    empty = np.zeros((0, 3))
    fit = _core.hinge_axis(empty, empty, empty, empty, np.zeros(0), None, None, 50.0, None, 100)
    assert fit.status == "NOT_IDENTIFIABLE"
    none = np.zeros(0, np.int64)
    assert _core.hinge_axis(*arguments(gyr_index=none, acc_index=none)).status == "NOT_IDENTIFIABLE"
    assert [len(a) for a in _core.condition(empty, empty, empty, empty, np.zeros(0), 50.0, 0.0)[1]] == [0] * 4
    # No number of samples fills a kernel when there are none.
    with pytest.raises(ValueError, match="cutoff_hz 4 needs a kernel longer than the 0 samples"):
        _core.condition(empty, empty, empty, empty, np.zeros(0), 50.0, 4.0)


@pytest.mark.parametrize("weight_ratio", [float("nan"), 0.0, -1.0, float("inf"), 1e-300, 1e300])
def test_absurd_weights_give_a_status(weight_ratio: float) -> None:
    assert _core.hinge_axis(*arguments(weight_ratio=weight_ratio)).status in STATUSES


@pytest.mark.parametrize("size", [1e155, 1e200, 1e300])
def test_overflow_is_a_status(size: float) -> None:
    fit = _core.hinge_axis(*arguments(gyr1=GOOD * size, acc1=GOOD * size))
    assert fit.status == "NUMERICAL_ERROR"
    assert all(np.isinf(mean) for mean, _ in fit.deviation)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"acc1": GOOD * 1e200}, id="acc overflows"),
        pytest.param({"gyr2": GOOD * 1e200}, id="gyr overflows"),
        pytest.param({"starts": np.zeros((1, 2, 3))}, id="start of zero"),
        pytest.param({"starts": np.full((1, 2, 3), np.inf)}, id="infinite start"),
        pytest.param({"starts": np.full((1, 2, 3), 1e-200)}, id="short start"),
        pytest.param({"starts": np.full((1, 2, 3), np.nan)}, id="start of NaN"),
        pytest.param({"starts": np.full((1, 2, 3), 1e200)}, id="long start"),
    ],
)
def test_axes_always_have_unit_length(changes: dict[str, Any]) -> None:
    fit = _core.hinge_axis(*arguments(**changes))
    np.testing.assert_allclose([np.linalg.norm(fit.axis1), np.linalg.norm(fit.axis2)], 1.0, rtol=1e-9)


EXTREME = st.one_of(
    st.floats(-1e3, 1e3),
    st.floats(allow_nan=False, allow_infinity=False),
    st.sampled_from([0.0, -0.0, 5e-324, 1e-300, -1e-160, 1e150, -1e154, 1e155, 1e300, -1.7e308]),
)


@settings(max_examples=80, deadline=2000, derandomize=True)
@given(
    st.integers(0, 12).flatmap(lambda n: hnp.arrays(np.float64, (4, n, 3), elements=EXTREME)),
    st.sampled_from([1e-12, 50.0, 1e12]),
    st.booleans(),
)
def test_no_numbers_make_the_core_panic_or_hang(arrays: Array, weight_ratio: float, given_starts: bool) -> None:
    count = arrays.shape[1]
    starts = np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]) if given_starts else None
    g1, a1, g2, a2 = (np.ascontiguousarray(array) for array in arrays)
    time_s = np.linspace(0.0, 6.0, count)
    fit = _core.hinge_axis(g1, a1, g2, a2, time_s, None, None, weight_ratio, starts, 50)
    assert fit.status in STATUSES
    assert len(fit.minima) >= 1


@settings(max_examples=60, deadline=2000, derandomize=True)
@given(
    st.integers(1, 12).flatmap(lambda n: hnp.arrays(np.float64, (4, n, 3), elements=EXTREME)),
    st.sampled_from([None, 5.0, 40.0]),
)
def test_no_numbers_escape_the_public_door(arrays: Array, lowpass_hz: float | None) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", imufast.ImufastWarning)
        try:
            imu1, imu2 = (imufast.Imu(arrays[i], arrays[i + 1], 100.0, units="SI") for i in (0, 2))
            axis = imufast.estimate_hinge_axis(imu1, imu2, lowpass_hz=lowpass_hz)
        except imufast.ImufastError:
            return
    assert axis.status in set(imufast.SolveStatus)
    assert axis.axis1.shape == axis.axis2.shape == (3,)
    assert not np.isnan(axis.bound95_deg).any()


@settings(max_examples=60, deadline=2000, derandomize=True)
@given(
    st.integers(4, 40).flatmap(lambda n: hnp.arrays(np.float64, (n,), elements=st.floats(1e-6, 1e6))),
    st.sampled_from([0.01, 1.0, 40.0, 1e6]),
)
def test_no_clock_makes_the_conditioning_hang(steps: Array, lowpass_hz: float) -> None:
    time_s = np.cumsum(steps)
    if not (np.diff(time_s) > 0).all():
        return
    rows = np.ones((len(time_s), 3))
    rate_hz = 1.0 / float(np.median(np.diff(time_s)))
    if 2.0 * rate_hz / lowpass_hz > len(time_s):
        with pytest.raises(ValueError, match="needs a kernel longer than the"):
            _core.condition(rows, rows, rows, rows, time_s, rate_hz, lowpass_hz)
        return
    times, arrays = _core.condition(rows, rows, rows, rows, time_s, rate_hz, lowpass_hz)
    assert len(times) <= 4 * len(time_s)
    # What is constant stays so.
    for array in arrays:
        np.testing.assert_allclose(array, 1.0, rtol=1e-9)


def run(code: str, *, memory_gb: float = 3.0, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
    """Python code in a process of its own, whose death does not take the tests along; out of memory, it aborts."""
    limit = (
        "import signal\nbefore = signal.getsignal(signal.SIGINT)\n"
        "import resource, numpy as np, imufast\nfrom imufast import _core\n"
        f"resource.setrlimit(resource.RLIMIT_AS, ({int(memory_gb * 2**30)},) * 2)\n"
    )
    return subprocess.run([sys.executable, "-c", limit + code], capture_output=True, text=True, timeout=timeout_s, check=False)


ENDS_IN_AN_EXCEPTION = """
try:
    {call}
except (imufast.ImufastError, ValueError) as error:
    print("refused:", error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits of memory are POSIX")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param("imufast.estimate_hinge_axis(s.imu1, s.imu2, lowpass_hz=1e-9)", "lowpass_hz must be 0", id="setting"),
        pytest.param("imufast.estimate_hinge_axis(s.imu1, s.imu2, lowpass_hz=0.01)", "lowpass_hz=0.01 needs", id="short"),
        pytest.param("_core.condition(x, x, x, x, t, 50.0, 1e-9)", "cutoff_hz 0.000000001 needs a kernel", id="core"),
        pytest.param("_core.condition(x, x, x, x, t, 1e300, 4.0)", "cutoff_hz 4 needs a kernel", id="core, high rate"),
    ],
)
def test_a_long_kernel_is_refused_and_does_not_kill_the_process(call: str, message: str) -> None:
    data = "s = imufast.simulate_hinge('mixed', duration_s=5); x, t = np.zeros((40, 3)), np.arange(40.0)"
    ended = run(ENDS_IN_AN_EXCEPTION.format(call=f"{data}; {call}"))
    assert ended.returncode == 0, ended.stderr[-300:]
    assert "refused" in ended.stdout
    assert message in ended.stdout


@pytest.mark.parametrize("rate_hz", [0.0, -50.0, float("nan"), float("inf")])
def test_a_rate_that_is_none_is_refused(rate_hz: float) -> None:
    x, time_s = np.zeros((40, 3)), np.arange(40.0)
    with pytest.raises(ValueError, match="rate_hz must be a positive finite number"):
        _core.condition(x, x, x, x, time_s, rate_hz, 4.0)
    with pytest.raises(ValueError, match="rate_hz must be a positive finite number"):
        _core.select_samples(x, x, x, x, time_s, rate_hz, 20, 0.1, 1.0)


@pytest.mark.parametrize("window_s", [-0.1, float("nan")])
def test_a_window_below_zero_is_refused(window_s: float) -> None:
    x = np.zeros((40, 3))
    with pytest.raises(ValueError, match="window_s must not be negative"):
        _core.select_samples(x, x, x, x, np.arange(40) / 50.0, 50.0, 20, window_s, 1.0)


@pytest.mark.parametrize("window_s", [60.0, 1e300, float("inf")])
def test_a_window_longer_than_the_data_is_never_complete(window_s: float) -> None:
    x = np.zeros((40, 3))
    gyr_index, acc_index, _, acc_score = _core.select_samples(x, x, x, x, np.arange(40) / 50.0, 50.0, 20, window_s, 1.0)
    assert len(gyr_index) == len(acc_index) == 0
    assert np.isinf(acc_score).all()


@pytest.mark.skipif(sys.platform == "win32", reason="limits of memory are POSIX")
@pytest.mark.parametrize(
    "call",
    [
        pytest.param("_core.select_samples(x, x, x, x, t, 1e300, 20, 0.5, 1.0)", id="core"),
        pytest.param(
            "a, b = (imufast.Imu(i.gyr, i.acc, 1e9, units='SI') for i in (s.imu1, s.imu2)); "
            "imufast.select_samples(a, b, window_s=1.0, max_samples=20)",
            id="public",
        ),
    ],
)
def test_a_window_of_many_samples_does_not_kill_the_process(call: str) -> None:
    data = "s = imufast.simulate_hinge('mixed', duration_s=5); x, t = np.zeros((40, 3)), np.arange(40.0)"
    ended = run(ENDS_IN_AN_EXCEPTION.format(call=f"{data}; {call}"))
    assert ended.returncode == 0, ended.stderr[-300:]


INTERRUPTED = """
import threading, time, signal, os
assert signal.getsignal(signal.SIGINT) is before, "importing imufast installs no handler"
# A shell starts what runs in its background deaf to Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
s = imufast.simulate_hinge("mixed", duration_s=60, dof=3)
threading.Timer(0.5, lambda: (print(time.time(), flush=True), os.kill(os.getpid(), signal.SIGINT))).start()
try:
    imufast.estimate_hinge_axis(s.imu1, s.imu2, starts="random", random_starts=1_000_000)
except KeyboardInterrupt:
    print(time.time(), flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT is POSIX")
def test_ctrl_c_stops_a_long_search_within_a_second() -> None:
    started = time.monotonic()
    ended = run(INTERRUPTED)
    assert ended.returncode == 0, ended.stderr[-300:]
    pressed, stopped = map(float, ended.stdout.split())
    assert stopped - pressed < 1.0
    assert time.monotonic() - started < 30.0
