"""Algorithm 1 on simulated recordings: truth, laws, an independent oracle, honest uncertainty, refusals."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import imufast
import numpy as np
import pytest
from imufast import HingeAxis, HingeSimulation, Imu, SoftTissue, SolveStatus, _core, estimate_hinge_axis, simulate_hinge
from numpy.typing import NDArray
from reference import hinge_axis as reference

Array = NDArray[np.float64]

# Fast simulated motion and dead sensors look odd to an Imu, which says so; that is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")

# Motions of section 7.1 that excite the joint; 1, 2, 8, 9 (at rest, stiff) hold nothing about the axis.
INFORMATIVE = (3, 4, 5, 6, 7, 10, 11, 12, 13, 14)
# Only accelerations along the axis tell the two sign pairings apart. Where a horizontal axis rests (3, 10) there are none.
SIGN_IS_TOLD = (4, 5, 6, 7, 11, 12, 13)


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two axes, their sign free; exact near 0."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))


def error_deg(axis: HingeAxis, truth: HingeSimulation) -> Array:
    return np.array([angle_deg(axis.axis1, truth.axis1), angle_deg(axis.axis2, truth.axis2)])


def estimate(simulation: HingeSimulation, **settings: Any) -> HingeAxis:
    return estimate_hinge_axis(simulation.imu1, simulation.imu2, **settings)


def paired(axis: HingeAxis, truth: HingeSimulation) -> bool:
    return float((axis.axis1 @ truth.axis1) * (axis.axis2 @ truth.axis2)) > 0.0


def random_rotation(rng: np.random.Generator) -> Array:
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q * np.linalg.det(q))


def turned(imu: Imu, rotation: Array) -> Imu:
    return Imu(imu.gyr @ rotation.T, imu.acc @ rotation.T, time_s=imu.time_s, name=imu.name)


@pytest.fixture(scope="module")
def mixed() -> HingeSimulation:
    return simulate_hinge("mixed", duration_s=20, seed=4)


@pytest.fixture(scope="module")
def mixed_axis(mixed: HingeSimulation) -> HingeAxis:
    return estimate(mixed)


# Truth


@pytest.mark.parametrize("motion", INFORMATIVE)
def test_truth_is_recovered_within_the_noise(motion: int) -> None:
    # 20 s with the noise of a good sensor: 0.005 rad/s against rates of 1 to 7 rad/s; measured errors are 0.003 to 0.05 deg.
    simulation = simulate_hinge(motion, duration_s=20, seed=3)
    axis = estimate(simulation)
    assert axis.status is SolveStatus.CONVERGED
    assert error_deg(axis, simulation).max() < 0.1
    assert axis.gyr_residual_std == pytest.approx(0.005 * np.sqrt(2), rel=0.35)
    assert (axis.n_gyr, axis.n_acc) == (1000, 1000)


def test_without_noise_only_the_approximation_of_eq_18_is_left() -> None:
    # The rate constraint is exact; the acceleration constraint leaves out the sensors' own rotation and has weight 1/50.
    simulation = simulate_hinge("free", duration_s=20, seed=4, gyr_noise=0.0, acc_noise=0.0)
    assert error_deg(estimate(simulation), simulation).max() < 0.05
    assert error_deg(estimate(simulation, weight_ratio=1e6), simulation).max() < 1e-4


@pytest.mark.parametrize("motion", SIGN_IS_TOLD)
def test_the_sign_pair_is_right_where_accelerations_tell_it(motion: int) -> None:
    for seed in range(10):
        simulation = simulate_hinge(motion, duration_s=20, seed=seed)
        assert paired(estimate(simulation), simulation), f"seed {seed}"


@pytest.mark.xfail(
    strict=True,
    reason="limit: in fast free motion the sensors' own rotation, which eq. 18 leaves out, drowns what tells the sign (costs "
    "of the two pairings within 5 to 50 %); 2 of the first 4 seeds are paired wrongly and nothing in the result says so",
)
def test_the_sign_pair_is_right_in_fast_free_motion() -> None:
    for seed in range(4):
        simulation = simulate_hinge(14, duration_s=20, seed=seed)
        assert paired(estimate(simulation), simulation), f"seed {seed}"


@pytest.mark.parametrize("motion", [3, 10])
def test_where_nothing_tells_the_sign_pair_the_other_pairing_is_a_minimum_of_nearly_the_same_cost(motion: int) -> None:
    axis = estimate(simulate_hinge(motion, duration_s=20, seed=3))
    best, other = axis.minima[:2]
    assert angle_deg(best.axis1, other.axis1) < 1.0
    assert float((best.axis1 @ other.axis1) * (best.axis2 @ other.axis2)) < -0.99
    assert other.cost < 1.2 * best.cost


def test_minima_are_distinct_sorted_and_led_by_the_estimate(mixed_axis: HingeAxis) -> None:
    costs = [minimum.cost for minimum in mixed_axis.minima]
    assert costs == sorted(costs)
    assert costs[0] == mixed_axis.cost
    np.testing.assert_array_equal(mixed_axis.minima[0].axis1, mixed_axis.axis1)
    np.testing.assert_array_equal(mixed_axis.minima[0].axis2, mixed_axis.axis2)
    assert len(costs) >= 2
    assert mixed_axis.axis1[np.abs(mixed_axis.axis1).argmax()] > 0.0, "the overall sign is canonical"


def test_cost_is_eq_23(mixed: HingeSimulation, mixed_axis: HingeAxis) -> None:
    data = reference.Data(mixed.gyr1, mixed.gyr2, mixed.acc1, mixed.acc2)
    x = np.concatenate([reference.angles(mixed_axis.axis1), reference.angles(mixed_axis.axis2)])
    assert mixed_axis.cost == pytest.approx(reference.cost(x, data), rel=1e-12)
    gyr_std = np.std(reference.gyr_residuals(x, data), ddof=1) / data.gyr_weight
    acc_std = np.std(reference.acc_residuals(x, data), ddof=1) / data.acc_weight
    assert mixed_axis.gyr_residual_std == pytest.approx(gyr_std, rel=1e-10)
    assert mixed_axis.acc_residual_std == pytest.approx(acc_std, rel=1e-10)


# The independent oracle


@pytest.mark.parametrize("weight_ratio", [0.5, 50.0, 5000.0])
@pytest.mark.parametrize("motion", ["mixed", 6, 7, 13, "sit_to_stand"])
def test_the_literal_algorithm_ends_in_the_same_minimum(motion: int | str, weight_ratio: float) -> None:
    simulation = simulate_hinge(motion, duration_s=15, seed=6)
    axis = estimate(simulation, weight_ratio=weight_ratio)
    data = reference.Data(simulation.gyr1, simulation.gyr2, simulation.acc1, simulation.acc2, weight_ratio)
    oracle = reference.best_of(data, starts=4, seed=1)
    assert angle_deg(axis.axis1, oracle.axis1) < 1e-4
    assert angle_deg(axis.axis2, oracle.axis2) < 1e-4
    assert (axis.axis1 @ oracle.axis1) * (axis.axis2 @ oracle.axis2) > 0.0
    # At 1e-4 deg the cost still differs in the eighth digit where the data are that good.
    assert axis.cost == pytest.approx(oracle.cost, rel=1e-7)


def test_chosen_samples_are_the_only_ones_used(mixed: HingeSimulation) -> None:
    rng = np.random.default_rng(0)
    gyr_index = np.sort(rng.choice(1000, 300, replace=False))
    acc_index = np.sort(rng.choice(1000, 150, replace=False))
    samples = SimpleNamespace(gyr_index=gyr_index, acc_index=acc_index)
    axis = estimate_hinge_axis(mixed.imu1, mixed.imu2, samples)
    assert (axis.n_gyr, axis.n_acc) == (300, 150)
    data = reference.Data(mixed.gyr1[gyr_index], mixed.gyr2[gyr_index], mixed.acc1[acc_index], mixed.acc2[acc_index])
    oracle = reference.best_of(data, starts=4, seed=1)
    assert axis.cost == pytest.approx(oracle.cost, rel=1e-9)
    assert angle_deg(axis.axis1, oracle.axis1) < 1e-4
    everything = SimpleNamespace(gyr_index=np.arange(1000), acc_index=np.arange(1000))
    assert estimate_hinge_axis(mixed.imu1, mixed.imu2, everything).cost == estimate(mixed).cost


def test_the_published_bound_is_that_of_eqs_57_to_65() -> None:
    # Sensors along their segments: the axis is y, far from the poles where the spherical coordinates break down.
    along = np.array([1.0, 0.0, 0.0, 0.0])
    simulation = simulate_hinge("mixed", duration_s=20, seed=4, mount1=along, mount2=along)
    axis = estimate(simulation)
    data = reference.Data(simulation.gyr1, simulation.gyr2, simulation.acc1, simulation.acc2)
    x = np.concatenate([reference.angles(axis.axis1), reference.angles(axis.axis2)])
    drawn = np.degrees(reference.angular_deviation_bound(x, reference.covariance(x, data), draws=200_000, seed=0))
    # 200 000 draws: good to about 0.5 %.
    np.testing.assert_allclose(axis.published_bound_deg, drawn, rtol=0.02)


# Starts


SIMULATIONS: dict[str, Callable[[], HingeSimulation]] = {
    **{f"motion {m}": lambda m=m: simulate_hinge(m, duration_s=20, seed=3) for m in INFORMATIVE},  # type: ignore[misc]
    **{
        f"scenario {k}": lambda k=k: simulate_hinge(scenario=k, duration_s=20, seed=1)  # type: ignore[misc]
        for k in (1, 2, 3, 4)
    },
    "walking, soft tissue": lambda: simulate_hinge("walking", duration_s=20, seed=1, soft_tissue=SoftTissue()),
    "scenario 1, soft tissue": lambda: simulate_hinge(scenario=1, duration_s=20, seed=1, soft_tissue=SoftTissue()),
    "mixed, biases": lambda: simulate_hinge("mixed", duration_s=20, seed=1, **imufast.random_biases(5)),
    "scenario 3, biases": lambda: simulate_hinge(scenario=3, duration_s=20, seed=1, **imufast.random_biases(5)),
    "mixed, 2 dof": lambda: simulate_hinge("mixed", duration_s=20, seed=1, dof=2),
    "mixed, 3 dof": lambda: simulate_hinge("mixed", duration_s=20, seed=1, dof=3),
    "scenario 1, 2 dof": lambda: simulate_hinge(scenario=1, duration_s=20, seed=1, dof=2),
    "scenario 4, 3 dof": lambda: simulate_hinge(scenario=4, duration_s=20, seed=1, dof=3),
}


def no_better_by_luck(simulation: HingeSimulation) -> None:
    # Random starts descend on all samples, each from where it was drawn. Descents end at steps of 1e-7 rad, which on the
    # best data still is a few 1e-9 of the cost; the same axes are as good as the same cost.
    ours = estimate(simulation)
    lucky = estimate(simulation, starts="random", random_starts=200, seed=1)
    same = max(angle_deg(ours.axis1, lucky.axis1), angle_deg(ours.axis2, lucky.axis2)) < 1e-4
    above = ours.cost / lucky.cost - 1.0
    assert above < (1e-7 if same else 1e-9), f"{above:.2e} above the best of 200 random starts"


@pytest.mark.parametrize("name", SIMULATIONS)
def test_200_random_starts_find_nothing_better(name: str) -> None:
    no_better_by_luck(SIMULATIONS[name]())


@pytest.mark.xfail(
    strict=True,
    reason="bug: with large residuals Gauss-Newton crawls; 100 iterations end (MAX_ITERATIONS) short of what luck finds",
)
def test_200_random_starts_find_nothing_better_in_sitting_down() -> None:
    no_better_by_luck(simulate_hinge("sit_to_stand", duration_s=20, seed=1, soft_tissue=SoftTissue()))


@pytest.mark.xfail(
    strict=True, reason="bug: the walk on few samples ends in other valleys than all samples have, and no start returns"
)
@pytest.mark.parametrize("dof", [2, 3])
def test_200_random_starts_find_nothing_better_where_a_joint_is_no_hinge(dof: Any) -> None:
    no_better_by_luck(simulate_hinge(scenario=2, duration_s=20, seed=1, dof=dof))


def test_nearly_the_same_start_gives_the_same_axis(mixed: HingeSimulation, mixed_axis: HingeAxis) -> None:
    for seed in range(5):
        lucky = estimate(mixed, starts="random", random_starts=20, seed=seed)
        assert angle_deg(lucky.axis1, mixed_axis.axis1) < 1e-3
        assert angle_deg(lucky.axis2, mixed_axis.axis2) < 1e-3


# Laws


@pytest.mark.parametrize("where", ["anywhere", "+z", "-z", "beside z"])
def test_turned_sensors_turn_the_axes_and_the_covariance(mixed: HingeSimulation, mixed_axis: HingeAxis, where: str) -> None:
    rng = np.random.default_rng(7)
    for _ in range(3):
        rotations = [random_rotation(rng), random_rotation(rng)]
        if where != "anywhere":
            # Bring the axes onto a pole of the spherical coordinates, a common way to wear sensors.
            pole = np.array([0.0, 0.0, -1.0 if where == "-z" else 1.0])
            pole = pole + (1e-6 * rng.standard_normal(3) if where == "beside z" else 0.0)
            pole = pole / np.linalg.norm(pole)
            for i, own in enumerate((mixed_axis.axis1, mixed_axis.axis2)):
                here = rotations[i] @ own
                turn = np.cross(here, pole)
                skew = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
                rotations[i] = (np.eye(3) + skew + skew @ skew / (1.0 + here @ pole)) @ rotations[i]
        axis = estimate_hinge_axis(turned(mixed.imu1, rotations[0]), turned(mixed.imu2, rotations[1]))
        assert axis.status is SolveStatus.CONVERGED
        expected = np.concatenate([rotations[0] @ mixed_axis.axis1, rotations[1] @ mixed_axis.axis2])
        found = np.concatenate([axis.axis1, axis.axis2])
        # One common sign; the descent ends when a step is shorter than 1e-7 rad.
        np.testing.assert_allclose(found * np.sign(found @ expected), expected, atol=1e-6)
        both = np.block([[rotations[0], np.zeros((3, 3))], [np.zeros((3, 3)), rotations[1]]])
        rotated = both @ mixed_axis.covariance @ both.T
        np.testing.assert_allclose(axis.covariance, rotated, atol=1e-4 * np.trace(rotated))
        np.testing.assert_allclose(axis.bound95_deg, mixed_axis.bound95_deg, rtol=1e-4)
        np.testing.assert_allclose(axis.published_bound_deg, mixed_axis.published_bound_deg, rtol=1e-4)
        assert axis.cost == pytest.approx(mixed_axis.cost, rel=1e-9)


def test_swapped_sensors_swap_the_axes(mixed: HingeSimulation, mixed_axis: HingeAxis) -> None:
    axis = estimate_hinge_axis(mixed.imu2, mixed.imu1)
    sign = np.sign(axis.axis1 @ mixed_axis.axis2)
    np.testing.assert_allclose(sign * axis.axis1, mixed_axis.axis2, atol=1e-6)
    np.testing.assert_allclose(sign * axis.axis2, mixed_axis.axis1, atol=1e-6)
    np.testing.assert_allclose(axis.bound95_deg, mixed_axis.bound95_deg[::-1], rtol=1e-4)
    swap = np.roll(np.arange(6), 3)
    np.testing.assert_allclose(
        axis.covariance, mixed_axis.covariance[np.ix_(swap, swap)], atol=1e-4 * np.trace(axis.covariance)
    )


def test_the_order_and_the_offset_of_time_do_not_move_the_axes(mixed: HingeSimulation, mixed_axis: HingeAxis) -> None:
    imu1, imu2 = (Imu(imu.gyr, imu.acc, time_s=imu.time_s + 1234.0, name=imu.name) for imu in (mixed.imu1, mixed.imu2))
    np.testing.assert_allclose(estimate_hinge_axis(imu1, imu2).axis1, mixed_axis.axis1, atol=1e-6)
    imu1, imu2 = (Imu(imu.gyr[::-1], imu.acc[::-1], imu.rate_hz, name=imu.name) for imu in (mixed.imu1, mixed.imu2))
    np.testing.assert_allclose(estimate_hinge_axis(imu1, imu2).axis1, mixed_axis.axis1, atol=1e-6)


def test_flipped_twice_is_the_same_and_once_the_opposite(mixed_axis: HingeAxis) -> None:
    once = mixed_axis.flipped()
    np.testing.assert_array_equal(once.axis1, -mixed_axis.axis1)
    np.testing.assert_array_equal(once.axis2, -mixed_axis.axis2)
    np.testing.assert_array_equal(once.covariance, mixed_axis.covariance)
    np.testing.assert_array_equal(once.flipped().axis1, mixed_axis.axis1)
    assert (once.cost, once.status) == (mixed_axis.cost, mixed_axis.status)


@pytest.mark.parametrize("name", ["towards1", "towards2"])
def test_oriented_points_to_a_direction(mixed_axis: HingeAxis, name: str) -> None:
    own = mixed_axis.axis1 if name == "towards1" else mixed_axis.axis2
    for direction in (own, -own, 100.0 * own + np.cross(own, [0.2, 0.5, 0.9]), np.eye(3)[0], [0, -1, 0]):
        chosen_by: dict[str, Any] = {name: direction}
        oriented = mixed_axis.oriented(**chosen_by)
        same = oriented.axis1 if name == "towards1" else oriented.axis2
        assert same @ np.asarray(direction, float) > 0.0
        # Both axes turn together, and turning before changes nothing.
        assert oriented.axis1 @ mixed_axis.axis1 == pytest.approx(oriented.axis2 @ mixed_axis.axis2)
        np.testing.assert_array_equal(mixed_axis.flipped().oriented(**chosen_by).axis1, oriented.axis1)


def test_oriented_by_flexion_lets_the_joint_angle_grow() -> None:
    simulation = simulate_hinge("sit_to_stand", duration_s=20, seed=3)
    axis = estimate(simulation)
    low, high = int(simulation.angle_rad[:500].argmin()), int(simulation.angle_rad[:500].argmax())
    start, stop = min(low, high), max(low, high)
    flexing = (simulation.imu1[start:stop], simulation.imu2[start:stop])
    oriented = axis.oriented(flexing=flexing)
    np.testing.assert_array_equal(axis.flipped().oriented(flexing=flexing).axis1, oriented.axis1)
    # The truth's own axis has flexion positive; here the angle falls or grows over the cut.
    assert float(oriented.axis1 @ simulation.axis1) * (1.0 if high > low else -1.0) > 0.99


# Uncertainty


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


def coverage(motion: int | str, duration_s: float, runs: int, published: bool = False) -> Array:
    """Share of simulations in which the truth lies within the bound, (2,)."""
    held = []
    for seed in range(runs):
        simulation = simulate_hinge(motion, duration_s=duration_s, seed=seed)
        axis = estimate(simulation)
        held.append(error_deg(axis, simulation) <= (axis.published_bound_deg if published else axis.bound95_deg))
    return np.asarray(np.mean(held, axis=0))


def test_the_bound_holds_the_truth() -> None:
    # Measured over 100 seeds of 10 s, axis 1 and axis 2: mixed 0.96 and 0.98, free (7) 0.99 and 0.89,
    # sit_to_stand 0.93 and 1.00, walking 0.90 and 0.99. The paper's own bound: 0.46 and 0.39 on mixed.
    assert coverage("mixed", 10.0, 100).min() >= 0.85
    assert coverage(7, 10.0, 60).min() >= 0.85
    assert coverage("sit_to_stand", 10.0, 60).min() >= 0.85


def test_the_papers_bound_is_too_small_which_is_why_it_is_not_ours() -> None:
    # Measured over 100 seeds: 0.46 and 0.39. Its covariance takes the residuals of neighbouring samples as independent.
    assert coverage("mixed", 10.0, 40, published=True).max() < 0.7


@pytest.mark.xfail(
    strict=True,
    reason="limit: where the axis keeps its direction the norm of noise biases the estimate (0.03 deg), which no covariance "
    "of residuals sees; measured coverage 0.51 (motion 6), 0.55 (motion 3), 0.52 (walking, 30 s)",
)
@pytest.mark.parametrize(("motion", "duration_s"), [(6, 10.0), (3, 10.0), ("walking", 30.0)])
def test_the_bound_holds_the_truth_also_in_planar_motion(motion: int | str, duration_s: float) -> None:
    assert coverage(motion, duration_s, 40).min() >= 0.85


def test_in_planar_motion_what_the_bound_misses_is_small() -> None:
    for motion in (3, 6, "walking"):
        for seed in range(10):
            simulation = simulate_hinge(motion, duration_s=20, seed=seed)
            assert error_deg(estimate(simulation), simulation).max() < 0.15


def honest(axis: HingeAxis, simulation: HingeSimulation) -> bool:
    return axis.status is SolveStatus.NOT_IDENTIFIABLE or bool((error_deg(axis, simulation) <= axis.bound95_deg).all())


@pytest.mark.xfail(
    strict=True,
    reason="bug: a still or stiff joint gives CONVERGED with a bound of 4 to 20 deg around an axis 40 to 90 deg off: noise in "
    "the Jacobian passes for information. The residual then is as large as the plain difference of the rates' norms",
)
@pytest.mark.parametrize("motion", [1, 2, 8, 9, "stationary", "stiff"])
def test_motion_without_information_is_never_a_confident_wrong_answer(motion: int | str) -> None:
    simulations = [simulate_hinge(motion, duration_s=20, seed=seed) for seed in range(8)]
    assert all(honest(estimate(simulation), simulation) for simulation in simulations)


def test_what_the_residual_explains_tells_motion_without_information_apart() -> None:
    # A way to tell: the residual at the estimate against the residual that any axis would leave, ‖ω1‖ - ‖ω2‖.
    def share(simulation: HingeSimulation) -> float:
        axis = estimate(simulation)
        plain = np.linalg.norm(simulation.gyr1, axis=1) - np.linalg.norm(simulation.gyr2, axis=1)
        return float(axis.gyr_residual_std / np.sqrt(np.mean(plain**2)))

    for motion in (1, 2, 8, 9):
        assert share(simulate_hinge(motion, duration_s=20, seed=1)) > 0.9
    for motion in INFORMATIVE:
        assert share(simulate_hinge(motion, duration_s=20, seed=1)) < 0.02


def test_a_few_seconds_have_no_bound() -> None:
    # Residuals within a second share their causes: fewer than five pieces say nothing about the spread.
    simulation = simulate_hinge("mixed", duration_s=20, seed=4)
    few = slice(400, 590)
    axis = estimate_hinge_axis(simulation.imu1[few], simulation.imu2[few])
    assert np.isinf(axis.bound95_deg).all()
    assert not np.isnan(axis.covariance).any()
    assert np.isfinite(axis.published_bound_deg).all()
    assert error_deg(axis, simulation).max() < 1.0


def test_more_data_narrow_the_bound() -> None:
    widths = [estimate(simulate_hinge("free", duration_s=d, seed=5)).bound95_deg.max() for d in (10, 40, 160)]
    assert widths[0] > widths[1] > widths[2]


# The low-pass, gaps, strap wobble


def test_the_low_pass_turns_from_the_strap_to_the_knee() -> None:
    # Measured at 100 Hz, thigh axis: 87 to 89 deg off raw, 18 to 19 deg with 4 Hz (the skin's own shift is left).
    for seed in range(3):
        simulation = simulate_hinge("walking", duration_s=20, rate_hz=100.0, seed=seed, soft_tissue=SoftTissue())
        raw, smooth = error_deg(estimate(simulation), simulation), error_deg(estimate(simulation, lowpass_hz=4.0), simulation)
        assert raw[0] > 60.0
        assert smooth[0] < 25.0
        assert smooth[1] < 6.0


def fit_on(arrays: list[Array], time_s: Array) -> tuple[list[float], list[float], float]:
    gyr1, acc1, gyr2, acc2 = map(np.ascontiguousarray, arrays)
    fit = _core.hinge_axis(gyr1, acc1, gyr2, acc2, time_s, None, None, 50.0, None, 100)
    return fit.axis1, fit.axis2, fit.cost


def test_the_low_pass_does_not_reach_across_a_break() -> None:
    full = simulate_hinge("mixed", duration_s=30, seed=4, soft_tissue=SoftTissue())
    keep = np.r_[0:500, 650:1500]
    imu1, imu2 = (Imu(i.gyr[keep], i.acc[keep], time_s=i.time_s[keep], name=i.name) for i in (full.imu1, full.imu2))
    axis = estimate_hinge_axis(imu1, imu2, lowpass_hz=4.0)
    # Each stretch low-passed alone, then put together by hand.
    parts = []
    for part in (slice(0, 500), slice(500, 1350)):
        time, arrays = _core.condition(
            imu1.gyr[part], imu1.acc[part], imu2.gyr[part], imu2.acc[part], imu1.time_s[part], imu1.rate_hz, 4.0
        )
        # 4 Hz at 50 Hz: half a kernel of 13 samples is lost at either end.
        assert len(time) == part.stop - part.start - 26
        parts.append([time, *arrays])
    time, *arrays = (np.concatenate(piece) for piece in zip(*parts, strict=True))
    axis1, axis2, cost = fit_on(arrays, time)
    assert (axis.axis1.tolist(), axis.axis2.tolist(), axis.cost) == (axis1, axis2, cost)
    assert axis.n_gyr == len(time)


def test_irregular_time_gives_the_axis_of_even_time() -> None:
    rng = np.random.default_rng(2)
    even = np.arange(0.0, 30.0, 0.02)
    uneven = even + np.clip(0.003 * rng.standard_normal(len(even)), -0.009, 0.009)
    uneven[0] = 0.0
    axes = []
    for time in (even, uneven):
        simulation = simulate_hinge("mixed", time_s=time, seed=4)
        axes.append(estimate(simulation, lowpass_hz=4.0))
        assert error_deg(axes[-1], simulation).max() < 0.5
        # Raw samples need no even time at all.
        assert error_deg(estimate(simulation), simulation).max() < 0.1
    assert angle_deg(axes[0].axis1, axes[1].axis1) < 0.1
    assert abs(axes[0].n_gyr - axes[1].n_gyr) <= 2


def test_lost_packets_take_samples_away_and_nothing_else() -> None:
    simulation = simulate_hinge("mixed", duration_s=20, seed=4, packet_loss=0.2)
    axis = estimate(simulation)
    assert axis.n_gyr == len(simulation.time_s) < 900
    assert error_deg(axis, simulation).max() < 0.1
    assert error_deg(estimate(simulation, lowpass_hz=8.0), simulation).max() < 1.0


# Refusals


@pytest.fixture(scope="module")
def pair(mixed: HingeSimulation) -> tuple[Imu, Imu]:
    return mixed.imu1[:500], mixed.imu2[:500]


def chosen(gyr: object, acc: object = None) -> Any:
    return SimpleNamespace(gyr_index=gyr, acc_index=np.arange(500) if acc is None else acc)


def no_selection(anything: Any) -> Any:
    return anything


Pair = tuple[Any, Any]
ALL = np.arange(500)
BAD_INPUT: dict[str, tuple[Callable[[Any, Any], object], str]] = {
    "imu1 a string": (lambda a, b: estimate_hinge_axis("thigh", b), "^imu1 must be an imufast.Imu, got str"),  # type: ignore[arg-type]
    "imu1 None": (lambda a, b: estimate_hinge_axis(None, b), "^imu1 must be .* NoneType"),  # type: ignore[arg-type]
    "imu1 an array": (lambda a, b: estimate_hinge_axis(a.gyr, b), "^imu1 must be .* ndarray"),
    "imu2 a number": (lambda a, b: estimate_hinge_axis(a, 3), "^imu2 must be .* int"),  # type: ignore[arg-type]
    "imu2 a recording": (lambda a, b: estimate_hinge_axis(a, imufast.Recording({"x": b})), "^imu2 must be .* Recording"),  # type: ignore[arg-type]
    "imu2 a pair": (lambda a, b: estimate_hinge_axis(a, (a, b)), "^imu2 must be .* tuple"),  # type: ignore[arg-type]
    "lengths differ": (lambda a, b: estimate_hinge_axis(a, b[:499]), "imu1 has 500 samples but imu2 has 499"),
    "rates differ": (lambda a, b: estimate_hinge_axis(a, Imu(b.gyr, b.acc, 100.0)), "imu1.*different time bases.*s apart"),
    "starts differ": (
        lambda a, b: estimate_hinge_axis(a, Imu(b.gyr, b.acc, time_s=b.time_s + 0.5)),
        "imu1.*different time bases.*0.5 s apart",
    ),
    "one row late": (lambda a, b: estimate_hinge_axis(a[:499], b[1:]), "imu1.*different time bases"),
    "same imu twice": (lambda a, b: estimate_hinge_axis(a, a), "imu1 .* and imu2 .* hold the same gyr data"),
    "same data twice": (
        lambda a, b: estimate_hinge_axis(a, Imu(a.gyr.copy(), b.acc, 50.0, name="other")),
        "imu2 .'other'. hold the same gyr data",
    ),
    "one sample": (lambda a, b: estimate_hinge_axis(a[:1], b[:1]), "imu1 and imu2 have 1 samples; at least 4"),
    "three samples": (lambda a, b: estimate_hinge_axis(a[:3], b[:3]), "imu1 and imu2 have 3 samples; at least 4"),
    "too short to filter": (
        lambda a, b: estimate_hinge_axis(a[:20], b[:20], lowpass_hz=4.0),
        "no unbroken stretch of 0.5 s, which lowpass_hz=4 needs",
    ),
    "index past the end": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL + 1)), "gyr_index must ascend within 0 to 499"),
    "index below 0": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL - 1)), "gyr_index must ascend within 0 to 499"),
    "index descends": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL[::-1])), "gyr_index must ascend"),
    "index repeats": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, [1, 1])), "acc_index must ascend"),
    "index of floats": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL * 1.0)), "gyr_index must be a vector of whole"),
    "index a mask": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, ALL > 5)), "acc_index must be a vector.* of bool"),
    "index of strings": (lambda a, b: estimate_hinge_axis(a, b, chosen(["1", "2"])), "gyr_index must be a vector of whole"),
    "index empty": (
        lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, np.zeros(0, np.int64))),
        r"acc_index must be a vector.*\(0,\)",
    ),
    "index a table": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL[None])), r"gyr_index must be a vector.*\(1, 500\)"),
    "index a number": (lambda a, b: estimate_hinge_axis(a, b, chosen(3)), r"gyr_index must be a vector.*\(\)"),
    "index missing": (lambda a, b: estimate_hinge_axis(a, b, chosen("none")), "gyr_index must be a vector"),
    "index beyond int64": (
        lambda a, b: estimate_hinge_axis(a, b, chosen(np.array([0, 2**63 + 5], np.uint64))),
        "gyr_index must ascend",
    ),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_refused_with_the_argument_that_is_wrong(pair: Pair, case: str) -> None:
    call, message = BAD_INPUT[case]
    with pytest.raises(imufast.InputError, match=message):
        call(*pair)


BAD_DIRECTIONS: dict[str, tuple[Callable[[HingeAxis, Any, Any], object], str]] = {
    "nothing": (lambda x, a, b: x.oriented(), "exactly one of towards1, towards2, flexing; got none"),
    "two": (lambda x, a, b: x.oriented(towards1=[1, 0, 0], towards2=[1, 0, 0]), "exactly one of .*towards1', 'towards2"),
    "two numbers": (lambda x, a, b: x.oriented(towards1=[1.0, 0.0]), "^towards1 must be three finite numbers"),
    "zero": (lambda x, a, b: x.oriented(towards2=[0, 0, 0]), "^towards2 must be three finite numbers"),
    "NaN": (lambda x, a, b: x.oriented(towards1=[np.nan, 0, 1]), "^towards1 must be three finite numbers"),
    "perpendicular": (
        lambda x, a, b: x.oriented(towards1=np.cross(x.axis1, [0.3, 0.2, 0.5])),
        "^towards1 does not tell the sign",
    ),
    "still": (lambda x, a, b: x.oriented(flexing=(a[:50], b[:50])), "^flexing does not tell the sign"),
    "flexing same imu": (lambda x, a, b: x.oriented(flexing=(a, a)), "hold the same gyr data"),
    "flexing no imu": (lambda x, a, b: x.oriented(flexing=(None, b)), "imu1 must be an imufast.Imu"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", BAD_DIRECTIONS)
def test_a_direction_that_does_not_tell_is_refused(mixed_axis: HingeAxis, pair: Pair, case: str) -> None:
    call, message = BAD_DIRECTIONS[case]
    with pytest.raises(imufast.InputError, match=message):
        call(mixed_axis, *pair)


@pytest.mark.xfail(strict=True, reason="bug: these escape as AttributeError, TypeError, ValueError or ZeroDivisionError")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(lambda x, a, b: estimate_hinge_axis(a, b, no_selection([1, 2, 3])), "^samples", id="samples a list"),
        pytest.param(lambda x, a, b: estimate_hinge_axis(a, b, no_selection({"gyr_index": ALL})), "^samples", id="a dict"),
        pytest.param(lambda x, a, b: estimate_hinge_axis(a, b, chosen([[1], [1, 2]])), "gyr_index", id="ragged index"),
        pytest.param(lambda x, a, b: x.oriented(towards1="up"), "^towards1", id="towards a word"),
        pytest.param(lambda x, a, b: x.oriented(towards1=[[1], 2, 3]), "^towards1", id="towards something ragged"),
        pytest.param(lambda x, a, b: x.oriented(towards1=x.axis1 * 1e-200) and 1 / 0, "^towards1", id="tiny direction"),
        pytest.param(lambda x, a, b: x.oriented(flexing=(a, b, a)), "^flexing", id="flexing three"),
        pytest.param(lambda x, a, b: x.oriented(flexing=a), "^flexing", id="flexing one"),
        pytest.param(
            lambda x, a, b: estimate_hinge_axis(a, b, chosen(np.array([5, 3, 7], np.uint64))), "ascend", id="unsigned descends"
        ),
    ],
)
def test_bad_input_that_still_slips_through(mixed_axis: HingeAxis, pair: Pair, call: Any, message: str) -> None:
    with pytest.raises(imufast.InputError, match=message):
        call(mixed_axis, *pair)


def test_dead_sensors_give_a_status_not_an_exception(pair: Pair) -> None:
    imu1, imu2 = pair
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


@pytest.mark.xfail(strict=True, reason="bug: dead gyroscopes give CONVERGED with a bound of about 20 deg")
def test_dead_gyroscopes_are_not_identifiable(pair: Pair) -> None:
    still = np.zeros((500, 3))
    axis = estimate_hinge_axis(Imu(still, pair[0].acc, 50.0), Imu(still, pair[1].acc, 50.0))
    assert axis.status is SolveStatus.NOT_IDENTIFIABLE
