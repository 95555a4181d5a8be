"""The joint centre against the paper's own equations, slow and literal, and against the truth of simulated motion."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from imufast import (
    BallJointSimulation,
    CenterEstimate,
    CenterSettings,
    CenterStatus,
    estimate_hinge_axis,
    estimate_joint_center,
    fit_joint_center,
    simulate_ball_joint,
    simulate_hinge,
)
from numpy.typing import NDArray
from reference import center as reference

Array = NDArray[np.float64]
PUBLISHED = CenterSettings.as_published()
CLEAN: dict[str, Any] = {"gyr_noise": 0.0, "acc_noise": 0.0}
BIASES: dict[str, Any] = {"acc_bias1": (0.15, -0.2, 0.1), "acc_bias2": (-0.12, 0.07, 0.18)}


@cache
def ball(seed: int, duration_s: float, clean: bool = False, biased: bool = False, dof: Any = 3) -> BallJointSimulation:
    return simulate_ball_joint(
        seed=seed, duration_s=duration_s, dof=dof, **(CLEAN if clean else {}), **(BIASES if biased else {})
    )


def stacked(center: Any) -> Array:
    if isinstance(center, CenterEstimate):
        return np.concatenate([center.in_sensor1, center.in_sensor2])
    return np.concatenate([center.joint_in_sensor1, center.joint_in_sensor2])


def literal(sim: BallJointSimulation) -> reference.Moments:
    assert sim.rate_hz is not None
    return reference.moments_of(sim.gyr1, sim.acc1, sim.gyr2, sim.acc2, 1.0 / sim.rate_hz)


def exact(sim: BallJointSimulation) -> reference.Moments:
    return reference.Moments(sim.gyr1, sim.gyr_rate1_true, sim.acc1, sim.gyr2, sim.gyr_rate2_true, sim.acc2)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_ss_as_published_is_the_least_sum_of_squares(seed: int) -> None:
    sim = ball(seed, 20.0)
    center = estimate_joint_center(sim.imu1, sim.imu2, "ss", settings=PUBLISHED)
    r, cost = reference.Problem(literal(sim)).squares(np.zeros(6))
    assert center.cost == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(stacked(center), -r, atol=2e-5)
    assert center.n_samples == len(sim.gyr1) - 2
    assert center.status is CenterStatus.CONVERGED


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sa_as_published_is_the_least_sum_of_absolute_values(seed: int) -> None:
    sim = ball(seed, 15.0)
    center = estimate_joint_center(sim.imu1, sim.imu2, "sa", settings=PUBLISHED)
    problem = reference.Problem(literal(sim))
    r, cost = problem.absolutes(problem.squares(np.zeros(6))[0])
    assert center.cost == pytest.approx(cost, rel=1e-6)
    assert center.cost == pytest.approx(np.abs(problem.residuals(-stacked(center))).sum(), rel=1e-10)
    np.testing.assert_allclose(stacked(center), -r, atol=5e-5)


def test_sa_is_the_least_sum_where_collisions_make_the_losses_differ() -> None:
    sim = ball(4, 15.0)
    rng = np.random.default_rng(4)
    moments = literal(sim)
    hits = moments.acc1 + np.where(rng.random((len(moments.acc1), 1)) < 0.1, rng.normal(0.0, 15.0, moments.acc1.shape), 0.0)
    moments = moments._replace(acc1=hits)
    problem = reference.Problem(moments)
    ss, sa = (fit_joint_center(*moments, method, settings=PUBLISHED) for method in ("ss", "sa"))
    r_ss, cost_ss = problem.squares(np.zeros(6))
    _, cost_sa = problem.absolutes(r_ss)
    assert ss.cost == pytest.approx(cost_ss, rel=1e-6)
    assert sa.cost == pytest.approx(cost_sa, rel=1e-6)
    truth = stacked(sim)
    assert np.linalg.norm(stacked(sa) - truth) < 0.25 * np.linalg.norm(stacked(ss) - truth)
    robust = fit_joint_center(*moments, "ss", settings=PUBLISHED, robust=True)
    assert np.linalg.norm(stacked(robust) - truth) < 0.5 * np.linalg.norm(stacked(ss) - truth)


@pytest.mark.parametrize("seed", [1, 2])
def test_ls_as_published_is_the_pseudo_inverse_in_the_global_frame(seed: int) -> None:
    sim = ball(seed, 15.0)
    center = estimate_joint_center(sim.imu1, sim.imu2, "ls", q_12=sim.q_12, settings=PUBLISHED)
    r, cost = reference.least_squares(literal(sim), sim.q_1[1:-1], sim.q_2[1:-1])
    np.testing.assert_allclose(stacked(center), -r, atol=1e-9)
    assert center.cost == pytest.approx(cost, rel=1e-9)
    # A quaternion and its negative are the same rotation.
    signs = np.where(np.random.default_rng(1).random((len(sim.q_12), 1)) < 0.5, -1.0, 1.0)
    same = estimate_joint_center(sim.imu1, sim.imu2, "ls", q_12=sim.q_12 * signs, settings=PUBLISHED)
    np.testing.assert_allclose(stacked(same), stacked(center), atol=1e-12)


@pytest.mark.parametrize("method", ["ss", "sa", "ls"])
@pytest.mark.parametrize("biased", [False, True])
def test_exact_moments_give_the_truth_back(method: str, biased: bool) -> None:
    sim = ball(5, 20.0, clean=True, biased=biased)
    how: dict[str, Any] = {"q_12": sim.q_12} if method == "ls" else {}
    center = fit_joint_center(*exact(sim), method, time_s=sim.time_s, **how)
    assert center.status is CenterStatus.CONVERGED
    assert np.abs(stacked(center) - stacked(sim)).max() < 1e-4
    np.testing.assert_allclose(center.acc_bias1, sim.acc_bias1, atol=2e-3)
    np.testing.assert_allclose(center.acc_bias2, sim.acc_bias2, atol=2e-3)
    assert len(center.undetermined) == len(center.acc_bias_undetermined) == 0


@pytest.mark.parametrize("biased", [False, True])
def test_the_default_finds_the_truth_of_clean_motion_to_a_millimetre(biased: bool) -> None:
    sim = ball(3, 50.0, clean=True, biased=biased)
    center = estimate_joint_center(sim.imu1, sim.imu2)
    assert np.linalg.norm(center.in_sensor1 - sim.joint_in_sensor1) < 1e-3
    assert np.linalg.norm(center.in_sensor2 - sim.joint_in_sensor2) < 1e-3


@pytest.mark.parametrize("method", ["ss", "sa"])
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_the_default_finds_the_centre_and_the_biases_through_noise(method: str, seed: int) -> None:
    sim = ball(seed, 50.0, biased=True)
    center = estimate_joint_center(sim.imu1, sim.imu2, method)
    assert center.status is CenterStatus.CONVERGED
    assert np.linalg.norm(stacked(center) - stacked(sim)) < 0.012
    assert np.abs(center.acc_bias1 - sim.acc_bias1).max() < 0.1
    assert np.abs(center.acc_bias2 - sim.acc_bias2).max() < 0.1
    assert (center.determined_std > 0.0).all()
    assert center.determined_std.max() < 0.012


@pytest.mark.parametrize("method", ["ss", "sa"])
def test_without_unknown_biases_real_ones_pull_the_centre(method: str) -> None:
    sim = ball(3, 50.0, biased=True)
    plain = estimate_joint_center(sim.imu1, sim.imu2, method, acc_bias_std=None)
    better = estimate_joint_center(sim.imu1, sim.imu2, method)
    assert np.linalg.norm(stacked(plain) - stacked(sim)) > 1.3 * np.linalg.norm(stacked(better) - stacked(sim))
    np.testing.assert_array_equal(plain.acc_bias1, np.zeros(3))
    np.testing.assert_array_equal(plain.acc_bias_covariance, np.zeros((6, 6)))
    assert plain.acc_bias_undetermined.shape == (0, 6)


def test_gyroscope_biases_that_rest_shows_are_taken_off() -> None:
    bias1, bias2 = (0.02, -0.01, 0.03), (-0.03, 0.01, 0.02)
    sim = simulate_ball_joint(("stationary", "random"), duration_s=20.0, seed=6, gyr_bias1=bias1, gyr_bias2=bias2)
    center = estimate_joint_center(sim.imu1, sim.imu2)
    assert center.gyr_bias1 is not None
    assert center.gyr_bias2 is not None
    np.testing.assert_allclose(center.gyr_bias1, bias1, atol=2e-3)
    np.testing.assert_allclose(center.gyr_bias2, bias2, atol=2e-3)
    without = estimate_joint_center(sim.imu1, sim.imu2, bias_from_rest=False)
    assert without.gyr_bias1 is None
    assert without.gyr_bias2 is None
    assert (stacked(without) != stacked(center)).any()


def hinges() -> list[Any]:
    mechanical = [simulate_hinge("mixed", duration_s=60, seed=seed, **BIASES) for seed in (1, 2)]
    return [*mechanical, ball(7, 50.0, biased=True, dof=1)]


@pytest.mark.parametrize("method", ["ss", "sa"])
@pytest.mark.parametrize("which", range(3))
def test_a_hinge_leaves_the_place_along_its_axis_open_and_nothing_else(method: str, which: int) -> None:
    sim = hinges()[which]
    center = estimate_joint_center(sim.imu1, sim.imu2, method)
    assert center.status is CenterStatus.PARTLY_DETERMINED
    assert center.undetermined.shape == (1, 6)
    along = np.concatenate([sim.axis1, sim.axis2]) / np.sqrt(2.0)
    assert abs(center.undetermined[0] @ along) > np.cos(np.radians(3.0))
    # The smallest centre of all that fit.
    assert abs(stacked(center) @ center.undetermined[0]) < 1e-6
    across = np.eye(6) - np.outer(along, along)
    assert np.linalg.norm(across @ (stacked(center) - stacked(sim))) < 0.012
    assert center.determined_std.max() < 0.01


@pytest.mark.parametrize("method", ["ss", "sa", "ls"])
def test_a_given_axis_is_projected_out(method: str) -> None:
    sim = simulate_hinge("mixed", duration_s=60, seed=1)
    axis = estimate_hinge_axis(sim.imu1, sim.imu2)
    how: dict[str, Any] = {"q_12": sim.q_12} if method == "ls" else {}
    center = estimate_joint_center(sim.imu1, sim.imu2, method, axis=axis, **how)
    along = np.concatenate([axis.axis1, axis.axis2]) / np.sqrt(2.0)
    assert abs(abs(center.undetermined[0] @ along) - 1.0) < 1e-9
    assert abs(stacked(center) @ along) < 1e-9
    assert len(center.undetermined) == 1
    assert center.status is CenterStatus.PARTLY_DETERMINED
    truth = np.concatenate([sim.axis1, sim.axis2]) / np.sqrt(2.0)
    assert np.linalg.norm((np.eye(6) - np.outer(truth, truth)) @ (stacked(center) - stacked(sim))) < 0.012


def test_of_a_hinge_the_bias_along_the_axis_is_open_too() -> None:
    sim = simulate_hinge("mixed", duration_s=60, seed=1, **BIASES)
    center = estimate_joint_center(sim.imu1, sim.imu2)
    assert len(center.acc_bias_undetermined) >= 1
    along = np.concatenate([sim.axis1, sim.axis2]) / np.sqrt(2.0)
    assert np.linalg.norm(center.acc_bias_undetermined @ along) > 0.9


@pytest.mark.parametrize("dof", [2, 3])
@pytest.mark.parametrize("method", ["ss", "sa"])
def test_a_joint_that_turns_about_two_or_three_axes_leaves_nothing_open(dof: int, method: str) -> None:
    sim = ball(8, 50.0, dof=dof)
    center = estimate_joint_center(sim.imu1, sim.imu2, method)
    assert center.status is CenterStatus.CONVERGED
    assert center.undetermined.shape == (0, 6)
    assert center.acc_bias_undetermined.shape == (0, 6)


def test_sa_and_ss_beat_ls_where_the_orientation_drifts() -> None:
    sim = ball(9, 50.0)
    drift = np.zeros((len(sim.time_s), 4))
    drift[:, 0], drift[:, 3] = np.cos(0.002 * sim.time_s), np.sin(0.002 * sim.time_s)
    w, z = drift[:, :1], drift[:, 3:]
    q = sim.q_12
    turned = np.hstack(
        [w * q[:, :1] - z * q[:, 3:], w * q[:, 1:2] - z * q[:, 2:3], w * q[:, 2:3] + z * q[:, 1:2], w * q[:, 3:] + z * q[:, :1]]
    )
    errors = {
        method: np.linalg.norm(stacked(center) - stacked(sim))
        for method, center in {
            "ls": estimate_joint_center(sim.imu1, sim.imu2, "ls", q_12=turned, settings=PUBLISHED),
            "ss": estimate_joint_center(sim.imu1, sim.imu2, "ss", settings=PUBLISHED),
            "sa": estimate_joint_center(sim.imu1, sim.imu2, "sa", settings=PUBLISHED),
        }.items()
    }
    assert max(errors["ss"], errors["sa"]) < errors["ls"], errors
