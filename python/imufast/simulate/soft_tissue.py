"""Skin and strap: how a worn sensor moves against the bone beneath it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .checks import FloatArray, number
from .signals import Signal, Sinusoids
from .so3 import Turning

__all__ = ["SoftTissue"]


@dataclass(frozen=True)
class SoftTissue:
    """Motion of the sensors against their bones, as small turns of a shell that carries the sensor about the joint centre.

    The shell is a rigid body with exact rate and acceleration, so gyr and acc stay consistent with each other and the sensor's
    place, seen from the shell, stays what it was; it is the hinge that no longer holds between the sensors. Four parts, each
    a smooth function of the bones' motion:

    - *shift*: skin slides as the joint bends. A turn about the limb's long axis (x), proportional to the hinge angle.
    - *drag*: soft mass trails behind a limb that turns. A turn across the limb (z), driven by the segment's angular rate about
      the hinge axis and softly limited to `drag_rad`.
    - *wobble*: the strap rings. An oscillation about the long axis that the same rate calls up and that dies with it. This is a
      description, not a spring: its size follows the rate at once.

    - *tilt*: the same about the hinge axis itself, where no constraint of a hinge feels it: the joint angle alone is off.

    With the defaults the rms of ‖ω1×j1‖ - ‖ω2×j2‖ below 4 Hz is about a tenth of the rms relative rate about the axis in
    walking and in sit-to-stand; on human knees it is 0.08 to 0.22.

    Attributes:
        shift_rad: turn per radian of hinge angle, rad; default 0.08, about 5 degrees in a stride.
        drag_rad: largest turn across the limb, rad; default 0.07 (4 degrees).
        tilt_rad: largest turn about the hinge axis, rad; default 0.
        wobble_rad_s: largest rate of the wobble, rad/s; default 6 (thigh straps ring with several rad/s in walking).
        wobble_hz: frequency of the wobble on segment 1, Hz; default 9. On segment 2 it is 1.2 times as high.
        drive_rad_s: angular rate at which drag and wobble reach 76 % (tanh 1) of their size, rad/s; default 2.
        segment2: size of all of it on segment 2 against segment 1; default 0.6, a shank carries less tissue than a thigh.

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    shift_rad: float = 0.08
    drag_rad: float = 0.07
    wobble_rad_s: float = 6.0
    wobble_hz: float = 9.0
    drive_rad_s: float = 2.0
    segment2: float = 0.6
    tilt_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("shift_rad", "drag_rad", "tilt_rad", "wobble_rad_s", "segment2"):
            number(name, getattr(self, name), least=0.0)
        for name in ("wobble_hz", "drive_rad_s"):
            number(name, getattr(self, name), above=0.0)

    def shell(self, segment: int, time_s: FloatArray, swing: Signal, hinge: Signal, phase: float) -> Turning:
        """The shell of segment 1 or 2 in the frame of its bone.

        Args:
            segment: 1 or 2.
            time_s: (N,) s.
            swing: angle of this segment about the hinge axis in space, rad, known to the third derivative.
            hinge: hinge angle, rad.
            phase: of the wobble, rad.
        """
        size = 1.0 if segment == 1 else self.segment2
        frequency = self.wobble_hz * (1.0 if segment == 1 else 1.2)
        drive = (swing.derivative() * (1.0 / self.drive_rad_s)).tanh()
        swinging = Sinusoids(np.ones(1), np.array([frequency]), np.array([phase])).at(time_s)
        wobble = self.wobble_rad_s / (2.0 * np.pi * frequency) * swinging * drive
        along = Turning.about([1.0, 0.0, 0.0], size * (self.shift_rad * hinge + wobble))
        across = Turning.about([0.0, 0.0, 1.0], size * self.drag_rad * drive)
        if not self.tilt_rad:
            return along.then(across)
        return along.then(across).then(Turning.about([0.0, 1.0, 0.0], size * self.tilt_rad * drive))
