"""Sensors with different samples on one time base."""

from __future__ import annotations

import imufast
import numpy as np
import pytest
from imufast.io import align


def sensor(time: np.ndarray, name: str) -> imufast.Imu:
    """Signals that are linear in time, so that linear interpolation is exact."""
    return imufast.Imu(np.outer(time, [1.0, 2.0, 3.0]), np.outer(time, [0.1, 0.2, 0.3]) + 5, time_s=time, name=name)


def test_one_clock_keeps_the_samples_that_all_have() -> None:
    grid = np.arange(100) / 50
    a, b, c = (sensor(np.delete(grid, gone), name) for gone, name in (([3], "a"), ([50, 51], "b"), ([99], "c")))
    rec = align([a, b, c])
    np.testing.assert_array_equal(rec.time_s, np.delete(grid, [3, 50, 51, 99]))
    np.testing.assert_array_equal(rec["b"].gyr[:, 0], rec.time_s)
    assert (rec["a"].lost, rec["a"].segments()) == (3, [(0, 49), (49, 96)])


def test_clocks_of_their_own_are_interpolated_and_said_so() -> None:
    a = sensor(np.arange(200) / 100, "a")
    b = sensor(0.0037 + np.arange(150) / 80, "b")
    with pytest.warns(imufast.ImufastWarning, match="'b' are not those of 'a'; interpolated"):
        rec = align([a, b])
    inside = (a.time_s >= b.time_s[0]) & (a.time_s <= b.time_s[-1])
    np.testing.assert_array_equal(rec.time_s, a.time_s[inside])
    np.testing.assert_allclose(rec["b"].gyr, np.outer(rec.time_s, [1, 2, 3]), atol=1e-12)
    assert rec.rate_hz == a.rate_hz


def test_nothing_is_interpolated_across_a_break() -> None:
    a = sensor(np.arange(200) / 100, "a")
    time = 0.003 + np.delete(np.arange(199), [50, *range(100, 110)]) / 100
    with pytest.warns(imufast.ImufastWarning, match="interpolated"):
        rec = align([a, sensor(time, "b")])
    hole = (rec.time_s > 0.993) & (rec.time_s < 1.103)
    assert not hole.any()
    # One lost sample is bridged.
    assert np.isin(np.round([0.50, 0.51], 2), np.round(rec.time_s, 2)).all()
    assert rec["a"].lost == 11


def test_sensors_of_different_times_are_refused() -> None:
    a, b = sensor(np.arange(20) / 100, "a"), sensor(100 + np.arange(20) / 100, "b")
    with pytest.raises(imufast.InputError, match=r"'a' .* and 'b' .* have no time in common"):
        align([a, b])
