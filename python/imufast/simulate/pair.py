"""Two sensors worn on two segments: from how the segments move to what the sensors would read without noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of, quaternion, vector3
from .pose import Bodies, Movement, Y
from .sensors import specific_force
from .signals import stream
from .so3 import Turning, conjugate, multiply, random_quaternion, rotate_back
from .soft_tissue import SoftTissue
from .timing import Part, interval_before

__all__ = ["SensorPair"]


@dataclass(frozen=True, eq=False)
class SensorPair:
    """Where the sensors sit and how they sample; pairs are (sensor 1, sensor 2).

    Attributes:
        mounts: (4,) each, from the sensor to its segment.
        joints: (3,) each, the joint centre as seen from the sensor, m.
        soft_tissue: None where the sensors are bolted to the bones.
        phases: of the soft tissue's wobble, rad.
        mean_rate: gyroscopes report the mean over the interval before each sample.
        clock_offset_s: sensor 2 samples this much late, s.
        gravity: m/s².
    """

    mounts: tuple[FloatArray, FloatArray]
    joints: tuple[FloatArray, FloatArray]
    soft_tissue: SoftTissue | None
    phases: tuple[float, float]
    mean_rate: bool
    clock_offset_s: float
    gravity: float

    @classmethod
    def checked(
        cls,
        seed: int,
        usual_joints: tuple[FloatArray, FloatArray],
        *,
        mount1: ArrayLike | None,
        mount2: ArrayLike | None,
        joint_in_sensor1: ArrayLike | None,
        joint_in_sensor2: ArrayLike | None,
        soft_tissue: SoftTissue | None,
        gyr_sampling: str,
        clock_offset_s: float,
        gravity: float,
    ) -> SensorPair:
        """The settings of a simulation, checked; mounts that are not given are drawn.

        `usual_joints` (3,) each: the joint centre from the sensor in segment axes, m, where none is given.
        """
        mounts = [
            random_quaternion(stream(seed, name)) if mount is None else quaternion(name, mount)
            for name, mount in (("mount1", mount1), ("mount2", mount2))
        ]
        joints = [
            rotate_back(q, usual) if joint is None else vector3(name, joint)
            for name, joint, q, usual in zip(
                ("joint_in_sensor1", "joint_in_sensor2"),
                (joint_in_sensor1, joint_in_sensor2),
                mounts,
                usual_joints,
                strict=True,
            )
        ]
        if soft_tissue is not None and not isinstance(soft_tissue, SoftTissue):
            raise SettingsError(f"soft_tissue must be a SoftTissue or None; got {type(soft_tissue).__name__}")
        return cls(
            mounts=(mounts[0], mounts[1]),
            joints=(joints[0], joints[1]),
            soft_tissue=soft_tissue,
            phases=(stream(seed, "wobble1").uniform(-np.pi, np.pi), stream(seed, "wobble2").uniform(-np.pi, np.pi)),
            mean_rate=one_of("gyr_sampling", gyr_sampling, ("instant", "interval_mean")) == "interval_mean",
            clock_offset_s=number("clock_offset_s", clock_offset_s),
            gravity=number("gravity", gravity, least=0.0),
        )

    @property
    def axes(self) -> tuple[FloatArray, FloatArray]:
        """The segments' y axis, the first of the joint's, in either sensor frame."""
        return rotate_back(self.mounts[0], Y), rotate_back(self.mounts[1], Y)

    def truth(self, movement: Movement, part: Part, start_s: float) -> dict[str, FloatArray]:
        """Truth of one stretch that begins `start_s` into its motion; see `PairSimulation` for the names."""
        time_s = start_s + part.since_start_s
        bodies = movement(time_s)
        now = [self._sensor(i, time_s, bodies) for i in (0, 1)]
        rigid = [bodies.segments[i].mounted(self.mounts[i]) for i in (0, 1)]
        truth = {
            "q_1": now[0].q,
            "q_2": now[1].q,
            "q_12": multiply(conjugate(now[0].q), now[1].q),
            "q_12_bone": multiply(conjugate(rigid[0].q), rigid[1].q),
            "joint_position": np.stack([p.rows[0] for p in bodies.position], axis=-1),
            **bodies.truth,
        }
        for i, late in ((0, 0.0), (1, self.clock_offset_s)):
            read_at = time_s + late
            then = bodies if late == 0.0 else movement(read_at)
            sensor = now[i] if late == 0.0 else self._sensor(i, read_at, then)
            joint_acc = np.stack([p.rows[2] for p in then.position], axis=-1)
            truth[f"gyr{i + 1}_true"] = self._mean_rate(movement, i, read_at) if self.mean_rate else sensor.gyr
            truth[f"acc{i + 1}_true"] = specific_force(sensor, joint_acc, -self.joints[i], self.gravity)
            truth[f"gyr_rate{i + 1}_true"] = sensor.gyr_rate
        return truth

    def _sensor(self, i: int, time_s: FloatArray, bodies: Bodies) -> Turning:
        bone = bodies.segments[i]
        if self.soft_tissue is not None:
            bone = bone.then(self.soft_tissue.shell(i + 1, time_s, bodies.swing[i], bodies.bend, self.phases[i]))
        return bone.mounted(self.mounts[i])

    def _mean_rate(self, movement: Movement, i: int, time_s: FloatArray) -> FloatArray:
        """Mean of each component of the rate over the interval before each sample: Gauss-Legendre, exact to rounding here."""
        before = interval_before(time_s)
        total = np.zeros((len(time_s), 3))
        for node, weight in zip(*np.polynomial.legendre.leggauss(6), strict=True):
            at = time_s - before * 0.5 * (1.0 - node)
            total += 0.5 * weight * self._sensor(i, at, movement(at)).gyr
        return total
