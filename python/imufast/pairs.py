"""Two sensors of one joint as the algorithms see them: same instants, conditioned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.errors import InputError
from imufast.imu import Imu, check_same_time

__all__ = ["PairSignals", "check_pair", "identical", "pair_signals"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PairSignals:
    """Simultaneous samples of two sensors: (M,) times in s; (M, 3) rates in rad/s and accelerations in m/s², C-contiguous."""

    time_s: Array
    gyr1: Array
    acc1: Array
    gyr2: Array
    acc2: Array
    rate_hz: float

    def __len__(self) -> int:
        return len(self.time_s)

    def relative_rate(self, axis1: Array, axis2: Array) -> Array:
        """(M,) rate of the joint angle about the hinge axis, rad/s: `axis2·gyr2 − axis1·gyr1`."""
        return self.gyr2 @ axis2 - self.gyr1 @ axis1

    def residual(self, axis1: Array, axis2: Array) -> Array:
        """(M,) gyroscope residual of the hinge constraint (eq. 14), rad/s: `‖gyr1×axis1‖ − ‖gyr2×axis2‖`."""
        return _core.hinge_residuals(self.gyr1, self.gyr2, axis1.tolist(), axis2.tolist())


def check_pair(imu1: Imu, imu2: Imu, *, same_data: bool = False) -> None:
    """Check that two Imus can be the two sensors of a joint; their times are those of the first.

    Args:
        imu1, imu2: the Imus.
        same_data: whether the same data twice pass: for callers that have an answer to it.

    Raises:
        InputError: not Imus, different time bases, the same data twice, or fewer than four samples.
    """
    for name, imu in (("imu1", imu1), ("imu2", imu2)):
        if not isinstance(imu, Imu):
            raise InputError(f"{name} must be an imufast.Imu, got {type(imu).__name__}")
    if len(imu1) != len(imu2):
        raise InputError(
            f"imu1 has {len(imu1)} samples but imu2 has {len(imu2)}: bring them to one time base with imufast.align"
        )
    check_same_time(imu1, imu2, "imu1 and imu2")
    if len(imu1) < 4:
        raise InputError(f"imu1 and imu2 have {len(imu1)} samples; at least 4 are needed")
    if not same_data and identical(imu1.gyr, imu2.gyr) and imu1.gyr.any():
        raise InputError(f"imu1 ({imu1.name!r}) and imu2 ({imu2.name!r}) hold the same gyr data: give two different sensors")


def identical(a: Array, b: Array) -> bool:
    """Whether two sensors hold the same rows; different ones mostly differ at once."""
    return bool(a[0].tolist() == b[0].tolist()) and np.array_equal(a, b)


def pair_signals(imu1: Imu, imu2: Imu, lowpass_hz: float | None = None) -> PairSignals:
    """The signals of two sensors of a joint, low-passed when asked to.

    Args:
        imu1, imu2: Imus on one time base, at least four samples.
        lowpass_hz: cut-off (-6 dB) of the one low-pass, Hz; None or 0: the samples as they are.

    Raises:
        InputError: as `check_pair`, or no stretch between breaks is as long as the low-pass.
    """
    check_pair(imu1, imu2)
    time_s, rate_hz = imu1.time_s, imu1.rate_hz
    if not lowpass_hz:
        return PairSignals(time_s, imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, rate_hz)
    longest = max(stop - start for start, stop in imu1.segments())
    short = InputError(
        f"imu1 and imu2 have no unbroken stretch of {2.0 / lowpass_hz:.3g} s, which lowpass_hz={lowpass_hz:g} needs: "
        "give more samples or lowpass_hz=None"
    )
    if longest < 2.0 * rate_hz / lowpass_hz:
        raise short
    time, arrays = _core.condition(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, time_s, rate_hz, lowpass_hz)
    if len(time) < 4:
        raise short
    gyr1, acc1, gyr2, acc2 = arrays
    return PairSignals(time, gyr1, acc1, gyr2, acc2, rate_hz)
