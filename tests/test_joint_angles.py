"""Three joint angles: laws, signs, bands, gimbal lock, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import imufast
import numpy as np
import pytest
from angle_cases import Array, frame_of, mirrored, orientation
from imufast import InputError, joint_angles, joint_angles_deg
from imufast.joint_angles import cardan
from scipy.spatial.transform import Rotation

MOUNT1, MOUNT2 = Rotation.random(2, random_state=21)
"""Take vectors of the segments' ISB frames to the sensors'."""
LEFT = frame_of(MOUNT1, "left"), frame_of(MOUNT2, "left")
RIGHT = frame_of(MOUNT1, "right"), frame_of(MOUNT2, "right")


def motion(seed: int = 0, count: int = 300) -> Rotation:
    """Segment 2 as seen from segment 1, in ISB axes: any motion of a joint."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 6.0, count)
    alpha, beta, gamma = (
        amplitude * np.sin(t * rate + phase)
        for amplitude, rate, phase in zip((1.2, 0.7, 0.9), rng.uniform(1, 3, 3), rng.uniform(0, 6, 3), strict=True)
    )
    return Rotation.from_euler("ZXY", np.stack([alpha, beta, gamma], axis=1))


def tracked(segments: Rotation, **keywords: Any) -> imufast.RelativeOrientation:
    return orientation(MOUNT1 * segments * MOUNT2.inv(), **keywords)


def one(turn: str, degrees: float) -> Rotation:
    return Rotation.from_euler("ZXY", [[degrees if axis == turn else 0.0 for axis in "ZXY"]] * 5, degrees=True)


@pytest.mark.parametrize("convention", ["ISB", "McGrath"])
@pytest.mark.parametrize("signs", ["clinical", "consistent"])
@pytest.mark.parametrize("frames", [LEFT, RIGHT])
def test_angles_and_orientations_invert_each_other(
    convention: str, signs: str, frames: tuple[imufast.SegmentFrame, imufast.SegmentFrame]
) -> None:
    segments = motion()
    found = joint_angles(tracked(segments), *frames, convention=convention, signs=signs)
    apart = (found.as_scipy().inv() * segments).magnitude()
    assert apart.max() < 1e-9
    assert found.status is imufast.AngleStatus.FOUND
    assert (found.angles_deg.shape, found.std_deg.shape) == ((300, 3), (300, 3))


def test_turning_a_sensor_on_its_segment_changes_nothing() -> None:
    on1, on2 = Rotation.random(2, random_state=5)
    covariance = np.radians(2.0) ** 2 * np.diag([1.0, 4.0, 9.0])
    here = joint_angles(tracked(motion(), covariance=covariance), *RIGHT)
    seen = on2.as_matrix() @ covariance @ on2.as_matrix().T
    rel = orientation(on1 * MOUNT1 * motion() * MOUNT2.inv() * on2.inv(), covariance=seen)
    there = joint_angles(rel, frame_of(on1 * MOUNT1, "right"), frame_of(on2 * MOUNT2, "right"))
    np.testing.assert_allclose(there.angles_deg, here.angles_deg, atol=1e-9)
    np.testing.assert_allclose(there.std_deg, here.std_deg, rtol=1e-9)


def test_mirror_images_have_the_same_clinical_angles() -> None:
    right = joint_angles(tracked(motion()), *RIGHT)
    left = joint_angles(tracked(mirrored(motion())), *LEFT)
    np.testing.assert_allclose(left.angles_deg, right.angles_deg, atol=1e-9)
    # By one hand on both sides they have not.
    other = joint_angles(tracked(mirrored(motion())), *LEFT, signs="consistent")
    same = joint_angles(tracked(motion()), *RIGHT, signs="consistent")
    np.testing.assert_allclose(other.angles_deg * [1.0, -1.0, -1.0], same.angles_deg, atol=1e-9)


