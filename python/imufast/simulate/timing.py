"""When samples are taken and which of them arrive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast.errors import SettingsError

from .checks import FloatArray, number, times
from .motion_base import MotionBase

__all__ = ["Clock", "Part", "Timeline", "arrived", "interval_before", "schedule"]

MOST_SAMPLES = 2e7  # about 10 GB of readings and truth


@dataclass(frozen=True, eq=False)
class Part:
    """The samples of one stretch of a recording: when on the recording's clock, and how long after the stretch began (s)."""

    time_s: FloatArray
    since_start_s: FloatArray


@dataclass(frozen=True, eq=False)
class Timeline:
    """All stretches of a recording; `rate_hz` is None where they lie on given times."""

    parts: list[Part]
    rate_hz: float | None

    @cached_property
    def time_s(self) -> FloatArray:
        """(N,) time stamps of all stretches, s."""
        return np.concatenate([part.time_s for part in self.parts])

    @property
    def counts(self) -> list[int]:
        """Number of samples of each stretch."""
        return [len(part.time_s) for part in self.parts]

    @property
    def unbroken(self) -> bool:
        """Whether all samples lie on one regular grid without a gap."""
        return self.rate_hz is not None and bool((np.diff(np.round(self.time_s * self.rate_hz)) == 1.0).all())


@dataclass(frozen=True, eq=False)
class Clock:
    """When samples are asked for: at a rate, or at given times (N,), s."""

    rate_hz: float
    time_s: FloatArray | None

    @classmethod
    def checked(cls, rate_hz: float | None, time_s: ArrayLike | None, usual_hz: float) -> Clock:
        """The settings of a simulation, checked; where neither is given, the usual rate."""
        if time_s is not None and rate_hz is not None:
            raise SettingsError("rate_hz and time_s exclude each other; give one of them")
        rate = number("rate_hz", usual_hz if rate_hz is None else rate_hz, above=0.0)
        return cls(rate, None if time_s is None else times("time_s", time_s))

    def timeline(self, motions: Sequence[MotionBase], transition_s: float) -> Timeline:
        """The motions one after the other, `transition_s` apart."""
        gap_s = number("transition_s", transition_s, least=0.0)
        parts = schedule([m.recorded_s for m in motions], gap_s, self.rate_hz, self.time_s)
        if sum(len(part.time_s) for part in parts) < 2:
            raise SettingsError("duration_s, rate_hz or time_s leave fewer than 2 samples")
        return Timeline(parts, self.rate_hz if self.time_s is None else None)


def schedule(durations_s: list[float], gap_s: float, rate_hz: float, time_s: FloatArray | None) -> list[Part]:
    """Place stretches one after the other, `gap_s` apart, from time 0 on.

    On a regular grid durations and gaps are rounded to whole samples. Of given times, those in a gap are left out; a time
    before 0 or after the last stretch is refused.
    """
    if time_s is None:
        if (sum(durations_s) + gap_s * len(durations_s)) * rate_hz > MOST_SAMPLES:
            raise SettingsError(f"duration_s and rate_hz ask for more than {MOST_SAMPLES:.0e} samples; simulate it in pieces")
        counts = [round(duration * rate_hz) for duration in durations_s]
        gap = round(gap_s * rate_hz)
        starts = np.cumsum([0] + [count + gap for count in counts[:-1]])
        return [
            Part((first + np.arange(count)) / rate_hz, np.arange(count) / rate_hz)
            for first, count in zip(starts, counts, strict=True)
        ]
    begins = np.cumsum([0.0] + [duration + gap_s for duration in durations_s[:-1]])
    end = begins[-1] + durations_s[-1]
    if time_s[0] < 0.0 or time_s[-1] >= end:
        raise SettingsError(f"time_s must lie within the motion, 0 <= t < {end:g} s; got {time_s[0]:g} to {time_s[-1]:g}")
    parts = []
    for begin, duration in zip(begins, durations_s, strict=True):
        inside = time_s[(time_s >= begin) & (time_s < begin + duration)]
        parts.append(Part(inside, inside - begin))
    return parts


def interval_before(time_s: FloatArray) -> FloatArray:
    """Length of the interval that ends at each sample (N,), s; the first one is taken to be as long as the second."""
    steps = np.diff(time_s)
    return np.concatenate([steps[:1], steps]) if len(steps) else np.zeros(len(time_s))


def arrived(rng: np.random.Generator, n: int, loss: float, burst: float) -> NDArray[np.bool_]:
    """Which of n packets arrive, (n,): a fraction `loss` does not, in bursts of mean length `burst` (Gilbert's two states)."""
    here = np.ones(n, dtype=np.bool_)
    if loss == 0.0:
        return here
    # Runs of both states are geometric; the mean good run follows from the fraction lost (never shorter than one packet).
    good = max(1.0, burst * (1.0 - loss) / loss)
    place = 0 if rng.random() < loss else int(rng.geometric(1.0 / good))
    while place < n:
        length = int(rng.geometric(1.0 / burst))
        here[place : place + length] = False
        place += length + int(rng.geometric(1.0 / good))
    return here
