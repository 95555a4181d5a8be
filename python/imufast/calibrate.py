"""From two sensors on a joint to everything that is known of it: `calibrate_joint`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.axis import JointAxis
from imufast.calibration import JointCalibration
from imufast.center import CenterEstimate, CenterStatus, JointCenter, estimate_joint_center
from imufast.decide import Verdict
from imufast.hinge import HingeCalibration, calibrate_hinge
from imufast.imu import Imu
from imufast.noise import sensor_noise
from imufast.pairs import check_pair
from imufast.settings import CenterSettings, HingeSettings, check_choice
from imufast.smoother import Smoother, relative_bias_std, run_smoother

__all__ = ["calibrate_joint"]

Array = NDArray[np.float64]

JOINTS = ("auto", "hinge", "ball")
ONE_AXIS, MANY_AXES = 0.35, 0.6
"""Below and above these values of `rate_ratio` the misfit is overruled."""
LOWPASS_HZ, MOVING, LOST, LONGEST_S = 4.0, 0.3, 0.5, 300.0
"""Of `rate_ratio`: Hz; rad/s; rad; s."""
BREAK_STEPS, WHOLE_S = 1.5, 1.0
"""A longer step is a gap, steps; pieces between gaps that the low-pass leaves something of, s."""
LARGEST_STD = 0.05
"""A ball joint is accepted when its centre is at least as certain as this, m."""


def calibrate_joint(
    imu1: Imu,
    imu2: Imu,
    joint: str = "auto",
    *,
    hinge_settings: HingeSettings | None = None,
    center_settings: CenterSettings | None = None,
) -> JointCalibration:
    """Find out what a joint is and where: hinge axis (`calibrate_hinge`), centre (`estimate_joint_center`, method "sa"), biases
    and noise, in one object that everything after it uses.

    Args:
        imu1, imu2: the sensors on the two segments, same time base. Any mounting.
        joint: "auto" tells hinges, ball joints and neither apart; "hinge" asks for a hinge and calls nothing else BALL_JOINT;
            "ball" leaves the axis out.
        hinge_settings: default `HingeSettings()`.
        center_settings: default `CenterSettings()`.

    Returns:
        JointCalibration. Without rest the gyroscope biases are those that the smoother finds, and where lost packets leave
        little in one piece the centre, too. Where misfit and `rate_ratio` contradict each other clearly, the latter settles
        it. Where a strap has slipped, centre and biases are those of the time since. Motion that does not tell is a verdict,
        not an exception.

    Raises:
        InputError: not two Imus of one time base, the same data twice, or too few samples.
        SettingsError: an unknown joint.
    """
    check_choice("joint", joint, JOINTS)
    check_pair(imu1, imu2)
    hinge = None if joint == "ball" else calibrate_hinge(imu1, imu2, settings=hinge_settings)
    axis = None if hinge is None else _axis(hinge)
    if hinge is not None and hinge.mounting_changed_at_s:
        kept = [imu.between(hinge.mounting_changed_at_s[-1]) for imu in (imu1, imu2)]
        imu1, imu2 = kept if len(kept[0]) >= 4 else (imu1, imu2)
    accepted_axis = axis if hinge is not None and hinge.accepted else None
    center = estimate_joint_center(imu1, imu2, "sa", axis=accepted_axis, gyr_bias=_rested(hinge), settings=center_settings)
    found = center.status in (CenterStatus.CONVERGED, CenterStatus.PARTLY_DETERMINED)
    settings = (hinge.settings if hinge else hinge_settings) or HingeSettings()
    zeros, none_seen = np.zeros(3), center.gyr_bias1 is None or center.gyr_bias2 is None
    known = JointCalibration(
        center=center if found else None,
        gyr_bias1=zeros if center.gyr_bias1 is None else center.gyr_bias1,
        gyr_bias2=zeros if center.gyr_bias2 is None else center.gyr_bias2,
        acc_bias1=center.acc_bias1 if found else zeros,
        acc_bias2=center.acc_bias2 if found else zeros,
        gyr_bias_std=settings.gyr_bias_std if none_seen else center.settings.gyr_bias_rest_std,
        acc_bias_covariance=center.acc_bias_covariance if found else np.eye(6) * (center.settings.acc_bias_std or 0.0) ** 2,
        noise=replace(sensor_noise(imu1, imu2), link_std=center.residual_std if found else None),
        history=() if hinge is None else hinge.history,
        hinge=hinge,
        estimate=center,
    )
    torn = _is_torn(imu1)
    motion = Motion.find(imu1, imu2, None if torn else known) if found or torn else None
    ratio = None
    if motion is not None:
        ratio = motion.rate_ratio()
        biases = motion.gyr_biases()
        # Rest and motion together tell how certain the biases are; rest alone what they are.
        new = biases if none_seen else {"relative_gyr_bias_std": biases["relative_gyr_bias_std"]}
        known = replace(known, **new)
        if torn:
            known = replace(known, **motion.joint(center.settings.undetermined_std))
    verdict, accepted, why = _judge(joint, hinge, center, ratio)
    if verdict in (Verdict.BALL_JOINT, Verdict.NOT_A_HINGE):
        axis = None
    return replace(known, verdict=verdict, accepted=accepted, why=why, axis=axis, rate_ratio=ratio)


def _rested(hinge: HingeCalibration | None) -> tuple[Array, Array] | None:
    """Gyroscope biases that rest anywhere in the recording has shown."""
    if hinge is None or hinge.gyr_bias1 is None or hinge.gyr_bias2 is None:
        return None
    return hinge.gyr_bias1, hinge.gyr_bias2


def _axis(hinge: HingeCalibration) -> JointAxis | None:
    if hinge.axis1 is None or hinge.axis2 is None or hinge.bound95_deg is None or hinge.covariance is None:
        return None
    if not np.isfinite(hinge.covariance).all():  # a direction as good as any other
        return None
    return JointAxis(hinge.axis1, hinge.axis2, hinge.covariance, hinge.bound95_deg)


def _judge(
    joint: str, hinge: HingeCalibration | None, center: CenterEstimate, ratio: float | None
) -> tuple[Verdict, bool, tuple[str, ...]]:
    """The verdict on the joint from those on its axis and its centre, and from how far the relative rate is about one axis."""
    determined = center.status is CenterStatus.CONVERGED and float(center.determined_std.max()) < LARGEST_STD
    why: tuple[str, ...] = ()
    if hinge is not None:
        verdict, accepted, why = hinge.verdict, hinge.accepted, hinge.why
        if verdict in (Verdict.HINGE, Verdict.APPROXIMATE_HINGE) and ratio is not None and ratio > MANY_AXES:
            verdict, accepted = Verdict.NOT_A_HINGE, False
            why = (f"the joint turns about a second axis {ratio:.2f} times as much as about the first",)
        elif verdict is Verdict.NOT_A_HINGE and ratio is not None and ratio < ONE_AXIS:
            verdict = Verdict.APPROXIMATE_HINGE
            why = (f"a dominant axis (second to first {ratio:.2f}), but the misfit leaves its direction too uncertain",)
        if joint == "hinge" or verdict is not Verdict.NOT_A_HINGE:
            return verdict, accepted, why
    if determined:
        return Verdict.BALL_JOINT, True, ()
    reason = f"the motion leaves {len(center.undetermined)} of 6 directions of the joint centre open"
    if center.status not in (CenterStatus.CONVERGED, CenterStatus.PARTLY_DETERMINED, CenterStatus.NOT_IDENTIFIABLE):
        reason = f"the search for the joint centre ended with {center.status}"
    elif center.status is CenterStatus.CONVERGED:
        reason = f"the joint centre is certain to {1e3 * float(center.determined_std.max()):.0f} mm only"
    elif not len(center.undetermined):
        reason = "no joint centre explains the motion: the sensors may not share a joint"
    if hinge is None:
        return Verdict.NOT_ENOUGH_INFORMATION, False, (reason,)
    return Verdict.NOT_A_HINGE, False, (*why, reason)


def _is_torn(imu: Imu) -> bool:
    """Whether lost packets leave most of the recording in pieces too short for the low-pass of hinge axis and centre."""
    steps = np.diff(imu.time_s)
    ends = np.flatnonzero(steps * imu.rate_hz > BREAK_STEPS)
    pieces = np.diff(np.concatenate([[0], ends + 1, [len(imu)]]))
    return bool(pieces[pieces >= WHOLE_S * imu.rate_hz].sum() < 0.5 * len(imu))


@dataclass(frozen=True, eq=False)
class Motion:
    """What the smoother finds in a recording: it needs no low-pass, bridges gaps and weighs all it estimates together.

    Attributes:
        imu1, imu2: the latest minutes of the recording, which it saw.
        fit: what it found; converged, and the orientation known.
    """

    imu1: Imu
    imu2: Imu
    fit: _core.SmootherFit

    @classmethod
    def find(cls, imu1: Imu, imu2: Imu, calibration: JointCalibration | None) -> Motion | None:
        """None where the orientation stays unknown."""
        rows = slice(max(0, len(imu1) - int(LONGEST_S * imu1.rate_hz)), None)
        imu1, imu2 = imu1[rows], imu2[rows]
        if imu1.duration_s < 4.0 / min(LOWPASS_HZ, 0.45 * imu1.rate_hz):
            return None
        fit = run_smoother(imu1, imu2, calibration, Smoother())
        numbers = (fit.q_12, fit.covariance, fit.constants, fit.constants_covariance)
        if not all(np.isfinite(x).all() for x in numbers):
            return None
        std = np.sqrt(fit.covariance[:, :3].sum(axis=1))
        return cls(imu1, imu2, fit) if float(np.median(std)) < LOST else None

    @property
    def gyr_bias1(self) -> Array:
        """(3,) rad/s."""
        return np.array(self.fit.constants[12:15])

    @property
    def gyr_bias2(self) -> Array:
        """(3,) rad/s."""
        return np.array(self.fit.constants[15:18])

    def gyr_biases(self) -> dict[str, Any]:
        """Gyroscope biases and how certain they are."""
        covariance = self.fit.constants_covariance[12:, 12:]
        return {
            "gyr_bias1": self.gyr_bias1,
            "gyr_bias2": self.gyr_bias2,
            "gyr_bias_std": float(np.sqrt(np.trace(covariance) / 6.0)),
            "relative_gyr_bias_std": relative_bias_std(self.fit.q_12, covariance),
        }

    def joint(self, undetermined_std: float) -> dict[str, Any]:
        """Centre and accelerometer biases; directions of the centre less certain than this, m, are open."""
        x, covariance = self.fit.constants, self.fit.constants_covariance
        values, vectors = np.linalg.eigh(covariance[:6, :6])
        return {
            "center": JointCenter(-x[0:3], -x[3:6], covariance[:6, :6], vectors.T[values > undetermined_std**2]),
            "acc_bias1": x[6:9],
            "acc_bias2": x[9:12],
            "acc_bias_covariance": covariance[6:12, 6:12],
        }

    def rate_ratio(self) -> float | None:
        """How much the joint turns about its second axis over how much about its first: singular values s2:s1 of the relative
        rate, low-passed at 4 Hz, over the samples at which it moves.

        Measured: mechanical hinges up to 0.03, knees 0.13-0.33, hips 0.13-0.46, ankles 0.26-0.63, mechanical joints with more
        degrees of freedom from 0.77 on. None where the joint hardly moves.
        """
        q, imu1 = self.fit.q_12, self.imu1
        w, v = q[:, :1], q[:, 1:]
        gyr2 = self.imu2.gyr - self.gyr_bias2
        turned = gyr2 + 2.0 * np.cross(v, np.cross(v, gyr2) + w * gyr2)
        relative = np.ascontiguousarray(turned - (imu1.gyr - self.gyr_bias1))
        nothing = np.zeros_like(relative)
        lowpass_hz = min(LOWPASS_HZ, 0.45 * imu1.rate_hz)
        slow = _core.condition(relative, nothing, nothing, nothing, imu1.time_s, imu1.rate_hz, lowpass_hz)[1][0]
        moving = slow[np.linalg.norm(slow, axis=1) > MOVING]
        if len(moving) < imu1.rate_hz:
            return None
        values = np.sqrt(np.linalg.eigvalsh(moving.T @ moving))
        return float(values[1] / values[2])
