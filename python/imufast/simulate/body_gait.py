"""Walking and sit-to-stand, made of where pelvis and feet are: a foot on the ground does not move at all."""

from __future__ import annotations

import numpy as np

from .body_motions import TRUNK, BodyMotion, Program, Rng, cycles, spell, upright
from .body_tree import DEG, FOOT, SIDES, Anatomy, Leg, Tree
from .checks import FloatArray
from .jets import Jet, axis_turn
from .pose import X, Z
from .signals import Signal, periodic, random_band

__all__ = ["sit_to_stand", "walking"]


def _flat_foot(heading: Jet, pitch: Jet) -> Jet:
    return axis_turn(Z, heading) @ axis_turn(X, pitch)


def _height(anatomy: Anatomy, pelvis: Jet, pelvis_at: Jet, ankles: dict[str, Jet], most: float) -> FloatArray:
    """Height (N,) of the point midway between the hips at which the farther ankle is `most` of a leg's length away."""
    highest = []
    for side, ankle in ankles.items():
        k = SIDES.index(side)
        hip = pelvis_at.value + pelvis.value @ anatomy.joint_in_segment("pelvis", f"hip_{side}")
        across = ankle.value - hip
        reach = most * (anatomy.femur_m[k] + anatomy.tibia_m[k])
        highest.append(across[:, 2] + np.sqrt(np.maximum(reach**2 - across[:, 0] ** 2 - across[:, 1] ** 2, 1e-4)))
    return np.asarray(np.min(highest, axis=0))


