"""Algorithm 1 on simulated recordings: truth, an independent oracle, starts, laws, the low-pass."""

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
from reference.compare import INFORMATIVE, angle_deg, error_deg, estimate

Array = NDArray[np.float64]

# Fast simulated motion and dead sensors look odd to an Imu, which says so; that is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")

# Only accelerations along the axis tell the two sign pairings apart. Where a horizontal axis rests (3, 10) there are none.
SIGN_IS_TOLD = (4, 5, 6, 7, 11, 12, 13)


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
    reason="limit of the published method: in fast free motion the sensors' own rotation, which eq. 18 leaves out, drowns what "
    "tells the sign (costs of the two pairings within 5 to 50 %); 2 of the first 4 seeds are paired wrongly",
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
    "sit_to_stand, soft tissue": lambda: simulate_hinge("sit_to_stand", duration_s=20, seed=1, soft_tissue=SoftTissue()),
    "walking, soft tissue": lambda: simulate_hinge("walking", duration_s=20, seed=1, soft_tissue=SoftTissue()),
    "scenario 1, soft tissue": lambda: simulate_hinge(scenario=1, duration_s=20, seed=1, soft_tissue=SoftTissue()),
    "mixed, biases": lambda: simulate_hinge("mixed", duration_s=20, seed=1, **imufast.random_biases(5)),
    "scenario 3, biases": lambda: simulate_hinge(scenario=3, duration_s=20, seed=1, **imufast.random_biases(5)),
    "mixed, 2 dof": lambda: simulate_hinge("mixed", duration_s=20, seed=1, dof=2),
    "mixed, 3 dof": lambda: simulate_hinge("mixed", duration_s=20, seed=1, dof=3),
    "scenario 1, 2 dof": lambda: simulate_hinge(scenario=1, duration_s=20, seed=1, dof=2),
    "scenario 4, 3 dof": lambda: simulate_hinge(scenario=4, duration_s=20, seed=1, dof=3),
}


def no_better_by_luck(simulation: HingeSimulation, starts: int = 200) -> None:
    # Random starts descend on all samples, each from where it was drawn. Descents end at steps of 1e-7 rad, which on the
    # best data still is a few 1e-9 of the cost; the same axes are as good as the same cost.
    ours = estimate(simulation)
    lucky = estimate(simulation, starts="random", random_starts=starts, seed=1)
    same = max(angle_deg(ours.axis1, lucky.axis1), angle_deg(ours.axis2, lucky.axis2)) < 1e-4
    above = ours.cost / lucky.cost - 1.0
    assert above < (1e-7 if same else 1e-9), f"{above:.2e} above the best of {starts} random starts"


@pytest.mark.parametrize("name", SIMULATIONS)
def test_200_random_starts_find_nothing_better(name: str) -> None:
    no_better_by_luck(SIMULATIONS[name]())


@pytest.mark.parametrize("dof", [2, 3])
def test_200_random_starts_find_nothing_better_where_a_joint_is_no_hinge(dof: Any) -> None:
    no_better_by_luck(simulate_hinge(scenario=2, duration_s=20, seed=1, dof=dof))


@pytest.mark.parametrize(
    "given", [{"motion": "mixed"}, {"motion": "mixed", "dof": 3}, {"motion": "walking", "soft_tissue": SoftTissue()}]
)
def test_random_starts_find_nothing_better_where_the_deterministic_ones_walk_on_few_samples_first(given: Any) -> None:
    # Above 4096 samples the valleys are found on some of them.
    simulation = simulate_hinge(**given, duration_s=50, rate_hz=100, seed=1)
    assert len(simulation.time_s) == 5000
    no_better_by_luck(simulation, starts=30)


def test_a_rare_movement_in_a_long_rest_is_found() -> None:
    # The walk on few samples must not step over it: 3 s of movement in 10 minutes of rest.
    worn: dict[str, Any] = {"mount1": [0.8, 0.0, 0.6, 0.0], "mount2": [0.6, 0.8, 0.0, 0.0]}
    rest = simulate_hinge("stationary", duration_s=600, seed=1, **worn)
    moving = simulate_hinge("mixed", duration_s=20, seed=4, **worn)
    imu1, imu2 = (
        Imu(
            np.vstack([quiet.gyr[:17000], lively.gyr[400:550], quiet.gyr[17150:]]),
            np.vstack([quiet.acc[:17000], lively.acc[400:550], quiet.acc[17150:]]),
            50.0,
            name=quiet.name,
        )
        for quiet, lively in ((rest.imu1, moving.imu1), (rest.imu2, moving.imu2))
    )
    axis = estimate_hinge_axis(imu1, imu2)
    assert axis.n_gyr == 30_000
    assert error_deg(axis, moving).max() < 1.0


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
    fit = _core.hinge_axis(gyr1, acc1, gyr2, acc2, time_s, None, None, 50.0, None, imufast.AxisSettings().max_iterations)
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
