"""Angles between the segments of a body, and their bands: those of `joint_angles`, with what a body knows of its errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.joint_angles import clinical

__all__ = ["MCGRATH", "angles_deg", "between", "pelvis_deg", "pelvis_std_deg", "spread_deg", "std_deg"]

Array = NDArray[np.float64]
MCGRATH = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Takes vectors of McGrath's frames (x right, y forward, z towards the body) to ISB's (X anterior, Y proximal, Z right)."""

HEADINGS = 12
"""So many directions stand for all."""


def between(upper: tuple[Array, Array], lower: tuple[Array, Array]) -> Array:
    """(K, 3, 3) distal segment to proximal one, from (K, 3, 3) sensor to world and (3, 3) segment to sensor of either."""
    return np.swapaxes(upper[0] @ upper[1], 1, 2) @ (lower[0] @ lower[1])


def angles_deg(kind: str, side: str, relative: Array) -> Array:
    """(K, 3) flexion, adduction, internal rotation of what `between` gives, degrees."""
    return np.degrees(clinical(relative, side, kind)[0])


def std_deg(
    kind: str,
    side: str,
    upper: tuple[Array, Array],
    lower: tuple[Array, Array],
    turns: tuple[Array, Array],
    covariance: tuple[Array, Array, Array],
    loose: tuple[Array, Array],
) -> Array:
    """(K, 3) standard deviations of `angles_deg`, to first order; at most 180.

    Args:
        kind, side: as `angles_deg`.
        upper, lower: as `between`.
        turns: (3, C) of either segment's frame, in its own axes, by the constants.
        covariance: (K, 6, 6) of the rotation vectors by which both sensors may be turned in the world, (K, 6, C) of these with
            the constants, (C, C) of the constants.
        loose: (3,) each, variance about each of its axes of how a segment may be turned against its frame, rad².
    """
    relative = between(upper, lower)
    back = np.swapaxes(lower[0] @ lower[1], 1, 2)
    _, per_turn = clinical(relative, side, kind)
    # Rotation vector in the distal segment by the two turns in the world, and by the constants, which move both frames.
    by_turns = per_turn @ np.concatenate([-back, back], axis=2)
    to_lower = np.swapaxes(relative, 1, 2)
    by_constants = per_turn @ (turns[1] - to_lower @ turns[0])
    return _std(by_turns, by_constants, covariance, per_turn**2 @ loose[1] + (per_turn @ to_lower) ** 2 @ loose[0])


def spread_deg(kind: str, side: str, upper: tuple[Array, Array], lower: tuple[Array, Array]) -> Array:
    """(K, 3) how far `angles_deg` are off, rms, where the heading of one segment against the other may be any: too far for
    derivatives. `upper`, `lower` as of `between`, in a world with z up."""
    now = angles_deg(kind, side, between(upper, lower))
    square = np.zeros_like(now)
    headings = np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False)
    for c, s in zip(np.cos(headings), np.sin(headings), strict=True):
        about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        off = angles_deg(kind, side, between(upper, (about_z @ lower[0], lower[1]))) - now
        square += ((off + 180.0) % 360.0 - 180.0) ** 2
    spread: Array = np.sqrt(square / HEADINGS)
    return spread


def pelvis_deg(pelvis: tuple[Array, Array]) -> Array:
    """(K, 2) how a pelvis is tilted (its front up: positive) and listed (its right side down: positive), degrees, whatever its
    heading: turns about its own Z, then X, as OpenSim's `pelvis_tilt` and `pelvis_list` of a pelvis that faces ahead.

    Args:
        pelvis: (K, 3, 3) sensor to world, z up, and (3, 3) segment to sensor.
    """
    up = (pelvis[0] @ pelvis[1])[:, 2]
    angles: Array = np.degrees(np.stack([np.arcsin(np.clip(up[:, 0], -1.0, 1.0)), np.arctan2(-up[:, 2], up[:, 1])], axis=1))
    return angles


def pelvis_std_deg(pelvis: tuple[Array, Array], turns: Array, covariance: tuple[Array, Array, Array]) -> Array:
    """(K, 2) standard deviations of `pelvis_deg`, to first order; at most 180. `covariance` as of `std_deg`: (K, 3, 3),
    (K, 3, C) and (C, C)."""
    tilt, list_ = np.radians(pelvis_deg(pelvis)).T
    slope, zero = np.tan(np.clip(tilt, -1.5, 1.5)), np.zeros(len(tilt))
    per_turn = np.stack(
        [
            np.stack([zero, np.sin(list_), np.cos(list_)], axis=1),
            np.stack([zero + 1.0, -slope * np.cos(list_), slope * np.sin(list_)], axis=1),
        ],
        axis=1,
    )
    back = np.swapaxes(pelvis[0] @ pelvis[1], 1, 2)
    return _std(per_turn @ back, per_turn @ turns, covariance)


def _std(by_turns: Array, by_constants: Array, covariance: tuple[Array, Array, Array], more: Array | float = 0.0) -> Array:
    """(K, A) degrees, of gradients (K, A, T) and (K, A, C) and of further variances, rad²."""
    own, beside, constants = covariance
    variance = (by_turns @ own * by_turns).sum(axis=2) + (by_constants @ constants * by_constants).sum(axis=2)
    variance += 2.0 * (by_turns @ beside * by_constants).sum(axis=2)
    # Below zero is what rounding makes of something that nothing determines.
    std: Array = np.minimum(np.degrees(np.sqrt(np.where(variance < 0.0, np.inf, variance) + more)), 180.0)
    return std
