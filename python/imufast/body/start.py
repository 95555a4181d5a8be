"""Where the search for a lower body starts: from what `calibrate_joint` and `track` find at each joint alone (3.9)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.layout import Layout
from imufast.body.settings import Anthropometry
from imufast.body.stance import STILL, Rests
from imufast.calibrate import calibrate_joint
from imufast.imu import BREAK_STEPS, Imu, Recording
from imufast.quaternion import conjugate, exp, matrix, multiply, rotate
from imufast.smoother import Smoother
from imufast.track import RelativeOrientation, TrackStatus, track

__all__ = ["BodyStart", "JointStart", "joint_start"]

Array = NDArray[np.float64]
TILT_S = 10.0
"""Over so long to either side specific force is averaged to tell what is up, s: longer than any movement."""

ALONE = Smoother(most_parts=1)
"""How two sensors are tracked: a start need not know how far parts of it differ."""
TOLD = 3.0
"""A bone that is as long as so many of its standard deviations has a direction."""
OPEN_DEG = 30.0
"""Two sensors whose turn against each other is less certain than this do not show it."""


@dataclass(frozen=True, eq=False)
class JointStart:
    """One joint by its two sensors alone.

    Attributes:
        rel: relative orientation.
        centers: (2, 3) the joint as seen from both sensors, m.
        axes: (2, 3) a knee's axis in both sensors, with one common sign; of a ball joint meaningless.
        biases: (2, 2, 3) gyroscope and accelerometer bias of both sensors.
        seen: whether the relative orientation was.
    """

    rel: RelativeOrientation
    centers: Array
    axes: Array
    biases: Array
    seen: bool


def joint_start(upper: Imu, lower: Imu, knee: bool, before: JointStart | None = None) -> JointStart:
    """A joint from its two sensors; centre and axis are those from `before`, where it is given, and biases start there."""
    if before is not None:
        rel = track(upper, lower, before.rel.calibration, ALONE)
        found = rel.calibration
        biases = np.stack([[found.gyr_bias1, found.acc_bias1], [found.gyr_bias2, found.acc_bias2]])
        return JointStart(rel, before.centers, before.axes, biases, rel.status is TrackStatus.TRACKED)
    known = calibrate_joint(upper, lower, joint="hinge" if knee else "ball")
    rel = track(upper, lower, known, ALONE)
    found = rel.calibration
    centers = np.zeros((2, 3)) if found.center is None else np.stack([found.center.in_sensor1, found.center.in_sensor2])
    axes = np.tile([1.0, 0.0, 0.0], (2, 1))
    if knee and known.axis is not None:
        axes = np.stack([known.axis.axis1, known.axis.axis2])
    elif knee:
        axes = _axes_from(rel, upper, lower)
    biases = np.stack([[found.gyr_bias1, found.acc_bias1], [found.gyr_bias2, found.acc_bias2]])
    return JointStart(rel, centers, axes, biases, rel.status is TrackStatus.TRACKED)


class BodyStart:
    """All joints together.

    Args:
        recording, layout: the sensors and where they are.
        before: the start from other stretches of the same recording: its joint centres, axes and uprights are kept.

    Attributes:
        joints: joint to what its two sensors alone say.
        biases: (S, 2, 3) gyroscope and accelerometer biases, rad/s and m/s²: the mean of what the joints of a sensor say.
        q: (N, S, 4) sensors to the world, from the root down.
        postures: hip or ankle to directions (2, 3) in both its sensors that usually agree, where the motion shows them, and to
            (N,) in which of the stretches between breaks, by number from 1 on, it does not show them; else 0.
        up: (S, 3) what is upwards in each sensor at rest, else on average; after `stand` while the subject stands.
        stood: whether it is known to stand still for a second.
        sat: whether it never does, but rests on a chair for as long.
    """

    def __init__(self, recording: Recording, layout: Layout, before: BodyStart | None = None) -> None:
        self.layout = layout
        imus = [recording[name] for name in layout.placed.values()]
        self.joints: dict[str, JointStart] = {
            name: joint_start(imus[a], imus[b], name.startswith("knee"), None if before is None else before.joints[name])
            for name, (a, b) in layout.joints.items()
        }
        total, count = np.zeros((len(imus), 2, 3)), np.zeros((len(imus), 1, 1))
        for name, pair in layout.joints.items():
            for side, sensor in enumerate(pair):
                total[sensor] += self.joints[name].biases[side]
                count[sensor] += 1.0
        self.biases: Array = total / np.maximum(count, 1.0)
        self.postures: dict[str, tuple[Array, NDArray[np.intp]]] = {}
        self.q = np.empty((len(recording.time_s), len(imus), 4))
        self.q[:, 0] = _upright(imus[0], self.biases[0, 0])
        for name, (upper, lower) in layout.joints.items():
            self.q[:, lower] = multiply(self.q[:, upper], self.joints[name].rel.q_12)
            self._face(name, recording)
        if before is not None:
            self.up: Array = before.up
            self.stood: bool = before.stood
            self.sat: bool = before.sat
            return
        self.stood = self.sat = False
        quiet = np.max([np.linalg.norm(imu.gyr, axis=1) for imu in imus], axis=0) < STILL
        self.up = self._mean_up(quiet if quiet.sum() >= recording.rate_hz else np.ones(len(quiet), dtype=bool))

    def _face(self, name: str, recording: Recording) -> None:
        """Between breaks where the two sensors of a joint do not show its heading: turns the lower one's stretch so that the
        knee's axis points the same way in both, on average; of a hip or an ankle as it does where they do show it."""
        upper, lower = self.layout.joints[name]
        kind, _, side = name.partition("_")
        certain = self.joints[name].rel.angle_std_deg < OPEN_DEG
        knee = self.joints.get(f"knee_{side}")
        if knee is None or certain.all() or (kind != "knee" and not certain.any()):
            return

        def right(sensor: int, axis: Array) -> Array:
            return rotate(self.q[:, sensor], np.broadcast_to(axis, (len(certain), 3)))

        # The lower segment of a hip is a thigh, the upper one of an ankle a shank: there the axis is known.
        known = {"hip": [None, knee.axes[0]], "knee": [*knee.axes], "ankle": [knee.axes[1], None]}[kind]
        pair = [right(sensor, axis) for sensor, axis in zip((upper, lower), known, strict=True) if axis is not None]
        if kind != "knee":
            other = upper if kind == "hip" else lower
            usual = rotate(conjugate(self.q[certain, other]), pair[0][certain]).mean(axis=0)
            pair.insert(0 if kind == "hip" else 1, right(other, usual))
            axes = [usual if axis is None else axis for axis in known]
            self.postures[name] = (
                np.stack([axis / max(np.linalg.norm(axis), 1e-9) for axis in axes]),
                np.zeros(len(certain), int),
            )
        breaks = np.flatnonzero(np.diff(recording.time_s) > BREAK_STEPS / recording.rate_hz) + 1
        for number, rows in enumerate(np.split(np.arange(len(certain)), breaks), start=1):
            if not certain[rows].any():
                if name in self.postures:
                    self.postures[name][1][rows] = number
                high, low = ((axis[rows, :2] @ [1.0, 1.0j]).sum() for axis in pair)
                half = 0.5 * np.angle(high * np.conj(low))
                about_z = np.broadcast_to([np.cos(half), 0.0, 0.0, np.sin(half)], (len(rows), 4))
                self.q[rows, lower] = multiply(about_z, self.q[rows, lower])

    def stand(self, rests: Rests, fit: _core.BodyFit) -> None:
        """Take the uprights from those rests in which the subject stands; where it never does, from all of the motion, but of
        feet from all rests, in which they are on the floor or hang.

        Args:
            rests: of this recording or of one that it is a part of.
            fit: joint centres, and knee axes that point to the right.
        """
        standing = rests.standing(fit.centers, fit.axes, self.up)
        self.stood = bool(standing.any())
        self.sat = not self.stood and rests.sitting(fit.centers, fit.axes, self.up)
        if self.stood:
            self.up = rests.up(standing)
            return
        self.up = self._mean_up(np.ones(len(self.q), dtype=bool))
        if rests.long_enough(rests.all):
            feet = [segment.startswith("foot") for segment in self.layout.segments]
            self.up[feet] = rests.up(rests.all)[feet]

    def _mean_up(self, rows: NDArray[np.bool_]) -> Array:
        up = matrix(self.q[rows])[:, :, 2, :].mean(axis=0)
        unit: Array = up / np.linalg.norm(up, axis=1, keepdims=True)
        return unit

    def constants(self, anthropometry: Anthropometry) -> tuple[Array, Array]:
        """Joint centres and axes; a bone of an impossible length is replaced by the usual one in its direction, where that is
        known: little motion draws centres towards their sensors, so that who sits has short thighs. Else along the upright."""
        centers = np.stack([self.joints[name].centers for name in self.layout.names])
        axes = np.stack([self.joints[name].axes for name in self.layout.names])
        a = anthropometry
        for name, (high, low) in self.layout.bones().items():
            kind, _, side = name.partition("_")
            if not side:
                continue
            mean = (a.femur_m if kind == "femur" else a.tibia_m)[0]
            length = float(np.linalg.norm(centers[high] - centers[low]))
            if not 0.6 * mean < length < 1.5 * mean:
                sensor = self.layout.joints[self.layout.names[high[0]]][high[1]]
                bone, along = centers[high] - centers[low], self.up[sensor]
                variance = sum(bone @ self._center_covariance(*end) @ bone for end in (high, low))
                if length > 1e-3 and length**4 > TOLD**2 * variance:
                    along = bone / length
                middle = 0.5 * (centers[high] + centers[low]) if length > 1e-3 else np.zeros(3)
                centers[high], centers[low] = middle + 0.5 * mean * along, middle - 0.5 * mean * along
        return centers, axes

    def _center_covariance(self, joint: int, side: int) -> Array:
        """(3, 3) of a joint's centre as one of its two sensors says, m²."""
        center = self.joints[self.layout.names[joint]].rel.calibration.center
        if center is None:
            return np.diag(np.full(3, np.inf))
        return center.covariance[3 * side : 3 * side + 3, 3 * side : 3 * side + 3]


