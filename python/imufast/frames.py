"""Anatomical frames of body segments as the sensors on them see them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast.axis import JointAxis
from imufast.deviation import angular_deviation_deg
from imufast.errors import InputError
from imufast.imu import Imu
from imufast.quaternion import from_matrix, matrix
from imufast.samples import ReadOnly

__all__ = ["JOINTS", "SIDES", "SegmentFrame", "axis_covariance", "segment_frame", "spanned", "turns_by"]

Array = NDArray[np.float64]

SIDES = ("left", "right")
JOINTS = {"knee": -1.0, "hip": 1.0, "ankle": 1.0}
"""Flexion (of the ankle dorsiflexion) turns the distal segment about the axis that points to the person's right by the right
hand, +1, or against it, −1."""
DIRECTIONS = ("anterior", "proximal", "right")
"""X, Y and Z of ISB frames."""
LEAST_APART_DEG = 20.0
"""Two directions closer than this to one line span no frame, degrees."""
STANDING_STD_DEG = 5.0
"""How far a segment is taken to lean in a standing pose, one standard deviation, degrees."""
STILL_RAD_S, STILL_M_S2 = 0.35, 1.5
"""A pose is held: rms of the rate and of the specific force about its mean stay below these."""


@dataclass(frozen=True, eq=False)
class SegmentFrame(ReadOnly):
    """The anatomical axes of a body segment, seen from the sensor on it. Made by `segment_frame`.

    Attributes:
        anterior, proximal, right: (3,) unit vectors in the sensor's frame: to the front, towards the trunk (up while standing),
            and to the person's right, on both sides of the body. X, Y and Z of ISB (Wu et al. 2002); y, z and x of McGrath and
            Stirling 2020.
        side: "left", "right", or None for a segment of the midline.
        joint: "knee", "hip" or "ankle", where a flexion axis has told it; else None.
        covariance: (3, 3) of the error as a small rotation, in the segment's ISB axes, rad².
        by_axis: (3, 3) small rotation, likewise, for a small error of the flexion axis that it was made from, a vector in the
            sensor's frame; None where it was made otherwise.
    """

    anterior: Array
    proximal: Array
    right: Array
    side: str | None = None
    joint: str | None = None
    covariance: Array = field(default_factory=lambda: np.zeros((3, 3)), repr=False)
    by_axis: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        axes = np.array([_vector(name, getattr(self, name)) for name in DIRECTIONS])
        if np.abs(axes @ axes.T - np.eye(3)).max() > 1e-6 or np.linalg.det(axes) < 0.0:
            raise InputError(
                "anterior, proximal and right must be perpendicular unit vectors, right-handed in this order; segment_frame "
                "makes them from what is known"
            )
        if self.side not in (None, *SIDES):
            raise InputError(f"side must be 'left', 'right' or None, got {self.side!r}")
        if self.joint is not None:
            check_joint(self.joint)
        covariance = _numbers("covariance", self.covariance, (3, 3))
        checked = [*zip(DIRECTIONS, axes, strict=True), ("covariance", covariance)]
        if self.by_axis is not None:
            checked.append(("by_axis", _numbers("by_axis", self.by_axis, (3, 3))))
        for name, value in checked:
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def matrix(self) -> Array:
        """(3, 3) takes vectors of the ISB frame (X anterior, Y proximal, Z right) to the sensor's."""
        return np.stack([self.anterior, self.proximal, self.right], axis=1)

    @property
    def q_sensor_segment(self) -> Array:
        """(4,) the same as a unit quaternion w x y z."""
        return from_matrix(self.matrix)


