"""Quaternions in numpy, Hamilton, scalar first `[w, x, y, z]`; `q_ab` takes vectors of frame b to frame a.

Every function works row by row on (..., 4) and (..., 3) arrays.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "conjugate",
    "continuous",
    "exp",
    "from_matrix",
    "log",
    "matrix",
    "multiply",
    "rotate",
    "rotate_back",
    "shortest_turn",
    "twist",
]

Array = NDArray[np.float64]


def multiply(q_ab: ArrayLike, q_bc: ArrayLike) -> Array:
    """q_ac = q_ab * q_bc; (..., 4)."""
    p, q = np.asarray(q_ab, dtype=np.float64), np.asarray(q_bc, dtype=np.float64)
    w1, x1, y1, z1 = np.moveaxis(p, -1, 0)
    w2, x2, y2, z2 = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def conjugate(q_ab: ArrayLike) -> Array:
    """q_ba, the inverse of the unit quaternion q_ab; (..., 4)."""
    inverse: Array = np.asarray(q_ab, dtype=np.float64) * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def rotate(q_ab: ArrayLike, v_b: ArrayLike) -> Array:
    """The vectors v_b (..., 3), seen in frame a."""
    q, v = np.asarray(q_ab, dtype=np.float64), np.asarray(v_b, dtype=np.float64)
    twice = 2.0 * np.cross(q[..., 1:], v)
    turned: Array = v + q[..., :1] * twice + np.cross(q[..., 1:], twice)
    return turned


def rotate_back(q_ab: ArrayLike, v_a: ArrayLike) -> Array:
    """The vectors v_a (..., 3), seen in frame b."""
    return rotate(conjugate(q_ab), v_a)


def matrix(q_ab: ArrayLike) -> Array:
    """(..., 3, 3) rotation matrices of unit quaternions: their columns are the axes of frame b, seen in frame a."""
    q = np.asarray(q_ab, dtype=np.float64)[..., None, :]
    return np.swapaxes(rotate(np.broadcast_to(q, (*q.shape[:-2], 3, 4)), np.eye(3)), -1, -2)


def exp(turn: ArrayLike) -> Array:
    """(..., 4) the turn by a rotation vector (..., 3), rad."""
    r = np.asarray(turn, dtype=np.float64)
    angle = np.linalg.norm(r, axis=-1, keepdims=True)
    # sin(angle / 2) / angle, which np.sinc knows at zero, too.
    return np.concatenate([np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * r], axis=-1)


def log(q_ab: ArrayLike) -> Array:
    """(..., 3) the rotation vector of a unit quaternion, at most half a turn long, rad."""
    q = np.asarray(q_ab, dtype=np.float64)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    turn: Array = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0) * q[..., 1:]
    return turn


def from_matrix(matrix_ab: ArrayLike) -> Array:
    """(..., 4) the unit quaternions of rotation matrices (..., 3, 3), scalar part not negative."""
    m = np.asarray(matrix_ab, dtype=np.float64)
    trace = np.trace(m, axis1=-2, axis2=-1)[..., None]
    outer = np.empty((*m.shape[:-2], 4, 4))  # 4 q qᵀ
    outer[..., :1, 0] = 1.0 + trace
    outer[..., 0, 1:] = outer[..., 1:, 0] = m[..., [2, 0, 1], [1, 2, 0]] - m[..., [1, 2, 0], [2, 0, 1]]
    outer[..., 1:, 1:] = m + np.swapaxes(m, -1, -2) + (1.0 - trace)[..., None] * np.eye(3)
    # All rows are multiples of q; the longest has lost the least to cancellation.
    longest = np.einsum("...ii->...i", outer).argmax(axis=-1)[..., None, None]
    q = np.take_along_axis(outer, longest, axis=-2)[..., 0, :]
    q *= np.where(q[..., :1] < 0.0, -1.0, 1.0)
    unit: Array = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return unit


def continuous(q: Array) -> Array:
    """(N, 4) the same rotations without sign flips from one to the next."""
    turned = np.einsum("ij,ij->i", q[1:], q[:-1]) < 0.0
    if not turned.any():
        return q
    signs = np.concatenate([[1.0], np.cumprod(np.where(turned, -1.0, 1.0))])
    return np.ascontiguousarray(q * signs[:, None])


def shortest_turn(v_b: ArrayLike, v_a: ArrayLike) -> Array:
    """(4,) the smallest turn q_ab that takes the unit vector v_b to the unit vector v_a."""
    b, a = np.asarray(v_b, dtype=np.float64), np.asarray(v_a, dtype=np.float64)
    along = float(b @ a)
    if along > -1.0 + 1e-9:
        q = np.array([1.0 + along, *np.cross(b, a)])
    else:  # opposite: half a turn about anything across
        q = np.array([0.0, *np.cross(b, np.eye(3)[int(np.abs(b).argmin())])])
    unit: Array = q / np.linalg.norm(q)
    return unit


def twist(q: Array, axis: Array) -> tuple[Array, Array]:
    """The turn about `axis` that comes nearest to each rotation, and what a small further turn does to it.

    Args:
        q: (N, 4) unit quaternions w, v that take a frame to one in which `axis` is the same vector.
        axis: (3,) unit vector.

    Returns:
        (N,) angle 2 atan2(v·axis, w), rad, within ±2π; and (N, 3) its gradient g: turning q by a small rotation vector δ on the
        right changes the angle by g·δ. Without a turn off the axis g is the axis; half a turn off it, g is infinite.
    """
    w, v = q[:, 0], q[:, 1:]
    p = v @ axis
    size = np.maximum(w * w + p * p, np.finfo(np.float64).tiny)
    gradient = w[:, None] * (w[:, None] * axis + np.cross(axis, v)) + p[:, None] * v
    return 2.0 * np.arctan2(p, w), gradient / size[:, None]
