"""What the samples of a sensor scatter by themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from imufast.imu import Imu

__all__ = ["SensorNoise", "sensor_noise"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SensorNoise:
    """Noise of two sensors and of the joint between them.

    Attributes:
        gyr_std1, gyr_std2: white noise of a gyroscope sample, each channel, one standard deviation, rad/s.
        acc_std1, acc_std2: of an accelerometer sample, m/s².
        rate_hz: rate at which these are meant, Hz.
        link_std: by how much the specific forces that both sensors tell of the joint centre differ in norm, low-passed, one
            standard deviation, m/s²: noise, soft tissue and whatever the joint is not; None where unknown.
    """

    gyr_std1: float
    gyr_std2: float
    acc_std1: float
    acc_std2: float
    rate_hz: float
    link_std: float | None = None


def sensor_noise(imu1: Imu, imu2: Imu) -> SensorNoise:
    """White noise of both sensors from the quietest twentieth of their seconds: rms fourth difference over √70, which motion
    hardly enters. `link_std` is None."""
    gyr_std1, acc_std1 = _white_std(imu1, imu1.gyr), _white_std(imu1, imu1.acc)
    gyr_std2, acc_std2 = _white_std(imu2, imu2.gyr), _white_std(imu2, imu2.acc)
    return SensorNoise(gyr_std1, gyr_std2, acc_std1, acc_std2, imu1.rate_hz)


QUIETEST = 0.05
ORDERS = {4: (70.0, 2.63), 2: (6.0, 1.94)}
"""Order of a difference: its variance of white noise of one, and how many times fewer independent values its squares are worth
than they count: the sum of its squared autocorrelations."""


def _white_std(imu: Imu, values: Array) -> float:
    # Differences mean nothing across a gap; where hardly any stretch is long enough, shorter ones do.
    whole = np.isclose(np.diff(imu.time_s) * imu.rate_hz, 1.0, atol=0.2)
    order = next((k for k in ORDERS if len(values) > k and _runs(whole, k).sum() >= k), 2)
    gain, worth = ORDERS[order]
    kept = _runs(whole, order)
    differences = np.diff(values, n=order, axis=0)
    differences = differences[kept] if kept.any() else differences
    window = max(1, min(len(differences), round(imu.rate_hz)))
    power = (differences[: len(differences) // window * window] ** 2).reshape(-1, window, 3).mean(axis=(1, 2)) / gain
    return float(np.sqrt(np.quantile(power, QUIETEST) / _low_quantile(len(power), 3.0 * window / worth)))


def _runs(whole: NDArray[np.bool_], length: int) -> NDArray[np.bool_]:
    """Where so many steps on end are whole."""
    pieces = [whole[k : len(whole) - length + 1 + k] for k in range(length)]
    return np.asarray(np.logical_and.reduce(pieces), np.bool_)


def _low_quantile(count: int, freedom: float) -> float:
    """What the `QUIETEST` quantile of `count` mean squares of so many degrees of freedom is by chance, their mean being one
    (Blom's position of an order statistic, Wilson & Hilferty's approximation of χ²)."""
    place = (QUIETEST * (count - 1) + 0.625) / (count + 0.25)
    spread = math.sqrt(2.0 / (9.0 * freedom))
    return float((1.0 - spread**2 + NormalDist().inv_cdf(place) * spread) ** 3)
