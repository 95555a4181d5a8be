"""A lower body as a stick figure: places of its joints, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import SIDES
from imufast.body.result import LowerBody
from imufast.quaternion import rotate

__all__ = ["Skeleton", "skeleton"]

Array = NDArray[np.float64]

FACING_S = 1.0
"""Which way the subject faces is averaged over so long to either side, s: a pelvis that turns with each step still turns."""
LUMBAR_M, TOE_M, SOLE_M = 0.12, 0.17, 0.07
"""Drawn, not estimated: how far the pelvis is shown above the hips, and toes before and below the ankle."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Places of joints over time, x to the subject's right, y ahead, z up; the hips (or what comes first) stay where they are,
    the lowest point of the legs is at 0.

    Attributes:
        time_s: (K,) s.
        points: name to (K, 3), m: "hip_right", "knee_right", "ankle_right", "toe_right" ... and "lumbar".
        bones: name to the names of both its ends: "pelvis", "trunk", "thigh_right", "shank_right", "foot_right" ...
        assumed: names of points at the end of a segment whose next joint has no sensor: usual lengths along the segment.
    """

    time_s: Array
    points: dict[str, Array]
    bones: dict[str, tuple[str, str]]
    assumed: frozenset[str]


def skeleton(body: LowerBody) -> Skeleton:
    """Where the joints are at each moment, one segment hung on the next from the pelvis down, so that bones keep their lengths;
    seen as the subject faces. Toes and the pelvis's height are drawn, not estimated."""
    count = len(body.time_s)
    points: dict[str, Array] = {}
    assumed: set[str] = set()
    measures = body.anthropometry
    if "pelvis" in body.q:
        middle = np.mean([body.joints[f"hip_{side}"].in_sensors[0] for side in SIDES if f"hip_{side}" in body.joints], axis=0)
        for side in SIDES:
            if f"hip_{side}" in body.joints:
                points[f"hip_{side}"] = rotate(body.q["pelvis"], body.joints[f"hip_{side}"].in_sensors[0] - middle)
        points["lumbar"] = _along(body, "pelvis", [0.0, 0.0, LUMBAR_M])
    for side in SIDES:
        thigh, shank, foot = (f"{segment}_{side}" for segment in ("thigh", "shank", "foot"))
        hip, knee, ankle, toe = (f"{joint}_{side}" for joint in ("hip", "knee", "ankle", "toe"))
        if thigh in body.q and hip not in points:
            points[hip] = np.zeros((count, 3))
            assumed.add(hip)
        if knee in body.joints and thigh in body.q:
            near = body.joints[hip].in_sensors[1] if hip in body.joints else None
            far = body.joints[knee].in_sensors[0]
            usual = [0.0, 0.0, -measures.femur_m[0]]
            step = _along(body, thigh, usual) if near is None else rotate(body.q[thigh], far - near)
            points[knee] = points[hip] + step
        elif hip in body.joints:
            points[knee] = points[hip] + _along(body, thigh, [0.0, 0.0, -measures.femur_m[0]])
            assumed.add(knee)
        if shank not in body.q:
            continue
        if knee not in points:
            # Beside the other leg's, where there is one.
            points[knee] = np.broadcast_to([0.0, 0.0, -measures.femur_m[0]], (count, 3))
            assumed.add(knee)
        near = body.joints[knee].in_sensors[1] if knee in body.joints else None
        far = body.joints[ankle].in_sensors[0] if ankle in body.joints else None
        if near is None or far is None:
            points[ankle] = points[knee] + _along(body, shank, [0.0, 0.0, -measures.tibia_m[0]])
            assumed.add(ankle)
        else:
            points[ankle] = points[knee] + rotate(body.q[shank], far - near)
        if foot in body.q_segment:
            points[toe] = points[ankle] + _along(body, foot, [0.0, TOE_M, -SOLE_M])
    legs = [place for name, place in points.items() if name != "lumbar"]
    turned = _facing(body)
    if "pelvis" not in body.q and all(f"hip_{side}" in points for side in SIDES):
        # Two legs with nothing between them stand as far apart as hips usually are.
        half = 0.5 * measures.hips_m[0] * np.stack([*turned, np.zeros(count)], axis=1)
        for side, sign in (("right", 1.0), ("left", -1.0)):
            for name in [name for name in points if name.endswith(side)]:
                points[name] = points[name] + sign * half
        legs = list(points.values())
    low = np.min([place[:, 2] for place in legs], axis=0)
    for name, place in points.items():
        x, y, z = place.T
        along = turned[0] * x + turned[1] * y, -turned[1] * x + turned[0] * y
        points[name] = np.stack([*along, z - low], axis=1)
    bones = {"pelvis": ("hip_left", "hip_right")}
    for side in SIDES:
        bones |= {f"trunk_{side}": ("lumbar", f"hip_{side}"), f"thigh_{side}": (f"hip_{side}", f"knee_{side}")}
        bones |= {f"shank_{side}": (f"knee_{side}", f"ankle_{side}"), f"foot_{side}": (f"ankle_{side}", f"toe_{side}")}
    bones = {name: ends for name, ends in bones.items() if set(ends) <= set(points)}
    return Skeleton(body.time_s, points, bones, frozenset(assumed))


def _along(body: LowerBody, segment: str, vector: list[float]) -> Array:
    """(K, 3) a vector of a segment's axes (x right, y forward, z towards the body) in the world; upright where it has none."""
    if segment not in body.q_segment:
        return np.broadcast_to(np.array(vector), (len(body.time_s), 3))
    return rotate(body.q_segment[segment], np.broadcast_to(np.array(vector), (len(body.time_s), 3)))


def _facing(body: LowerBody) -> tuple[Array, Array]:
    """Cosine and sine, (K,) each, of the heading of the subject's right side, averaged over time."""
    known = next((segment for segment in body.q if segment in body.q_segment), None)
    if known is None:
        return np.ones(len(body.time_s)), np.zeros(len(body.time_s))
    ahead = _along(body, known, [1.0, 0.0, 0.0])[:, :2]
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(ahead, axis=0)])
    first = np.searchsorted(body.time_s, body.time_s - FACING_S, side="left")
    last = np.searchsorted(body.time_s, body.time_s + FACING_S, side="right")
    mean = (total[last] - total[first]) / (last - first)[:, None]
    size = np.linalg.norm(mean, axis=1, keepdims=True)
    unit = np.where(size > 1e-6, mean / np.maximum(size, 1e-6), [1.0, 0.0])
    return unit[:, 0], unit[:, 1]