def _axes_from(rel: RelativeOrientation, upper: Imu, lower: Imu) -> Array:
    """The direction about which the joint turns most, where the calibration names none."""
    turned = rotate(rel.q_12, lower.gyr) - upper.gyr
    axis = np.linalg.eigh(turned.T @ turned)[1][:, 2]
    other = rotate(conjugate(rel.q_12), np.broadcast_to(axis, turned.shape)).mean(axis=0)
    return np.stack([axis, other / max(float(np.linalg.norm(other)), 1e-9)])


def _upright(imu: Imu, gyr_bias: Array) -> Array:
    """(N, 4) sensor to world (z up) of one sensor: its gyroscope, and on average over some seconds what it feels is upwards."""
    steps = np.diff(imu.time_s)
    rates = 0.5 * (imu.gyr[1:] + imu.gyr[:-1]) - gyr_bias
    # Across a break nothing is known; the tilt comes back from the accelerometer.
    steps = np.where(steps > 1.0, 0.0, steps)
    q = _running_product(np.concatenate([[[1.0, 0.0, 0.0, 0.0]], exp(rates * steps[:, None])]))
    felt = rotate(q, imu.acc)
    reach = max(int(TILT_S * imu.rate_hz), 1)
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(felt, axis=0)])
    rows = np.arange(len(felt))
    mean = total[np.minimum(rows + reach + 1, len(felt))] - total[np.maximum(rows - reach, 0)]
    up = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    # The shortest turn that brings it to z.
    tilt = np.concatenate([1.0 + up[:, 2:], np.stack([up[:, 1], -up[:, 0], np.zeros(len(up))], axis=1)], axis=1)
    tilt = np.where(tilt[:, :1] < 1e-6, [0.0, 1.0, 0.0, 0.0], tilt)
    return multiply(tilt / np.linalg.norm(tilt, axis=1, keepdims=True), q)


def _running_product(q: Array) -> Array:
    """Products of the first 1, 2, ... quaternions, by doubling."""
    total, reach = q.copy(), 1
    while reach < len(q):
        total[reach:] = multiply(total[:-reach], total[reach:])
        reach *= 2
    unit: Array = total / np.linalg.norm(total, axis=1, keepdims=True)
    return unit