def segment_frame(
    side: str | None,
    *,
    flexion_axis: JointAxis | ArrayLike | None = None,
    sensor: int | None = None,
    joint: str | None = None,
    joint_centers: tuple[ArrayLike, ArrayLike] | None = None,
    standing: Imu | None = None,
    anterior: ArrayLike | None = None,
    proximal: ArrayLike | None = None,
    right: ArrayLike | None = None,
    q_sensor_segment: ArrayLike | None = None,
    keep: str | None = None,
    std_deg: float | None = None,
) -> SegmentFrame:
    """The anatomical frame of a segment from what is known of it, as the sensor on it sees it: of anterior, proximal and right
    exactly two directions, each from one source; or all of it as a quaternion. Nothing is guessed: what is missing is named.

    The direction that is kept is taken as it is, the other made perpendicular within their plane: eq. 19 of McGrath and
    Stirling 2020, and Wu et al. 2002, where the long axis is kept.

    Args:
        side: "left" or "right"; None for a segment of the midline, such as the pelvis.
        flexion_axis: gives *right*: a `JointAxis` whose sign is such that flexion is positive (see its `oriented`), or (3,)
            that axis in the sensor's frame. Needs `joint`: knees flex against the right hand about the axis to the right, hips
            and ankles with it.
        sensor: which sensor of the `JointAxis` sits on this segment, 1 (proximal) or 2 (distal).
        joint: "knee", "hip" or "ankle": the joint whose axis it is.
        joint_centers: gives *proximal*: the proximal and the distal joint's centre as seen from the sensor, (3,) each, m
            (`JointCenter.in_sensor1`, `.in_sensor2`; eq. 20 of McGrath and Stirling).
        standing: gives *proximal*: the sensor's Imu, cut to a time in which the segment is held vertical.
        anterior, proximal, right: (3,) a direction in the sensor's frame, any length.
        q_sensor_segment: (4,) unit quaternion that takes vectors of the ISB frame (X anterior, Y proximal, Z right) to the
            sensor's.
        keep: the direction that is kept: "proximal" (default, where it is one of the two), "right" (default else) or
            "anterior".
        std_deg: standard deviation of each direction that is given (or of the quaternion, about each axis), degrees. Default 5
            for a standing pose, else 0. A `JointAxis` states its own.

    Returns:
        SegmentFrame, with the covariance that follows from those of the directions.

    Raises:
        InputError: too little or too much is known (the message says what would do), directions within 20° of one line, a pose
            that is not held still, or an argument of the wrong kind.
    """
    if side not in (None, *SIDES):
        raise InputError(f"side must be 'left', 'right' or None (a segment of the midline), got {side!r}")
    given_std = None if std_deg is None else _std(std_deg)
    if joint is not None:
        check_joint(joint)
    sources = _sources(
        {
            "anterior": [("anterior", anterior)],
            "proximal": [("proximal", proximal), ("joint_centers", joint_centers), ("standing", standing)],
            "right": [("right", right), ("flexion_axis", flexion_axis)],
        }
    )
    if (sensor is not None or joint is not None) and flexion_axis is None:
        raise InputError("sensor and joint say whose flexion_axis it is: give it too, or leave them out")
    if q_sensor_segment is not None:
        if sources or keep is not None:
            raise InputError(f"q_sensor_segment says all of the frame: leave out {', '.join(sources.values()) or 'keep'}")
        q = _numbers("q_sensor_segment", q_sensor_segment, (4,))
        if abs(float(np.linalg.norm(q)) - 1.0) > 1e-6:
            raise InputError(f"q_sensor_segment must be a unit quaternion w x y z, got {q.tolist()}")
        variance = math.radians(given_std or 0.0) ** 2
        front, up, aside = matrix(q / np.linalg.norm(q)).T
        return SegmentFrame(front, up, aside, side, covariance=variance * np.eye(3))
    if len(sources) != 2:
        raise InputError(_missing(sources))
    kept = _kept(keep, sources)
    made = {}
    for direction, name in sources.items():
        if name == "flexion_axis":
            made[direction] = _from_axis(flexion_axis, sensor, joint, given_std or 0.0)
            continue
        if name == "joint_centers":
            vector, default = _from_centers(joint_centers), 0.0
        elif name == "standing":
            vector, default = _from_standing(standing), STANDING_STD_DEG
        else:
            vector, default = _unit(name, {"anterior": anterior, "proximal": proximal, "right": right}[name]), 0.0
        std = default if given_std is None else given_std
        made[direction] = vector, math.radians(std) ** 2 * (np.eye(3) - np.outer(vector, vector))
    return _build(made, kept, side, joint, sources.get("right") == "flexion_axis")


def check_joint(joint: object) -> None:
    """Refuse what is no joint of which the sense of flexion is known."""
    if not isinstance(joint, str) or joint not in JOINTS:
        raise InputError(f"joint must be one of {', '.join(map(repr, JOINTS))}, got {joint!r}")


