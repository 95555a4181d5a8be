"""The results of the simulations: a recording of two sensors and the exact truth behind it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imufast.imu import Imu, Recording

from .checks import FloatArray

__all__ = ["BallJointSimulation", "HingeSimulation", "PairSimulation"]


@dataclass(frozen=True, eq=False)
class PairSimulation:
    """A simulated recording of two segments that one joint connects, with its exact truth.

    Quaternions are (N, 4), Hamilton, scalar first, `q_ab` from frame b to frame a; the global frame has z up. The
    `Imu`s look at these arrays without a copy: do not write into them.

    Attributes:
        time_s: (N,) time stamps, s; the motion begins at 0.
        rate_hz: the rate, where all samples lie on an unbroken regular grid; else None.
        gyr1, acc1, gyr2, acc2: (N, 3) what the sensors read, rad/s and m/s², in sensor frames.
        gyr1_true, acc1_true, gyr2_true, acc2_true: the same without noise, bias and disturbance. Those of sensor 2 belong to
            the instants at which it truly sampled, `time_s + clock_offset_s`; all other truth belongs to `time_s`.
        gyr_rate1_true, gyr_rate2_true: (N, 3) angular acceleration at the instants of acc, rad/s², in sensor frames.
        axis1, axis2: (3,) hinge axis in either sensor frame, with one common sign; flexion is positive about it. For a joint
            that is no hinge: the first of its axes, seen from the two segments.
        joint_in_sensor1, joint_in_sensor2: (3,) the joint centre as seen from each sensor, m; -r of the papers' rigid-body
            equations (2017: eqs 1-4, 2020: eqs 4-7).
        q_1, q_2: sensor to global.
        q_12: sensor 2 to sensor 1, soft tissue included.
        q_12_bone: the same, had both sensors been bolted to the bones; equal to q_12 without soft tissue.
        joint_position: (N, 3) joint centre in the global frame, m.
        gyr_bias1, acc_bias1, gyr_bias2, acc_bias2: (3,) rad/s and m/s².
        clock_offset_s: by how much later than its time stamp sensor 2 samples, s.
        dof: degrees of freedom of the joint.
        motion: (N,) name of the motion at each sample; "1" to "14" or "S1" to "S8" for the papers'.
        part: (N,) which stretch of the sequence of motions each sample belongs to, from 0 on.
        row: (N,) the row that each sample would have had, had no packet been lost.
    """

    time_s: FloatArray
    rate_hz: float | None
    gyr1: FloatArray
    acc1: FloatArray
    gyr2: FloatArray
    acc2: FloatArray
    gyr1_true: FloatArray
    acc1_true: FloatArray
    gyr2_true: FloatArray
    acc2_true: FloatArray
    gyr_rate1_true: FloatArray
    gyr_rate2_true: FloatArray
    axis1: FloatArray
    axis2: FloatArray
    joint_in_sensor1: FloatArray
    joint_in_sensor2: FloatArray
    q_1: FloatArray
    q_2: FloatArray
    q_12: FloatArray
    q_12_bone: FloatArray
    joint_position: FloatArray
    gyr_bias1: FloatArray
    acc_bias1: FloatArray
    gyr_bias2: FloatArray
    acc_bias2: FloatArray
    clock_offset_s: float
    dof: int
    motion: NDArray[np.str_]
    part: NDArray[np.int64]
    row: NDArray[np.int64]

    @property
    def is_hinge(self) -> bool:
        """Whether the joint has one degree of freedom."""
        return self.dof == 1

    @cached_property
    def imu1(self) -> Imu:
        """Sensor 1 as an `Imu`."""
        return self._imu(self.gyr1, self.acc1, "sensor1")

    @cached_property
    def imu2(self) -> Imu:
        """Sensor 2 as an `Imu`."""
        return self._imu(self.gyr2, self.acc2, "sensor2")

    @cached_property
    def recording(self) -> Recording:
        """Both sensors, "sensor1" and "sensor2", on one time base."""
        return Recording({"sensor1": self.imu1, "sensor2": self.imu2})

    def _imu(self, gyr: FloatArray, acc: FloatArray, name: str) -> Imu:
        if self.rate_hz is not None:
            return Imu(gyr, acc, rate_hz=self.rate_hz, name=name)
        return Imu(gyr, acc, time_s=self.time_s, name=name)


@dataclass(frozen=True, eq=False)
class HingeSimulation(PairSimulation):
    """A simulated recording of two segments joined by a hinge (or by a joint that is none), with its exact truth.

    Attributes: those of every pair, see `PairSimulation`, and
        angle_rad: (N,) hinge angle, rad; its rate is axis2·ω2 - axis1·ω1 of sensors on the bones of a hinge.
        angle_rate: (N,) that rate, rad/s.
    """

    angle_rad: FloatArray
    angle_rate: FloatArray


@dataclass(frozen=True, eq=False)
class BallJointSimulation(PairSimulation):
    """A simulated recording of two segments joined by a spherical joint, with its exact truth.

    The accelerometers read `acc1 = acc1_true + tissue_acc1 + collision1 + acc_bias1 + noise`, and likewise sensor 2.

    Attributes: those of every pair, see `PairSimulation`, and
        joint_angles_rad: (N, 3) the joint's turns about segment axes y, then z, then x, rad; zero beyond its `dof`.
        joint_acc: (N, 3) specific force at the joint centre (its acceleration + gravity, upwards at rest) in the global frame,
            m/s²: what a0 of Olsson & Halvorsen 2017, eqs 1-4, becomes there.
        collision1, collision2: (N, 3) impulses of collisions, m/s², in sensor frames; zero elsewhere.
        tissue_acc1, tissue_acc2: (N, 3) disturbance by soft tissue (eq. 29), m/s², in sensor frames.
        tissue_matrix1, tissue_matrix2: (3, 3) its matrix H, m/rad; zero without.
    """

    joint_angles_rad: FloatArray
    joint_acc: FloatArray
    collision1: FloatArray
    collision2: FloatArray
    tissue_acc1: FloatArray
    tissue_acc2: FloatArray
    tissue_matrix1: FloatArray
    tissue_matrix2: FloatArray
