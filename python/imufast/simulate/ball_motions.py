"""The motions of two links with a spherical joint: those of the rig of Olsson & Halvorsen 2017 (section IV), and random ones.

Segment frames: x along the link from 1 towards 2, y and z across it; global z up. A frame in the hand is turned by heading
about z, then tilt about x, then swing about y. Link 1 is that frame turned back by its share of the joint's turns, link 2 is
link 1 turned by the joint: about y, then z, then x. So a share of 0 is a hand that holds link 1, 1 one that holds link 2, and
0.5 two hands, one at each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of
from .motion_base import MotionBase
from .pose import BallPose, BallProgram
from .signals import Signal, Sinusoids, random_band, stream

__all__ = ["BallMotion", "ball_program", "named_ball_motion", "paper_segment"]

KINDS = ("random", "stationary", "held", "bend_y", "bend_z", "alternate", "clockwise", "counterclockwise")
# Kind and number of samples of S1 to S8, at 100 Hz.
SEGMENTS = (
    ("stationary", 1354),
    ("held", 1132),
    ("bend_y", 1625),
    ("bend_z", 1372),
    ("alternate", 2213),
    ("clockwise", 2666),
    ("counterclockwise", 2698),
    ("stationary", 2159),
)
NAMES = tuple(f"S{k}" for k in range(1, len(SEGMENTS) + 1))
HANGING = 0.5 * np.pi  # swing that lets x point down: link 1 above, link 2 below
CHANNELS = ("heading", "tilt", "swing", "y", "z", "x")


@dataclass(frozen=True)
class BallMotion(MotionBase):
    """One motion of two links with a spherical joint.

    Attributes:
        kind: "random" (both links roam, the joint turns in all its degrees of freedom, each channel with random frequencies and
            a random size); "stationary" (lying, the joint straight; S1, S8); "held" (hanging in a hand; S2); "bend_y" and
            "bend_z" (back and forth, mostly about y or z, either link doing half of it; S3, S4); "alternate" (about y and z by
            turns; S5); "clockwise" and "counterclockwise" as seen from above (the hand holds link 1 and the end of link 2 goes
            round a circle; half way it is all turned upside down and link 1 goes round; S6, S7).
        label: what `BallJointSimulation.motion` says at its samples, and part of what its random draws depend on; None: the
            kind.
        duration_s: length of the whole motion, s.
        start_s, stop_s: the stretch of it that is recorded, s; None: to the end.
        tempo: multiplies all frequencies.
        size: multiplies all angles. 1: back and forth by 0.6 rad rms, circles with a half angle of 0.45 rad.
        axis_tilt_rad: angle of the hand's y axis above the horizontal plane, rad (its mean, where the hand moves).
        sway_m: rms motion of the grip in each direction, m; no effect on "stationary".
        take: another take of the same motion: different random draws.
        grip_m: how far from the joint centre a hand holds its link, m; default 0, at the joint. The joint centre swings about
            the grip; where either link turns, about the middle between two hands, weighted by what each link does not turn.

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    KINDS: ClassVar[tuple[str, ...]] = KINDS

    grip_m: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        number("grip_m", self.grip_m, least=0.0)


def paper_segment(name: str, duration_s: float | None = None) -> BallMotion:
    """Segment "S1" to "S8" of section IV, as long as in the paper unless stated (s).

    Raises:
        SettingsError: no such segment, or a duration that is not positive.
    """
    one_of("segment", name, NAMES)
    kind, samples = SEGMENTS[NAMES.index(name)]
    return BallMotion(kind, label=name, duration_s=samples / 100.0 if duration_s is None else duration_s)


def named_ball_motion(motion: Any, duration_s: float | None) -> BallMotion:
    """The motion of a name that `simulate_ball_joint` was given; 50 s long, or as long as in the paper, unless stated."""
    if not isinstance(motion, str) or motion not in (*NAMES, *KINDS):
        raise SettingsError(f"motion must be S1 to S8, one of {', '.join(KINDS)}, or a BallMotion; got {motion!r}")
    if motion in NAMES:
        return paper_segment(motion, duration_s)
    made = BallMotion(motion)
    return made if duration_s is None else replace(made, duration_s=duration_s)


def ball_program(motion: BallMotion, seed: int) -> BallProgram:
    """The motion as functions of the time since it began; all random draws are made here."""

    def rng(channel: str) -> np.random.Generator:
        return stream(seed, "ball motion", motion.name, motion.take, channel)

    at = {"heading": rng("pose").uniform(-np.pi, np.pi), "tilt": motion.axis_tilt_rad, "swing": HANGING}
    if motion.kind == "stationary":
        return _parts(motion, rng, at | {"swing": 0.0}, rms={}, share1=0.0, sway_m=0.0)
    if motion.kind == "held":
        return _parts(motion, rng, at, rms=dict.fromkeys(CHANNELS, 0.03), share1=0.5, sway_m=0.1 * motion.sway_m)
    if motion.kind == "random":
        sizes = dict(zip(CHANNELS, rng("sizes").uniform(0.7, 1.3, len(CHANNELS)), strict=True))
        typical = {"heading": 0.5, "tilt": 0.4, "swing": 0.5, "y": 0.5, "z": 0.4, "x": 0.3}
        rms = {name: sizes[name] * typical[name] for name in CHANNELS}
        return _parts(motion, rng, at, rms, share1=0.0, sway_m=motion.sway_m, band_hz=(0.2, 1.0))
    if motion.kind in ("clockwise", "counterclockwise"):
        return _circles(motion, rng, at)
    return _back_and_forth(motion, rng, at)


