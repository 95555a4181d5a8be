"""Where both segments are: angles that a motion says, and the turning frames a simulation makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .checks import FloatArray
from .signals import Signal
from .so3 import Turning

__all__ = ["BallPose", "BallProgram", "Bodies", "Movement", "Pose", "Position", "Program", "X", "Y", "Z"]

X, Y, Z = np.eye(3)
Position = tuple[Signal, Signal, Signal]


@dataclass(frozen=True, eq=False)
class Pose:
    """Angles (rad) and the joint centre (m, global) at N instants; `motions` says what the angles mean.

    `second` and `third` are further turns between the segments for joints that are no hinges, with rms 1 rad while the joint
    moves: the simulation scales them.
    """

    heading: Signal
    tilt: Signal
    swing: Signal
    hinge: Signal
    second: Signal
    third: Signal
    position: Position


Program = Callable[[FloatArray], Pose]


@dataclass(frozen=True, eq=False)
class BallPose:
    """Angles (rad) of two links with a spherical joint and the joint centre (m, global) at N instants; see `ball_motions`.

    `turns` are the joint's angles about y, z and x, one after the other; `share1` is the part of them that link 1 makes
    against the frame that heading, tilt and swing turn, 0 (link 1 keeps to it) to 1 (link 2 does). With a grip, `position` is
    that of the hand; see `BallMotion.grip_m`.
    """

    heading: Signal
    tilt: Signal
    swing: Signal
    turns: tuple[Signal, Signal, Signal]
    share1: Signal
    position: Position
    grip_m: float


BallProgram = Callable[[FloatArray], BallPose]


@dataclass(frozen=True, eq=False)
class Bodies:
    """Both segments at N instants, whatever joins them.

    Attributes:
        segments: segment 1 and 2 in the global frame (z up).
        position: joint centre in the global frame, m.
        swing: angle of each segment about the first joint axis in space, rad; soft tissue answers to it.
        bend: joint angle about that axis, rad; likewise.
        truth: further truth (N, ...) under the names of the simulation's result.
    """

    segments: tuple[Turning, Turning]
    position: Position
    swing: tuple[Signal, Signal]
    bend: Signal
    truth: dict[str, FloatArray]


Movement = Callable[[FloatArray], Bodies]
