"""Soft tissue: which sensors skin and straps turn and shift on their bones, and by which angles.

In step with the flexion of a joint nearby, to first order: so a joint's centre moves in the sensor, which the core estimates
(`factors/skin.rs`). It shows where the centres are at the average posture, and there the frames of the segments are found. The
angles are not turned back to the bones by it: on what a knee does that is no hinge's doing, no inertial sensor gives a verdict.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import Layout
from imufast.body.settings import LowerBodySettings
from imufast.quaternion import conjugate, multiply

__all__ = ["Skin", "Tissue", "skins"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Skin:
    """What moves a thigh's or shank's sensor on its bone in proportion to the flexion of a joint at that bone.

    Attributes:
        sensor: its number.
        pair: the numbers of the two sensors whose joint it is that bends.
        axis: joint and side of the knee axis about which it bends, in the lower one of them.
    """

    sensor: int
    pair: tuple[int, int]
    axis: tuple[int, int]


def skins(layout: Layout, settings: LowerBodySettings) -> list[Skin]:
    """A thigh answers to its knee and its hip, a shank to its knee; none where sensors are taken to sit on bone."""
    if settings.soft_tissue_deg == 0.0 and settings.soft_tissue_m == 0.0:
        return []
    found: list[Skin] = []
    for name, pair in layout.joints.items():
        kind, _, side = name.partition("_")
        if kind == "knee":
            found += [Skin(sensor, pair, (layout.names.index(name), 1)) for sensor in pair]
        elif kind == "hip" and f"knee_{side}" in layout.joints:
            found.append(Skin(pair[1], pair, (layout.names.index(f"knee_{side}"), 0)))
    return found


class Tissue:
    """The skins of a body and the postures that their angles count from.

    Args:
        moved: what `skins` gives.
        q: (K, S, 4) sensors to the world: the average of these is zero.
    """

    def __init__(self, moved: list[Skin], q: Array) -> None:
        self.skins = moved
        self.zero = [_mean(_relative(q, skin)) for skin in moved]

    def drives(self, q: Array, axes: Array) -> Array:
        """(K, T, 1) flexion of the joint that moves each skin, rad: how its lower sensor is turned against the upper one about
        the knee's axis.

        Args:
            q: (K, S, 4) sensors to the world.
            axes: (J, 2, 3) knee axes.
        """
        found = np.zeros((len(q), len(self.skins), 1))
        for n, (skin, zero) in enumerate(zip(self.skins, self.zero, strict=True)):
            relative = _relative(q, skin)
            off = multiply(np.broadcast_to(conjugate(zero), relative.shape), relative)
            found[:, n, 0] = np.mod(2.0 * np.arctan2(off[:, 1:] @ axes[skin.axis], off[:, 0]) + np.pi, 2.0 * np.pi) - np.pi
        return found


def _relative(q: Array, skin: Skin) -> Array:
    upper, lower = skin.pair
    return multiply(conjugate(q[:, upper]), q[:, lower])


def _mean(q: Array) -> Array:
    """(4,) of unit quaternions (K, 4), whatever their signs."""
    mean: Array = np.linalg.eigh(q.T @ q)[1][:, -1]
    return mean
