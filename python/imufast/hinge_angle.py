"""The angle of a hinge from relative orientation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast.angles import AngleStatus, JointAngles, assembled_std, check_rel, orientation_covariance, quadratic, status_of
from imufast.axis import JointAxis
from imufast.errors import InputError
from imufast.frames import SegmentFrame, axis_covariance
from imufast.quaternion import conjugate, matrix, multiply, shortest_turn, twist
from imufast.track import VAGUE_DEG, RelativeOrientation

__all__ = ["flexion_axis", "hinge_angle", "hinge_angle_deg", "hinge_turn", "off_axis_covariance"]

Array = NDArray[np.float64]
Zero: TypeAlias = str | tuple[float, float] | ArrayLike | tuple[SegmentFrame, SegmentFrame]
Flexion: TypeAlias = str | tuple[float, float] | None

MANY_AXES = 0.6
"""A joint that turns off its axis by more than this share of what it turns about it (both rms), and by more than
`OFF_AXIS_DEG`, is no hinge."""
OFF_AXIS_DEG = 10.0
LEAST_TURN_DEG = 1.0
"""A stretch over which the joint turns less than this on the whole does not tell which way is flexion."""
LOPSIDED = 1.5
"""The larger excursion from zero tells flexion where it is so many times the smaller one."""


def hinge_angle(
    rel: RelativeOrientation,
    axis: JointAxis,
    *,
    zero: Zero = "mean",
    zero_deg: float = 0.0,
    zero_std_deg: float = 0.0,
    flexion: Flexion = None,
    soft_tissue_std_deg: float | None = None,
) -> JointAngles:
    """The angle of a hinge joint over time, with its standard deviation.

    It is the turn about the axis that comes nearest to the relative orientation: 2 atan2(v·axis2, w) of the quaternion (w, v)
    of A⁻¹ q_12, where A takes axis2 to axis1; for a hinge, the integral of axis2·gyr2 − axis1·gyr1. How the sensors are mounted
    does not change it. Unwrapped: it passes 180° without a jump.

    Args:
        rel: what `track` gave.
        axis: the hinge axis in both sensor frames (`calibration.axis`), with the sign that makes the angle grow by the right
            hand.
        zero: where the angle is `zero_deg`: "mean" (default), its mean over the recording; (start_s, stop_s), its mean over an
            interval, such as a standing pose; (4,) a pose, as q_12; or (frame1, frame2), the pose in which the two segments'
            axes are parallel.
        zero_deg: the angle there, degrees. Default 0.
        zero_std_deg: how well that is known, degrees. Default 0.
        flexion: which way is positive. None (default): as the axis points, which is by convention, not anatomy; "axis": the
            same, and this is flexion, for the axis was turned so (`axis.oriented`); (start_s, stop_s): over this interval the
            joint flexes on the whole; "excursion": the larger excursion from zero is flexion, as of knees and elbows.
        soft_tissue_std_deg: how far skin and straps turn the sensors on the bones about the axis, degrees. Default None: as
            much as the joint is seen to leave its axis, in the quieter of the two directions. No hinge leaves its axis: what
            does is soft tissue, or what the joint does beside flexing; it is most about the limb, round which straps slide.
            0: the angle of the sensors is meant, not of the bones.

    Returns:
        JointAngles with one angle, "flexion" or, where `flexion` is None, "hinge_angle". Its standard deviation is made of
        that of the orientation, of the axis, of the zero and of soft tissue, as if they were independent.

    Raises:
        InputError: an argument of the wrong kind, an interval without samples, or a way of telling flexion that does not tell
            it.
    """
    rel = check_rel(rel)
    check_axis(axis)
    check_degrees("zero_deg", zero_deg, -360.0, 360.0)
    check_degrees("zero_std_deg", zero_std_deg, 0.0, 180.0)
    turn, gradient, rest = hinge_turn(rel.q_12, axis.axis1, axis.axis2)
    covariance = orientation_covariance(rel)
    tissue, off_axis = off_axis_covariance(rel, axis, turn, rest)
    along = max(float(axis.axis2 @ tissue @ axis.axis2), 0.0)
    if soft_tissue_std_deg is not None:
        along = np.radians(check_degrees("soft_tissue_std_deg", soft_tissue_std_deg, 0.0, 180.0)) ** 2

    orientation = quadratic(gradient[:, None, :], covariance)
    # What a small turn of either sensor's axis does to the angle, and what it does to the zero.
    by_axis = np.hstack([-np.einsum("nij,nj->ni", matrix(rel.q_12), gradient), gradient])
    rows, offset, sense, words, zero_variance = _zero(zero, rel, axis, turn, orientation)
    by_axis = by_axis - (by_axis[rows].mean(axis=0) if sense is None else sense)
    parts = {
        "orientation": orientation,
        "axis": np.maximum(np.einsum("ni,ij,nj->n", by_axis, axis_covariance(axis), by_axis), 0.0)[:, None],
        "zero": np.full((1, 1), zero_variance + np.radians(zero_std_deg) ** 2),
        "soft_tissue": np.full((1, 1), along),
    }
    std, made_of = assembled_std(parts, len(rel))
    angle = np.degrees(turn - offset)
    sign = _sign(flexion, rel, angle)
    status, why = status_of(rel)
    if status is AngleStatus.FOUND and off_axis > max(MANY_AXES * float(angle.std()), OFF_AXIS_DEG):
        status = AngleStatus.NOT_A_HINGE
        why += (f"the joint turns {off_axis:.0f}° off its axis, {float(angle.std()):.0f}° about it, both rms",)
    if flexion is None:
        why += ("which way is flexion was not told: the sign is that of the axis",)
    return JointAngles(
        time_s=rel.time_s,
        names=("hinge_angle" if flexion is None else "flexion",),
        angles_deg=(sign * angle + zero_deg)[:, None],
        std_deg=std,
        status=status,
        convention="hinge",
        zero=words if not zero_deg else f"{words}, set to {zero_deg:g} degrees",
        signs="as the axis points" if flexion is None else "flexion",
        side=None,
        joint=None,
        gimbal_lock=np.zeros(len(rel), dtype=bool),
        off_axis_deg=off_axis,
        parts=made_of,
        why=why,
    )


def hinge_angle_deg(rel: RelativeOrientation, axis: JointAxis, **keywords: Any) -> Array:
    """(N,) the numbers of `hinge_angle` alone, degrees. Arguments and exceptions as there."""
    angle: Array = hinge_angle(rel, axis, **keywords).angles_deg[:, 0]
    return angle


def flexion_axis(rel: RelativeOrientation, axis: JointAxis, *, zero: Zero = "mean", flexion: Flexion = None) -> JointAxis:
    """The axis, turned so that flexion is positive; arguments and exceptions as of `hinge_angle`."""
    rel = check_rel(rel)
    check_axis(axis)
    turn = hinge_turn(rel.q_12, axis.axis1, axis.axis2)[0]
    offset = _zero(zero, rel, axis, turn, np.zeros((len(rel), 1)))[1]
    return axis if _sign(flexion, rel, np.degrees(turn - offset)) > 0.0 else axis.flipped()


def hinge_turn(q_12: Array, axis1: Array, axis2: Array) -> tuple[Array, Array, Array]:
    """(N,) turn of sensor 2 against sensor 1 about the hinge axis, unwrapped, rad, from an arbitrary zero on; (N, 3) its
    gradient for a small turn of sensor 2, in its frame; (N, 4) the orientation from that zero on, in sensor frame 2."""
    rest = multiply(conjugate(shortest_turn(axis2, axis1)), q_12)
    turn, gradient = twist(rest, axis2)
    return np.unwrap(turn), gradient, rest


def off_axis_covariance(rel: RelativeOrientation, axis: JointAxis, turn: Array, rest: Array) -> tuple[Array, float]:
    """(3, 3) of how the joint leaves its hinge axis beyond what the orientation's own errors explain, in sensor frame 2, rad²,
    and the smaller of its two directions about the axis itself, where it cannot be seen; and the rms off the axis, degrees.

    Args:
        rel: the orientations.
        axis: the hinge axis.
        turn, rest: what `hinge_turn` gave.
    """
    fair = rel.angle_std_deg <= VAGUE_DEG
    if not fair.any():
        return np.zeros((3, 3)), float(rel.angle_std_deg.mean())
    half = -0.5 * turn[fair]
    back = np.concatenate([np.cos(half)[:, None], np.sin(half)[:, None] * axis.axis2], axis=1)
    q = multiply(back, rest[fair])
    q = np.where(q[:, :1] < 0.0, -q, q)
    size = np.linalg.norm(q[:, 1:], axis=1)
    vectors = q[:, 1:] * np.where(size > 1e-9, 2.0 * np.arctan2(size, q[:, 0]) / np.maximum(size, 1e-9), 2.0)[:, None]
    vectors = vectors - vectors.mean(axis=0)
    across = np.eye(3) - np.outer(axis.axis2, axis.axis2)
    found = vectors.T @ vectors / len(vectors)
    off = across @ (found - orientation_covariance(rel)[fair].mean(axis=0)) @ across
    values, directions = np.linalg.eigh(0.5 * (off + off.T))
    left = across @ ((directions * np.maximum(values, 0.0)) @ directions.T) @ across
    quieter = max(float(np.linalg.eigvalsh(left)[1]), 0.0)
    total: Array = left + quieter * np.outer(axis.axis2, axis.axis2)
    return total, float(np.degrees(np.sqrt(np.trace(across @ found @ across))))


def check_axis(axis: object) -> None:
    """Refuse what is no hinge axis."""
    if not isinstance(axis, JointAxis):
        if axis is None:
            raise InputError("axis is None: there was no calibration (calibrate_joint makes one), or it found no hinge")
        raise InputError(f"axis must be a JointAxis such as calibration.axis, got {type(axis).__name__}")
    for name in ("axis1", "axis2"):
        vector = np.asarray(getattr(axis, name))
        if vector.shape != (3,) or not abs(float(np.linalg.norm(vector)) - 1.0) < 1e-6:
            raise InputError(f"axis.{name} must be a unit vector of three numbers, got {vector.tolist()}")


def check_degrees(name: str, value: object, low: float, high: float) -> float:
    """The value as a plain float."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)) or not low <= value <= high:
        raise InputError(f"{name} must be a number between {low:g} and {high:g} degrees, got {value!r}")
    return float(value)


