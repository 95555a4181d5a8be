"""What the samples of a sensor scatter by themselves."""

from __future__ import annotations

from dataclasses import dataclass

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
    """White noise of both sensors from the quietest twentieth of their seconds: rms second difference over √6, which slow
    motion does not enter. `link_std` is None."""
    gyr_std1, acc_std1 = _white_std(imu1, imu1.gyr), _white_std(imu1, imu1.acc)
    gyr_std2, acc_std2 = _white_std(imu2, imu2.gyr), _white_std(imu2, imu2.acc)
    return SensorNoise(gyr_std1, gyr_std2, acc_std1, acc_std2, imu1.rate_hz)


def _white_std(imu: Imu, values: Array) -> float:
    second = np.diff(values, n=2, axis=0)
    # Second differences mean nothing across a gap.
    whole = np.isclose(np.diff(imu.time_s) * imu.rate_hz, 1.0, atol=0.2)
    second = second[whole[1:] & whole[:-1]] if (whole[1:] & whole[:-1]).any() else second
    window = max(1, min(len(second), round(imu.rate_hz)))
    power = (second[: len(second) // window * window] ** 2).reshape(-1, window, 3).mean(axis=(1, 2)) / 6.0
    return float(np.sqrt(np.quantile(power, 0.05)))
