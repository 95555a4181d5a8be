"""What the tests of joint angles share: orientations by hand, mountings, mirrors."""

from __future__ import annotations

import imufast
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
Q = [3, 0, 1, 2]
"""From scipy's x y z w to w x y z."""


def orientation(
    rotations: Rotation,
    *,
    covariance: Array | None = None,
    calibration: imufast.JointCalibration | None = None,
    rate: float = 100.0,
) -> imufast.RelativeOrientation:
    """A relative orientation of N rotations, as `track` gives it; (3, 3) or (N, 3, 3) covariance, rad²."""
    q = rotations.as_quat()[:, Q]
    each = np.zeros((len(q), 3, 3)) if covariance is None else np.broadcast_to(covariance, (len(q), 3, 3)).copy()
    return imufast.RelativeOrientation(
        time_s=np.arange(len(q)) / rate,
        q_12=q,
        angle_std_deg=np.degrees(np.sqrt(np.trace(each, axis1=1, axis2=2))),
        status=imufast.TrackStatus.TRACKED,
        calibration=calibration or imufast.JointCalibration(),
        method=imufast.Smoother(),
        covariance=each,
    )


def hinge(angle_rad: Array, seed: int = 0) -> tuple[Rotation, imufast.JointAxis]:
    """A perfect hinge at these angles, its sensors mounted anyhow, and its axis."""
    mount1, mount2 = Rotation.random(2, random_state=seed)
    rotations = mount1 * Rotation.from_rotvec(angle_rad[:, None] * np.array([0.0, 1.0, 0.0])) * mount2.inv()
    y = np.array([0.0, 1.0, 0.0])
    return rotations, imufast.JointAxis(mount1.apply(y), mount2.apply(y))


def frame_of(
    mount: Rotation, side: str | None, joint: str | None = "knee", covariance: Array | None = None
) -> imufast.SegmentFrame:
    """The frame of a segment whose sensor is mounted so: `mount` takes vectors of the ISB frame to the sensor's."""
    front, up, right = mount.as_matrix().T
    return imufast.SegmentFrame(front, up, right, side, joint, np.zeros((3, 3)) if covariance is None else covariance)


def mirrored(rotations: Rotation, normal: int = 2) -> Rotation:
    """The mirror images of rotations in the plane across one axis of the frame in which both are told."""
    mirror = np.diag([-1.0 if k == normal else 1.0 for k in range(3)])
    return Rotation.from_matrix(mirror @ rotations.as_matrix() @ mirror)
