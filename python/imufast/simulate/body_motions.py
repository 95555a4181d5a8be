"""What a subject does in a simulated recording of the lower body.

The motion profile of McGrath & Stirling 2020, section 3.2, is made of angles, and of a foot that stays where it stands; walking
and sit-to-stand are made of where pelvis and feet are, so that a foot on the ground does not move at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from imufast.errors import SettingsError

from .body_tree import DEG, FOOT, SIDES, Anatomy, Leg, Tree
from .checks import FloatArray
from .jets import Jet, axis_turn
from .motion_base import MotionBase
from .pose import X, Y, Z
from .signals import Signal, random_band

__all__ = ["BodyMotion", "exercises", "named_body_motion"]

KINDS = ("profile", "ankles_and_knees", "seated", "walking", "sit_to_stand", "standing")
Program = Callable[[FloatArray], Tree]
Rng = Callable[[str], np.random.Generator]
ANGLES = tuple(f"{name}_{side}" for side in SIDES for name in ("hip0", "hip1", "hip2", "knee", "ankle0", "ankle1", "ankle2"))
TRUNK = ("heading", "tilt", "lean")


@dataclass(frozen=True)
class BodyMotion(MotionBase):
    """One motion of pelvis and legs.

    Attributes:
        kind: "profile" (section 3.2 of the paper: ankles, knees, hips and trunk, one after the other, three times each where
            `duration_s` allows, then standing); "ankles_and_knees" (its first half only: the hips hardly move); "seated" (the
            same on a chair: knees stretch, feet hang); "walking" (with feet that stand still on the ground, along a bend);
            "sit_to_stand" (both feet on the ground); "standing".
        label: what `LowerBodySimulation.motion` says at its samples, and part of what its random draws depend on; None: the
            kind.
        duration_s: length of the whole motion, s.
        start_s, stop_s: the stretch of it that is recorded, s; None: to the end.
        tempo: multiplies the rates of walking and sit-to-stand and of the sway.
        size: multiplies the angles of the profile, the step length of walking and how low one sits.
        sway_m: rms sway of the pelvis in each direction while walking or sitting down and standing up, m; elsewhere the angles
            sway by 20 degrees a metre.
        take: another take of the same motion: different random draws.

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    KINDS: ClassVar[tuple[str, ...]] = KINDS

    duration_s: float = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axis_tilt_rad != 0.0:
            raise SettingsError(f"axis_tilt_rad means nothing for a body; got {self.axis_tilt_rad:g}")


def named_body_motion(motion: Any, duration_s: float | None) -> BodyMotion:
    """The motion of a name that `simulate_lower_body` was given; 60 s long unless stated."""
    if not isinstance(motion, str) or motion not in KINDS:
        raise SettingsError(f"motion must be one of {', '.join(KINDS)}, a BodyMotion, or several; got {motion!r}")
    return BodyMotion(motion, duration_s=60.0 if duration_s is None else duration_s)


def upright(heading: Jet, tilt: Jet, lean: Jet) -> Jet:
    """The pelvis: heading about z, then tilt about x (backwards positive), then lean about y."""
    return axis_turn(Z, heading) @ axis_turn(X, tilt) @ axis_turn(Y, lean)


def spell(time_s: FloatArray, start: float, stop: float, ramp: float = 0.4) -> Jet:
    """1 between `start` and `stop`, with smooth ends inside."""
    ramp = min(ramp, 0.5 * (stop - start))
    return Jet.of(Signal.step(time_s, start, ramp) - Signal.step(time_s, stop - ramp, ramp))


def there_and_back(time_s: FloatArray, start: float, period: float, times: int) -> Jet:
    """0 to 1 and back, `times` times."""
    total = spell(time_s, start, start + period, 0.5 * period)
    for k in range(1, times):
        total = total + spell(time_s, start + k * period, start + (k + 1) * period, 0.5 * period)
    return total


def cycles(time_s: FloatArray, start: float, period: float, phase: float = 0.0) -> Jet:
    angle = Jet.of(Signal.line(2.0 * np.pi / period, time_s)) + (phase - 2.0 * np.pi * start / period)
    return angle.sin()


