"""Means to check a simulation that the simulator does not use itself."""

from __future__ import annotations

import numpy as np
from imufast.simulate.checks import FloatArray
from scipy.spatial.transform import Rotation


def rotation(q: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def differ(a: FloatArray, b: FloatArray) -> float:
    return float(np.abs(a - b).max())


def slope(values: FloatArray, step: float) -> FloatArray:
    """Central difference of eighth order, at the samples 4 .. N-5."""
    weights = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
    n = len(values)
    total: FloatArray = sum(
        w * (values[4 + k : n - 4 + k] - values[4 - k : n - 4 - k]) for k, w in enumerate(weights, start=1)
    ) / np.float64(step)
    return total


def joint_acceleration(acc: FloatArray, gyr: FloatArray, rate: FloatArray, joint_in_sensor: FloatArray) -> FloatArray:
    """Specific force at the joint centre in the sensor frame, with the matrix K written out."""
    (x, y, z), (dx, dy, dz) = gyr.T, rate.T
    K = np.array(
        [
            [-(y**2) - z**2, x * y - dz, x * z + dy],
            [x * y + dz, -(x**2) - z**2, y * z - dx],
            [x * z - dy, y * z + dx, -(x**2) - y**2],
        ]
    )
    return np.asarray(acc - np.einsum("ijn,j->ni", K, -joint_in_sensor))
