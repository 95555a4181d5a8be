"""Physical laws that every simulated recording obeys, each checked by means that the simulator does not use itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imufast.simulate import HingeSimulation, SoftTissue, simulate_hinge
from imufast.simulate.checks import FloatArray
from laws import differ, joint_acceleration, rotation, slope
from scipy.spatial.transform import Rotation

MOTIONS: list[int | str] = [*range(1, 15), "mixed", "walking", "sit_to_stand"]
CASES: list[dict[str, Any]] = [
    {"motion": 7},
    {"motion": 14},
    {"motion": 10, "duration_s": 10.0},
    {"motion": "mixed"},
    {"motion": "walking"},
    {"motion": "sit_to_stand"},
    {"motion": "walking", "soft_tissue": SoftTissue()},
    {"motion": 14, "soft_tissue": SoftTissue(segment2=1.0)},
    {"motion": "walking", "soft_tissue": SoftTissue(tilt_rad=0.05)},
    {"motion": 7, "dof": 2},
    {"motion": "mixed", "dof": 3, "soft_tissue": SoftTissue()},
]


def case_name(case: dict[str, Any]) -> str:
    return "-".join(str(v) if isinstance(v, (int, str, float)) else "tissue" for v in case.values())


def at(case: dict[str, Any], start_s: float, step_s: float, n: int, **more: Any) -> HingeSimulation:
    return simulate_hinge(time_s=start_s + step_s * np.arange(n), **{"seed": 11, **case, **more})


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_integrated_rates_give_the_orientation(case: dict[str, Any]) -> None:
    """A fourth-order Magnus integrator (two Gauss nodes a step) converges to the stated orientation at its order."""
    start_s, duration_s = 4.0, 5.0
    ends = at(case, start_s, duration_s, 2)

    def errors(rate_hz: float) -> FloatArray:
        step = 1.0 / rate_hz
        middle = start_s + step * (np.arange(round(duration_s * rate_hz)) + 0.5)
        instants = np.stack([middle - step * np.sqrt(3) / 6, middle + step * np.sqrt(3) / 6], axis=1).ravel()
        s = simulate_hinge(time_s=instants, seed=11, **case)
        found = []
        for gyr, q in ((s.gyr1_true, ends.q_1), (s.gyr2_true, ends.q_2)):
            a, b = gyr[0::2], gyr[1::2]
            turns = Rotation.from_rotvec(0.5 * step * (a + b) + np.sqrt(3) / 12 * step**2 * np.cross(a, b))
            while len(turns) > 1:  # the product of all, pair by pair
                odd = turns[-1:] if len(turns) % 2 else Rotation.identity(0)
                turns = Rotation.concatenate([turns[: len(turns) - len(odd) : 2] * turns[1 : len(turns) : 2], odd])
            found.append((rotation(q[0]) * turns[0] * rotation(q[1]).inv()).magnitude())
        return np.array(found)

    coarse, fine = errors(200.0), errors(800.0)
    assert (fine < 1e-8).all()
    assert (fine < np.maximum(coarse / 64.0, 1e-13)).all()


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


@pytest.mark.parametrize("case", CASES, ids=case_name)
def test_both_sensors_agree_on_the_acceleration_of_the_joint_centre(case: dict[str, Any]) -> None:
    """Eqs 4-7, with the matrix K written out."""
    s = simulate_hinge(seed=5, **case)
    a1 = joint_acceleration(s.acc1_true, s.gyr1_true, s.gyr_rate1_true, s.joint_in_sensor1)
    a2 = joint_acceleration(s.acc2_true, s.gyr2_true, s.gyr_rate2_true, s.joint_in_sensor2)
    scale = np.abs(s.acc1_true).max() + np.abs(s.acc2_true).max()
    assert differ(rotation(s.q_12).apply(a2), a1) < 1e-13 * scale


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("seed", [0, 1])
def test_hinge_constraints_hold_to_rounding(motion: int | str, seed: int) -> None:
    s = simulate_hinge(motion, seed=seed)
    across1 = np.linalg.norm(np.cross(s.gyr1_true, s.axis1), axis=1)
    across2 = np.linalg.norm(np.cross(s.gyr2_true, s.axis2), axis=1)
    assert differ(across1, across2) < 1e-13  # eq. 14
    assert differ(rotation(s.q_1).apply(s.axis1), rotation(s.q_2).apply(s.axis2)) < 1e-13  # eq. 8
    assert differ(s.gyr2_true @ s.axis2 - s.gyr1_true @ s.axis1, s.angle_rate) < 1e-13
    assert np.linalg.norm(s.axis1) == pytest.approx(1.0, abs=1e-15)
    assert s.is_hinge
    # The joint only turns about its axis: relative to any start, q_12 is a turn by the angle about axis1.
    turned = (rotation(s.q_12) * rotation(s.q_12[0]).inv()).as_matrix()
    expected = Rotation.from_rotvec((s.angle_rad - s.angle_rad[0])[:, None] * s.axis1).as_matrix()
    assert differ(turned, expected) < 1e-13


@pytest.mark.parametrize("motion", [7, "walking", "mixed"])
def test_angle_rate_is_the_derivative_of_the_angle(motion: int | str) -> None:
    step = 1e-3
    s = at({"motion": motion}, 6.0, step, 1000)
    assert differ(slope(s.angle_rad, step), s.angle_rate[4:-4]) < 1e-10


@pytest.mark.parametrize(("kind", "dof"), [("free", 2), ("free", 3), ("walking", 2), ("planar", 3)])
def test_more_degrees_of_freedom_are_no_hinge(kind: str, dof: Any) -> None:
    s = simulate_hinge(kind, dof=dof)
    relative = rotation(s.q_12).inv().apply(s.gyr1_true) - s.gyr2_true
    spread = np.linalg.svd(relative, compute_uv=False)
    assert not s.is_hinge
    assert spread[1] > 0.1 * spread[0]
    residual = np.linalg.norm(np.cross(s.gyr1_true, s.axis1), axis=1) - np.linalg.norm(np.cross(s.gyr2_true, s.axis2), axis=1)
    assert residual.std() > 0.1


@pytest.mark.parametrize("kind", ["stationary", "stiff"])
def test_a_locked_joint_stays_locked_whatever_its_freedom(kind: str) -> None:
    s = simulate_hinge(kind, dof=3)
    assert differ(s.q_12, np.broadcast_to(s.q_12[0], s.q_12.shape)) < 1e-15


def test_mounting_only_rotates_the_data() -> None:
    q1, q2 = Rotation.random(2, rng=4).as_quat(scalar_first=True)
    aligned = simulate_hinge(14, mount1=[1, 0, 0, 0], mount2=[1, 0, 0, 0], soft_tissue=SoftTissue(), dof=2)
    turned = simulate_hinge(14, mount1=q1, mount2=q2, soft_tissue=SoftTissue(), dof=2)
    r1, r2 = rotation(q1), rotation(q2)
    for i, r in ((1, r1), (2, r2)):
        for name in (f"gyr{i}_true", f"acc{i}_true", f"gyr_rate{i}_true", f"axis{i}", f"joint_in_sensor{i}"):
            # Up to 2e3 rad/s² of wobble: relative to the size of the data.
            before, after = getattr(aligned, name), r.apply(getattr(turned, name))
            assert differ(after, before) < 1e-13 * max(1.0, np.abs(before).max())
    assert differ((r1 * rotation(turned.q_12) * r2.inv()).as_matrix(), rotation(aligned.q_12).as_matrix()) < 1e-13
    assert np.array_equal(aligned.axis1, [0.0, 1.0, 0.0])
    assert np.array_equal(aligned.axis2, [0.0, 1.0, 0.0])  # eq. 69
    assert np.array_equal(turned.angle_rad, aligned.angle_rad)


def test_only_the_mounting_turns_with_the_seed_of_the_mounting() -> None:
    """A given mount leaves the motion and the noise of the other sensor untouched."""
    free, given = simulate_hinge(5), simulate_hinge(5, mount2=[0.5, 0.5, 0.5, 0.5])
    assert np.array_equal(free.gyr1, given.gyr1)
    assert np.array_equal(free.angle_rad, given.angle_rad)
    assert not np.array_equal(free.gyr2, given.gyr2)


def test_soft_tissue_of_size_zero_is_none() -> None:
    none = simulate_hinge("walking")
    zero = simulate_hinge("walking", soft_tissue=SoftTissue(shift_rad=0.0, drag_rad=0.0, wobble_rad_s=0.0))
    for name in ("gyr1", "acc1", "gyr2", "acc2", "q_1", "q_2"):
        assert np.array_equal(getattr(none, name), getattr(zero, name))


@pytest.mark.parametrize("motion", ["walking", "sit_to_stand"])
def test_soft_tissue_moves_sensors_by_degrees_and_leaves_the_bones(motion: str) -> None:
    bare, worn = simulate_hinge(motion, rate_hz=100.0), simulate_hinge(motion, rate_hz=100.0, soft_tissue=SoftTissue())
    assert np.array_equal(worn.q_12_bone, bare.q_12)
    assert np.array_equal(worn.angle_rad, bare.angle_rad)
    slip_deg = np.degrees((rotation(worn.q_12).inv() * rotation(worn.q_12_bone)).magnitude())
    assert 2.0 < slip_deg.max() < 20.0
    wobble = np.linalg.norm(worn.gyr1_true - bare.gyr1_true, axis=1)
    assert 1.5 < wobble.max() < 10.0


def test_the_wobble_has_its_frequency_and_dies_with_the_motion() -> None:
    tissue = SoftTissue(shift_rad=0.0, drag_rad=0.0, wobble_hz=10.0)
    bare, worn = (simulate_hinge("walking", rate_hz=200.0, soft_tissue=t, mount1=[1, 0, 0, 0]) for t in (None, tissue))
    about_limb = (worn.gyr1_true - bare.gyr1_true)[:, 0]
    spectrum = np.abs(np.fft.rfft(about_limb)) ** 2
    hz = np.fft.rfftfreq(len(about_limb), 1 / 200.0)
    assert spectrum[(hz > 6.0) & (hz < 14.0)].sum() > 0.9 * spectrum.sum()
    rest = simulate_hinge("mixed", soft_tissue=SoftTissue()).gyr1_true[:100]
    assert differ(rest, np.zeros_like(rest)) == 0.0


@pytest.mark.parametrize("case", [{"motion": "walking", "soft_tissue": SoftTissue()}, {"motion": 14}], ids=case_name)
def test_interval_mean_is_the_mean_over_the_last_interval(case: dict[str, Any]) -> None:
    mean = simulate_hinge(gyr_sampling="interval_mean", seed=11, **case)
    fine = at(case, 10.0, 0.02 / 64, 65)
    row = int(np.flatnonzero(np.isclose(mean.time_s, 10.02))[0])
    weights = np.ones(65)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    for measured, instant in ((mean.gyr1_true, fine.gyr1_true), (mean.gyr2_true, fine.gyr2_true)):
        simpson = weights @ instant / (3 * 64)
        assert differ(measured[row], simpson) < 1e-5
    plain = simulate_hinge(seed=11, **case)
    assert np.array_equal(plain.acc1, mean.acc1)
    assert not np.array_equal(plain.gyr1, mean.gyr1)
