"""Where both segments are, as signals: what a motion says and a simulation turns into sensor readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .checks import FloatArray
from .signals import Signal

__all__ = ["Pose", "Program"]


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
    position: tuple[Signal, Signal, Signal]


Program = Callable[[FloatArray], Pose]
