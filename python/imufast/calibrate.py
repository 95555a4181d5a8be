"""From two sensors on a joint to everything that is known of it: `calibrate_joint`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.axis import JointAxis
from imufast.calibration import JointCalibration
from imufast.center import CenterEstimate, CenterStatus, JointCenter, estimate_joint_center
from imufast.decide import Verdict
from imufast.deviation import angular_deviation_deg
from imufast.hinge import HingeCalibration, calibrate_hinge
from imufast.imu import Imu
from imufast.noise import sensor_noise
from imufast.pairs import check_pair
from imufast.quaternion import matrix
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
PIECE_S, PIECES = 2.0, 6
"""Length of the pieces of time in which the axis may differ, s; the fewest that tell how much."""
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
        little in one piece the centre, too. Of what is nearly a hinge (misfit from `hinge_misfit` on) the axis is the one about
        which the joint turns most in the latest five minutes, by the smoother's orientation: soft tissue pulls that of `hinge`,
        which keeps its own, off it. Where misfit and `rate_ratio` contradict each other clearly, the latter settles it. Where
        a strap has slipped, centre and biases are those of the time since. Motion that does not tell is a verdict, not an
        exception.

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
        if axis is not None and hinge is not None and (hinge.misfit or 0.0) >= settings.hinge_misfit:
            turned = motion.hinge_axis(hinge.misfit or 0.0, settings.floor_deg)
            if turned is not None:
                axis = turned if turned.axis1 @ axis.axis1 + turned.axis2 @ axis.axis2 >= 0.0 else turned.flipped()
    verdict, accepted, why = _judge(joint, hinge, center, ratio)
    limit = settings.max_error_approximate_deg
    if accepted and verdict is Verdict.APPROXIMATE_HINGE and axis is not None and not axis.bound95_deg.max() < limit:
        accepted, why = False, (f"the bound {axis.bound95_deg.max():.3g}° is not below {limit:g}°",)
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
        rates = self._relative_rates()
        if rates is None:
            return None
        values = np.sqrt(np.linalg.eigvalsh(rates.in1.T @ rates.in1))
        return float(values[1] / values[2])

    def hinge_axis(self, misfit: float, floor_deg: float) -> JointAxis | None:
        """The axis about which the joint turns most: the first principal direction of the relative rate, in either frame.

        The covariance holds how much the axis differs between pieces of the recording, and the orientation's error as if it
        were one and the same all the time; the bound, besides, what is no hinge (atan of the misfit) and `floor_deg`. None
        where the joint hardly moves, or too shortly.
        """
        rates = self._relative_rates()
        if rates is None or len(rates.pieces) < PIECES:
            return None
        orientation = self.fit.covariance[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
        mean2 = orientation.mean(axis=0)
        turn = matrix(self.fit.q_12)
        mean1 = np.einsum("nij,njk,nlk->il", turn, orientation, turn) / len(turn)
        axes, bounds, covariance = [], [], np.zeros((6, 6))
        for i, (relative, other, error) in enumerate(((rates.in1, rates.gyr2_in1, mean1), (rates.in2, rates.gyr1_in2, mean2))):
            axis, block = _principal(relative, other, error, rates.pieces)
            mean, std = angular_deviation_deg(axis, block)
            bounds.append(min(math.hypot(mean + 2.0 * std, math.degrees(math.atan(misfit)), floor_deg), 180.0))
            axes.append(axis)
            covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
        if float(((rates.in1 @ axes[0]) * (rates.in2 @ axes[1])).sum()) < 0.0:
            axes[1] = -axes[1]
        return JointAxis(axes[0], axes[1], covariance, np.array(bounds))

    def _relative_rates(self) -> RelativeRates | None:
        """None where the joint hardly moves."""
        imu1, turn = self.imu1, matrix(self.fit.q_12)
        gyr1, gyr2 = imu1.gyr - self.gyr_bias1, self.imu2.gyr - self.gyr_bias2
        gyr2_in1, gyr1_in2 = np.einsum("nij,nj->ni", turn, gyr2), np.einsum("nji,nj->ni", turn, gyr1)
        lowpass_hz = min(LOWPASS_HZ, 0.45 * imu1.rate_hz)
        time_s, slow = _core.condition(
            gyr2_in1 - gyr1, gyr2_in1, gyr2 - gyr1_in2, gyr1_in2, imu1.time_s, imu1.rate_hz, lowpass_hz
        )
        moving = np.linalg.norm(slow[0], axis=1) > MOVING
        if moving.sum() < imu1.rate_hz:
            return None
        cuts = np.flatnonzero(np.diff(time_s[moving] // PIECE_S)) + 1
        in1, other1, in2, other2 = (x[moving] for x in slow)
        return RelativeRates(in1, other1, in2, other2, np.concatenate([[0], cuts]))


@dataclass(frozen=True, eq=False)
class RelativeRates:
    """Low-passed rates while the joint moves, (M, 3) rad/s: of segment 2 against segment 1 in either sensor's frame, and what
    the other gyroscope reads there; `pieces` are the first rows of pieces of time."""

    in1: Array
    gyr2_in1: Array
    in2: Array
    gyr1_in2: Array
    pieces: NDArray[np.int64]


def _principal(relative: Array, other: Array, orientation: Array, pieces: NDArray[np.int64]) -> tuple[Array, Array]:
    """(3,) the first principal direction of the relative rate, and (3, 3) the covariance of its error, rad².

    Args:
        relative: (M, 3) relative rate, in the frame of one sensor.
        other: (M, 3) the other sensor's rate, turned to there: an error δ of the orientation adds δ × other.
        orientation: (3, 3) covariance of δ, there, rad².
        pieces: (K,) first rows of pieces of time, whose sums are taken as independent.
    """
    values, vectors = np.linalg.eigh(relative.T @ relative)
    axis = vectors[:, 2]
    across = np.eye(3) - np.outer(axis, axis)
    about = relative @ axis
    # An axis tilted by e changes the sum of about times across by (first eigenvalue less that of the direction) e.
    sums = np.add.reduceat(about[:, None] * relative, pieces, axis=0) @ across
    x, y, z = about @ other
    moved = across @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    covariance = (sums.T @ sums + moved @ orientation @ moved.T) / max(values[2] - values[1], 1e-12) ** 2
    return axis, covariance