def _zero(
    zero: object, rel: RelativeOrientation, axis: JointAxis, turn: Array, orientation: Array
) -> tuple[NDArray[np.bool_], float, Array | None, str, float]:
    """Which samples are zero on average; the turn there, rad; what small turns of both axes do to it, or None (as those
    samples); in words; the variance that it adds, rad²."""
    everything = np.ones(len(turn), dtype=bool)
    if isinstance(zero, str):
        if zero != "mean":
            raise InputError(
                f"zero must be 'mean', an interval (start_s, stop_s), a pose q_12 (4,) or two SegmentFrames, got {zero!r}"
            )
        # A mean over the recording errs less than the samples do: it adds nothing to their variance.
        return everything, float(turn.mean()), None, "mean of the recording", 0.0
    if isinstance(zero, Sequence) and len(zero) == 2 and all(isinstance(part, SegmentFrame) for part in zero):
        frame1, frame2 = zero
        pose = multiply(frame1.q_sensor_segment, conjugate(frame2.q_sensor_segment))
        words, covariance = "the segments' axes parallel", frame2.matrix @ frame2.covariance @ frame2.matrix.T
        covariance = covariance + _seen_from(pose, frame1.matrix @ frame1.covariance @ frame1.matrix.T)
    else:
        numbers = _numbers(zero)
        if len(numbers) == 2:
            rows = interval_rows("zero", (numbers[0], numbers[1]), rel.time_s)
            # Errors that do not average out within the interval: at most those of its samples.
            since = numbers - rel.time_s[0]
            words = f"mean of {since[0]:.6g} to {since[1]:.6g} s after the start"
            return rows, float(turn[rows].mean()), None, words, float(orientation[rows].mean())
        if abs(float(np.linalg.norm(numbers)) - 1.0) > 1e-6:
            raise InputError(f"zero must be a unit quaternion w x y z where it is four numbers, got {numbers.tolist()}")
        pose, words, covariance = numbers, "a given pose", np.zeros((3, 3))
    (at,), (gradient,), _ = hinge_turn(pose[None], axis.axis1, axis.axis2)
    # Of poses that differ by whole turns, the one nearest to the recording.
    at += 2.0 * np.pi * np.round((float(np.median(turn)) - at) / (2.0 * np.pi))
    sense = np.concatenate([-matrix(pose) @ gradient, gradient])
    return everything, float(at), sense, words, float(max(gradient @ covariance @ gradient, 0.0))


