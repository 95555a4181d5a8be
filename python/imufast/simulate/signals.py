"""Smooth scalar functions of time, evaluated together with their exact derivatives.

Everything the simulator moves is made of these, so that rates and accelerations are never differences of samples. A
`Sinusoids` is the function, a `Signal` what it is at given instants; sums and products of signals carry the derivatives on.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .checks import FloatArray

__all__ = ["ORDER", "Signal", "Sinusoids", "periodic", "pulse", "random_band", "stream"]

ORDER = 3  # two for accelerations, one more because soft tissue answers to rates


def stream(seed: int, *names: object) -> np.random.Generator:
    """The random generator for one purpose: a change to one setting leaves the draws of all others alone."""
    return np.random.default_rng([seed, zlib.crc32("/".join(map(str, names)).encode())])


@dataclass(frozen=True, eq=False)
class Signal:
    """A scalar at N instants: row k of `rows` (K + 1, N) is its k-th time derivative."""

    rows: FloatArray

    @classmethod
    def constant(cls, value: float, time_s: FloatArray) -> Signal:
        """The same value at all times."""
        rows = np.zeros((ORDER + 1, len(time_s)))
        rows[0] = value
        return cls(rows)

    @classmethod
    def line(cls, slope: float, time_s: FloatArray) -> Signal:
        """`slope` * time."""
        rows = np.zeros((ORDER + 1, len(time_s)))
        rows[0], rows[1] = slope * time_s, slope
        return cls(rows)

    @classmethod
    def step(cls, time_s: FloatArray, start_s: float, ramp_s: float) -> Signal:
        """From 0 to 1 within `ramp_s` from `start_s` on, with four continuous derivatives (polynomial of degree 9)."""
        x = np.clip((time_s - start_s) / ramp_s, 0.0, 1.0)
        shape = np.polynomial.Polynomial([0, 0, 0, 0, 0, 126, -420, 540, -315, 70])
        rows = [(shape.deriv(k) if k else shape)(x) / ramp_s**k for k in range(ORDER + 1)]
        return cls(np.array(rows))

    @property
    def order(self) -> int:
        """The highest derivative known."""
        return len(self.rows) - 1

    def __add__(self, other: Signal | float) -> Signal:
        if isinstance(other, Signal):
            n = min(self.order, other.order) + 1
            return Signal(self.rows[:n] + other.rows[:n])
        rows = self.rows.copy()
        rows[0] += other
        return Signal(rows)

    __radd__ = __add__

    def __neg__(self) -> Signal:
        return Signal(-self.rows)

    def __sub__(self, other: Signal | float) -> Signal:
        return self + (-other)

    def __rsub__(self, other: float) -> Signal:
        return -self + other

    def __mul__(self, other: Signal | float) -> Signal:
        if not isinstance(other, Signal):
            return Signal(self.rows * other)
        order = min(self.order, other.order)
        rows = np.zeros((order + 1, self.rows.shape[1]))
        for k in range(order + 1):  # Leibniz
            for i in range(k + 1):
                rows[k] += math.comb(k, i) * self.rows[i] * other.rows[k - i]
        return Signal(rows)

    __rmul__ = __mul__

    def derivative(self, n: int = 1) -> Signal:
        """The n-th time derivative, known to n orders less."""
        return Signal(self.rows[n:])

    def tanh(self) -> Signal:
        """Softly limited to -1 .. 1; known to the second derivative."""
        u0, u1, u2 = self.rows[:3]
        value = np.tanh(u0)
        slope = 1.0 - value * value
        return Signal(np.array([value, slope * u1, slope * u2 - 2.0 * value * slope * u1 * u1]))


@dataclass(frozen=True, eq=False)
class Sinusoids:
    """offset + sum of amplitude * sin(2 pi frequency_hz t + phase); arrays (M,)."""

    amplitude: FloatArray
    frequency_hz: FloatArray
    phase: FloatArray
    offset: float = 0.0

    def at(self, time_s: FloatArray) -> Signal:
        """The signal at the instants `time_s` (N,)."""
        rows = np.zeros((ORDER + 1, len(time_s)))
        rows[0] = self.offset
        # One by one, not as a matrix product: a sample then does not depend on which others are asked for.
        for amplitude, frequency, phase in zip(self.amplitude, 2.0 * np.pi * self.frequency_hz, self.phase, strict=True):
            angle = frequency * time_s + phase
            cycle = (np.sin(angle), np.cos(angle))
            for k in range(ORDER + 1):
                sign = -1.0 if k % 4 >= 2 else 1.0
                rows[k] += sign * amplitude * frequency**k * cycle[k % 2]
        return Signal(rows)


def random_band(rng: np.random.Generator, rms: float, band_hz: tuple[float, float], lines: int = 10) -> Sinusoids:
    """Random motion of a given rms within a band: one sinusoid of random frequency and phase in each of `lines` equal parts."""
    low, high = band_hz
    frequency = low + (high - low) * (np.arange(lines) + rng.random(lines)) / lines
    return Sinusoids(np.full(lines, rms * math.sqrt(2.0 / lines)), frequency, rng.uniform(-np.pi, np.pi, lines))


def periodic(shape: Callable[[FloatArray], FloatArray], frequency_hz: float, harmonics: int) -> Sinusoids:
    """The Fourier series, cut after `harmonics`, of a shape that is given over one cycle, 0 <= x < 1."""
    samples = 512
    spectrum = np.fft.rfft(shape(np.arange(samples) / samples))[: harmonics + 1] / samples
    order = np.arange(1, harmonics + 1, dtype=np.float64)
    return Sinusoids(
        2.0 * np.abs(spectrum[1:]), order * frequency_hz, np.angle(spectrum[1:]) + 0.5 * np.pi, float(spectrum[0].real)
    )


def pulse(x: FloatArray, centre: float, sharpness: float) -> FloatArray:
    """A bump of height 1 that repeats with period 1; its width is about 0.4 / sqrt(sharpness) of the period."""
    return np.exp(sharpness * (np.cos(2.0 * np.pi * (x - centre)) - 1.0))
