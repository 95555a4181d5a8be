"""Settings of the smoother, and what they and a calibration say beforehand."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.errors import InputError
from imufast.settings import Checked

if TYPE_CHECKING:
    from imufast.calibration import JointCalibration
    from imufast.imu import Imu

__all__ = ["Smoother", "parts_ratio", "relative_bias_std", "run_smoother"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Smoother(Checked):
    """How a whole recording is smoothed: maximum a posteriori over orientations, joint centre and biases together.

    Args:
        window_s: both sensors' accelerations of the joint centre are compared as averages over windows this long, s. Small
            follows impacts, large forgives soft tissue and timing. Default 0.2.
        key_step_s: time between two such comparisons, s. Small costs time in proportion. Default 0.1.
        bridge_s: gaps up to this length the gyroscopes bridge, s; beyond, only centre and biases are carried across.
            Default 1.
        tail: degrees of freedom of the residuals' Student t; small forgives outliers, large trusts all alike. Default 4.
        link_std: scale of the residuals, m/s²; None: estimated from the recording. Default None.
        drift_std: what the errors of both gyroscopes add up to, rad/√s; None: estimated. Default None.
        lever_std: standard deviation of each coordinate of the joint centre beforehand, without a calibration, m. Default 0.5.
        acc_bias_std: of each accelerometer bias channel beforehand, without a calibration, m/s². Default 0.3; much more lets
            soft tissue pass for bias.
        gyr_bias_std: of each gyroscope bias channel beforehand, without a calibration, rad/s. Default 0.02.
        gyr_bias_rest_std: what is left of it where rest shows the bias, rad/s; None: rest is not looked for. Default 0.002.
        lever_change_std: how far each coordinate of the centre may be off from a calibration beyond what that says, m: sensors
            slip. Default 0.01.
        acc_bias_change_std: likewise of each accelerometer bias channel, m/s²: temperature. Default 0.05.
        gyr_bias_change_std: likewise of each gyroscope bias channel, rad/s. Default 0.002 (0.1 deg/s).
        max_iterations: Gauss-Newton iterations. Default 60.
        most_parts: a recording is held against itself in so many parts at most, of 5 s at least, to see how far it may be off
            (`parts_ratio`), which takes as long again; 1: not. Default 4.

    Raises:
        SettingsError: a value is out of its range.
    """

    window_s: float = 0.2
    key_step_s: float = 0.1
    bridge_s: float = 1.0
    tail: float = 4.0
    link_std: float | None = None
    drift_std: float | None = None
    lever_std: float = 0.5
    acc_bias_std: float = 0.3
    gyr_bias_std: float = 0.02
    gyr_bias_rest_std: float | None = 0.002
    lever_change_std: float = 0.01
    acc_bias_change_std: float = 0.05
    gyr_bias_change_std: float = 0.002
    max_iterations: int = 60
    most_parts: int = 4

    def __post_init__(self) -> None:
        ranges = {
            "window_s": (1e-3, 10.0),
            "key_step_s": (1e-3, 10.0),
            "bridge_s": (1e-3, 60.0),
            "tail": (0.5, 1e6),
            "link_std": (1e-6, 1e3),
            "drift_std": (1e-7, 10.0),
            "lever_std": (1e-6, 1e3),
            "acc_bias_std": (1e-6, 1e3),
            "gyr_bias_std": (1e-7, 10.0),
            "gyr_bias_rest_std": (1e-7, 10.0),
            "lever_change_std": (1e-6, 1e3),
            "acc_bias_change_std": (1e-6, 1e3),
            "gyr_bias_change_std": (1e-7, 10.0),
        }
        optional = ("link_std", "drift_std", "gyr_bias_rest_std")
        for name, (low, high) in ranges.items():
            if name not in optional or getattr(self, name) is not None:
                self._number(name, low, high)
        self._count("max_iterations", 1, 100_000)
        self._count("most_parts", 1, 100)

    def prior(self, calibration: JointCalibration | None) -> tuple[Array, Array]:
        """Most probable values (18,) and their inverse covariance (18, 18) of r_1, r_2 (from the joint centre to the sensor),
        accelerometer biases and gyroscope biases beforehand."""
        mean = np.zeros(18)
        covariance = np.diag(np.repeat([self.lever_std, self.acc_bias_std, self.gyr_bias_std], 6) ** 2)
        if calibration is not None:
            if calibration.center is not None:
                mean[:6] = -np.concatenate([calibration.center.in_sensor1, calibration.center.in_sensor2])
                covariance[:6, :6] = _limited(calibration.center.covariance, self.lever_change_std, self.lever_std)
            mean[6:12] = np.concatenate([calibration.acc_bias1, calibration.acc_bias2])
            covariance[6:12, 6:12] = _limited(calibration.acc_bias_covariance, self.acc_bias_change_std, self.acc_bias_std)
            mean[12:] = np.concatenate([calibration.gyr_bias1, calibration.gyr_bias2])
            covariance[12:, 12:] = (calibration.gyr_bias_std**2 + self.gyr_bias_change_std**2) * np.eye(6)
        precision = np.linalg.inv(covariance)
        return mean, np.ascontiguousarray(0.5 * (precision + precision.T))


def _limited(covariance: Array, more_std: float, most_std: float) -> Array:
    """The covariance with `more_std` added to every direction, and no direction less certain than `most_std`."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    values = np.minimum(np.maximum(values, 0.0) + more_std**2, max(most_std, more_std) ** 2)
    return np.asarray((vectors * values) @ vectors.T)


