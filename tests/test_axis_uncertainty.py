"""How far an estimate of the axis says it can be trusted: covariance, bounds, and motion that tells nothing."""

from __future__ import annotations

import numpy as np
import pytest
from imufast import HingeAxis, HingeSimulation, Imu, SolveStatus, _core, estimate_hinge_axis, simulate_hinge
from numpy.typing import NDArray
from reference.compare import INFORMATIVE, UNINFORMATIVE, error_deg, estimate

Array = NDArray[np.float64]

# Fast simulated motion and dead sensors look odd to an Imu, which says so; that is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")


@pytest.fixture(scope="module")
def mixed() -> HingeSimulation:
    return simulate_hinge("mixed", duration_s=20, seed=4)


@pytest.fixture(scope="module")
def mixed_axis(mixed: HingeSimulation) -> HingeAxis:
    return estimate(mixed)


def test_covariance_is_symmetric_positive_and_singular_along_the_axes(mixed_axis: HingeAxis) -> None:
    p, size = mixed_axis.covariance, np.trace(mixed_axis.covariance)
    assert p.shape == (6, 6)
    np.testing.assert_allclose(p, p.T, atol=1e-12 * size)
    eigenvalues = np.linalg.eigvalsh(p)
    assert eigenvalues[0] > -1e-12 * size
    assert eigenvalues[2] > 1e-6 * size, "four directions are uncertain, two are not"
    np.testing.assert_allclose(p[:3, :3] @ mixed_axis.axis1, 0.0, atol=1e-12 * size)
    np.testing.assert_allclose(p[3:, 3:] @ mixed_axis.axis2, 0.0, atol=1e-12 * size)
    np.testing.assert_allclose(p @ np.concatenate([mixed_axis.axis1, np.zeros(3)]), 0.0, atol=1e-12 * size)


def coverage(motion: int | str, duration_s: float, runs: int, *, floor_deg: float = 0.0, published: bool = False) -> Array:
    """Share of simulations in which the truth lies within the bound, (2,); without the floor unless asked for."""
    held = []
    for seed in range(runs):
        simulation = simulate_hinge(motion, duration_s=duration_s, seed=seed)
        axis = estimate(simulation, floor_deg=floor_deg)
        held.append(error_deg(axis, simulation) <= (axis.published_bound_deg if published else axis.bound95_deg))
    return np.asarray(np.mean(held, axis=0))


def test_the_covariance_alone_holds_the_truth() -> None:
    # No floor. Measured over 100 seeds of 10 s, axis 1 and axis 2: mixed 0.98 and 0.98, free (7) 1.00 and 1.00,
    # sit_to_stand 0.96 and 1.00, walking 1.00 and 1.00. The paper's own bound: 0.46 and 0.39 on mixed.
    assert coverage("mixed", 10.0, 100).min() >= 0.9
    assert coverage(7, 10.0, 60).min() >= 0.9
    assert coverage("sit_to_stand", 10.0, 60).min() >= 0.9


def test_the_floor_is_added_by_the_root_of_the_sum_of_squares(mixed: HingeSimulation, mixed_axis: HingeAxis) -> None:
    bare = estimate(mixed, floor_deg=0.0)
    assert bare.bound95_deg.max() < 0.3
    for axis, floor_deg in ((mixed_axis, 0.5), (estimate(mixed, floor_deg=2.0), 2.0)):
        np.testing.assert_allclose(axis.bound95_deg, np.hypot(bare.bound95_deg, floor_deg), rtol=1e-12)
        # What is published stays as published.
        np.testing.assert_array_equal(axis.published_bound_deg, bare.published_bound_deg)
        np.testing.assert_array_equal(axis.covariance, bare.covariance)


def test_the_papers_bound_is_too_small_which_is_why_it_is_not_ours() -> None:
    # Measured over 100 seeds: 0.46 and 0.39. Its covariance takes the residuals of neighbouring samples as independent.
    assert coverage("mixed", 10.0, 40, published=True).max() < 0.7


# Where the axis keeps its direction, the norm of noise in eq. 14 biases the estimate (0.03 deg), however long the recording.
PLANAR = [(6, 40.0), (3, 40.0), ("walking", 60.0)]


@pytest.mark.xfail(
    strict=True,
    reason="limit of the published method: no covariance of residuals sees the bias that the norm of noise leaves in planar "
    "motion; measured over 40 seeds: 0.50 and 0.62 (motion 6), 0.62 and 0.62 (motion 3), 0.18 and 0.93 (walking)",
)
@pytest.mark.parametrize(("motion", "duration_s"), PLANAR)
def test_the_covariance_alone_holds_the_truth_in_planar_motion(motion: int | str, duration_s: float) -> None:
    assert coverage(motion, duration_s, 20).min() >= 0.9


@pytest.mark.parametrize(("motion", "duration_s"), PLANAR)
def test_the_floor_holds_what_the_covariance_misses_in_planar_motion(motion: int | str, duration_s: float) -> None:
    assert coverage(motion, duration_s, 20, floor_deg=0.5).min() == 1.0


def test_in_planar_motion_what_the_bound_misses_is_small() -> None:
    for motion in (3, 6, "walking"):
        for seed in range(10):
            simulation = simulate_hinge(motion, duration_s=20, seed=seed)
            assert error_deg(estimate(simulation), simulation).max() < 0.15


@pytest.mark.parametrize("motion", [*UNINFORMATIVE, "stationary", "stiff"])
def test_motion_without_information_is_not_identifiable(motion: int | str) -> None:
    for seed in range(8):
        axis = estimate(simulate_hinge(motion, duration_s=20, seed=seed))
        assert axis.status is SolveStatus.NOT_IDENTIFIABLE, f"seed {seed}"


