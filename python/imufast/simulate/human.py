"""Human-like motions of thigh (segment 1) and shank (segment 2): walking and sit-to-stand, as truncated Fourier series.

The shapes are drawn after textbook curves of the sagittal knee and hip; flexion is positive about the hinge axis.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .checks import FloatArray
from .pose import Pose, Program
from .signals import Signal, periodic, pulse, random_band

__all__ = ["sit_to_stand", "walking"]

DEG = np.pi / 180.0
UPRIGHT = 0.5 * np.pi  # swing that lets the limb's x point down
Rng = Callable[[str], np.random.Generator]


def _cosine(x: FloatArray, cycles: int = 1, shift: float = 0.0) -> FloatArray:
    return np.cos(2.0 * np.pi * cycles * (x - shift))


def walking(rng: Rng, tempo: float, size: float, axis_tilt_rad: float, sway_m: float) -> Program:
    """Level walking, 0.95 strides/s at tempo 1, heel strike at the start of each stride; knee 4 to about 63 degrees."""
    stride = 0.95 * tempo
    knee = periodic(lambda x: DEG * (4 + 14 * pulse(x, 0.15, 9) + 56 * pulse(x, 0.73, 3)), stride, 10)
    thigh = periodic(lambda x: DEG * (8 + 20 * _cosine(x, shift=-0.06) + 2 * _cosine(x, 2, 0.1)), stride, 4)
    turn = periodic(lambda x: DEG * 5 * _cosine(x, shift=0.1), stride, 2)
    lean = periodic(lambda x: DEG * 3 * _cosine(x, shift=0.3), stride, 2)
    # The strike: a few millimetres within about 50 ms are some 10 m/s² at the knee.
    bob = periodic(lambda x: 0.02 * _cosine(x, 2, 0.2) - 0.006 * pulse(x, 0.03, 60), stride, 24)
    surge = periodic(lambda x: 0.05 * _cosine(x, 1, 0.85) - 0.004 * pulse(x, 0.02, 60), stride, 24)
    # No two strides are alike: all angles grow and shrink by 6 %, the heading wanders.
    vary = {name: random_band(rng(name), 0.06, (0.05, 0.4 * tempo)) for name in ("knee", "thigh")}
    wander = {name: random_band(rng(name), DEG * 4, (0.03, 0.2 * tempo)) for name in ("heading", "tilt")}
    further = {name: random_band(rng(name), 1.0, (0.5 * tempo, 2.0 * tempo)) for name in ("second", "third")}
    sways = [random_band(rng(f"sway {axis}"), sway_m, (0.1 * tempo, 0.6 * tempo)) for axis in "xyz"]
    heading = rng("pose").uniform(-np.pi, np.pi)

    def pose(time_s: FloatArray) -> Pose:
        forward = surge.at(time_s) + Signal.line(1.3 * tempo, time_s) + sways[0].at(time_s)
        aside = sways[1].at(time_s)
        return Pose(
            heading=size * (turn.at(time_s) + wander["heading"].at(time_s)) + heading,
            tilt=size * (lean.at(time_s) + wander["tilt"].at(time_s)) + axis_tilt_rad,
            swing=UPRIGHT - size * thigh.at(time_s) * (1.0 + vary["thigh"].at(time_s)),
            hinge=size * knee.at(time_s) * (1.0 + vary["knee"].at(time_s)),
            **{name: turns.at(time_s) for name, turns in further.items()},
            position=(
                np.cos(heading) * forward - np.sin(heading) * aside,
                np.sin(heading) * forward + np.cos(heading) * aside,
                bob.at(time_s) + sways[2].at(time_s),
            ),
        )

    return pose


def sit_to_stand(rng: Rng, tempo: float, size: float, axis_tilt_rad: float, sway_m: float) -> Program:
    """Standing up and sitting down again every 5 s at tempo 1; knee 5 to about 95 degrees."""
    cycle = 0.2 * tempo

    def sitting(x: FloatArray) -> FloatArray:
        return 0.5 * (1.0 + np.tanh(3.0 * _cosine(x)))

    knee = periodic(lambda x: DEG * (5 + 90 * sitting(x)), cycle, 12)
    thigh = periodic(lambda x: DEG * (85 * sitting(x) - 10 * (1 - (2 * sitting(x) - 1) ** 2)), cycle, 12)
    # A seat is never met twice in the same way, and a standing person sways.
    vary = {name: random_band(rng(name), DEG * 2, (0.1, 0.7 * tempo)) for name in ("heading", "tilt", "swing", "hinge")}
    further = {name: random_band(rng(name), 1.0, (0.2 * tempo, 0.6 * tempo)) for name in ("second", "third")}
    sways = [random_band(rng(f"sway {axis}"), sway_m, (0.1 * tempo, 0.6 * tempo)) for axis in "xyz"]
    heading = rng("pose").uniform(-np.pi, np.pi)

    def pose(time_s: FloatArray) -> Pose:
        wander = {name: size * band.at(time_s) for name, band in vary.items()}
        x, y, z = (sway.at(time_s) for sway in sways)
        return Pose(
            heading=wander["heading"] + heading,
            tilt=wander["tilt"] + axis_tilt_rad,
            swing=UPRIGHT - size * thigh.at(time_s) + wander["swing"],
            hinge=size * knee.at(time_s) + wander["hinge"],
            **{name: turns.at(time_s) for name, turns in further.items()},
            position=(x, y, z),
        )

    return pose
