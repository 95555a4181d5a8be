"""Physical laws of simulated spherical joints, each checked by means that the simulator does not use itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imufast.simulate import (
    BallJointSimulation,
    BallMotion,
    Collisions,
    SoftTissue,
    random_tissue,
    simulate_ball_joint,
)
from imufast.simulate.checks import FloatArray
from laws import differ, joint_acceleration, rotation, slope
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

SEGMENTS = [f"S{k}" for k in range(1, 9)]
CASES: list[dict[str, Any]] = [
    *({"motion": name} for name in SEGMENTS[2:7]),
    {"motion": "S7", "dof": 2},
    {"motion": "random"},
    {"motion": "random", "dof": 1},
    {"motion": "random", "soft_tissue": SoftTissue()},
    {"motion": BallMotion("random", tempo=2.0, axis_tilt_rad=0.6, sway_m=0.1)},
    *({"motion": BallMotion(kind, tempo=1.5, grip_m=0.2)} for kind in ("bend_y", "clockwise")),
]


def case_name(case: dict[str, Any]) -> str:
    return "-".join(str(v) if isinstance(v, (int, str)) else type(v).__name__ for v in case.values())


def at(case: dict[str, Any], start_s: float, step_s: float, n: int, **more: Any) -> BallJointSimulation:
    return simulate_ball_joint(time_s=start_s + step_s * np.arange(n), **{"seed": 11, **case, **more})


def lever_matrix(s: BallJointSimulation) -> tuple[FloatArray, FloatArray]:
    """Eqs 10-12 in frame 1 with exact rates: the (3N, 6) matrix and (3N,) right-hand side for the stacked r1, r2."""
    zero = np.zeros_like(s.gyr1_true)
    turned = rotation(s.q_12)
    columns = [-joint_acceleration(zero, s.gyr1_true, s.gyr_rate1_true, -e) for e in np.eye(3)]
    columns += [turned.apply(joint_acceleration(zero, s.gyr2_true, s.gyr_rate2_true, -e)) for e in np.eye(3)]
    return np.stack(columns, axis=-1).reshape(-1, 6), (s.acc1_true - turned.apply(s.acc2_true)).ravel()


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_rates_are_derivatives_of_the_orientation(case: dict[str, Any]) -> None:
    step = 5e-4
    s = at(case, 5.0, step, 400)
    for q, gyr, gyr_rate in ((s.q_1, s.gyr1_true, s.gyr_rate1_true), (s.q_2, s.gyr2_true, s.gyr_rate2_true)):
        matrix = rotation(q).as_matrix()
        skew = np.swapaxes(matrix[4:-4], 1, 2) @ slope(matrix, step)
        rate = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        assert differ(rate, gyr[4:-4]) < 1e-9
        assert differ(slope(gyr, step), gyr_rate[4:-4]) < 1e-7


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_specific_force_is_the_second_derivative_of_the_position_plus_gravity(case: dict[str, Any]) -> None:
    step = 1e-3
    s = at(case, 5.0, step, 400, gravity=9.7)
    up = np.array([0.0, 0.0, 9.7])
    for q, acc, joint in ((s.q_1, s.acc1_true, s.joint_in_sensor1), (s.q_2, s.acc2_true, s.joint_in_sensor2)):
        turned = rotation(q)
        position = s.joint_position - turned.apply(joint)
        acceleration = slope(slope(position, step), step)
        assert differ(turned[8:-8].inv().apply(acceleration + up), acc[8:-8]) < 1e-6


@pytest.mark.parametrize(("kind", "start_s"), [("random", 5.0), ("clockwise", 5.0), ("clockwise", 30.0)])
def test_a_hand_that_does_not_sway_holds_its_link_still(kind: str, start_s: float) -> None:
    """A sensor where the hand grips feels nothing but gravity: on link 1, and after the rig is turned upside down on link 2."""
    motion = BallMotion(kind, grip_m=0.2, sway_m=0.0)
    grips = {"joint_in_sensor1": [0.2, 0.0, 0.0], "joint_in_sensor2": [-0.2, 0.0, 0.0]}
    mounts = {"mount1": [1.0, 0.0, 0.0, 0.0], "mount2": [1.0, 0.0, 0.0, 0.0]}
    s = at({"motion": motion}, start_s, 0.01, 400, **grips, **mounts)
    held, swung = (s.acc1_true, s.acc2_true) if start_s < 25.0 else (s.acc2_true, s.acc1_true)
    np.testing.assert_allclose(np.linalg.norm(held, axis=1), 9.81, rtol=1e-12)
    assert np.linalg.norm(swung, axis=1).std() > 0.3


def test_two_hands_hold_their_middle_still() -> None:
    motion = BallMotion("bend_y", grip_m=0.2, sway_m=0.0)
    still = {"mount1": [1.0, 0.0, 0.0, 0.0], "mount2": [1.0, 0.0, 0.0, 0.0]}
    s = at({"motion": motion}, 5.0, 0.01, 400, **still)
    hands = [s.joint_position + rotation(q).apply([along, 0.0, 0.0]) for q, along in ((s.q_1, -0.2), (s.q_2, 0.2))]
    np.testing.assert_allclose(hands[0] + hands[1], 0.0, atol=1e-12)
    assert np.ptp(s.joint_position, axis=0).max() > 0.05


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_both_sensors_agree_on_the_acceleration_of_the_joint_centre(case: dict[str, Any]) -> None:
    """Eqs 3-4, in one sensor frame and in the global one."""
    s = simulate_ball_joint(**{"seed": 5, **case})
    a1 = joint_acceleration(s.acc1_true, s.gyr1_true, s.gyr_rate1_true, s.joint_in_sensor1)
    a2 = joint_acceleration(s.acc2_true, s.gyr2_true, s.gyr_rate2_true, s.joint_in_sensor2)
    scale = np.abs(s.acc1_true).max() + np.abs(s.acc2_true).max()
    assert differ(rotation(s.q_12).apply(a2), a1) < 1e-13 * scale
    assert differ(rotation(s.q_1).apply(a1), s.joint_acc) < 1e-13 * scale


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_the_joint_turns_by_its_angles(case: dict[str, Any]) -> None:
    s = simulate_ball_joint(mount1=[1, 0, 0, 0], mount2=[1, 0, 0, 0], **case)
    expected = Rotation.from_euler("YZX", s.joint_angles_rad)
    assert differ(rotation(s.q_12_bone).as_matrix(), expected.as_matrix()) < 1e-13
    assert not s.joint_angles_rad[:, s.dof :].any()
    assert s.joint_angles_rad[:, : s.dof].any(axis=0).all()


@pytest.mark.parametrize("motion", [("S3", "S4", "S5", "S6", "S7"), "random"])
def test_least_squares_with_exact_rates_gives_the_centre(motion: Any) -> None:
    """Eq. 14 on the truth: informative motion determines all six coordinates."""
    s = simulate_ball_joint(motion, seed=2)
    matrix, right = lever_matrix(s)
    r = np.linalg.lstsq(matrix, right, rcond=None)[0]
    assert differ(np.asarray(r, dtype=np.float64), -np.concatenate([s.joint_in_sensor1, s.joint_in_sensor2])) < 1e-12
    singular = np.linalg.svd(matrix, compute_uv=False)
    assert singular[-1] > 0.1 * singular[0]


def test_one_degree_of_freedom_is_a_hinge() -> None:
    """What a hinge leaves undetermined: both centres sliding along its axis."""
    s = simulate_ball_joint("random", dof=1, seed=2)
    matrix, _ = lever_matrix(s)
    assert s.is_hinge
    assert np.abs(matrix @ np.concatenate([s.axis1, s.axis2])).max() < 1e-12 * np.abs(matrix).max()
    assert np.linalg.matrix_rank(matrix) == 5


@pytest.mark.parametrize("dof", [1, 2, 3])
def test_the_relative_rate_has_as_many_directions_as_the_joint(dof: Any) -> None:
    s = simulate_ball_joint("random", dof=dof, seed=4)
    relative = rotation(s.q_12).inv().apply(s.gyr1_true) - s.gyr2_true
    spread = np.linalg.svd(relative, compute_uv=False)
    assert (spread[:dof] > 0.3 * spread[0]).all()
    if dof == 1:
        assert (spread[1:] < 1e-12 * spread[0]).all()


def test_mounting_only_rotates_the_data() -> None:
    q1, q2 = Rotation.random(2, rng=4).as_quat(scalar_first=True)
    r1, r2 = rotation(q1), rotation(q2)
    H = random_tissue(3)
    turned_H = {
        f"tissue_matrix{i}": r.inv().as_matrix() @ H[f"tissue_matrix{i}"] @ r.as_matrix()  # type: ignore[literal-required]
        for i, r in ((1, r1), (2, r2))
    }
    aligned = simulate_ball_joint("random", mount1=[1, 0, 0, 0], mount2=[1, 0, 0, 0], **H)
    turned = simulate_ball_joint("random", mount1=q1, mount2=q2, **turned_H)
    for i, r in ((1, r1), (2, r2)):
        for name in ("gyr{}_true", "acc{}_true", "gyr_rate{}_true", "tissue_acc{}", "axis{}", "joint_in_sensor{}"):
            before, after = getattr(aligned, name.format(i)), r.apply(getattr(turned, name.format(i)))
            assert differ(after, before) < 1e-13 * max(1.0, np.abs(before).max())
    assert differ((r1 * rotation(turned.q_12) * r2.inv()).as_matrix(), rotation(aligned.q_12).as_matrix()) < 1e-13
    for name in ("joint_angles_rad", "joint_acc", "joint_position"):
        assert np.array_equal(getattr(turned, name), getattr(aligned, name))


def test_soft_tissue_turns_the_sensors_and_keeps_the_centre() -> None:
    bare, worn = simulate_ball_joint("random"), simulate_ball_joint("random", soft_tissue=SoftTissue())
    assert np.array_equal(worn.q_12_bone, bare.q_12)
    slip_deg = np.degrees((rotation(worn.q_12).inv() * rotation(worn.q_12_bone)).magnitude())
    assert 2.0 < slip_deg.max() < 25.0
    assert np.array_equal(worn.joint_in_sensor1, bare.joint_in_sensor1)


def test_equation_29_is_exact_and_touches_its_own_accelerometer_only() -> None:
    H = np.random.default_rng(1).normal(size=(3, 3))
    quiet: dict[str, Any] = {"motion": "random", "duration_s": 5.0, "acc_noise": 0.0, "clock_offset_s": 0.003}
    bare, worn = simulate_ball_joint(**quiet), simulate_ball_joint(tissue_matrix2=H, **quiet)
    expected = np.einsum("ij,nj->ni", H, worn.gyr_rate2_true)
    assert differ(worn.tissue_acc2, expected) < 1e-13 * np.abs(expected).max()
    assert np.array_equal(worn.acc2, worn.acc2_true + worn.tissue_acc2)
    assert np.array_equal(worn.tissue_matrix2, H)
    assert not worn.tissue_acc1.any()
    for name in ("acc1", "gyr1", "gyr2", "acc2_true"):
        assert np.array_equal(getattr(worn, name), getattr(bare, name))


def test_collisions_hit_the_accelerometers_where_told() -> None:
    settings = Collisions(per_s=2.0, least_m_s2=20.0, most_m_s2=50.0, most_samples=3, motions=("S6", "S7"))
    motions = ("S3", "S6", "S7")
    bare, hit = simulate_ball_joint(motions), simulate_ball_joint(motions, collisions=settings)
    for name in ("gyr1", "gyr2", "acc1_true", "acc2_true"):
        assert np.array_equal(getattr(hit, name), getattr(bare, name))
    struck: NDArray[np.bool_] = np.any(hit.collision1, axis=1)
    assert np.array_equal(struck, hit.collision2.any(axis=1))
    assert not struck[hit.motion == "S3"].any()
    assert struck[hit.motion == "S6"].any()
    assert struck[hit.motion == "S7"].any()
    for i in "12":
        change = getattr(hit, f"acc{i}") - getattr(bare, f"acc{i}")
        assert differ(change, getattr(hit, f"collision{i}")) < 1e-13 * 50.0
        size = np.linalg.norm(getattr(hit, f"collision{i}"), axis=1)
        first = struck & ~np.roll(struck, 1)
        assert (size[first] >= 20.0 - 1e-12).all()
        assert (size[first] <= 50.0 + 1e-12).all()
    assert not np.allclose(hit.collision1[struck], hit.collision2[struck])


def test_collisions_come_in_the_stated_number_length_and_direction() -> None:
    settings = Collisions(per_s=0.5, least_m_s2=30.0, most_m_s2=30.0, most_samples=1, sensors=(2,))
    s = simulate_ball_joint("stationary", duration_s=4000.0, rate_hz=20.0, collisions=settings)
    size = np.linalg.norm(s.collision2, axis=1)
    assert not s.collision1.any()
    assert np.count_nonzero(size) == pytest.approx(2000, rel=0.1)
    np.testing.assert_allclose(size[size > 0], 30.0)
    assert np.abs((s.collision2[size > 0] / 30.0).mean(axis=0)).max() < 0.05
    longer = simulate_ball_joint(
        "stationary", duration_s=4000.0, rate_hz=20.0, collisions=Collisions(per_s=0.05, most_samples=4, sensors=(2,))
    )
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], longer.collision2.any(axis=1), [0]]))))[::2]
    assert set(range(1, 5)) <= set(runs.tolist())
    assert np.mean(runs) == pytest.approx(2.5, abs=0.3)
