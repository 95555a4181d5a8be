"""Skin and straps on a leg: how worn sensors move against the bones beneath them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imufast.errors import SettingsError

from .body_tree import SEGMENTS, Tree
from .checks import number
from .jets import Jet, axis_turn
from .pose import X, Y, Z
from .signals import Sinusoids, stream
from .so3 import random_direction

__all__ = ["LegTissue"]


@dataclass(frozen=True)
class LegTissue:
    """Motion of each sensor against its bone, as a smooth function of how the leg is bent; gyr and acc stay consistent.

    A thigh's sensor answers to the flexion of knee and hip (for the hip, the sine of it), a shank's to that of the knee; each
    segment draws the directions in which it turns and slides. The wobble is a ringing about the bone that the knee's rate calls
    up and that dies with it.

    Attributes:
        turn_deg_per_rad: turn against the bone per radian of flexion, degrees; default 3.
        slide_m_per_rad: shift along the bone's surface per radian of flexion, m; default 0.01.
        wobble_rad_s: largest rate of the wobble, rad/s; default 0 (thigh straps ring with several rad/s in walking).
        wobble_hz: its frequency, Hz; default 9.
        drive_rad_s: rate of the knee at which it reaches 76 % (tanh 1) of its size, rad/s; default 2.
        segments: which segments have it; default thighs and shanks.

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    turn_deg_per_rad: float = 3.0
    slide_m_per_rad: float = 0.01
    wobble_rad_s: float = 0.0
    wobble_hz: float = 9.0
    drive_rad_s: float = 2.0
    segments: tuple[str, ...] = ("thigh_right", "thigh_left", "shank_right", "shank_left")

    def __post_init__(self) -> None:
        for name in ("turn_deg_per_rad", "slide_m_per_rad", "wobble_rad_s"):
            number(name, getattr(self, name), least=0.0)
        for name in ("wobble_hz", "drive_rad_s"):
            number(name, getattr(self, name), above=0.0)
        legs = SEGMENTS[1:]
        if not isinstance(self.segments, tuple) or any(segment not in legs for segment in self.segments):
            raise SettingsError(f"segments must be a tuple of {', '.join(legs)}; got {self.segments!r}")

    def moved(self, segment: str, seed: int, tree: Tree, time_s: np.ndarray) -> tuple[Jet, Jet]:
        """Turn (N, 3, 3) and shift (N, 3, m) of what carries the sensor, in the frame of its segment."""
        side = segment.split("_")[1]
        knee = tree.knee[side]
        drives = [knee]
        if segment.startswith("thigh"):
            # The sine of the hip's flexion: how far the thigh's long axis leans back against the pelvis.
            along = tree.turned["pelvis"].transposed() @ (tree.turned[segment] @ Jet.constant(Z, knee.n))
            drives.append(-along.dot(Jet.constant(Y, knee.n)))
        rng = stream(seed, "leg tissue", segment)
        angle, shift = Jet.constant(np.zeros(3), knee.n), Jet.constant(np.zeros(3), knee.n)
        for drive in drives:
            angle = angle + Jet.constant(np.radians(self.turn_deg_per_rad) * random_direction(rng), knee.n) * drive
            shift = shift + Jet.constant(self.slide_m_per_rad * random_direction(rng), knee.n) * drive
        phase = np.array([rng.uniform(-np.pi, np.pi)])
        size = np.array([self.wobble_rad_s / (2.0 * np.pi * self.wobble_hz)])
        ringing = Jet.of(Sinusoids(size, np.array([self.wobble_hz]), phase).at(time_s))
        wobble = ringing * (knee.derivative() * (1.0 / self.drive_rad_s)).tanh()
        x, y, z = (Jet(angle.rows[..., k]) for k in range(3))
        return axis_turn(X, x) @ axis_turn(Y, y) @ axis_turn(Z, z + wobble), shift