def axis_covariance(axis: JointAxis) -> Array:
    """(6, 6) of the errors of a hinge axis as small rotations of either sensor, rad²: its covariance, scaled so that the bound
    which follows from it is the stated one, which also knows of biases and of what is no hinge."""
    scale = np.ones(6)
    blocks = np.array(axis.covariance, dtype=np.float64)
    vectors = (axis.axis1, axis.axis2)
    for i, vector in enumerate(vectors):
        block = slice(3 * i, 3 * i + 3)
        stated = min(float(axis.bound95_deg[i]), 180.0)
        mean, std = angular_deviation_deg(vector, blocks[block, block])
        if not math.isfinite(mean) or mean + 2.0 * std < 1e-9:
            # Nothing but the bound is known; an even error has 95 % of its length below 2.448 times its std.
            blocks[block, :] = blocks[:, block] = 0.0
            blocks[block, block] = math.radians(stated / 2.448) ** 2 * (np.eye(3) - np.outer(vector, vector))
        elif stated > 0.0:
            scale[block] = stated / (mean + 2.0 * std)
    # An axis that is off by e is turned by axis × e.
    turning = np.zeros((6, 6))
    turning[:3, :3], turning[3:, 3:] = _cross(axis.axis1), _cross(axis.axis2)
    covariance: Array = turning @ (scale[:, None] * blocks * scale) @ turning.T
    return covariance


def _sources(given: dict[str, list[tuple[str, Any]]]) -> dict[str, str]:
    """Which direction comes from which argument; None is not given."""
    chosen = {}
    for direction, arguments in given.items():
        names = [name for name, value in arguments if value is not None]
        if len(names) > 1:
            raise InputError(f"{' and '.join(names)} both say where {direction} is: give one of them")
        if names:
            chosen[direction] = names[0]
    return chosen


def _missing(sources: dict[str, str]) -> str:
    if len(sources) > 2:
        return f"two directions make a frame, but {', '.join(sources.values())} are three: leave one out"
    long = "joint_centers, standing (an Imu cut to a standing pose) or proximal"
    wanted = {
        "right": "flexion_axis (with joint), or right",
        "proximal": long,
        "anterior": "anterior",
    }
    if not sources:
        return f"nothing says how the segment sits under its sensor: give flexion_axis (with joint) or right, and {long}"
    (known,) = sources
    rest = " or ".join(text for direction, text in wanted.items() if direction != known)
    return f"{sources[known]} alone leaves the turn about it open: give one direction more: {rest}"


def _kept(keep: object, sources: dict[str, str]) -> str:
    if keep is None:
        return "proximal" if "proximal" in sources else "right"
    if keep not in sources:
        raise InputError(f"keep must be one of the two directions that are known, {' or '.join(sources)}; got {keep!r}")
    return str(keep)


def _from_axis(axis: object, sensor: object, joint: str | None, std_deg: float) -> tuple[Array, Array]:
    if joint is None:
        raise InputError(f"flexion_axis needs joint, one of {', '.join(map(repr, JOINTS))}: which way it points depends on it")
    if isinstance(axis, JointAxis):
        if sensor not in (1, 2) or isinstance(sensor, bool):
            raise InputError(f"sensor must be 1 or 2: which sensor of the flexion_axis sits on this segment; got {sensor!r}")
        block = slice(0, 3) if sensor == 1 else slice(3, 6)
        vector = np.array(axis.axis1 if sensor == 1 else axis.axis2, dtype=np.float64)
        turned = axis_covariance(axis)[block, block]
        across = _cross(vector)
        return JOINTS[joint] * vector, across @ turned @ across.T
    if sensor is not None:
        raise InputError("sensor is for a JointAxis; a flexion_axis of three numbers is in this sensor's frame already")
    vector = _unit("flexion_axis", axis)
    return JOINTS[joint] * vector, math.radians(std_deg) ** 2 * (np.eye(3) - np.outer(vector, vector))


def _from_centers(centers: object) -> Array:
    if not isinstance(centers, (tuple, list)) or len(centers) != 2:
        raise InputError(f"joint_centers must be two: the proximal and the distal joint's; got {type(centers).__name__}")
    proximal, distal = (_numbers(f"joint_centers[{i}]", value, (3,)) for i, value in enumerate(centers))
    if float(np.linalg.norm(proximal - distal)) < 1e-3:
        raise InputError("joint_centers are one and the same point: give the segment's proximal and distal joint, m")
    return _unit("joint_centers", proximal - distal)


