"""Pelvis and two legs as rigid segments: their measures, and where they are, from angles or from where the feet stand.

Segment frames as in McGrath & Stirling 2020, section 2.1: x to the subject's right, y forward, z towards the body; the
global frame has z up. Hips and ankles are balls, knees hinges. A segment's origin is the joint nearer to the pelvis; that of
the pelvis lies midway between the hips.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from imufast.errors import SettingsError

from .checks import FloatArray, number, seed_number
from .jets import Jet, axis_turn
from .pose import X, Y, Z
from .signals import stream

__all__ = ["JOINTS", "SEGMENTS", "SIDES", "Anatomy", "Leg", "Tree", "random_anatomy"]

SIDES = ("right", "left")
SEGMENTS = ("pelvis", *(f"{segment}_{side}" for side in SIDES for segment in ("thigh", "shank", "foot")))
JOINTS = {
    f"{joint}_{side}": (upper if joint == "hip" else f"{upper}_{side}", f"{lower}_{side}")
    for side in SIDES
    for joint, upper, lower in (("hip", "pelvis", "thigh"), ("knee", "thigh", "shank"), ("ankle", "shank", "foot"))
}
"""Joint to its two segments, the one nearer to the pelvis first."""
DEG = np.pi / 180.0
FOOT = {"ankle_m": 0.08, "toe_m": 0.13}
"""Height of the ankle over the sole, and how far before it the ball of the foot lies, m."""


@dataclass(frozen=True)
class Anatomy:
    """A subject's measures; defaults are the means of Tables 1 and 2 of McGrath & Stirling 2020.

    Attributes:
        hip_distance_m: between the hip centres, m; default 0.187.
        femur_m: hip to knee of the right and the left leg, m; default 0.394.
        tibia_m: knee to ankle, m; default 0.411.
        femur_axis_deg: angle of the knee's axis, pointing to the right, with the femur (from knee to hip), degrees; default 84
            and 96.
        tibia_axis_deg: with the tibia (from ankle to knee), degrees; default 92 and 88.

    Raises:
        SettingsError: a length that is not positive, or an axis within 45 degrees of its bone.
    """

    hip_distance_m: float = 0.187
    femur_m: tuple[float, float] = (0.394, 0.394)
    tibia_m: tuple[float, float] = (0.411, 0.411)
    femur_axis_deg: tuple[float, float] = (84.0, 96.0)
    tibia_axis_deg: tuple[float, float] = (92.0, 88.0)

    def __post_init__(self) -> None:
        number("hip_distance_m", self.hip_distance_m, above=0.0)
        for name in ("femur_m", "tibia_m", "femur_axis_deg", "tibia_axis_deg"):
            pair = getattr(self, name)
            if not isinstance(pair, tuple) or len(pair) != 2:
                raise SettingsError(f"{name} must be a pair (right, left); got {pair!r}")
            for value in pair:
                if name.endswith("_m"):
                    number(name, value, above=0.0)
                else:
                    number(name, value, above=45.0, below=135.0)

    def knee_axis(self, segment: str) -> FloatArray:
        """(3,) axis of the knee in the frame of "thigh_left", "shank_right" ..., pointing to the right."""
        bone, side = segment.split("_")
        angles = self.femur_axis_deg if bone == "thigh" else self.tibia_axis_deg
        angle = DEG * angles[SIDES.index(side)]
        return np.array([np.sin(angle), 0.0, np.cos(angle)])

    def straight(self, side: str) -> FloatArray:
        """(3, 3) shank to thigh of the straight leg: a turn in the frontal plane that brings the two axes together."""
        angle = DEG * (self.femur_axis_deg[SIDES.index(side)] - self.tibia_axis_deg[SIDES.index(side)])
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])

    def joint_in_segment(self, segment: str, joint: str) -> FloatArray:
        """(3,) a joint's centre in the frame of one of its two segments, m."""
        name, side = joint.split("_")
        k = SIDES.index(side)
        if segment == "pelvis":
            return (0.5 if side == "right" else -0.5) * self.hip_distance_m * X
        if name == "knee" and segment.startswith("thigh"):
            return -self.femur_m[k] * Z
        if name == "ankle" and segment.startswith("shank"):
            return -self.tibia_m[k] * Z
        return np.zeros(3)


def random_anatomy(seed: int = 0) -> Anatomy:
    """A subject drawn from the distributions of Tables 1 and 2 and of section 2.2.7 of McGrath & Stirling 2020, within two
    standard deviations.

    Raises:
        SettingsError: not a seed.
    """
    rng = stream(seed_number(seed), "anatomy")

    def draw(std: float) -> float:
        return float(std * np.clip(rng.standard_normal(), -2.0, 2.0))

    usual = Anatomy()
    femur, tibia = usual.femur_m[0] + draw(0.030), usual.tibia_m[0] + draw(0.026)
    return replace(
        usual,
        hip_distance_m=usual.hip_distance_m + draw(0.009),
        femur_m=(femur, femur + draw(0.008)),
        tibia_m=(tibia, tibia + draw(0.006)),
        femur_axis_deg=(usual.femur_axis_deg[0] + draw(2.4), usual.femur_axis_deg[1] + draw(2.4)),
        tibia_axis_deg=(usual.tibia_axis_deg[0] + draw(1.2), usual.tibia_axis_deg[1] + draw(1.2)),
    )


