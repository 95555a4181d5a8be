"""Joint angles from relative orientation: what is found, and how far to trust it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError
from imufast.samples import ReadOnly
from imufast.track import RelativeOrientation, TrackStatus

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["AngleStatus", "AngleStd", "JointAngles"]

Array = NDArray[np.float64]

MOST_STD_DEG = 180.0
"""Beyond half a turn an angle says no more."""


class AngleStatus(str, Enum):
    """What became of joint angles."""

    FOUND = "FOUND"
    """Found, as well as `std_deg` says."""
    NOT_A_HINGE = "NOT_A_HINGE"
    """The joint turns off the axis nearly as much as about it: one angle does not tell how it stands."""
    GIMBAL_LOCK = "GIMBAL_LOCK"
    """Some samples, `gimbal_lock`, have the middle angle near 90°, where the other two cannot be told apart."""
    NOT_OBSERVABLE = "NOT_OBSERVABLE"
    """The motion does not show the relative orientation, hence no angle."""
    UNCERTAIN = "UNCERTAIN"
    """The search for the orientations did not end as it should; take the numbers with care."""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class AngleStd(ReadOnly):
    """What the standard deviation of joint angles is made of: rms over time of each part, (k,) degrees, one an angle.

    Attributes:
        orientation: of the tracked orientation: noise, drift, how well the two sensors agree.
        axis: of the hinge axis; with three angles, of both segment frames.
        zero: of the pose that is zero.
        soft_tissue: of skin and straps that move on the bones.
    """

    orientation: Array
    axis: Array
    zero: Array
    soft_tissue: Array


@dataclass(frozen=True, eq=False)
class JointAngles(ReadOnly):
    """Angles of a joint over time, each with its uncertainty.

    Attributes:
        time_s: (N,) times of the samples, s.
        names: what the k angles are: ("flexion",), or ("hinge_angle",) where nobody said which way flexion is; or three, such
            as ("flexion", "adduction", "internal_rotation").
        angles_deg: (N, k) without jumps of 360°, degrees; read-only, as all arrays here.
        std_deg: (N, k) one standard deviation, degrees; at most 180.
        status: what became of them.
        convention: "hinge", "ISB" or "McGrath".
        zero: what zero means, in words.
        signs: "clinical", "consistent" or "rotations"; of a hinge "flexion" or "as the axis points".
        side: "left", "right" or None (not told).
        joint: "knee", "hip", "ankle" or None (not told).
        gimbal_lock: (N,) where the middle of three angles is within 10° of ±90°: the others are not to be trusted there.
        off_axis_deg: by how much the joint turns off its hinge axis, rms, degrees; None without an axis.
        parts: what the standard deviation is made of.
        why: what the reader should know, one sentence each.
        rotation_signs: (3,) times the three angles: turns by the right hand about Z of segment 1, then X, then Y of segment 2;
            None of a hinge.
    """

    time_s: Array = field(repr=False)
    names: tuple[str, ...]
    angles_deg: Array = field(repr=False)
    std_deg: Array = field(repr=False)
    status: AngleStatus
    convention: str
    zero: str
    signs: str
    side: str | None
    joint: str | None
    gimbal_lock: NDArray[np.bool_] = field(repr=False)
    off_axis_deg: float | None
    parts: AngleStd = field(repr=False)
    why: tuple[str, ...] = ()
    rotation_signs: Array | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return len(self.time_s)

    def __getitem__(self, name: str) -> Array:
        """(N,) one angle by its name, degrees."""
        if name not in self.names:
            raise InputError(f"there is no angle {name!r}; there are {', '.join(map(repr, self.names))}")
        return np.asarray(self.angles_deg[:, self.names.index(name)])

    def as_scipy(self) -> Rotation:
        """N scipy rotations that take vectors of segment 2's ISB frame (X anterior, Y proximal, Z right) to segment 1's: the
        three angles turned back into an orientation. Needs scipy.

        Raises:
            InputError: a hinge angle alone is no orientation.
        """
        from scipy.spatial.transform import Rotation

        if self.rotation_signs is None:
            raise InputError("a hinge angle alone is no orientation; joint_angles gives three")
        return Rotation.from_euler("ZXY", self.angles_deg * self.rotation_signs, degrees=True)


def check_rel(rel: object) -> RelativeOrientation:
    """The relative orientation, without what overflowed; or a refusal by name."""
    if not isinstance(rel, RelativeOrientation):
        raise InputError(f"rel must be a RelativeOrientation, what track gave, got {type(rel).__name__}")
    if not len(rel):
        raise InputError("rel holds no samples")
    broken = ~(np.abs(np.linalg.norm(rel.q_12, axis=1) - 1.0) < 1e-3)
    if not broken.any():
        return rel
    # Where the numbers overflowed nothing is known.
    q = np.where(broken[:, None], [1.0, 0.0, 0.0, 0.0], rel.q_12)
    status = TrackStatus.NUMERICAL_ERROR
    return replace(rel, q_12=q, angle_std_deg=np.where(broken, MOST_STD_DEG, rel.angle_std_deg), covariance=None, status=status)


def orientation_covariance(rel: RelativeOrientation) -> Array:
    """(N, 3, 3) of the error in sensor frame 2, rad². Where only its size is stated, all of it may be about any one axis: so it
    is taken about each."""
    if rel.covariance is not None:
        return rel.covariance
    covariance: Array = np.radians(rel.angle_std_deg)[:, None, None] ** 2 * np.eye(3)
    return covariance


def quadratic(vectors: Array, covariance: Array) -> Array:
    """(N, k) variances vᵀ P v of (N, k, 3) vectors, with one (3, 3) covariance or (N, 3, 3)."""
    each = np.broadcast_to(covariance, (len(vectors), 3, 3))
    variances: Array = np.maximum(np.einsum("nki,nij,nkj->nk", vectors, each, vectors), 0.0)
    return variances


def assembled_std(parts: dict[str, Array], count: int) -> tuple[Array, AngleStd]:
    """(N, k) the standard deviation of variances that add up, rad² in, and rms of each, degrees out."""
    total = np.zeros((count, 1)) + sum(parts.values())
    std = np.minimum(np.degrees(np.sqrt(total)), MOST_STD_DEG)
    rms = {
        name: np.minimum(np.degrees(np.sqrt(np.broadcast_to(value, total.shape).mean(axis=0))), MOST_STD_DEG)
        for name, value in parts.items()
    }
    return std, AngleStd(**rms)


def status_of(rel: RelativeOrientation) -> tuple[AngleStatus, tuple[str, ...]]:
    """What the orientations allow, and what they give to know."""
    if rel.status is TrackStatus.TRACKED:
        return AngleStatus.FOUND, rel.why
    if rel.status is TrackStatus.NOT_OBSERVABLE:
        return AngleStatus.NOT_OBSERVABLE, rel.why
    return AngleStatus.UNCERTAIN, rel.why
