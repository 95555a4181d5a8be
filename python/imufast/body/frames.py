"""Anatomical frames in sensor frames, joint angles, and their bands.

Frames as in McGrath & Stirling 2020: x to the right, y forward, z towards the body, eqs 19 and 20. Angles are those of Grood &
Suntay 1983 as ISB recommends (in ISB's axes Z, X, Y one after the other): flexion, adduction, internal rotation of the distal
segment, positive on both sides; of the ankle dorsiflexion.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["angle_std_deg", "angles_deg", "frame"]

Array = NDArray[np.float64]


def frame(right: Array, up: Array) -> Array:
    """(3, 3) segment to sensor: z along `up`, x along what is left of `right` (eq. 19)."""
    z = up / np.linalg.norm(up)
    y = np.cross(z, right)
    y /= np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def angles_deg(kind: str, side: str, relative: Array) -> Array:
    """(K, 3) flexion, adduction, internal rotation of distal-to-proximal rotations (K, 3, 3)."""
    about_x = np.arctan2(-relative[:, 1, 2], relative[:, 2, 2])
    about_y = np.arcsin(np.clip(relative[:, 0, 2], -1.0, 1.0))
    about_z = np.arctan2(-relative[:, 0, 1], relative[:, 0, 0])
    mirror = 1.0 if side == "right" else -1.0
    bend = -1.0 if kind == "knee" else 1.0
    return np.asarray(np.degrees(np.stack([bend * about_x, mirror * about_y, mirror * about_z], axis=-1)))


def angle_std_deg(
    kind: str,
    side: str,
    turned: tuple[Array, Array],
    frames: Callable[[Array], tuple[Array, Array]],
    covariance: tuple[Array, Array, Array],
    loose: tuple[Array, Array],
) -> Array:
    """(K, 3) standard deviations of `angles_deg`, to first order.

    Args:
        kind, side: as `angles_deg`.
        turned: (K, 3, 3) each, sensor to world, of both sensors.
        frames: both frames (3, 3), segment to sensor, after a step (C,) of the constants.
        covariance: (K, 6, 6) of the rotation vectors by which both sensors may be turned in the world, (K, 6, C) of these with
            the constants, (C, C) of the constants.
        loose: (3,) each, variance about each of its axes of how a segment may be turned against its frame, rad².
    """
    own, beside, constants = covariance
    count = constants.shape[0]
    upper, lower = frames(np.zeros(count))
    in_world = turned[1] @ lower
    relative = np.swapaxes(turned[0] @ upper, 1, 2) @ in_world
    # Rotation vector in the distal segment by the two turns in the world...
    back = np.swapaxes(in_world, 1, 2)
    by_turns = np.concatenate([-back, back], axis=2)
    # ...and by the constants, which move both frames.
    by_upper, by_lower = np.zeros((3, count)), np.zeros((3, count))
    step = 1e-6
    for c in range(count):
        moved = np.zeros(count)
        moved[c] = step
        new_upper, new_lower = frames(moved)
        by_upper[:, c] = _vector(upper.T @ new_upper) / step
        by_lower[:, c] = _vector(lower.T @ new_lower) / step
    by_constants = by_lower - np.swapaxes(relative, 1, 2) @ by_upper
    # Angles by the rotation vector.
    now = angles_deg(kind, side, relative)
    slopes = np.empty((len(relative), 3, 3))
    for c in range(3):
        turn = np.zeros((3, 3))
        a, b = (c + 1) % 3, (c + 2) % 3
        turn[a, b], turn[b, a] = -step, step
        slopes[:, :, c] = (angles_deg(kind, side, relative @ (np.eye(3) + turn)) - now) / step
    jt, jc = slopes @ by_turns, slopes @ by_constants
    variance = np.einsum("kia,kab,kib->ki", jt, own, jt) + np.einsum("kia,ab,kib->ki", jc, constants, jc)
    variance += 2.0 * np.einsum("kia,kab,kib->ki", jt, beside, jc)
    # A turn of the upper segment about its own axes is the opposite turn of the lower one about the same lines.
    upper_slopes = slopes @ np.swapaxes(relative, 1, 2)
    variance += upper_slopes**2 @ loose[0] + slopes**2 @ loose[1]
    return np.asarray(np.minimum(np.sqrt(np.maximum(variance, 0.0)), 180.0))


def _vector(turn: Array) -> Array:
    """Rotation vector of a small rotation."""
    return 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
