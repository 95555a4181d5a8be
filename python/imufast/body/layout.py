"""Which sensor is on which segment, and what joints and bones that makes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError
from imufast.imu import Recording

__all__ = ["JOINTS", "SEGMENTS", "SIDES", "Layout", "layout"]

SIDES = ("right", "left")
SEGMENTS = ("pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left", "shank_left", "foot_left")
JOINTS = {
    "hip_right": ("pelvis", "thigh_right"),
    "knee_right": ("thigh_right", "shank_right"),
    "ankle_right": ("shank_right", "foot_right"),
    "hip_left": ("pelvis", "thigh_left"),
    "knee_left": ("thigh_left", "shank_left"),
    "ankle_left": ("shank_left", "foot_left"),
}


class Layout:
    """Segments with a sensor, from the pelvis down, and the joints between them.

    Attributes:
        placed: segment to sensor name, in the order of `SEGMENTS`.
        segments: their names; a sensor's number is its place here.
        joints: joint to the numbers of its sensors, the one nearer to the pelvis first.
        names: of the joints; a joint's number is its place here.
    """

    def __init__(self, placed: dict[str, str]) -> None:
        self.placed, self.segments = placed, list(placed)
        index = {segment: k for k, segment in enumerate(self.segments)}
        self.joints = {name: (index[a], index[b]) for name, (a, b) in JOINTS.items() if a in index and b in index}
        self.names = list(self.joints)

    def parts(self) -> list[Layout]:
        """The layouts of the parts that no joint connects: without a pelvis both legs."""
        part = list(range(len(self.segments)))
        # Segments and joints go from the pelvis down, so the upper one's part is settled.
        for upper, lower in self.joints.values():
            part[lower] = part[upper]
        return [
            Layout({s: n for (s, n), k in zip(self.placed.items(), part, strict=True) if k == root})
            for root in sorted(set(part))
        ]

    def beyond(self, joint: str) -> NDArray[np.intp]:
        """(S,) 1 for all sensors that hang on a joint, from its lower one on, else 0."""
        hang = np.zeros(len(self.segments), dtype=np.intp)
        hang[self.joints[joint][1]] = 1
        for upper, lower in self.joints.values():
            hang[lower] |= hang[upper]
        return hang

    def seen(self, joint: str, segment: str) -> tuple[int, int] | None:
        """Joint and side, as the core counts them; None where the joint or the segment is not in the model."""
        if joint not in self.joints:
            return None
        return self.names.index(joint), JOINTS[joint].index(segment)

    def bones(self) -> dict[str, tuple[tuple[int, int], tuple[int, int]]]:
        """Bone to both its ends, nearer to the pelvis (of the hips: the right one) first."""
        found = {}
        for side in SIDES:
            for bone, segment, upper, lower in (("femur", "thigh", "hip", "knee"), ("tibia", "shank", "knee", "ankle")):
                ends = [self.seen(f"{joint}_{side}", f"{segment}_{side}") for joint in (upper, lower)]
                if ends[0] is not None and ends[1] is not None:
                    found[f"{bone}_{side}"] = (ends[0], ends[1])
        hips = [self.seen(f"hip_{side}", "pelvis") for side in SIDES]
        if hips[0] is not None and hips[1] is not None:
            found["hips"] = (hips[0], hips[1])
        return found


def layout(recording: object, placement: object) -> Layout:
    """The checked placement.

    Raises:
        InputError: not a recording; a placement that names no segment or sensor, uses a sensor twice, or leaves a segment
            without a neighbour.
    """
    if not isinstance(recording, Recording):
        raise InputError(f"recording must be a Recording, got {type(recording).__name__}; imufast.read(...) makes one")
    if not isinstance(placement, Mapping):
        raise InputError(f"placement must map segments to sensor names, got {type(placement).__name__}")
    for segment, name in placement.items():
        if segment not in SEGMENTS:
            raise InputError(f"placement names no segment: {segment!r}; segments are {', '.join(SEGMENTS)}")
        if name not in recording:
            raise InputError(f"placement[{segment!r}] names no sensor: {name!r}; there are {', '.join(map(repr, recording))}")
    placed = {segment: placement[segment] for segment in SEGMENTS if segment in placement}
    names = list(placed.values())
    for name in names:
        if names.count(name) > 1:
            twice = [segment for segment in placed if placed[segment] == name]
            raise InputError(f"placement uses sensor {name!r} for {' and '.join(twice)}; each segment needs its own")
    if len(placed) < 2:
        raise InputError("placement must have two segments that share a joint at least")
    found = Layout(placed)
    alone = [part.segments[0] for part in found.parts() if not part.joints]
    if alone:
        raise InputError(
            f"placement leaves {' and '.join(alone)} unconnected: no neighbour has a sensor; "
            f"leave {alone[0]!r} out of the placement"
        )
    return found