def run_smoother(imu1: Imu, imu2: Imu, calibration: JointCalibration | None, settings: Smoother) -> _core.SmootherFit:
    """The smoothed relative orientation of two sensors on one time base, as the core gives it.

    Raises:
        InputError: a window of more samples than anything asks for.
    """
    if settings.window_s * imu1.rate_hz > 1e5:
        raise InputError(f"window_s={settings.window_s:g} at {imu1.rate_hz:g} Hz is a window of more than 100 000 samples")
    mean, precision = settings.prior(calibration)
    return _core.smooth_orientation(
        imu1.gyr,
        imu1.acc,
        imu2.gyr,
        imu2.acc,
        imu1.time_s,
        imu1.rate_hz,
        mean,
        precision,
        settings.window_s,
        settings.key_step_s,
        settings.bridge_s,
        settings.tail,
        settings.drift_std,
        settings.link_std,
        settings.gyr_bias_rest_std,
        settings.max_iterations,
    )


PART_S = 5.0
"""A part of a recording that is held against the others lasts at least so long, s."""


def parts_ratio(imu1: Imu, imu2: Imu, settings: Smoother) -> float | None:
    """How many times as far, squared, parts of a recording are apart in joint centre and accelerometer biases as they say, at
    least 1 (the square of the Birge ratio); None where it is too short for two parts, or fewer than two can be smoothed.

    Soft tissue errs alike wherever the motion is alike, so residuals do not tell how far it turns the estimate; what another
    stretch of the same recording makes of the same joint does. With the covariances Σ of two parts, their common prior Λ and
    the difference d, the model expects of `dᵀ(Σ₁ + Σ₂)⁻¹d` the trace of `(Σ₁ + Σ₂)⁻¹D`, where
    `D = Σ₁ − Σ₁ΛΣ₁ + Σ₂ − Σ₂ΛΣ₂ + (Σ₁ − Σ₂)Λ(Σ₁ − Σ₂)`; the ratio is over all pairs of parts.
    """
    parts = min(settings.most_parts, int(imu1.duration_s / PART_S))
    if parts < 2:
        return None
    edges = [round(k * len(imu1) / parts) for k in range(parts + 1)]
    cuts = [slice(start, stop) for start, stop in pairwise(edges)]
    fits = [run_smoother(imu1[cut], imu2[cut], None, settings) for cut in cuts]
    prior = settings.prior(None)[1][:12, :12]
    found = [
        (fit.constants[:12], fit.constants_covariance[:12, :12])
        for fit in fits
        if fit.status not in ("NUMERICAL_ERROR", "NOT_OBSERVABLE") and bool(np.isfinite(fit.constants_covariance).all())
    ]
    squared, expected = 0.0, 0.0
    for (one, first), (other, second) in combinations(found, 2):
        apart, unlike = one - other, first - second
        own = first - first @ prior @ first + second - second @ prior @ second + unlike @ prior @ unlike
        squared += float(apart @ np.linalg.solve(first + second, apart))
        expected += float(np.trace(np.linalg.solve(first + second, own)))
    return max(squared / expected, 1.0) if expected > 0.0 else None


def relative_bias_std(q_12: Array, covariance: Array) -> float:
    """What gyroscope biases of this covariance (6, 6) leave uncertain of each channel of the relative rate, rad/s: the root of
    trace(Rᵀ C11 R + C22 − 2 Rᵀ C12)/3, averaged over orientations (N, 4). What both have in common cancels."""
    products = q_12.T @ q_12 / len(q_12)
    (ww, wx, wy, wz), (_, xx, xy, xz), (_, _, yy, yz), (_, _, _, zz) = products
    turn = np.array(
        [
            [ww + xx - yy - zz, 2.0 * (xy - wz), 2.0 * (xz + wy)],
            [2.0 * (xy + wz), ww - xx + yy - zz, 2.0 * (yz - wx)],
            [2.0 * (xz - wy), 2.0 * (yz + wx), ww - xx - yy + zz],
        ]
    )
    variance = float(np.trace(covariance)) - 2.0 * float((turn * covariance[:3, 3:]).sum())
    return max(float(np.sqrt(max(variance, 0.0) / 3.0)), LEAST_RELATIVE_BIAS_STD)


LEAST_RELATIVE_BIAS_STD = 2e-4
"""Gyroscope biases are not steadier than this from minute to minute, rad/s (0.01 deg/s)."""
