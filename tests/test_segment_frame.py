"""Segment frames: what they are made of, their covariance, and what is missing, by name."""

from __future__ import annotations

from typing import Any

import imufast
import numpy as np
import pytest
from imufast import Imu, InputError, JointAxis, SegmentFrame, segment_frame
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
MOUNT = Rotation.random(random_state=11)
"""Takes vectors of the segment's ISB frame to the sensor's."""
FRONT, UP, RIGHT = (MOUNT.apply(v) for v in np.eye(3))


def standing(lean_deg: float = 0.0, shaking: float = 0.0, name: str = "thigh") -> Imu:
    rng = np.random.default_rng(0)
    up = Rotation.from_rotvec(np.radians(lean_deg) * FRONT).apply(UP)
    gyr = rng.normal(0.0, 0.005 + shaking, (200, 3))
    return Imu(gyr, 9.81 * up + rng.normal(0.0, 0.02, (200, 3)), rate_hz=100.0, name=name)


def check(frame: SegmentFrame, atol: float = 1e-9) -> None:
    np.testing.assert_allclose([frame.anterior, frame.proximal, frame.right], [FRONT, UP, RIGHT], atol=atol)
    np.testing.assert_allclose(frame.matrix, MOUNT.as_matrix(), atol=atol)
    q = MOUNT.as_quat()[[3, 0, 1, 2]]
    assert abs(float(frame.q_sensor_segment @ q)) == pytest.approx(1.0, abs=1e-6)


def test_any_two_directions_or_all_of_it_give_the_same_frame() -> None:
    knee = {"flexion_axis": -RIGHT, "joint": "knee"}
    for given in (
        {"right": 3.0 * RIGHT, "proximal": UP},
        {"right": RIGHT, "anterior": 0.1 * FRONT},
        {"anterior": FRONT, "proximal": UP},
        {**knee, "proximal": UP},
        {**knee, "anterior": FRONT},
        {"flexion_axis": RIGHT, "joint": "hip", "proximal": UP},
        {**knee, "joint_centers": (0.25 * UP + 0.03 * RIGHT, -0.15 * UP + 0.03 * RIGHT)},
        {"q_sensor_segment": MOUNT.as_quat()[[3, 0, 1, 2]]},
    ):
        check(segment_frame("left", **given))
    check(segment_frame("right", right=RIGHT, standing=standing()), atol=1e-3)
    axis = JointAxis(-RIGHT, np.array([1.0, 0.0, 0.0]))
    check(segment_frame("right", flexion_axis=axis, sensor=1, joint="knee", proximal=UP))
    check(segment_frame("right", flexion_axis=JointAxis(axis.axis2, axis.axis1), sensor=2, joint="knee", proximal=UP))


def test_what_is_kept_is_kept_and_the_other_is_made_perpendicular() -> None:
    slanting = RIGHT + 0.3 * UP + 0.1 * FRONT
    kept = segment_frame("left", right=slanting, proximal=UP)
    np.testing.assert_allclose(kept.proximal, UP, atol=1e-12)
    # Eq. 19 of McGrath and Stirling 2020: x = (z × x) × z, y = z × x of their axes.
    z, x = UP, slanting / np.linalg.norm(slanting)
    anterior = np.cross(z, x) / np.linalg.norm(np.cross(z, x))
    np.testing.assert_allclose(kept.anterior, anterior, atol=1e-12)
    np.testing.assert_allclose(kept.right, np.cross(anterior, z), atol=1e-12)
    other = segment_frame("left", right=slanting, proximal=UP, keep="right")
    np.testing.assert_allclose(other.right, x, atol=1e-12)
    assert segment_frame("left", right=slanting, anterior=FRONT).right == pytest.approx(x)


@pytest.mark.parametrize("keep", ["proximal", "right"])
def test_the_covariance_is_that_of_frames_from_directions_that_err(keep: str) -> None:
    right = RIGHT + 0.2 * UP
    right /= np.linalg.norm(right)
    std_deg, rng = 2.0, np.random.default_rng(4)
    frame = segment_frame(None, right=right, proximal=UP, keep=keep, std_deg=std_deg)
    turns = []
    for _ in range(1500):
        drawn = [v + np.radians(std_deg) * rng.standard_normal(3) for v in (right, UP)]
        other = segment_frame(None, right=drawn[0], proximal=drawn[1], keep=keep)
        turns.append(Rotation.from_matrix(frame.matrix.T @ other.matrix).as_rotvec())
    # 1500 draws tell a variance to 4 %.
    found = np.cov(np.array(turns).T)
    np.testing.assert_allclose(found, frame.covariance, atol=0.08 * float(np.trace(frame.covariance)))