def _seen_from(pose: Array, covariance1: Array) -> Array:
    """A covariance in sensor frame 1, seen from sensor frame 2."""
    turned: Array = matrix(pose).T @ covariance1 @ matrix(pose)
    return turned


def _numbers(zero: object) -> Array:
    try:
        numbers = np.array(zero, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape not in ((2,), (4,)) or not np.isfinite(numbers).all():
        raise InputError(
            f"zero must be 'mean', an interval (start_s, stop_s), a pose q_12 (4,) or two SegmentFrames, got {zero!r}"
        )
    return numbers


def interval_rows(name: str, interval: tuple[float, float], time_s: Array) -> NDArray[np.bool_]:
    """Which samples lie in an interval, both ends included.

    Raises:
        InputError: none does.
    """
    start, stop = interval
    rows: NDArray[np.bool_] = (time_s >= start) & (time_s <= stop)
    if not rows.any():
        raise InputError(
            f"{name}: there is no sample from {start:.10g} to {stop:.10g} s; the recording goes from {time_s[0]:.10g} to "
            f"{time_s[-1]:.10g} s"
        )
    return rows


def _sign(flexion: object, rel: RelativeOrientation, angle: Array) -> float:
    """+1 where the axis points so that the angle grows in flexion, −1 where it is the other way."""
    if flexion is None or (isinstance(flexion, str) and flexion == "axis"):
        return 1.0
    if isinstance(flexion, str) and flexion == "excursion":
        up, down = max(float(angle.max()), 0.0), max(-float(angle.min()), 0.0)
        if max(up, down) < LOPSIDED * min(up, down) or max(up, down) < LEAST_TURN_DEG:
            raise InputError(
                f"flexion='excursion' does not tell the sign: the angle goes from {-down:.1f} to {up:.1f}° about its zero, no "
                "way much further; give a zero near extension, the interval of a flexion, or orient the axis"
            )
        return 1.0 if up > down else -1.0
    pair = np.asarray(flexion, dtype=np.float64) if isinstance(flexion, (tuple, list)) and len(flexion) == 2 else np.zeros(0)
    if pair.shape != (2,) or not np.isfinite(pair).all():
        raise InputError(f"flexion must be None, 'axis', 'excursion' or an interval (start_s, stop_s), got {flexion!r}")
    rows = interval_rows("flexion", (float(pair[0]), float(pair[1])), rel.time_s)
    change = float(angle[rows][-1] - angle[rows][0])
    if abs(change) < LEAST_TURN_DEG:
        raise InputError(
            f"flexion: from {pair[0]:g} to {pair[1]:g} s the joint turns by {change:.2f}° only, which tells no sign"
        )
    return 1.0 if change > 0.0 else -1.0
