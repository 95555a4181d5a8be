"""What an inertial sensor on a moving body reads: the exact signals, then noise and bias.

Reference: Olsson et al. 2020, eqs 1, 3 (measurement models) and 4-7 (rigid body).
"""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from .checks import FloatArray, number, seed_number
from .signals import stream
from .so3 import Turning, random_direction, rotate_back

__all__ = ["SensorBiases", "noisy", "random_biases", "specific_force"]


def specific_force(sensor: Turning, joint_acc: FloatArray, r: FloatArray, gravity: float) -> FloatArray:
    """Exact reading of an accelerometer (N, 3), m/s², in the sensor frame: eqs 1 and 4-6.

    Args:
        sensor: orientation of the sensor in the global frame (z up) with its angular velocity and acceleration.
        joint_acc: (N, 3) acceleration of the joint centre in the global frame, m/s².
        r: (3,) from the joint centre to the sensor, in the sensor frame, m.
        gravity: m/s²; it reads upwards at rest.
    """
    at_joint = rotate_back(sensor.q, joint_acc + np.array([0.0, 0.0, gravity]))
    return at_joint + np.cross(sensor.gyr, np.cross(sensor.gyr, r)) + np.cross(sensor.gyr_rate, r)


def noisy(true: FloatArray, bias: FloatArray, noise_std: float, rng: np.random.Generator) -> FloatArray:
    """True signal (N, 3) + constant bias (3,) + white Gaussian noise of one standard deviation (eqs 1 and 3)."""
    return true + bias + noise_std * rng.standard_normal(true.shape)


class SensorBiases(TypedDict):
    """Constant biases of both sensors, under the names that `simulate_hinge` takes: (3,), rad/s and m/s²."""

    gyr_bias1: FloatArray
    acc_bias1: FloatArray
    gyr_bias2: FloatArray
    acc_bias2: FloatArray


def random_biases(seed: int = 0, *, gyr_rad_s: float = np.pi / 180.0, acc_m_s2: float = 1.0) -> SensorBiases:
    """Biases of fixed size in random directions, as in section 7.5 of Olsson et al. 2020.

    Args:
        seed: non-negative integer; the same seed gives the same directions.
        gyr_rad_s: norm of each gyroscope bias, rad/s; default 1 deg/s.
        acc_m_s2: norm of each accelerometer bias, m/s²; default 1.

    Returns:
        A mapping to hand on: `simulate_hinge(3, **random_biases(7))`.

    Raises:
        SettingsError: a negative size or seed.
    """
    seed = seed_number(seed)
    gyr_rad_s = number("gyr_rad_s", gyr_rad_s, least=0.0)
    acc_m_s2 = number("acc_m_s2", acc_m_s2, least=0.0)
    rng = stream(seed, "biases")
    return SensorBiases(
        gyr_bias1=gyr_rad_s * random_direction(rng),
        acc_bias1=acc_m_s2 * random_direction(rng),
        gyr_bias2=gyr_rad_s * random_direction(rng),
        acc_bias2=acc_m_s2 * random_direction(rng),
    )
