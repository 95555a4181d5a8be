"""The motions of a two-segment rig (Olsson et al. 2020, section 7.1), two human ones, and the paper's four scenarios.

Segment frames: x along the limb from proximal to distal, y the hinge axis, z to the front of a standing person; global z up.
Segment 1 is turned by heading about z, then tilt about x, then swing about y; so the hinge axis lies `tilt` above the
horizontal plane and swing is the turn of segment 1 about it. Segment 2 is segment 1 turned by the hinge angle about y.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of, whole
from .human import sit_to_stand, walking
from .motion_base import MotionBase
from .pose import Pose, Program
from .signals import Signal, Sinusoids, random_band, stream

__all__ = ["FAST_TEMPO", "KINDS", "Motion", "named_motion", "paper_motion", "program", "scenario_motions"]

KINDS = ("mixed", "stationary", "stiff", "sequential", "planar", "free", "walking", "sit_to_stand")
# Motions 8-14: the same ranges at 2.5 times the rate. Median rates are 1 to 3, then 3 to 7 rad/s; rig files show 1 to 3.
FAST_TEMPO = 2.5


@dataclass(frozen=True)
class Motion(MotionBase):
    """One motion of the two segments.

    Attributes:
        kind: "stationary"; "stiff" (free rotation, the joint locked); "sequential" (segment 1 turns about the hinge axis while
            segment 2 rests, in the second half the converse); "planar" (both turn about the hinge axis, which keeps its
            direction); "free" (both turn, the axis roams); "mixed" (2 s of rest, then free with slow and fast spells);
            "walking"; "sit_to_stand".
        label: what `HingeSimulation.motion` says at its samples, and part of what its random draws depend on; None: the kind.
        duration_s: length of the whole motion, s.
        start_s, stop_s: the stretch of it that is recorded, s; None: to the end.
        tempo: multiplies all frequencies.
        size: multiplies all angles (1: 0.6 rad rms for a rig's motions, a normal knee for the human ones).
        axis_tilt_rad: angle of the hinge axis above the horizontal plane, rad (for "free" and "stiff" its mean).
        sway_m: rms motion of the joint centre in each direction, m; no effect where the joint centre must rest.
        take: another take of the same motion: different random draws.

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    KINDS: ClassVar[tuple[str, ...]] = KINDS


def paper_motion(motion: int, duration_s: float = 50.0) -> Motion:
    """Motion 1-14 of section 7.1; 50 s each give the 700 s of the paper's Scenario 1.

    Raises:
        SettingsError: no such motion, or a duration that is not positive.
    """
    index = whole("motion", motion, least=1) - 1
    if index > 13:
        raise SettingsError(f"motion must be 1 to 14, or a name; got {motion}")
    kind, tilt = (
        ("stationary", 0.0),
        ("stiff", 0.0),
        ("sequential", 0.0),
        ("sequential", math.pi / 4),
        ("planar", 0.0),
        ("planar", math.pi / 4),
        ("free", 0.0),
    )[index % 7]
    tempo = 1.0 if index < 7 else FAST_TEMPO
    return Motion(kind, label=str(motion), duration_s=duration_s, tempo=tempo, axis_tilt_rad=tilt)


def scenario_motions(scenario: int, duration_s: float = 50.0) -> tuple[Motion, ...]:
    """Scenario 1-4 of section 7.1 as stretches of the 14 motions.

    Args:
        scenario: 1 to 4.
        duration_s: length of each whole motion, s, at least 20: the paper takes 10 s of segment 1 alone from motions 3 and
            10, and 20 s of motion 6.

    Raises:
        SettingsError: no such scenario, or motions too short for it.
    """
    one_of("scenario", scenario, (1, 2, 3, 4))
    full = number("duration_s", duration_s, least=20.0)
    m = {k: paper_motion(k, full) for k in range(1, 15)}
    if scenario == 1:
        return tuple(m.values())
    if scenario == 2:
        alone = (m[3].stretch(0.0, 10.0), m[10].stretch(0.0, 10.0))
        return (m[1], *alone, *(m[k] for k in (8, 2, 9, 3, 10, 4, 11, 5, 12, 6, 13, 7, 14)))
    excitation = m[6].stretch(0.0, 20.0)
    if scenario == 3:
        return (excitation, m[1], m[8], m[2], m[9])
    first = [m[k].stretch(0.0, full / 2) for k in (2, 9)]
    second = [m[k].stretch(full / 2, full) for k in (2, 9)]
    return (m[1], m[8], *first, excitation, *second)


def named_motion(motion: Any, duration_s: float | None) -> Motion:
    """The motion of a number or a name that `simulate_hinge` was given; 50 s long unless stated."""
    length = 50.0 if duration_s is None else duration_s
    if isinstance(motion, str):
        if motion not in KINDS:
            raise SettingsError(f"motion must be 1 to 14 or one of {', '.join(KINDS)}; got {motion!r}")
        return Motion(motion, duration_s=length)
    return paper_motion(motion, length)


def program(motion: Motion, seed: int) -> Program:
    """The motion as functions of the time since it began; all random draws are made here."""

    def rng(channel: str) -> np.random.Generator:
        return stream(seed, "motion", motion.name, motion.take, channel)

    if motion.kind == "walking":
        return walking(rng, motion.tempo, motion.size, motion.axis_tilt_rad, motion.sway_m)
    if motion.kind == "sit_to_stand":
        return sit_to_stand(rng, motion.tempo, motion.size, motion.axis_tilt_rad, motion.sway_m)
    return _rig(motion, rng)


def _rig(motion: Motion, rng: Callable[[str], np.random.Generator]) -> Program:
    band = (0.2 * motion.tempo, 0.6 * motion.tempo)
    rms = 0.6 * motion.size
    names = ("heading", "tilt", "swing", "hinge", "second", "third")
    turns = {name: random_band(rng(name), 1.0 if name in ("second", "third") else rms, band) for name in names}
    sways = [random_band(rng(f"sway {axis}"), motion.sway_m, band) for axis in "xyz"]
    # Each motion is held elsewhere in space: rests then differ in where gravity points.
    start = rng("pose")
    at = {"heading": start.uniform(-np.pi, np.pi), "tilt": motion.axis_tilt_rad}
    at |= {"swing": start.uniform(-0.5, 0.5), "hinge": start.uniform(-0.6, 0.6)}
    # The fast spells of "mixed" come and go every 12 s.
    quick = {name: random_band(rng(f"quick {name}"), 0.4 * rms, (2 * band[0], 3 * band[1])) for name in names[:4]}
    spells = Sinusoids(np.array([0.5]), np.array([motion.tempo / 12.0]), np.array([-0.5 * np.pi]), offset=0.5)

    def moving(time_s: FloatArray) -> dict[str, Signal]:
        """How strongly each channel moves, 0 to 1."""
        still, full = Signal.constant(0.0, time_s), Signal.constant(1.0, time_s)
        gate = dict.fromkeys((*names, "sway"), still)
        if motion.kind == "stiff":
            gate |= dict.fromkeys(("heading", "tilt", "swing", "sway"), full)
        elif motion.kind == "sequential":
            # Half the motion each, with ramps of 1 s (shorter in a short motion) inside either half.
            half, ramp = 0.5 * motion.duration_s, min(1.0, 0.1 * motion.duration_s)
            gate["swing"] = Signal.step(time_s, 0.0, ramp) - Signal.step(time_s, half - ramp, ramp)
            later = Signal.step(time_s, half, ramp) - Signal.step(time_s, 2 * half - ramp, ramp)
            gate |= dict.fromkeys(("hinge", "second", "third"), later)
        elif motion.kind == "planar":
            gate |= dict.fromkeys(("swing", "hinge", "second", "third", "sway"), full)
        elif motion.kind == "free":
            gate = dict.fromkeys(gate, full)
        elif motion.kind == "mixed":
            gate = dict.fromkeys(gate, Signal.step(time_s, 2.0, 1.0))
        return gate

    def pose(time_s: FloatArray) -> Pose:
        gate = moving(time_s)
        value = {name: gate[name] * turns[name].at(time_s) + at.get(name, 0.0) for name in names}
        if motion.kind == "mixed":
            spell = gate["sway"] * spells.at(time_s)
            value |= {name: value[name] + spell * quick[name].at(time_s) for name in quick}
        if motion.kind == "sequential":
            value["hinge"] = value["hinge"] - (value["swing"] - at["swing"])  # segment 2 rests while segment 1 swings
        position = [gate["sway"] * sway.at(time_s) for sway in sways]
        return Pose(**value, position=(position[0], position[1], position[2]))

    return pose