def test_mirrored_recordings_from_raw_data_have_the_same_angles() -> None:
    s = imufast.simulate_hinge("mixed", duration_s=40, rate_hz=50, seed=4, gyr_noise=0.001, acc_noise=0.01)
    flip = np.array([1.0, 1.0, -1.0])

    # Specific force is mirrored as vectors are, a rate as turns are.
    images = [imufast.Imu(-imu.gyr * flip, imu.acc * flip, rate_hz=50.0, name=imu.name) for imu in (s.imu1, s.imu2)]
    found = []
    for side, (imu1, imu2), mirror in (("right", (s.imu1, s.imu2), np.ones(3)), ("left", images, flip)):
        calibration = imufast.calibrate_joint(imu1, imu2)
        # A knee flexes by the right hand about the axis to the left, which a mirror turns round like any axis of a turn.
        true = [-(mirror * axis) if side == "left" else axis for axis in (s.axis1, s.axis2)]
        axis = calibration.axis.oriented(towards1=true[0])  # type: ignore[union-attr]
        long = np.cross(s.axis1, [0.3, 0.5, 0.2]), np.cross(s.axis2, [0.1, 0.2, 0.9])
        frame1, frame2 = (
            imufast.segment_frame(side, flexion_axis=axis, sensor=sensor, joint="knee", proximal=mirror * long[sensor - 1])
            for sensor in (1, 2)
        )
        found.append(joint_angles_deg(imufast.track(imu1, imu2, calibration), frame1, frame2))
    # Both recordings are searched on their own: the answers agree as far as the search converges.
    np.testing.assert_allclose(found[0], found[1], atol=0.1)


# The table of docs/joint-angles.md: a turn of the distal segment by the right hand about an axis of ISB, 10 degrees.
SIGNS = [
    ("knee", "right", "Z", (-10, 0, 0)),
    ("knee", "left", "Z", (-10, 0, 0)),
    ("hip", "right", "Z", (10, 0, 0)),
    ("ankle", "left", "Z", (10, 0, 0)),
    ("knee", "right", "X", (0, 10, 0)),
    ("hip", "left", "X", (0, -10, 0)),
    ("knee", "right", "Y", (0, 0, 10)),
    ("ankle", "left", "Y", (0, 0, -10)),
]


@pytest.mark.parametrize(("joint", "side", "turn", "clinical"), SIGNS)
def test_signs_are_those_of_the_table(joint: str, side: str, turn: str, clinical: tuple[float, ...]) -> None:
    frames = frame_of(MOUNT1, side, joint), frame_of(MOUNT2, side, joint)
    rel = tracked(one(turn, 10.0))
    found = joint_angles(rel, *frames)
    np.testing.assert_allclose(found.angles_deg, np.tile(np.array(clinical), (5, 1)), atol=1e-9)
    assert (found.side, found.joint, found.signs) == (side, joint, "clinical")
    consistent = np.tile(np.array({"Z": (clinical[0], 0, 0), "X": (0, -10, 0), "Y": (0, 0, 10)}[turn]), (5, 1))
    np.testing.assert_allclose(joint_angles_deg(rel, *frames, signs="consistent"), consistent, atol=1e-9)
    raw = np.tile(np.array({"Z": (10, 0, 0), "X": (0, 10, 0), "Y": (0, 0, 10)}[turn]), (5, 1))
    np.testing.assert_allclose(joint_angles_deg(rel, *frames, convention="McGrath"), raw, atol=1e-9)


