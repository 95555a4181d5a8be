"""The angle of a hinge: laws, zeros, signs, its band, and what is refused."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import replace

import imufast
import numpy as np
import pytest
from angle_cases import Array, hinge, orientation
from imufast import InputError, JointAxis, hinge_angle, hinge_angle_deg
from imufast.frames import axis_covariance
from imufast.hinge_angle import flexion_axis, hinge_turn
from imufast.quaternion import from_matrix, matrix, shortest_turn
from scipy.spatial.transform import Rotation

TURN = np.radians(5.0 + 60.0 * np.sin(np.linspace(0.0, 12.0, 400)) ** 4)
LEANING = Rotation.from_rotvec(0.05 * np.random.default_rng(3).standard_normal((400, 3)))


@pytest.mark.parametrize("seed", range(4))
def test_a_perfect_hinge_gives_its_angle_whatever_the_mounting(seed: int) -> None:
    rotations, axis = hinge(TURN, seed)
    found = hinge_angle(orientation(rotations), axis)
    np.testing.assert_allclose(found.angles_deg[:, 0], np.degrees(TURN - TURN.mean()), atol=1e-9)
    assert (found.status, found.names, found.zero) == (imufast.AngleStatus.FOUND, ("hinge_angle",), "mean of the recording")
    assert found.off_axis_deg == pytest.approx(0.0, abs=1e-6)


def test_many_turns_are_unwrapped() -> None:
    turn = np.linspace(0.0, 30.0, 500)
    rotations, axis = hinge(turn)
    np.testing.assert_allclose(hinge_angle_deg(orientation(rotations), axis, zero=(0.0, 0.0)), np.degrees(turn), atol=1e-9)


@pytest.mark.parametrize("zero", ["mean", "interval", "pose", "frames"])
def test_turning_a_sensor_on_its_segment_changes_nothing(zero: str) -> None:
    rotations, axis = hinge(TURN)
    rotations = rotations * LEANING
    on1, on2 = Rotation.random(2, random_state=9)
    turned = JointAxis(on1.apply(np.array(axis.axis1)), on2.apply(np.array(axis.axis2)))
    frames = [
        imufast.segment_frame("left", flexion_axis=a, joint="knee", anterior=b)
        for a, b in ((axis.axis1, (1, 2, 3)), (axis.axis2, (2, 1, 0)))
    ]
    moved = []
    for on, f in zip((on1, on2), frames, strict=True):
        front, up, right = (on.apply(np.array(v)) for v in (f.anterior, f.proximal, f.right))
        moved.append(imufast.SegmentFrame(front, up, right, f.side, f.joint))
    pose = rotations[17]
    zeros = {
        "mean": ("mean", "mean"),
        "interval": ((0.5, 1.0), (0.5, 1.0)),
        "pose": (pose.as_quat()[[3, 0, 1, 2]], (on1 * pose * on2.inv()).as_quat()[[3, 0, 1, 2]]),
        "frames": (tuple(frames), tuple(moved)),
    }[zero]
    here = hinge_angle(orientation(rotations), axis, zero=zeros[0])
    there = hinge_angle(orientation(on1 * rotations * on2.inv()), turned, zero=zeros[1])
    np.testing.assert_allclose(there.angles_deg, here.angles_deg, atol=1e-9)
    np.testing.assert_allclose(there.std_deg, here.std_deg, atol=1e-6)


def test_the_integral_of_the_relative_rate_is_the_angle() -> None:
    s = imufast.simulate_hinge("mixed", duration_s=20, rate_hz=200, gyr_noise=0.0)
    rel = orientation(Rotation.from_quat(s.q_12[:, [1, 2, 3, 0]]), rate=200.0)
    axis = JointAxis(s.axis1, s.axis2)
    rate = s.gyr2_true @ s.axis2 - s.gyr1_true @ s.axis1
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) / 200.0)])
    # The trapezium rule at 200 Hz is good to about 0.01 degrees.
    np.testing.assert_allclose(hinge_angle_deg(rel, axis, zero=(0.0, 0.0)), np.degrees(summed), atol=0.05)
    np.testing.assert_allclose(hinge_angle_deg(rel, axis), np.degrees(s.angle_rad - s.angle_rad.mean()), atol=1e-6)


def test_the_gradient_is_the_finite_difference() -> None:
    rotations, axis = hinge(TURN)
    rotations = rotations * Rotation.from_rotvec(0.5 * np.random.default_rng(1).standard_normal((400, 3)))
    q = rotations.as_quat()[:, [3, 0, 1, 2]]
    _, gradient, _ = hinge_turn(q, axis.axis1, axis.axis2)
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        up, down = (
            hinge_turn((rotations * Rotation.from_rotvec(sign * step)).as_quat()[:, [3, 0, 1, 2]], axis.axis1, axis.axis2)[0]
            for sign in (1.0, -1.0)
        )
        change = (up - down + np.pi) % (2.0 * np.pi) - np.pi
        np.testing.assert_allclose(change / 2e-6, gradient[:, k], rtol=1e-5, atol=1e-6)


def test_zero_is_where_it_was_said_to_be() -> None:
    rotations, axis = hinge(TURN)
    rel = orientation(rotations)
    interval = (rel.time_s >= 1.0) & (rel.time_s <= 1.5)
    found = hinge_angle(rel, axis, zero=(1.0, 1.5), zero_deg=5.0)
    assert found.angles_deg[interval].mean() == pytest.approx(5.0)
    assert found.zero == "mean of 1 to 1.5 s after the start, set to 5 degrees"
    posed = hinge_angle_deg(rel, axis, zero=rel.q_12[7])
    assert posed[7] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(posed, hinge_angle_deg(rel, axis, zero=-rel.q_12[7]), atol=1e-9)
    # Also where the recording has turned full circles since.
    on, axis = hinge(TURN + 4.0 * np.pi)
    assert np.abs(hinge_angle_deg(orientation(on), axis, zero=rel.q_12[7])).max() < 180.0


def test_zero_by_definition_is_where_the_segments_are_parallel() -> None:
    mount1, mount2 = Rotation.random(2, random_state=4)
    rotations = mount1 * Rotation.from_rotvec(-TURN[:, None] * [0.0, 0.0, 1.0]) * mount2.inv()
    frames = [
        imufast.segment_frame("right", flexion_axis=-m.apply([0, 0, 1]), joint="knee", proximal=m.apply([0, 1, 0]))
        for m in (mount1, mount2)
    ]
    axis = JointAxis(-mount1.apply([0, 0, 1]), -mount2.apply([0, 0, 1]))
    np.testing.assert_allclose(hinge_angle_deg(orientation(rotations), axis, zero=tuple(frames)), np.degrees(TURN), atol=1e-9)


def test_flexion_is_positive_the_way_it_was_told() -> None:
    rotations, axis = hinge(TURN)
    rel = orientation(rotations)
    for given in (axis, axis.flipped()):
        found = hinge_angle(rel, given, zero=(0.0, 0.0), flexion="excursion")
        np.testing.assert_allclose(found["flexion"], np.degrees(TURN - TURN[0]), atol=1e-9)
        assert (found.names, found.signs) == (("flexion",), "flexion")
        rising = (rel.time_s[0], rel.time_s[40])
        np.testing.assert_allclose(
            hinge_angle(rel, given, flexion=rising)["flexion"], np.degrees(TURN - TURN.mean()), atol=1e-9
        )
        np.testing.assert_array_equal(flexion_axis(rel, given, flexion=rising).axis1, axis.axis1)
    assert hinge_angle(rel, axis.flipped(), flexion="axis")["flexion"] == pytest.approx(np.degrees(TURN.mean() - TURN))
    assert "which way is flexion was not told" in hinge_angle(rel, axis).why[-1]
    assert not hinge_angle(rel, axis, flexion="axis").why


def test_the_band_is_that_of_the_orientation_about_the_axis() -> None:
    rotations, axis = hinge(TURN)
    along, across = np.outer(axis.axis2, axis.axis2), np.eye(3) - np.outer(axis.axis2, axis.axis2)
    rel = orientation(rotations, covariance=np.radians(2.0) ** 2 * along + np.radians(7.0) ** 2 * across)
    found = hinge_angle(rel, axis, zero_std_deg=1.5)
    np.testing.assert_allclose(found.std_deg, np.hypot(2.0, 1.5), rtol=1e-6)
    assert found.parts.orientation == pytest.approx(2.0)
    assert found.parts.zero == pytest.approx(1.5)
    # An interval adds what its own samples err.
    np.testing.assert_allclose(hinge_angle(rel, axis, zero=(0.0, 1.0)).std_deg, np.hypot(2.0, 2.0), rtol=1e-6)
    # A filter that tells the size of its error alone may have all of it about the axis.
    alone = replace(rel, covariance=None)
    np.testing.assert_allclose(hinge_angle(alone, axis).std_deg[:, 0], rel.angle_std_deg)


def test_an_uncertain_axis_widens_the_band_as_much_as_it_moves_the_angle() -> None:
    rotations, axis = hinge(TURN)
    rotations = rotations * LEANING
    rel = orientation(rotations)
    sigma = np.radians(4.0)
    tangent = np.zeros((6, 6))
    for block, vector in ((slice(0, 3), axis.axis1), (slice(3, 6), axis.axis2)):
        tangent[block, block] = sigma**2 * (np.eye(3) - np.outer(vector, vector))
    stated = JointAxis(axis.axis1, axis.axis2, tangent, np.degrees(np.array([2.448, 2.448]) * sigma))
    rng = np.random.default_rng(5)
    draws = []
    for _ in range(400):
        moved = axis.axis1 + sigma * rng.standard_normal(3), axis.axis2 + sigma * rng.standard_normal(3)
        other = JointAxis(*(v / np.linalg.norm(v) for v in moved))
        draws.append(hinge_angle_deg(rel, other, zero=(0.0, 0.5)))
    spread = float(np.sqrt(np.var(draws, axis=0).mean()))
    told = hinge_angle(rel, stated, zero=(0.0, 0.5), soft_tissue_std_deg=0.0)
    # First order beside draws of 4 degrees, whose second order is a tenth of that.
    assert float(np.sqrt((told.std_deg**2).mean())) == pytest.approx(spread, rel=0.35)
    # Errors of the axis change the zero, too: there they cannot be seen.
    assert told.parts.axis > 0.0
    pose = hinge_angle(rel, stated, zero=rel.q_12[50], soft_tissue_std_deg=0.0)
    assert pose.std_deg[50] == pytest.approx(0.0, abs=1e-9)


def test_the_covariance_of_an_axis_is_scaled_to_its_stated_bound() -> None:
    _, axis = hinge(TURN)
    across = np.eye(3) - np.outer(axis.axis1, axis.axis1)
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = 1e-6 * across
    stated = axis_covariance(JointAxis(axis.axis1, axis.axis2, covariance, np.array([10.0, 5.0])))
    for block, bound in ((slice(0, 3), 10.0), (slice(3, 6), 5.0)):
        std = np.degrees(np.sqrt(np.trace(stated[block, block]) / 2.0))
        assert std == pytest.approx(bound / 2.5, rel=0.05)
    unknown = JointAxis(axis.axis1, axis.axis2, np.full((6, 6), np.inf), np.array([180.0, 180.0]))
    assert np.isfinite(axis_covariance(unknown)).all()
    assert not axis_covariance(axis).any()


def test_what_leaves_the_axis_widens_the_band() -> None:
    rotations, axis = hinge(TURN)
    rng = np.random.default_rng(0)
    side = np.cross(axis.axis2, [1.0, 0.3, 0.2])
    side /= np.linalg.norm(side)
    other = np.cross(axis.axis2, side)
    slides = np.radians(rng.normal(0.0, [6.0, 2.0], (400, 2)))
    rel = orientation(rotations * Rotation.from_rotvec(slides[:, :1] * side + slides[:, 1:] * other))
    found = hinge_angle(rel, axis)
    # The quieter of both directions: 2 degrees.
    assert found.parts.soft_tissue == pytest.approx(2.0, rel=0.1)
    assert found.off_axis_deg == pytest.approx(np.hypot(6.0, 2.0), rel=0.1)
    assert hinge_angle(rel, axis, soft_tissue_std_deg=0.0).parts.soft_tissue == 0.0
    assert hinge_angle(rel, axis, soft_tissue_std_deg=9.0).parts.soft_tissue == pytest.approx(9.0)
    # What the orientation's own errors explain is no soft tissue.
    unsure = orientation(rotations * Rotation.from_rotvec(slides[:, :1] * side), covariance=np.radians(10.0) ** 2 * np.eye(3))
    assert hinge_angle(unsure, axis).parts.soft_tissue == pytest.approx(0.0, abs=1e-9)


def test_a_joint_that_is_no_hinge_is_told() -> None:
    rng = np.random.default_rng(2)
    rotations, axis = hinge(TURN)
    rel = orientation(rotations * Rotation.from_rotvec(np.cumsum(0.06 * rng.standard_normal((400, 3)), axis=0)))
    found = hinge_angle(rel, axis)
    assert found.status is imufast.AngleStatus.NOT_A_HINGE
    assert "off its axis" in found.why[0]


def test_what_the_orientation_does_not_know_no_angle_knows() -> None:
    rotations, axis = hinge(TURN)
    lost = replace(
        orientation(rotations),
        status=imufast.TrackStatus.NOT_OBSERVABLE,
        angle_std_deg=np.full(400, 150.0),
        covariance=None,
        why=("still",),
    )
    found = hinge_angle(lost, axis)
    assert found.status is imufast.AngleStatus.NOT_OBSERVABLE
    assert found.why[0] == "still"
    assert (found.std_deg >= 149.0).all()
    q = orientation(rotations).q_12.copy()
    q[100:150] = np.nan
    broken = hinge_angle(replace(orientation(rotations), q_12=q), axis)
    assert broken.status is imufast.AngleStatus.UNCERTAIN
    assert np.isfinite(broken.angles_deg).all()
    assert (broken.std_deg[100:150] == 180.0).all()
    stalled = replace(orientation(rotations), status=imufast.TrackStatus.STALLED)
    assert hinge_angle(stalled, axis).status is imufast.AngleStatus.UNCERTAIN


def test_gaps_are_times_that_are_not_there() -> None:
    rotations, axis = hinge(TURN)
    whole = orientation(rotations)
    keep = (whole.time_s < 1.0) | (whole.time_s > 2.0)
    some = replace(
        whole, time_s=whole.time_s[keep], q_12=whole.q_12[keep], angle_std_deg=whole.angle_std_deg[keep], covariance=None
    )
    np.testing.assert_allclose(
        hinge_angle_deg(some, axis, zero=(0.0, 0.5)), hinge_angle_deg(whole, axis, zero=(0.0, 0.5))[keep], atol=1e-9
    )


def test_results_cannot_be_changed_and_survive_pickling() -> None:
    rotations, axis = hinge(TURN)
    found = hinge_angle(orientation(rotations), axis)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.angles_deg, found.angles_deg)
    assert len(again) == 400
    for array in (found.angles_deg, found.std_deg, found.gimbal_lock):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        found.status = imufast.AngleStatus.UNCERTAIN  # type: ignore[misc]
    with pytest.raises(InputError, match="there is no angle 'flexion'; there are 'hinge_angle'"):
        found["flexion"]
    with pytest.raises(InputError, match="alone is no orientation"):
        found.as_scipy()


def test_wrong_input_is_refused_by_name() -> None:
    rotations, axis = hinge(TURN)
    rel = orientation(rotations)
    long = JointAxis(2.0 * axis.axis1, axis.axis2)
    still = orientation(Rotation.concatenate([rotations[0]] * 50))
    even, even_axis = hinge(np.sin(np.linspace(0.0, 50.0, 400)))
    cases: tuple[tuple[Callable[[], object], str], ...] = (
        (lambda: hinge_angle(rel.q_12, axis), "rel must be a RelativeOrientation"),  # type: ignore[arg-type]
        (lambda: hinge_angle(rel, None), "axis is None: there was no calibration"),  # type: ignore[arg-type]
        (lambda: hinge_angle(rel, axis.axis1), "axis must be a JointAxis"),  # type: ignore[arg-type]
        (lambda: hinge_angle(rel, long), "axis.axis1 must be a unit vector"),
        (lambda: hinge_angle(rel, axis, zero="standing"), "zero must be 'mean'"),
        (lambda: hinge_angle(rel, axis, zero=(50.0, 60.0)), "zero: there is no sample from 50 to 60 s"),
        (lambda: hinge_angle(rel, axis, zero=(1.0, 2.0, 3.0)), "zero must be 'mean'"),
        (lambda: hinge_angle(rel, axis, zero=(1.0, np.nan)), "zero must be 'mean'"),
        (lambda: hinge_angle(rel, axis, zero=(1.0, 2.0, 3.0, 4.0)), "unit quaternion"),
        (lambda: hinge_angle(rel, axis, zero=object()), "zero must be 'mean'"),  # type: ignore[arg-type]
        (lambda: hinge_angle(rel, axis, zero_deg="5"), "zero_deg must be a number"),  # type: ignore[arg-type]
        (lambda: hinge_angle(rel, axis, zero_std_deg=-1.0), "zero_std_deg must be a number"),
        (lambda: hinge_angle(rel, axis, soft_tissue_std_deg=np.nan), "soft_tissue_std_deg must be a number"),
        (lambda: hinge_angle(rel, axis, flexion="up"), "flexion must be None, 'axis'"),
        (lambda: hinge_angle(rel, axis, flexion=(9.0, 10.0)), "flexion: there is no sample"),
        (lambda: hinge_angle(still, axis, flexion=(0.0, 1.0)), "which tells no sign"),
        (lambda: hinge_angle(still, axis, flexion="excursion"), "does not tell the sign"),
        (lambda: hinge_angle(orientation(even), even_axis, flexion="excursion"), "does not tell the sign"),
    )
    for call, said in cases:
        with pytest.raises(InputError, match=said.replace("(", r"\(")):
            call()


def test_matrices_and_quaternions_agree_with_scipy() -> None:
    rotations = Rotation.random(50, random_state=1)
    q = rotations.as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(matrix(q), rotations.as_matrix(), atol=1e-12)
    half_turns = [Rotation.from_rotvec(np.pi * v) for v in (np.eye(3)[0], np.eye(3)[1], np.eye(3)[2])]
    every = np.stack([one.as_matrix() for one in [*rotations, *half_turns, Rotation.identity()]])
    np.testing.assert_allclose(matrix(from_matrix(every)), every, atol=1e-12)
    assert (from_matrix(every)[:, 0] >= 0.0).all()
    for one in (*rotations, *half_turns):
        np.testing.assert_allclose(matrix(from_matrix(one.as_matrix())), one.as_matrix(), atol=1e-12)
    a: Array = np.array([0.6, 0.8, 0.0])
    for b in (a, -a, np.array([0.0, 0.0, 1.0]), -a + [0.0, 0.0, 1e-7]):
        unit = b / np.linalg.norm(b)
        np.testing.assert_allclose(matrix(shortest_turn(unit, a)) @ unit, a, atol=1e-6)