def _from_standing(imu: object) -> Array:
    if not isinstance(imu, Imu):
        raise InputError(f"standing must be an Imu, cut to a standing pose with imu.between(...), got {type(imu).__name__}")
    force = imu.acc.mean(axis=0)
    rate = float(np.sqrt((imu.gyr**2).sum(axis=1).mean()))
    shaken = float(np.sqrt(((imu.acc - force) ** 2).sum(axis=1).mean()))
    if rate > STILL_RAD_S or shaken > STILL_M_S2:
        raise InputError(
            f"standing is not still: {imu.name!r} turns with {rate:.2g} rad/s and feels {shaken:.2g} m/s² about its mean; cut "
            "it to a pose that is held"
        )
    return _unit("standing", force)


def _build(made: dict[str, tuple[Array, Array]], kept: str, side: str | None, joint: str | None, by_axis: bool) -> SegmentFrame:
    """The frame of two directions, and the covariance of its error from theirs."""
    (other,) = (name for name in made if name != kept)
    (first, first_cov), (second, second_cov) = made[kept], made[other]
    apart = math.degrees(math.asin(min(float(np.linalg.norm(np.cross(first, second))), 1.0)))
    if apart < LEAST_APART_DEG:
        raise InputError(f"{kept} and {other} are only {apart:.0f}° from one line: they do not span a frame")

    found = spanned(kept, first, other, second)
    change = turns_by(lambda x: spanned(kept, first + x[:3], other, second + x[3:])[None], found[None], 6)[0]
    errors = np.zeros((6, 6))
    errors[:3, :3], errors[3:, 3:] = first_cov, second_cov
    right = change[:, :3] if kept == "right" else change[:, 3:]
    covariance = change @ errors @ change.T
    return SegmentFrame(found[0], found[1], found[2], side, joint, covariance, right if by_axis else None)


def spanned(kept: str, first: Array, other: str, second: Array) -> Array:
    """(3, 3) of which rows are anterior, proximal, right (X, Y, Z of ISB), from two of these: `first`, the direction `kept`, is
    taken as it is, of `second`, the direction `other`, what is across it (eq. 19 of McGrath and Stirling 2020)."""
    rows = np.zeros((3, 3))
    i, j = DIRECTIONS.index(kept), DIRECTIONS.index(other)
    rows[i] = first / np.linalg.norm(first)
    rows[j] = second - (second @ rows[i]) * rows[i]
    rows[j] /= np.linalg.norm(rows[j])
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    rows[3 - i - j] = sign * np.cross(rows[i], rows[j])
    return rows


def turns_by(axes: Callable[[Array], Array], found: Array, count: int) -> Array:
    """(F, 3, count) the small rotation of frames, in their own axes, for small changes of what they are made of: central
    differences.

    Args:
        axes: (count,) changes to (F, 3, 3) frames, of which rows are the axes.
        found: (F, 3, 3) these without a change.
        count: how many numbers may change.
    """
    step = 1e-6
    turns = np.empty((len(found), 3, count))
    for k in range(count):
        x = np.zeros(count)
        x[k] = step
        turned = found @ np.swapaxes((axes(x) - axes(-x)) / (2.0 * step), 1, 2)
        turns[:, :, k] = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    return turns


def _cross(v: Array) -> Array:
    """(3, 3) [v×]."""
    x, y, z = v.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _numbers(name: str, value: object, shape: tuple[int, ...]) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers of shape {shape}, got {type(value).__name__}") from None
    if array.shape != shape or not (np.abs(array) < 1e9).all():
        raise InputError(f"{name} must be finite numbers of shape {shape}, got {value!r}")
    return array


def _vector(name: str, value: object) -> Array:
    return _numbers(name, value, (3,))


def _unit(name: str, value: object) -> Array:
    vector = _vector(name, value)
    size = float(np.linalg.norm(vector))
    if size < 1e-9:
        raise InputError(f"{name} must point somewhere, got {vector.tolist()}")
    return np.asarray(vector / size)


def _std(value: object) -> float:
    number = float(_numbers("std_deg", value, ()))
    if not 0.0 <= number <= 180.0:
        raise InputError(f"std_deg must be between 0 and 180, got {value!r}")
    return number