@pytest.mark.parametrize("motion", [*INFORMATIVE, "walking", "sit_to_stand", "free", "mixed"])
def test_motion_with_information_is_identifiable(motion: int | str) -> None:
    for seed in range(4):
        assert estimate(simulate_hinge(motion, duration_s=20, seed=seed)).status is SolveStatus.CONVERGED, f"seed {seed}"


@pytest.mark.parametrize("duration_s", [6.0, 8.0, 10.0])
@pytest.mark.parametrize("motion", [1, 8])
def test_a_short_rest_is_never_a_confident_wrong_answer(motion: int, duration_s: float) -> None:
    for seed in range(20):
        simulation = simulate_hinge(motion, duration_s=duration_s, seed=seed)
        axis = estimate(simulation)
        within = bool((error_deg(axis, simulation) <= axis.bound95_deg).all())
        assert within or axis.status is SolveStatus.NOT_IDENTIFIABLE, f"seed {seed}"


def unexplained(simulation: HingeSimulation, axis: HingeAxis) -> float:
    """Rms residual at the estimate over the rms of what is left without any axis, ‖ω1‖ - ‖ω2‖."""
    gyr1, gyr2 = simulation.gyr1, simulation.gyr2
    residual = np.linalg.norm(np.cross(gyr1, axis.axis1), axis=1) - np.linalg.norm(np.cross(gyr2, axis.axis2), axis=1)
    plain = np.linalg.norm(gyr1, axis=1) - np.linalg.norm(gyr2, axis=1)
    return float(np.sqrt(np.mean(residual**2) / np.mean(plain**2)))


def test_what_stays_unexplained_tells_motion_without_information_apart() -> None:
    simulations = [simulate_hinge(motion, duration_s=20, seed=1) for motion in (*UNINFORMATIVE, *INFORMATIVE)]
    simulations += [simulate_hinge(scenario=k, duration_s=20, seed=2, dof=dof) for k in (2, 3) for dof in (2, 3)]
    shares = []
    for simulation in simulations:
        axis = estimate(simulation)
        shares.append(unexplained(simulation, axis))
        assert (axis.status is SolveStatus.NOT_IDENTIFIABLE) == (shares[-1] >= 0.9)
        imu1, imu2 = simulation.imu1, simulation.imu2
        fit = _core.hinge_axis(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, imu1.time_s, None, None, 50.0, None, 300)
        assert fit.unexplained == pytest.approx(shares[-1], rel=1e-9)
    still, hinges = shares[: len(UNINFORMATIVE)], shares[len(UNINFORMATIVE) : -4]
    assert min(still) > 0.9
    assert max(hinges) < 0.02
    # Joints of more degrees of freedom are determined, wrongly believed or not: to judge them is not this function's task.
    assert 0.5 < min(shares[-4:]) <= max(shares[-4:]) < 0.9


def test_a_bound_of_90_deg_is_not_identifiable(mixed: HingeSimulation) -> None:
    # A bound that wide holds every axis there is.
    assert estimate(mixed, floor_deg=89.0).status is SolveStatus.CONVERGED
    assert estimate(mixed, floor_deg=90.0).status is SolveStatus.NOT_IDENTIFIABLE


def test_a_few_seconds_have_no_bound() -> None:
    # Residuals within a second share their causes: fewer than five pieces say nothing about the spread.
    simulation = simulate_hinge("mixed", duration_s=20, seed=4)
    few = slice(400, 590)
    axis = estimate_hinge_axis(simulation.imu1[few], simulation.imu2[few])
    assert axis.status is SolveStatus.CONVERGED
    assert np.isinf(axis.bound95_deg).all()
    assert not np.isnan(axis.covariance).any()
    assert np.isfinite(axis.published_bound_deg).all()
    assert error_deg(axis, simulation).max() < 1.0


def test_more_data_narrow_the_bound() -> None:
    widths = [estimate(simulate_hinge("free", duration_s=d, seed=5), floor_deg=0.0).bound95_deg.max() for d in (10, 40, 160)]
    assert widths[0] > widths[1] > widths[2]


def test_dead_sensors_give_a_status_not_an_exception(mixed: HingeSimulation) -> None:
    imu1, imu2 = mixed.imu1[:500], mixed.imu2[:500]
    still, level = np.zeros((500, 3)), np.tile([0.0, 0.0, 9.81], (500, 1))
    nothing = estimate_hinge_axis(Imu(still, level, 50.0), Imu(still, level[:, ::-1], 50.0))
    assert nothing.status is SolveStatus.NOT_IDENTIFIABLE
    assert not nothing.bound95_deg.max() < 90.0
    stuck = Imu(np.tile(imu1.gyr[300], (500, 1)), np.tile(imu1.acc[300], (500, 1)), 50.0)
    contradicted = estimate_hinge_axis(stuck, imu2)
    # No axis fits: the residual is of the size of the motion.
    assert contradicted.gyr_residual_std > 0.3
    for axis in (nothing, contradicted):
        assert np.linalg.norm(axis.axis1) == pytest.approx(1.0)
        assert np.linalg.norm(axis.axis2) == pytest.approx(1.0)


def test_dead_gyroscopes_are_not_identifiable(mixed: HingeSimulation) -> None:
    still = np.zeros((500, 3))
    axis = estimate_hinge_axis(Imu(still, mixed.acc1[:500], 50.0), Imu(still, mixed.acc2[:500], 50.0))
    assert axis.status is SolveStatus.NOT_IDENTIFIABLE