def walking(motion: BodyMotion, rng: Rng, anatomy: Anatomy) -> Program:
    """Steps of 0.48 m at 0.95 strides a second (size and tempo 1), each foot 58 % of a stride on the ground; a bend by 60
    degrees in the middle; it begins and ends standing."""
    stride_s, swing_s = 1.05 / motion.tempo, 0.44 / motion.tempo
    step_m, lift_m, apart_m = 0.48 * motion.size, 0.03, 0.5 * anatomy.hip_distance_m
    first, steps = 1.5, 0
    while first + (steps + 2) * 0.5 * stride_s + swing_s < motion.duration_s - 1.0:
        steps += 1
    start = rng("pose").uniform(-np.pi, np.pi)
    vary = rng("steps").uniform(-0.06, 0.06, (steps, 2))
    # Footholds: half a step, whole steps, half a step to close.
    heading, where = start, np.zeros(2)
    holds: dict[str, list[tuple[float, FloatArray, float]]] = {side: [] for side in SIDES}
    path: list[tuple[float, FloatArray, float]] = []
    for k in range(steps):
        side = SIDES[k % 2]
        length = step_m * (1.0 + vary[k, 0]) * (0.0 if k == steps - 1 else 0.5 if k == 0 else 1.0)
        turn = 60.0 * DEG / max(steps // 2, 1) if steps // 4 <= k < steps // 4 + steps // 2 else 0.0
        heading = heading + turn
        ahead = np.array([-np.sin(heading), np.cos(heading)])
        where = where + length * ahead
        out = (1.0 if side == "right" else -1.0) * apart_m * np.array([np.cos(heading), np.sin(heading)])
        holds[side].append((first + k * 0.5 * stride_s, where + out, heading + 0.3 * vary[k, 1]))
        path.append((first + k * 0.5 * stride_s, where.copy(), heading))
    wander = {name: random_band(rng(name), DEG * 2.0, (0.1 * motion.tempo, 0.6 * motion.tempo), 6) for name in (*TRUNK, *SIDES)}
    sways = [
        random_band(rng(f"sway {axis}"), 0.3 * motion.sway_m, (0.1 * motion.tempo, 0.5 * motion.tempo), 6) for axis in "xyz"
    ]
    beginning = {
        side: (1.0 if side == "right" else -1.0) * apart_m * np.array([np.cos(start), np.sin(start)]) for side in SIDES
    }

    def moving(time_s: FloatArray) -> tuple[Jet, Jet, dict[str, Jet], dict[str, Jet]]:
        """Pelvis orientation and place on the floor, feet and ankles."""
        n = len(time_s)
        feet, ankles = {}, {}
        for side in SIDES:
            at, pitch = Jet.constant(beginning[side], n), Jet.constant(np.array(0.0), n)
            turned, lift = Jet.constant(np.array(start), n), Jet.constant(np.array(0.0), n)
            place, facing = beginning[side], start
            for begin, hold, facing_then in holds[side]:
                s = Jet.of(Signal.step(time_s, begin, swing_s))
                at = at + Jet.vector([s * (hold - place)[0], s * (hold - place)[1]])
                turned = turned + s * (facing_then - facing)
                lift = lift + s * (-s + 1.0) * (4.0 * lift_m)
                place, facing = hold, facing_then
                # The heel rises while the ball of the foot still stands, then the toes.
                pitch = pitch - spell(time_s, begin - 0.6 * swing_s, begin + 0.6 * swing_s, 0.6 * swing_s) * (36.0 * DEG)
                pitch = pitch + spell(time_s, begin + 0.5 * swing_s, begin + swing_s, 0.25 * swing_s) * (8.0 * DEG)
            feet[side] = _flat_foot(turned, pitch)
            over = Jet.constant(np.array([0.0, -FOOT["toe_m"], FOOT["ankle_m"]]), n)
            # `at` is the place of the ankle of the flat foot; the foot turns about its ball.
            ball = _lifted(at, lift)
            forward = axis_turn(Z, turned) @ Jet.constant(np.array([0.0, FOOT["toe_m"], 0.0]), n)
            ankles[side] = ball + forward + feet[side] @ over
        floor, way = Jet.constant(np.zeros(2), n), Jet.constant(np.array(start), n)
        last, stood, facing = np.zeros(2), np.zeros(2), start
        for begin, hold, at_heading in path:
            # From midway between the feet to midway between them, each step blending into the next.
            s = Jet.of(Signal.step(time_s, begin + 0.5 * (swing_s - stride_s) - 0.06 * stride_s, stride_s))
            ahead = 0.5 * (hold + stood) - last
            floor = floor + Jet.vector([s * ahead[0], s * ahead[1]])
            way = way + s * (at_heading - facing)
            last, stood, facing = last + ahead, hold, at_heading
        lean = {name: Jet.of(wander[name].at(time_s)) for name in TRUNK}
        pelvis = upright(way + lean["heading"], lean["tilt"] + (-4.0 * DEG), lean["lean"])
        x, y = (Jet.of(sway.at(time_s)) for sway in sways[:2])
        return pelvis, floor + Jet.vector([x, y]), feet, ankles

    # The pelvis is as high as the legs allow on average, but for what is too quick in that for a trunk.
    coarse = np.arange(0.0, motion.duration_s, 0.02)
    pelvis, floor, _, ankles = moving(coarse)
    allowed = _height(anatomy, pelvis, _lifted(floor, Jet.constant(np.array(0.0), len(coarse))), ankles, 0.99)
    step_s, stop = 0.5 * stride_s, first + steps * 0.5 * stride_s
    regular = (coarse > first + stride_s) & (coarse < stop - stride_s)
    waves = [np.exp(-2j * np.pi * k * coarse / step_s) for k in (1, 2)]
    parts = [
        2.0 * np.mean((allowed - allowed[regular].mean())[regular] * wave[regular]) if regular.any() else 0.0 for wave in waves
    ]

    def bob(time_s: FloatArray) -> Jet:
        going = spell(time_s, first, stop + 0.5, 0.8)
        wave = Jet.of(Signal.constant(0.0, time_s))
        for k, part in enumerate(parts, start=1):
            wave = wave + cycles(time_s, 0.0, step_s / k, float(np.angle(part)) + 0.5 * np.pi) * float(np.abs(part))
        return wave * going

    height = float((allowed - bob(coarse).value).min()) - 0.3 * motion.sway_m

    def tree(time_s: FloatArray) -> Tree:
        n = len(time_s)
        pelvis, floor, feet, ankles = moving(time_s)
        rise = bob(time_s) + Jet.of(sways[2].at(time_s)) * 0.3 + height
        pelvis_at = _lifted(floor, rise)
        legs = {}
        for side in SIDES:
            hip = pelvis_at + pelvis @ Jet.constant(anatomy.joint_in_segment("pelvis", f"hip_{side}"), n)
            swivel = Jet.of(wander[side].at(time_s)) * 1.5
            legs[side] = Leg.standing(anatomy, side, pelvis, hip, feet[side], ankles[side], swivel)
        return Tree.grown(anatomy, pelvis, pelvis_at, legs)

    return tree


def _lifted(floor: Jet, height: Jet) -> Jet:
    """A place (N, 2) on the floor and a height as a point in space."""
    least = min(len(floor.rows), len(height.rows))
    return Jet(np.concatenate([floor.rows[:least], height.rows[:least, :, None]], axis=-1))


def sit_to_stand(motion: BodyMotion, rng: Rng, anatomy: Anatomy) -> Program:
    """Standing up and sitting down again every 5 s at tempo 1, both feet on the ground; the knees bend to about 95 degrees."""
    cycle = 0.2 * motion.tempo

    def sitting(x: FloatArray) -> FloatArray:
        return np.asarray(0.5 * (1.0 - np.tanh(3.0 * np.cos(2.0 * np.pi * x))))

    seated = periodic(sitting, cycle, 12)
    stooped = periodic(lambda x: 4.0 * sitting(x) * (1.0 - sitting(x)), cycle, 12)
    wander = {name: random_band(rng(name), DEG * 2.0, (0.1 * motion.tempo, 0.7 * motion.tempo), 6) for name in (*TRUNK, *SIDES)}
    sways = [
        random_band(rng(f"sway {axis}"), 0.3 * motion.sway_m, (0.1 * motion.tempo, 0.5 * motion.tempo), 6) for axis in "xyz"
    ]
    start = rng("pose").uniform(-np.pi, np.pi)
    apart = 0.5 * anatomy.hip_distance_m + 0.03
    ahead, right = np.array([-np.sin(start), np.cos(start), 0.0]), np.array([np.cos(start), np.sin(start), 0.0])
    legs_m = [anatomy.femur_m[k] + anatomy.tibia_m[k] for k in (0, 1)]
    high = 0.985 * min(legs_m) + FOOT["ankle_m"] - 0.9 * motion.sway_m
    low = anatomy.tibia_m[0] + 0.02 + FOOT["ankle_m"]

    def tree(time_s: FloatArray) -> Tree:
        n = len(time_s)
        down = Jet.of(seated.at(time_s)) * motion.size
        bow = Jet.of(stooped.at(time_s)) * motion.size
        lean = {name: Jet.of(wander[name].at(time_s)) for name in TRUNK}
        pelvis = upright(lean["heading"] + start, bow * (-28.0 * DEG) + lean["tilt"], lean["lean"])
        place = Jet.constant(high * Z - 0.02 * ahead, n) + Jet.constant((low - high) * Z - 0.36 * ahead, n) * down
        place = place + Jet.constant(0.10 * ahead, n) * bow
        place = place + Jet.vector([Jet.of(sway.at(time_s)) for sway in sways])
        legs = {}
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            ankle = Jet.constant(sign * apart * right + FOOT["ankle_m"] * Z, n)
            foot = _flat_foot(Jet.constant(np.array(start - sign * 6.0 * DEG), n), Jet.constant(np.array(0.0), n))
            hip = place + pelvis @ Jet.constant(anatomy.joint_in_segment("pelvis", f"hip_{side}"), n)
            swivel = Jet.of(wander[side].at(time_s))
            legs[side] = Leg.standing(anatomy, side, pelvis, hip, foot, ankle, swivel)
        return Tree.grown(anatomy, pelvis, place, legs)

    return tree
