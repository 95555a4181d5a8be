"""Turning frames that know their rate and acceleration; quaternions as in `imufast.quaternion`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imufast.quaternion import conjugate, multiply, rotate, rotate_back

from .checks import FloatArray
from .signals import Signal

__all__ = ["Turning", "conjugate", "multiply", "random_direction", "random_quaternion", "rotate", "rotate_back", "turned_by"]


def turned_by(axis: ArrayLike, angle_rad: ArrayLike) -> FloatArray:
    """Quaternion of the turn by `angle_rad` (...) about the unit vector `axis` (3,); (..., 4)."""
    half = 0.5 * np.asarray(angle_rad, dtype=np.float64)[..., None]
    return np.concatenate([np.cos(half), np.sin(half) * np.asarray(axis, dtype=np.float64)], axis=-1)


def random_direction(rng: np.random.Generator) -> FloatArray:
    """A unit vector (3,), uniform on the sphere."""
    v = rng.standard_normal(3)
    unit: FloatArray = v / np.linalg.norm(v)
    return unit


def random_quaternion(rng: np.random.Generator) -> FloatArray:
    """A unit quaternion (4,), uniform over all rotations, scalar part not negative."""
    q = rng.standard_normal(4)
    q /= np.linalg.norm(q)
    return q if q[0] >= 0.0 else -q


@dataclass(frozen=True)
class Turning:
    """A frame c that turns in its parent frame p, at N instants.

    `q` (N, 4) is q_pc; `gyr` (N, 3, rad/s) and `gyr_rate` (N, 3, rad/s²) are the angular velocity and acceleration of c
    relative to p, in the coordinates of c.
    """

    q: FloatArray
    gyr: FloatArray
    gyr_rate: FloatArray

    @classmethod
    def about(cls, axis: ArrayLike, angle: Signal) -> Turning:
        """The turn about a fixed unit vector by an angle (rad) that varies with time."""
        unit = np.asarray(axis, dtype=np.float64)
        return cls(turned_by(unit, angle.rows[0]), angle.rows[1][:, None] * unit, angle.rows[2][:, None] * unit)

    def then(self, child: Turning) -> Turning:
        """Frame of `child`, which turns in this frame, as seen from this frame's parent."""
        carried = rotate_back(child.q, self.gyr)
        return Turning(
            multiply(self.q, child.q),
            carried + child.gyr,
            rotate_back(child.q, self.gyr_rate) + child.gyr_rate + np.cross(carried, child.gyr),
        )

    def carried(self, v: ArrayLike) -> tuple[Signal, Signal, Signal]:
        """A fixed vector (3,) of this frame as the parent sees it, up to its second derivative."""
        fixed = np.broadcast_to(np.asarray(v, dtype=np.float64), self.gyr.shape)
        velocity = np.cross(self.gyr, fixed)
        acceleration = np.cross(self.gyr_rate, fixed) + np.cross(self.gyr, velocity)
        x, y, z = np.array([rotate(self.q, w) for w in (fixed, velocity, acceleration)]).transpose(2, 0, 1)
        return Signal(x), Signal(y), Signal(z)

    def mounted(self, q_cs: FloatArray) -> Turning:
        """A frame s that is rigidly fixed to this one."""
        return Turning(multiply(self.q, q_cs), rotate_back(q_cs, self.gyr), rotate_back(q_cs, self.gyr_rate))
