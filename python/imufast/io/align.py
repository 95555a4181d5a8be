"""Sensors with different samples brought onto one time base."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError
from imufast.imu import BREAK_STEPS, SAME_TIME_STEPS, Imu, Recording
from imufast.plausibility import warn_user

__all__ = ["align"]

Array: TypeAlias = NDArray[np.float64]


def align(imus: Iterable[Imu]) -> Recording:
    """Join sensors into one recording on the first one's time.

    Sensors on the same clock (most times agree within a thousandth of a step) keep their samples: those that all of them
    have; what one of them lost becomes a gap. Sensors with clocks of their own are interpolated linearly to the first
    one's times, inside the common range and never across a break; an ImufastWarning says so. Clocks are taken at their
    word: an offset between them is not corrected.

    Raises:
        InputError: nothing to join, equal names, or no common time.
    """
    sensors = list(imus) if isinstance(imus, Iterable) else []
    if not sensors or not all(isinstance(imu, Imu) for imu in sensors):
        raise InputError(f"imus must be a non-empty list of Imu, got {type(imus).__name__}")
    first, others = sensors[0], sensors[1:]
    for other in others:
        if other.time_s[-1] < first.time_s[0] or other.time_s[0] > first.time_s[-1]:
            raise InputError(
                f"imus: {first.name!r} ({_span(first)}) and {other.name!r} ({_span(other)}) have no time in common; "
                "are they of one recording and on one clock?"
            )
    partners = [_partners(first, other) for other in others]
    own_clock = [other.name for other, (_, same_clock) in zip(others, partners, strict=True) if not same_clock]
    if own_clock:
        warn_user(
            f"imus: the sample times of {', '.join(map(repr, own_clock))} are not those of {first.name!r}; "
            "interpolated linearly to them"
        )
        moved = [_interpolate(first.time_s, other) for other in others]
    else:
        moved = [
            (rows >= 0, {"gyr": other.gyr[rows], "acc": other.acc[rows]})
            for other, (rows, _) in zip(others, partners, strict=True)
        ]
    shared = np.all([np.ones(len(first), bool), *(valid for valid, _ in moved)], axis=0)
    if not shared.any():
        raise InputError(f"imus: {', '.join(repr(imu.name) for imu in sensors)} have no sample in common")
    time_s = first.time_s[shared]
    aligned = [first._replace(gyr=first.gyr[shared], acc=first.acc[shared], time_s=time_s)] + [
        first._replace(gyr=signals["gyr"][shared], acc=signals["acc"][shared], time_s=time_s, name=other.name)
        for other, (_, signals) in zip(others, moved, strict=True)
    ]
    return Recording(aligned)


def _span(imu: Imu) -> str:
    return f"{imu.time_s[0]:.6g} to {imu.time_s[-1]:.6g} s"


def _partners(first: Imu, other: Imu) -> tuple[NDArray[np.int64], bool]:
    """For each sample of the first, the row of the other at the same time (−1: none), and whether most have one."""
    a, b = first.time_s, other.time_s
    tolerance = SAME_TIME_STEPS / first.rate_hz
    rows = np.searchsorted(b, a - tolerance)
    there = rows < len(b)
    there[there] = b[rows[there]] <= a[there] + tolerance
    overlap = min(np.count_nonzero((x >= y[0] - tolerance) & (x <= y[-1] + tolerance)) for x, y in ((a, b), (b, a)))
    return np.where(there, rows, -1), 2 * np.count_nonzero(there) >= overlap > 0


def _interpolate(time_s: Array, imu: Imu) -> tuple[NDArray[np.bool_], dict[str, Any]]:
    own = imu.time_s
    before = np.clip(np.searchsorted(own, time_s, side="right") - 1, 0, max(len(own) - 2, 0))
    step = own[np.minimum(before + 1, len(own) - 1)] - own[before]
    inside = (time_s >= own[0]) & (time_s <= own[-1])
    # The last sample before a break is still a measurement, at its own time.
    valid = inside & ((step * imu.rate_hz <= BREAK_STEPS) | (time_s == own[before]))
    signals = {
        key: np.stack([np.interp(time_s, own, values[:, axis]) for axis in range(3)], axis=1)
        for key, values in (("gyr", imu.gyr), ("acc", imu.acc))
    }
    return valid, signals
