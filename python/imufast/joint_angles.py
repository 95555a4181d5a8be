"""Three angles of a joint between two anatomical frames: Grood and Suntay 1983, as the ISB recommends (Wu et al. 2002)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.angles import AngleStatus, JointAngles, assembled_std, check_rel, orientation_covariance, quadratic, status_of
from imufast.errors import InputError
from imufast.frames import JOINTS, SegmentFrame, check_joint
from imufast.hinge_angle import check_degrees, hinge_turn, off_axis_covariance
from imufast.quaternion import matrix
from imufast.track import VAGUE_DEG, RelativeOrientation

__all__ = ["CONVENTIONS", "NAMES", "SIGNS", "cardan", "clinical", "joint_angles", "joint_angles_deg"]

Array = NDArray[np.float64]

CONVENTIONS = ("ISB", "McGrath")
SIGNS = ("clinical", "consistent")
NAMES = {
    "knee": ("flexion", "adduction", "internal_rotation"),
    "hip": ("flexion", "adduction", "internal_rotation"),
    "ankle": ("dorsiflexion", "inversion", "internal_rotation"),
}
LOCK_DEG = 80.0
"""A middle angle beyond this is gimbal lock, degrees: errors of the other two grow sixfold."""


def joint_angles(
    rel: RelativeOrientation,
    frame1: SegmentFrame,
    frame2: SegmentFrame,
    convention: str = "ISB",
    *,
    joint: str | None = None,
    signs: str = "clinical",
    soft_tissue_std_deg: float | None = None,
) -> JointAngles:
    """Flexion, adduction and internal rotation of a joint over time, with their standard deviations.

    With R = Rz(α) Rx(β) Ry(γ), which takes vectors of segment 2's ISB frame to segment 1's: turns about Z of segment 1
    (to the right), the floating X, and Y of segment 2 (along it), the joint coordinate system of Grood and Suntay 1983.

    Args:
        rel: what `track` gave; sensor 1 on the proximal segment.
        frame1, frame2: the anatomical frames of both segments (`segment_frame`).
        convention: "ISB" (default): signs as `signs` says, so that they mean flexion and so on; "McGrath": α, β and γ as they
            are, the turns by the right hand about x (right), y (anterior) and z (proximal) of the frames of McGrath and
            Stirling 2020, in which knees flex to negative angles.
        joint: "knee", "hip" or "ankle". Default None: as the frames say, where a flexion axis has told them.
        signs: of "ISB": "clinical" (default): flexion, adduction and internal rotation positive, on both sides; "consistent":
            flexion positive, the other two by one hand on both sides: right abduction and internal rotation, left adduction
            and external rotation positive. Knees flex at −α, hips and ankles at +α.
        soft_tissue_std_deg: how far skin and straps turn the sensors on the bones, about each axis, degrees. Default None:
            where the calibration has a hinge axis, by as much as the joint is seen to leave it; else 0, and `why` says so.

    Returns:
        JointAngles with three angles; where the middle one is near ±90° (`gimbal_lock`), the other two are as unsure as
        `std_deg` says.

    Raises:
        InputError: an argument of the wrong kind, frames of different sides or joints, or a side or joint that nobody told.
    """
    rel = check_rel(rel)
    for name, frame in (("frame1", frame1), ("frame2", frame2)):
        if not isinstance(frame, SegmentFrame):
            raise InputError(f"{name} must be a SegmentFrame, what segment_frame makes, got {type(frame).__name__}")
    if convention not in CONVENTIONS:
        raise InputError(f"convention must be one of {', '.join(map(repr, CONVENTIONS))}, got {convention!r}")
    if signs not in SIGNS:
        raise InputError(f"signs must be one of {', '.join(map(repr, SIGNS))}, got {signs!r}")
    if joint is not None:
        check_joint(joint)
    side = _agreed("side", None, frame1.side, frame2.side)
    joint = _agreed("joint", joint, frame1.joint, frame2.joint)
    turns, names = _turns(convention, signs, side, joint)

    between = np.einsum("ji,njk,kl->nil", frame1.matrix, matrix(rel.q_12), frame2.matrix)
    raw, per_turn = cardan(between)
    # Gradients for small turns of segment 2 in its own frame, of sensor 2 in its, and of segment 1 in its own.
    by_sensor2 = np.einsum("nki,ji->nkj", per_turn, frame2.matrix)
    by_frame1 = np.einsum("nki,nji->nkj", per_turn, between)
    tissue, tilt, off_axis, told = _tissue(rel, soft_tissue_std_deg)
    none = np.zeros((1, 3))
    parts = {
        "orientation": quadratic(by_sensor2, orientation_covariance(rel)),
        "axis": quadratic(per_turn, _tilted(frame2, tilt)) + quadratic(by_frame1, _tilted(frame1, tilt)),
        "zero": none,
        "soft_tissue": quadratic(by_sensor2, tissue),
    }
    std, made_of = assembled_std(parts, len(rel))
    status, why = status_of(rel)
    why += told
    vague = [name.replace("_", " ") for name, median in zip(names, np.median(std, axis=0), strict=True) if median > VAGUE_DEG]
    if vague and status is not AngleStatus.NOT_OBSERVABLE:
        why += (f"less certain than {VAGUE_DEG:g}° most of the time: {', '.join(vague)}",)
    lock = np.abs(raw[:, 1]) > np.radians(LOCK_DEG)
    if lock.any():
        share = 100.0 * float(lock.mean())
        why += (f"gimbal lock for {share:.2g} % of the samples: the middle angle is near 90°",)
        status = AngleStatus.GIMBAL_LOCK if status is AngleStatus.FOUND else status
    return JointAngles(
        time_s=rel.time_s,
        names=names,
        angles_deg=np.degrees(np.unwrap(raw, axis=0)) * turns,
        std_deg=std,
        status=status,
        convention=convention,
        zero="the segments' axes parallel",
        signs=signs if convention == "ISB" else "rotations",
        side=side,
        joint=joint,
        gimbal_lock=lock,
        off_axis_deg=off_axis,
        parts=made_of,
        why=why,
        rotation_signs=turns,
    )


def joint_angles_deg(
    rel: RelativeOrientation, frame1: SegmentFrame, frame2: SegmentFrame, convention: str = "ISB", **keywords: Any
) -> Array:
    """(N, 3) the numbers of `joint_angles` alone, degrees. Arguments and exceptions as there."""
    return joint_angles(rel, frame1, frame2, convention, **keywords).angles_deg


def cardan(rotations: Array) -> tuple[Array, Array]:
    """α, β, γ of R = Rz(α) Rx(β) Ry(γ), and what small turns do to them.

    Args:
        rotations: (N, 3, 3).

    Returns:
        (N, 3) angles, rad, β within ±π/2; where β is ±π/2 to rounding, γ is 0. And (N, 3, 3): turning R by a small rotation
        vector δ on the right changes angle k by row k · δ; bounded where β is near ±π/2.
    """
    r = rotations
    sine = np.clip(r[:, 2, 1], -1.0, 1.0)
    # The cosine from what is small near the lock, for it is exact there.
    cosine = np.hypot(r[:, 2, 0], r[:, 2, 2])
    locked = cosine < 1e-9
    alpha = np.where(locked, np.arctan2(r[:, 1, 0], r[:, 0, 0]), np.arctan2(-r[:, 0, 1], r[:, 1, 1]))
    beta = np.arctan2(sine, cosine)
    gamma = np.where(locked, 0.0, np.arctan2(-r[:, 2, 0], r[:, 2, 2]))
    c, s, safe = np.cos(gamma), np.sin(gamma), np.maximum(cosine, 1e-6)
    zero, one = np.zeros_like(c), np.ones_like(c)
    first = np.stack([-s / safe, zero, c / safe], axis=1)
    second = np.stack([c, zero, s], axis=1)
    third = np.stack([zero, one, zero], axis=1) - sine[:, None] * first
    return np.stack([alpha, beta, gamma], axis=1), np.stack([first, second, third], axis=1)


def clinical(rotations: Array, side: str, joint: str) -> tuple[Array, Array]:
    """Flexion, adduction and internal rotation (convention "ISB", signs "clinical"), and what small turns do to them.

    Args:
        rotations: (N, 3, 3), distal ISB frame to proximal one.
        side: "left" or "right".
        joint: "knee", "hip" or "ankle".

    Returns:
        (N, 3) angles, rad, within ±π; (N, 3, 3) gradients as `cardan`.
    """
    turns, _ = _turns("ISB", "clinical", side, joint)
    raw, per_turn = cardan(rotations)
    return raw * turns, per_turn * turns[:, None]


def _agreed(name: str, given: str | None, *told: str | None) -> str | None:
    """What is given and what the frames say must not contradict each other."""
    known = sorted({value for value in (given, *told) if value is not None})
    if len(known) > 1:
        raise InputError(f"{name}: {' and '.join(map(repr, known))} contradict each other; both frames belong to one joint")
    return known[0] if known else None


def _turns(convention: str, signs: str, side: str | None, joint: str | None) -> tuple[Array, tuple[str, ...]]:
    """The signs of the three turns, and what the angles are called."""
    if convention == "McGrath":
        return np.ones(3), ("rotation_x", "rotation_y", "rotation_z")
    if joint is None:
        raise InputError(f"joint is not told, so which way is flexion is not known: give joint, one of {', '.join(JOINTS)}")
    if signs == "consistent":
        return np.array([JOINTS[joint], -1.0, 1.0]), NAMES[joint]
    if side is None:
        raise InputError(
            "side is not told, so which way is adduction is not known: name it in segment_frame, or choose "
            "signs='consistent' or convention='McGrath', which need none"
        )
    mirrored = 1.0 if side == "right" else -1.0
    return np.array([JOINTS[joint], mirrored, mirrored]), NAMES[joint]


def _tilted(frame: SegmentFrame, variance: float) -> Array:
    """(3, 3) of the error of a frame whose functional flexion axis is tilted against the anatomical one, rad²."""
    if frame.by_axis is None:
        return frame.covariance
    tilted: Array = frame.covariance + variance * frame.by_axis @ frame.by_axis.T
    return tilted


def _tissue(rel: RelativeOrientation, std_deg: float | None) -> tuple[Array, float, float | None, tuple[str, ...]]:
    """(3, 3) of soft tissue in sensor frame 2, rad²; the variance by which it tilts either sensor's functional axis against the
    anatomical one, per direction, rad²; the rms off the hinge axis, degrees; what there is to know."""
    axis = rel.calibration.axis
    off_axis, tissue, tilt = None, np.zeros((3, 3)), 0.0
    told: tuple[str, ...] = ()
    if axis is not None:
        turn, _, rest = hinge_turn(rel.q_12, axis.axis1, axis.axis2)
        tissue, off_axis = off_axis_covariance(rel, axis, turn, rest)
        # What soft tissue does in step with flexion cannot be told from flexion: it tilts the axis about which the sensors
        # turn. It is taken to be as much as what it does out of step, which is seen; on which segment is not: all on each.
        across = np.trace(tissue) - axis.axis2 @ tissue @ axis.axis2
        tilt = min(0.5 * float(across) / max(float(turn.var()), 1e-6), 1.0)
    elif std_deg is None:
        told = ("nothing shows how far soft tissue moves, for there is no hinge axis: the standard deviation leaves it out",)
    if std_deg is not None:
        tissue, tilt = np.radians(check_degrees("soft_tissue_std_deg", std_deg, 0.0, 180.0)) ** 2 * np.eye(3), 0.0
    return tissue, tilt, off_axis, told