@dataclass(frozen=True, eq=False)
class Leg:
    """One leg at N instants: orientations in the global frame, and the knee's flexion (rad)."""

    thigh: Jet
    shank: Jet
    foot: Jet
    knee: Jet

    @classmethod
    def bent(cls, anatomy: Anatomy, side: str, pelvis: Jet, hip: list[Jet], knee: Jet, ankle: list[Jet]) -> Leg:
        """From angles (rad): `hip` and `ankle` flexion, adduction and inward turn, each about the segment's x, y, z in turn;
        `knee` flexion."""
        thigh = pelvis @ _turned(side, hip)
        shank = thigh @ _knee(anatomy, side, knee)
        return cls(thigh, shank, shank @ _turned(side, ankle), knee)

    @classmethod
    def standing(cls, anatomy: Anatomy, side: str, pelvis: Jet, hip_at: Jet, foot: Jet, ankle_at: Jet, swivel: Jet) -> Leg:
        """From where hip and ankle are (m, global), how the foot is turned, and how far the knee points inwards (rad)."""
        k = SIDES.index(side)
        n = hip_at.n
        thigh_m, shank_m = anatomy.femur_m[k], anatomy.tibia_m[k]
        axis = anatomy.knee_axis(f"thigh_{side}")
        up, down = thigh_m * Z, -shank_m * (anatomy.straight(side) @ Z)
        # |hip to ankle|² = |up|² + |down|² - 2 up·R(-knee) down, where axis, up and down lie in one plane.
        along = float((up @ axis) * (down @ axis))
        reach = ankle_at - hip_at
        cosine = (reach.dot(reach) * -0.5 + (0.5 * (thigh_m**2 + shank_m**2) - along)) * (1.0 / float(up @ down - along))
        if not (np.abs(cosine.value) < 1.0).all():
            raise SettingsError("size is too large: a leg cannot reach from its hip to where the foot stands")
        knee = cosine.arccos()
        bent = axis_turn(axis, -knee) @ Jet.constant(down, n) - Jet.constant(up, n)
        # The line from ankle to hip, and to the right of it the knee's axis, in the thigh and in space.
        in_thigh = _frame(-bent, Jet.constant(X, n))
        lateral = pelvis @ Jet.constant(X, n)
        in_space = _frame(-reach, lateral) @ axis_turn(Z, swivel * _inwards(side))
        thigh = in_space @ in_thigh.transposed()
        return cls(thigh, thigh @ _knee(anatomy, side, knee), foot, knee)


def _inwards(side: str) -> float:
    """Sign of a turn about y (adduction) or z (inward) of the right and the left leg."""
    return 1.0 if side == "right" else -1.0


def _turned(side: str, angles: list[Jet]) -> Jet:
    flexion, adduction, inwards = angles
    sign = _inwards(side)
    return axis_turn(X, flexion) @ axis_turn(Y, adduction * sign) @ axis_turn(Z, inwards * sign)


def _knee(anatomy: Anatomy, side: str, flexion: Jet) -> Jet:
    """Shank to thigh."""
    return axis_turn(anatomy.knee_axis(f"thigh_{side}"), -flexion) @ Jet.constant(anatomy.straight(side), flexion.n)


def _frame(up: Jet, right: Jet) -> Jet:
    """A matrix of columns: z along `up`, x along what is left of `right`."""
    z = up.unit()
    x = (right - z * z.dot(right)).unit()
    return Jet.vector([x, z.cross(x), z])


@dataclass(frozen=True, eq=False)
class Tree:
    """All segments at N instants.

    Attributes:
        turned: segment to its orientation (N, 3, 3) in the global frame.
        origin: segment to its origin (N, 3), m, global.
        knee: side to the knee's flexion (N,), rad.
    """

    turned: dict[str, Jet]
    origin: dict[str, Jet]
    knee: dict[str, Jet] = field(default_factory=dict)

    @classmethod
    def grown(cls, anatomy: Anatomy, pelvis: Jet, pelvis_at: Jet, legs: dict[str, Leg]) -> Tree:
        """From the pelvis down."""
        turned, origin = {"pelvis": pelvis}, {"pelvis": pelvis_at}
        for side, leg in legs.items():
            turned |= {f"thigh_{side}": leg.thigh, f"shank_{side}": leg.shank, f"foot_{side}": leg.foot}
            for joint in ("hip", "knee", "ankle"):
                upper, lower = JOINTS[f"{joint}_{side}"]
                at = Jet.constant(anatomy.joint_in_segment(upper, f"{joint}_{side}"), pelvis.n)
                origin[lower] = origin[upper] + turned[upper] @ at
        return cls(turned, origin, {side: leg.knee for side, leg in legs.items()})