@dataclass(frozen=True)
class _Exercise:
    """One part of the profile: what, which leg, from when on, how long a repetition, how often, and how much of the usual."""

    name: str
    side: str
    start: float
    period: float
    times: int
    vigour: float

    @property
    def stop(self) -> float:
        return self.start + self.period * self.times


# Repetitions in s; the three of the trunk come once.
LEG_EXERCISES = (
    (("ankle flexion", 1.3), ("ankle circles", 1.2)),
    (("knee", 1.6),),
    (("hip flexion", 1.5), ("hip adduction", 1.4), ("hip turn", 1.2)),
)
SEATED = {"tilt": 15.0, "hip0": 85.0, "knee": 80.0}
"""Degrees by which the pelvis tilts back and the joints are bent on a chair."""
TRUNK_EXERCISES = (("bend", 3.5), ("twist", 3.0), ("side", 3.0))


def _schedule(motion: BodyMotion, rng: np.random.Generator) -> list[_Exercise]:
    """The exercises one after the other, as often as there is time for, at most three times each."""
    if motion.kind == "standing":
        return []
    half = motion.kind in ("ankles_and_knees", "seated")
    groups, trunk = (LEG_EXERCISES[:2], ()) if half else (LEG_EXERCISES, TRUNK_EXERCISES)
    rest, begin = 0.5, 2.0
    once = 2 * sum(period for group in groups for _, period in group)
    fixed = begin + 2 * rest * len(groups) + sum(period for _, period in trunk) + rest
    times = int(np.clip((motion.duration_s - fixed) // once, 1, 3))
    made, t = [], begin
    for group in groups:
        for side in SIDES:
            for name, period in group:
                made.append(_Exercise(name, side, t, period, times, 1.0 + 0.08 * rng.uniform(-1.0, 1.0)))
                t = made[-1].stop
            t += rest
    for name, period in trunk:
        made.append(_Exercise(name, "", t, period, 1, 1.0 + 0.08 * rng.uniform(-1.0, 1.0)))
        t = made[-1].stop
    return made


def exercises(motion: BodyMotion, rng: Rng, anatomy: Anatomy) -> Program:
    """Standing on one leg while the other does what it is asked, and then on both; or on a chair, where the pelvis rests."""
    seated = motion.kind == "seated"
    plan = _schedule(motion, rng("plan"))
    sway_rms = DEG * 20.0 * motion.sway_m
    sways = {
        name: random_band(rng(f"sway {name}"), sway_rms, (0.08 * motion.tempo, 0.7 * motion.tempo), 4)
        for name in (*ANGLES, *TRUNK)
    }
    heading = rng("pose").uniform(-np.pi, np.pi)
    feet_apart = 0.02

    def angles(time_s: FloatArray) -> dict[str, Jet]:
        begun = Jet.of(Signal.step(time_s, 0.5, 1.0))
        at = {name: Jet.of(sways[name].at(time_s)) * begun for name in sways}
        at["heading"] = at["heading"] + heading
        for side in SIDES:
            at[f"knee_{side}"] = at[f"knee_{side}"] + (SEATED["knee"] if seated else 4.0) * DEG
            at[f"hip0_{side}"] = at[f"hip0_{side}"] + (SEATED["hip0"] if seated else 0.0) * DEG
        at["tilt"] = at["tilt"] + (SEATED["tilt"] if seated else 0.0) * DEG

        def add(name: str, degrees: float, shape: Jet) -> None:
            # On a chair thighs stay where they are and knees stretch.
            share = {"hip": 0.0, "kne": -0.7}.get(name[:3], 1.0) if seated else 1.0
            at[name] = at[name] + shape * (share * degrees * DEG * motion.size)

        for e in plan:
            _exercise(e, time_s, add)
        return at

    def tree(time_s: FloatArray) -> Tree:
        n = len(time_s)
        at = angles(time_s)
        pelvis = upright(at["heading"], at["tilt"], at["lean"])
        legs = {
            side: Leg.bent(
                anatomy,
                side,
                pelvis,
                [at[f"hip{k}_{side}"] for k in range(3)],
                at[f"knee_{side}"],
                [at[f"ankle{k}_{side}"] for k in range(3)],
            )
            for side in SIDES
        }
        floating = Tree.grown(anatomy, pelvis, Jet.constant(np.zeros(3), n), legs)
        if seated:
            return floating
        # The pelvis is where the standing leg puts it; weight goes over to the other leg between exercises.
        on_left = Jet.constant(np.array(0.5), n)
        share = 0.5
        for e in plan:
            wanted = {"right": 1.0, "left": 0.0, "": 0.5}[e.side]
            if wanted != share:
                on_left = on_left + Jet.of(Signal.step(time_s, e.start - 0.5, 0.5)) * (wanted - share)
                share = wanted
        places = {}
        for side in SIDES:
            apart = (1.0 if side == "right" else -1.0) * (0.5 * anatomy.hip_distance_m + feet_apart)
            spot = np.array([apart * np.cos(heading), apart * np.sin(heading), FOOT["ankle_m"]])
            places[side] = Jet.constant(spot, n) - floating.origin[f"foot_{side}"]
        pelvis_at = places["left"] * on_left + places["right"] * (-on_left + 1.0)
        return Tree.grown(anatomy, pelvis, pelvis_at, legs)

    return tree


def _exercise(e: _Exercise, time_s: FloatArray, add: Callable[[str, float, Jet], None]) -> None:
    """Section 3.2, with ranges of a young adult."""
    side, v = e.side, e.vigour
    during = spell(time_s, e.start, e.stop)
    cycle = during * cycles(time_s, e.start, e.period)
    if e.name == "ankle flexion":
        add(f"hip0_{side}", 18.0, during)
        add(f"knee_{side}", 25.0, during)
        add(f"ankle0_{side}", 25.0 * v, cycle)
        add(f"ankle0_{side}", -8.0, during)
    elif e.name == "ankle circles":
        add(f"hip0_{side}", 18.0, during)
        add(f"knee_{side}", 25.0, during)
        add(f"ankle0_{side}", 22.0 * v, cycle)
        add(f"ankle1_{side}", 14.0 * v, during * cycles(time_s, e.start, e.period, 0.5 * np.pi))
        add(f"ankle2_{side}", 12.0 * v, during * cycles(time_s, e.start, e.period, 0.5 * np.pi + 0.5))
    elif e.name == "knee":
        swing = there_and_back(time_s, e.start, e.period, e.times)
        add(f"knee_{side}", 95.0 * v, swing)
        add(f"hip0_{side}", 4.0, swing)
        add(f"hip1_{side}", -3.0, swing)
    elif e.name == "hip flexion":
        swing = there_and_back(time_s, e.start, e.period, e.times)
        add(f"hip0_{side}", 55.0 * v, swing)
        add("tilt", 6.0, swing)
    elif e.name == "hip adduction":
        swing = there_and_back(time_s, e.start, e.period, e.times)
        add(f"hip1_{side}", -32.0 * v, swing)
        add("lean", 5.0 if side == "right" else -5.0, swing)
    elif e.name == "hip turn":
        add(f"hip2_{side}", 28.0 * v, cycle)
        add(f"hip0_{side}", 8.0, during)
        add(f"hip1_{side}", -6.0, during)
    elif e.name == "bend":
        swing = there_and_back(time_s, e.start, e.period, 1)
        add("tilt", -60.0 * v, swing)
        for q in SIDES:
            add(f"hip0_{q}", 66.0 * v, swing)
            add(f"knee_{q}", 8.0, swing)
            add(f"ankle0_{q}", 2.0, swing)
    elif e.name == "twist":
        add("heading", 35.0 * v, cycle)
        for q, sign in (("right", -1.0), ("left", 1.0)):
            add(f"hip2_{q}", 33.0 * v * sign, cycle)
    else:
        add("lean", 14.0 * v, cycle)
        for q, sign in (("right", -1.0), ("left", 1.0)):
            add(f"hip1_{q}", 14.0 * v * sign, cycle)