def test_signs_mean_what_the_body_does() -> None:
    # A right leg, standing: X to the front, Y up, Z to the right. Where the foot goes when the knee flexes: back; when the
    # hip adducts: to the left; when the ankle turns inwards, toes go left.
    def distal(joint: str, angles: tuple[float, float, float], v: tuple[float, float, float]) -> Array:
        raw = np.array(angles) * {"knee": [-1, 1, 1], "hip": [1, 1, 1], "ankle": [1, 1, 1]}[joint]
        segments = Rotation.from_euler("ZXY", [raw], degrees=True)
        frames = frame_of(MOUNT1, "right", joint), frame_of(MOUNT2, "right", joint)
        np.testing.assert_allclose(joint_angles_deg(tracked(segments), *frames), np.array([angles]), atol=1e-9)
        return np.asarray(segments.apply(v)[0])

    down, ahead = (0.0, -1.0, 0.0), (1.0, 0.0, 0.0)
    assert distal("knee", (60, 0, 0), down)[0] < -0.5
    assert distal("hip", (60, 0, 0), down)[0] > 0.5
    assert distal("hip", (0, 30, 0), down)[2] < -0.3
    assert distal("ankle", (20, 0, 0), ahead)[1] > 0.3
    assert distal("ankle", (0, 0, 20), ahead)[2] < -0.3


def test_the_angles_are_those_of_grood_and_suntay() -> None:
    # Their own construction: angles between axes of both segments, the floating axis e2 = e3 × e1 between them.
    segments = motion(3)
    r = segments.as_matrix()
    e1, e3 = np.array([0.0, 0.0, 1.0]), r[:, :, 1]
    e2 = np.cross(e3, e1)
    e2 /= np.linalg.norm(e2, axis=1, keepdims=True)
    # e2 points to the front where both segments are parallel; flexion is its turn about e1 from the front of segment 1.
    alpha = np.arctan2(e2[:, 1], e2[:, 0])
    beta = np.pi / 2.0 - np.arccos(np.clip(e3 @ e1, -1.0, 1.0))
    gamma = np.arctan2(np.einsum("ni,ni->n", e2, r[:, :, 2]), np.einsum("ni,ni->n", e2, r[:, :, 0]))
    expected = np.degrees(np.stack([-np.unwrap(alpha), beta, np.unwrap(gamma)], axis=1))
    np.testing.assert_allclose(joint_angles_deg(tracked(segments), *RIGHT), expected, atol=1e-9)


def test_a_hinge_about_the_right_has_flexion_alone() -> None:
    turn = np.radians(np.linspace(0.0, 60.0, 50))
    rel = tracked(Rotation.from_euler("Z", -turn[:, None]))
    found = joint_angles(rel, *LEFT)
    np.testing.assert_allclose(found["flexion"], np.degrees(turn), atol=1e-9)
    np.testing.assert_allclose(found.angles_deg[:, 1:], 0.0, atol=1e-9)
    axis = imufast.JointAxis(-LEFT[0].right, -LEFT[1].right)
    np.testing.assert_allclose(found["flexion"], imufast.hinge_angle_deg(rel, axis, zero=LEFT), atol=1e-9)


def test_the_gradient_is_the_finite_difference() -> None:
    segments = motion(7)
    _, gradient = cardan(segments.as_matrix())
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        up, down = (cardan((segments * Rotation.from_rotvec(sign * step)).as_matrix())[0] for sign in (1.0, -1.0))
        np.testing.assert_allclose((up - down) / 2e-6, gradient[:, :, k], rtol=1e-5, atol=1e-6)


def test_the_band_is_the_spread_of_what_errs() -> None:
    rng = np.random.default_rng(8)
    std1, std2, std = np.radians([3.0, 1.0, 2.0]), np.radians([1.0, 2.0, 4.0]), np.radians([2.0, 1.0, 1.5])
    segments = motion(1, 20)
    frames = frame_of(MOUNT1, "right", "knee", np.diag(std1**2)), frame_of(MOUNT2, "right", "knee", np.diag(std2**2))
    found = joint_angles(tracked(segments, covariance=np.diag(std**2)), *frames)
    draws = []
    for _ in range(1200):
        off1, off2, off = (Rotation.from_rotvec(s * rng.standard_normal(3)) for s in (std1, std2, std))
        rel = orientation(MOUNT1 * segments * MOUNT2.inv() * off)
        draws.append(joint_angles_deg(rel, frame_of(MOUNT1 * off1, "right"), frame_of(MOUNT2 * off2, "right")))
    # 1200 draws tell a standard deviation to 2 %; errors of 4 degrees are not quite small.
    np.testing.assert_allclose(np.std(draws, axis=0), found.std_deg, rtol=0.09)