def test_each_source_errs_by_what_it_says() -> None:
    none = segment_frame("left", right=RIGHT, proximal=UP)
    assert not none.covariance.any()
    posed = segment_frame("left", right=RIGHT, standing=standing())
    np.testing.assert_allclose(np.degrees(np.sqrt(np.diag(posed.covariance))), [5.0, 0.0, 5.0], atol=0.05)
    bound = JointAxis(-RIGHT, UP, bound95_deg=np.array([9.8, 0.0]))
    axis = segment_frame("left", flexion_axis=bound, sensor=1, joint="knee", proximal=UP)
    # 4° of standard deviation each way, of which the kept long axis takes away one.
    np.testing.assert_allclose(np.degrees(np.sqrt(np.diag(axis.covariance))), [0.0, 4.0, 0.0], atol=0.05)
    whole = segment_frame("left", q_sensor_segment=MOUNT.as_quat()[[3, 0, 1, 2]], std_deg=3.0)
    np.testing.assert_allclose(whole.covariance, np.radians(3.0) ** 2 * np.eye(3))


def test_a_frame_cannot_be_changed() -> None:
    frame = segment_frame("left", right=RIGHT, proximal=UP)
    with pytest.raises(ValueError, match="read-only"):
        frame.right[0] = 0.0
    with pytest.raises(AttributeError):
        frame.side = "right"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "nothing says how the segment sits under its sensor: give flexion_axis (with joint) or right, and joint_centers"),
        ({"right": RIGHT}, "right alone leaves the turn about it open: give one direction more: joint_centers, standing"),
        (
            {"standing": standing()},
            "standing alone leaves the turn about it open: give one direction more: flexion_axis (with joint)",
        ),
        ({"right": RIGHT, "proximal": UP, "anterior": FRONT}, "anterior, proximal, right are three: leave one out"),
        ({"right": RIGHT, "flexion_axis": RIGHT, "joint": "hip"}, "right and flexion_axis both say where right is"),
        ({"proximal": UP, "standing": standing()}, "proximal and standing both say where proximal is"),
        ({"flexion_axis": RIGHT, "proximal": UP}, "flexion_axis needs joint, one of 'knee', 'hip', 'ankle'"),
        ({"flexion_axis": JointAxis(RIGHT, UP), "joint": "knee", "proximal": UP}, "sensor must be 1 or 2"),
        ({"flexion_axis": RIGHT, "sensor": 1, "joint": "knee", "proximal": UP}, "sensor is for a JointAxis"),
        ({"right": RIGHT, "proximal": UP, "joint": "knee"}, "sensor and joint say whose flexion_axis it is"),
        ({"flexion_axis": RIGHT, "joint": "elbow", "proximal": UP}, "joint must be one of 'knee', 'hip', 'ankle', got 'elbow'"),
        ({"right": RIGHT, "proximal": RIGHT + 0.2 * UP}, "only 11° from one line"),
        ({"right": RIGHT, "proximal": UP, "keep": "anterior"}, "keep must be one of the two directions that are known"),
        ({"right": [0, 0, 0], "proximal": UP}, "right must point somewhere"),
        ({"right": [1, 2], "proximal": UP}, "right must be finite numbers of shape (3,)"),
        ({"right": "x", "proximal": UP}, "right must be numbers of shape (3,), got str"),
        ({"right": RIGHT, "proximal": [np.nan, 0, 1]}, "proximal must be finite numbers"),
        ({"right": RIGHT, "joint_centers": UP}, "joint_centers must be two"),
        ({"right": RIGHT, "joint_centers": (UP, UP)}, "one and the same point"),
        ({"right": RIGHT, "standing": UP}, "standing must be an Imu"),
        ({"right": RIGHT, "standing": standing(shaking=1.0)}, "standing is not still: 'thigh' turns with 1.7 rad/s"),
        ({"right": RIGHT, "proximal": UP, "std_deg": -1}, "std_deg must be between 0 and 180"),
        ({"q_sensor_segment": [1, 1, 0, 0]}, "q_sensor_segment must be a unit quaternion"),
        ({"q_sensor_segment": [1, 0, 0, 0], "right": RIGHT}, "q_sensor_segment says all of the frame: leave out right"),
    ],
)
def test_what_is_missing_or_too_much_is_told(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as refused:
        segment_frame("left", **given)
    assert said in str(refused.value), refused.value


def test_sides_and_frames_by_hand_are_checked() -> None:
    with pytest.raises(InputError, match="side must be 'left', 'right' or None"):
        segment_frame("L", right=RIGHT, proximal=UP)
    with pytest.raises(InputError, match="right-handed in this order"):
        SegmentFrame(FRONT, UP, -RIGHT)
    with pytest.raises(InputError, match="perpendicular unit vectors"):
        SegmentFrame(2.0 * FRONT, UP, RIGHT)
    with pytest.raises(InputError, match="covariance must be finite numbers of shape"):
        SegmentFrame(FRONT, UP, RIGHT, covariance=np.zeros(3))
    assert imufast.segment_frame(None, right=RIGHT, proximal=UP).side is None
