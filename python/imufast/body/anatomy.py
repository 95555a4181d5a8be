"""Segment frames of a body in its sensors, and where these are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import Layout
from imufast.frames import spanned
from imufast.quaternion import matrix

__all__ = ["frames", "positions"]

Array = NDArray[np.float64]


def frames(layout: Layout, centers: Array, axes: Array, up: Array) -> dict[int, Array]:
    """Sensor to (3, 3), segment (X anterior, Y proximal, Z right, as ISB and `SegmentFrame` have it) to sensor (eqs 19, 20);
    feet, and a pelvis without both hips, excepted."""
    bones, found = layout.bones(), {}
    for k, segment in enumerate(layout.segments):
        kind, _, side = segment.partition("_")
        if kind == "pelvis":
            if "hips" in bones:
                right = centers[bones["hips"][0]] - centers[bones["hips"][1]]
                # Of the upright what stands across the line between the hips.
                found[k] = spanned("right", right, "proximal", up[k]).T
        elif kind in ("thigh", "shank") and f"knee_{side}" in layout.joints:
            bone = bones.get(f"{'femur' if kind == 'thigh' else 'tibia'}_{side}")
            along = up[k] if bone is None else centers[bone[0]] - centers[bone[1]]
            j = layout.names.index(f"knee_{side}")
            found[k] = spanned("proximal", along, "right", axes[j, 0 if kind == "thigh" else 1]).T
    return found


def positions(layout: Layout, q: Array, centers: Array) -> Array:
    """(K, S, 3) places of the sensors, the root at rest."""
    turned = matrix(q)
    place = np.zeros((len(q), len(layout.segments), 3))
    for j, (upper, lower) in enumerate(layout.joints.values()):
        place[:, lower] = place[:, upper] + turned[:, upper] @ centers[j, 0] - turned[:, lower] @ centers[j, 1]
    return place