def test_soft_tissue_is_what_leaves_the_hinge_axis_or_as_told() -> None:
    turn = np.radians(30.0 + 30.0 * np.sin(np.linspace(0.0, 20.0, 400)))
    rng = np.random.default_rng(0)
    slide = np.radians(rng.normal(0.0, 5.0, 400))
    segments = Rotation.from_euler("Z", -turn[:, None]) * Rotation.from_euler("Y", slide[:, None])
    axis = imufast.JointAxis(-RIGHT[0].right, -RIGHT[1].right)
    rel = tracked(segments, calibration=imufast.JointCalibration(axis=axis))
    found = joint_angles(rel, *RIGHT)
    assert found.parts.soft_tissue == pytest.approx([0.0, 0.0, 5.0], abs=0.4)
    assert found.off_axis_deg == pytest.approx(5.0, rel=0.1)
    np.testing.assert_allclose(joint_angles(rel, *RIGHT, soft_tissue_std_deg=2.0).parts.soft_tissue, 2.0, rtol=0.2)
    none = joint_angles(tracked(segments), *RIGHT)
    assert not none.parts.soft_tissue.any()
    assert "no hinge axis" in none.why[0]
    assert not joint_angles(tracked(segments), *RIGHT, soft_tissue_std_deg=0.0).why


def test_gimbal_lock_is_flagged_and_nothing_is_nan() -> None:
    beta = np.radians([0.0, 70.0, 79.0, 81.0, 89.999, 90.0, -90.0, -85.0])
    segments = Rotation.from_euler("ZXY", np.stack([0.3 + 0.0 * beta, beta, 0.2 + 0.0 * beta], axis=1))
    found = joint_angles(tracked(segments, covariance=np.radians(1.0) ** 2 * np.eye(3)), *RIGHT)
    np.testing.assert_array_equal(found.gimbal_lock, [False, False, False, True, True, True, True, True])
    assert np.isfinite(found.angles_deg).all()
    assert np.isfinite(found.std_deg).all()
    assert (found.std_deg <= 180.0).all()
    assert found.std_deg[5, 0] == 180.0
    assert found.status is imufast.AngleStatus.GIMBAL_LOCK
    assert "gimbal lock" in found.why[-1]
    # Still an orientation.
    assert (found.as_scipy().inv() * segments).magnitude().max() < 1e-6


def test_names_are_those_of_the_joint() -> None:
    rel = tracked(motion())
    ankle = joint_angles(rel, frame_of(MOUNT1, "left", None), frame_of(MOUNT2, "left", None), joint="ankle")
    assert ankle.names == ("dorsiflexion", "inversion", "internal_rotation")
    assert joint_angles(rel, *LEFT, convention="McGrath").names == ("rotation_x", "rotation_y", "rotation_z")
    np.testing.assert_array_equal(joint_angles_deg(rel, *LEFT), joint_angles(rel, *LEFT).angles_deg)


def test_a_side_may_come_from_one_frame_and_none_is_needed_by_one_hand() -> None:
    rel = tracked(motion())
    trunk, thigh = frame_of(MOUNT1, None, None), frame_of(MOUNT2, "left", "hip")
    assert joint_angles(rel, trunk, thigh).side == "left"
    nobody = frame_of(MOUNT1, None, None), frame_of(MOUNT2, None, None)
    assert joint_angles(rel, *nobody, joint="hip", signs="consistent").side is None
    assert joint_angles(rel, *nobody, convention="McGrath").joint is None