Rng = Callable[[str], np.random.Generator]
HAND = {"heading": 0.12, "tilt": 0.12, "swing": 0.12, "y": 0.04, "z": 0.04, "x": 0.04}  # rms of what nobody meant to do, rad


def _parts(
    motion: BallMotion,
    rng: Rng,
    at: dict[str, float],
    rms: dict[str, float],
    share1: float,
    sway_m: float,
    band_hz: tuple[float, float] = (0.1, 0.6),
) -> BallProgram:
    """Every channel at random about its place; the other motions add to this one."""
    band = (band_hz[0] * motion.tempo, band_hz[1] * motion.tempo)
    turns = {name: random_band(rng(name), motion.size * rms.get(name, 0.0), band) for name in CHANNELS}
    sways = [random_band(rng(f"sway {axis}"), sway_m, (0.2 * motion.tempo, 1.2 * motion.tempo)) for axis in "xyz"]

    def pose(time_s: FloatArray) -> BallPose:
        value = {name: turns[name].at(time_s) + at.get(name, 0.0) for name in CHANNELS}
        return BallPose(
            heading=value["heading"],
            tilt=value["tilt"],
            swing=value["swing"],
            turns=(value["y"], value["z"], value["x"]),
            share1=Signal.constant(share1, time_s),
            position=(sways[0].at(time_s), sways[1].at(time_s), sways[2].at(time_s)),
            grip_m=motion.grip_m,
        )

    return pose


def _back_and_forth(motion: BallMotion, rng: Rng, at: dict[str, float]) -> BallProgram:
    hand = _parts(motion, rng, at, HAND, share1=0.5, sway_m=motion.sway_m)
    # A narrow band: strokes at one pace whose size comes and goes.
    band = (0.65 * motion.tempo, 0.95 * motion.tempo)
    strokes = {name: random_band(rng(f"stroke {name}"), 0.6 * motion.size, band) for name in "yz"}

    def moving(time_s: FloatArray) -> dict[str, Signal]:
        """How strongly the joint is turned about either axis, 0 to 1."""
        still, full = Signal.constant(0.0, time_s), Signal.constant(1.0, time_s)
        if motion.kind != "alternate":
            return {"y": full, "z": still} if motion.kind == "bend_y" else {"y": still, "z": full}
        # About y and z by turns of some 4 s, as many of either.
        spells = 2 * max(1, round(motion.duration_s * motion.tempo / 8.0))
        spell = motion.duration_s / spells
        ramp = 0.2 * spell
        gate = {"y": still, "z": still}
        for k in range(spells):
            name = "yz"[k % 2]
            gate[name] = gate[name] + _during(time_s, k * spell, (k + 1) * spell, ramp)
        return gate

    def pose(time_s: FloatArray) -> BallPose:
        held, gate = hand(time_s), moving(time_s)
        y, z = (turn + gate[name] * strokes[name].at(time_s) for name, turn in zip("yz", held.turns[:2], strict=True))
        return replace(held, turns=(y, z, held.turns[2]))

    return pose


def _circles(motion: BallMotion, rng: Rng, at: dict[str, float]) -> BallProgram:
    hand = _parts(motion, rng, at, HAND, share1=0.0, sway_m=motion.sway_m)
    rounds_hz, radius = 0.9 * motion.tempo, 0.45 * motion.size
    start = rng("round").uniform(-np.pi, np.pi)
    one = np.ones(1)
    along_y = Sinusoids(radius * one, rounds_hz * one, (start + 0.5 * np.pi) * one)
    along_z = Sinusoids(radius * one, rounds_hz * one, start * one)
    # No two rounds are alike: their width and breadth wander by a tenth.
    vary = {name: random_band(rng(f"vary {name}"), 0.1, (0.05 * motion.tempo, 0.4 * motion.tempo)) for name in "yz"}
    sense = 1.0 if motion.kind == "clockwise" else -1.0

    def pose(time_s: FloatArray) -> BallPose:
        held = hand(time_s)
        half = 0.5 * motion.duration_s
        # The turn upside down takes 2 s (less in a short motion); the joint is quiet before link 1 takes over.
        flip = min(2.0, 0.2 * motion.duration_s)
        ramp = 0.5 * flip
        first = _during(time_s, 0.0, half - 0.5 * flip, ramp)
        second = _during(time_s, half + 0.5 * flip, motion.duration_s, ramp)
        over = Signal.step(time_s, half - 0.5 * flip, flip)
        y = (first + second) * along_y.at(time_s) * (1.0 + vary["y"].at(time_s))
        # Upside down the same turns go round the other way as seen from above.
        z = sense * (first - second) * along_z.at(time_s) * (1.0 + vary["z"].at(time_s))
        return replace(
            held,
            swing=held.swing + math.pi * over,
            turns=(held.turns[0] + y, held.turns[1] + z, held.turns[2]),
            share1=over,
        )

    return pose


def _during(time_s: FloatArray, start_s: float, stop_s: float, ramp_s: float) -> Signal:
    """1 between two instants and 0 outside, with ramps inside."""
    return Signal.step(time_s, start_s, ramp_s) - Signal.step(time_s, stop_s - ramp_s, ramp_s)
