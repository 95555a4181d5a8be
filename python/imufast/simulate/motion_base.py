"""What the motions of every simulated joint have in common: their settings, and how a call names them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of, whole

__all__ = ["MotionBase", "as_motions"]


@dataclass(frozen=True)
class MotionBase:
    """One motion of two segments; `Motion` and `BallMotion` say which kinds there are and what the settings mean for them."""

    KINDS: ClassVar[tuple[str, ...]] = ()

    kind: str
    label: str | None = None
    duration_s: float = 50.0
    start_s: float = 0.0
    stop_s: float | None = None
    tempo: float = 1.0
    size: float = 1.0
    axis_tilt_rad: float = 0.0
    sway_m: float = 0.03
    take: int = 0

    def __post_init__(self) -> None:
        one_of("kind", self.kind, self.KINDS)
        if self.label is not None and not isinstance(self.label, str):
            raise SettingsError(f"label must be a string or None; got {self.label!r}")
        number("duration_s", self.duration_s, above=0.0)
        number("start_s", self.start_s, least=0.0, below=self.duration_s)
        if self.stop_s is not None:
            number("stop_s", self.stop_s, above=self.start_s)
            if self.stop_s > self.duration_s:
                raise SettingsError(f"stop_s must not exceed duration_s = {self.duration_s:g}; got {self.stop_s:g}")
        number("tempo", self.tempo, above=0.0)
        number("size", self.size, least=0.0)
        number("axis_tilt_rad", self.axis_tilt_rad)
        number("sway_m", self.sway_m, least=0.0)
        whole("take", self.take, least=0)

    @property
    def name(self) -> str:
        """The label, or the kind where there is none."""
        return self.kind if self.label is None else self.label

    @property
    def recorded_s(self) -> float:
        """Length of the stretch that is recorded, s."""
        return (self.duration_s if self.stop_s is None else self.stop_s) - self.start_s

    def stretch(self: M, start_s: float, stop_s: float) -> M:
        """The same motion, recorded from `start_s` to `stop_s` only."""
        return replace(self, start_s=start_s, stop_s=stop_s)


M = TypeVar("M", bound=MotionBase)


def as_motions(
    motion: Any,
    duration_s: float | None,
    clock: FloatArray | None,
    own: type[M],
    named: Callable[[Any, float | None], M],
) -> tuple[M, ...]:
    """What a simulation was asked for, as motions.

    Args:
        motion: one motion or a sequence of motions, each of the class `own` or what `named` understands.
        duration_s: where given, the length of each motion that is not of the class `own`, s.
        clock: (N,) given sampling times, s; one motion of no stated length lasts as long as they ask for.
        own: the class of the simulation's motions.
        named: turns anything else into a motion of a given length, or of its own usual length (None), or refuses it.
    """
    if isinstance(motion, own):
        if duration_s is not None:
            raise SettingsError(f"duration_s has no effect on a {own.__name__}, which has its own; set it there")
        return (motion,)
    length = None if duration_s is None else number("duration_s", duration_s, above=0.0)
    if isinstance(motion, Sequence) and not isinstance(motion, str):
        if not motion:
            raise SettingsError("motion must not be an empty sequence")
        if any(isinstance(m, Sequence) and not isinstance(m, str) for m in motion):
            raise SettingsError("motion must be one flat sequence; it holds another sequence")
        return tuple(m if isinstance(m, own) else named(m, length) for m in motion)
    made = named(motion, length)
    if clock is not None and length is None and clock[-1] >= made.duration_s:
        made = named(motion, float(np.nextafter(clock[-1], np.inf)))
    return (made,)