def test_wrong_input_is_refused_by_name() -> None:
    rel = tracked(motion())
    nobody = frame_of(MOUNT1, None, None), frame_of(MOUNT2, None, None)
    cases: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: joint_angles(rel, LEFT[0], RIGHT[1]), "side: 'left' and 'right' contradict each other"),
        (lambda: joint_angles(rel, *LEFT, joint="hip"), "joint: 'hip' and 'knee' contradict each other"),
        (lambda: joint_angles(rel, *nobody), "joint is not told, so which way is flexion is not known: give joint"),
        (lambda: joint_angles(rel, *nobody, joint="hip"), "side is not told, so which way is adduction is not known"),
        (lambda: joint_angles(rel, *LEFT, joint="elbow"), "joint must be one of"),
        (lambda: joint_angles(rel, *LEFT, convention="isb"), "convention must be one of 'ISB', 'McGrath'"),
        (lambda: joint_angles(rel, *LEFT, signs="mine"), "signs must be one of 'clinical', 'consistent'"),
        (lambda: joint_angles(rel, LEFT[0], np.eye(3)), "frame2 must be a SegmentFrame"),  # type: ignore[arg-type]
        (lambda: joint_angles(np.eye(3), *LEFT), "rel must be a RelativeOrientation"),  # type: ignore[arg-type]
        (lambda: joint_angles(rel, *LEFT, soft_tissue_std_deg=-1.0), "soft_tissue_std_deg must be a number"),
    )
    for call, said in cases:
        with pytest.raises(InputError) as refused:
            call()
        assert said in str(refused.value), refused.value


def test_an_angle_that_is_hardly_known_is_told() -> None:
    covariance = np.radians(30.0) ** 2 * np.outer(RIGHT[1].proximal, RIGHT[1].proximal)
    segments = Rotation.from_euler("ZXY", np.zeros((20, 3)))
    found = joint_angles(tracked(segments, covariance=covariance), *RIGHT, soft_tissue_std_deg=0.0)
    assert found.std_deg[0] == pytest.approx([0.0, 0.0, 30.0], abs=1e-6)
    assert found.why == ("less certain than 20° most of the time: internal rotation",)


def test_a_tilted_functional_axis_widens_the_angles_that_rest_on_it() -> None:
    turn = np.radians(30.0 + 30.0 * np.sin(np.linspace(0.0, 20.0, 400)))
    slide = np.radians(np.random.default_rng(0).normal(0.0, 5.0, 400))
    segments = Rotation.from_euler("Z", -turn[:, None]) * Rotation.from_euler("Y", slide[:, None])
    axis = imufast.JointAxis(-RIGHT[0].right, -RIGHT[1].right)
    rel = tracked(segments, calibration=imufast.JointCalibration(axis=axis))
    functional = [
        imufast.segment_frame("right", flexion_axis=axis, sensor=k, joint="knee", proximal=frame.proximal)
        for k, frame in enumerate(RIGHT, 1)
    ]
    found = joint_angles(rel, functional[0], functional[1])
    # 5 degrees off the axis in one of two directions, over 21 degrees of flexion, all of it on each segment.
    tilt = np.degrees(np.sqrt(0.5 * (5.0 / float(np.degrees(turn).std())) ** 2))
    assert functional[0].by_axis is not None
    straight = int(turn.argmin())
    assert found.parts.axis[0] == pytest.approx(0.0, abs=0.5)
    assert found.std_deg[straight, 2] == pytest.approx(np.sqrt(2.0 * tilt**2 + 5.0**2), rel=0.05)
    # Frames that were given otherwise do not rest on it.
    assert not joint_angles(rel, *RIGHT).parts.axis.any()


def test_a_lost_orientation_is_told() -> None:
    lost = replace(tracked(motion()), status=imufast.TrackStatus.NOT_OBSERVABLE)
    assert joint_angles(lost, *LEFT).status is imufast.AngleStatus.NOT_OBSERVABLE
