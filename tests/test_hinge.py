"""What calibrate_hinge says of simulated joints whose truth is known: verdicts, acceptance, bounds, signs."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from imufast import (
    HingeCalibration,
    HingeSimulation,
    HingeStep,
    Imu,
    InputError,
    Motion,
    SoftTissue,
    Verdict,
    calibrate_hinge,
    random_biases,
    simulate_hinge,
)
from numpy.typing import NDArray
from reference.compare import angle_deg
from test_hinge_stream import bits

Array = NDArray[np.float64]

HINGES = (Verdict.HINGE, Verdict.APPROXIMATE_HINGE)


def calibrate(sim: HingeSimulation, **settings: Any) -> HingeCalibration:
    return calibrate_hinge(sim.imu1, sim.imu2, **settings)


def truth(sim: HingeSimulation) -> tuple[Array, Array]:
    return sim.axis1, sim.axis2


def axes_of(result: HingeCalibration | HingeStep) -> tuple[Array, Array]:
    assert result.axis1 is not None
    assert result.axis2 is not None
    return result.axis1, result.axis2


def errors_deg(result: HingeCalibration | HingeStep, axis1: Array, axis2: Array) -> Array:
    """Angle of each axis to the truth, as a line."""
    found1, found2 = axes_of(result)
    return np.array([angle_deg(found1, axis1), angle_deg(found2, axis2)])


def paired_right(result: HingeCalibration | HingeStep, axis1: Array, axis2: Array) -> bool:
    found1, found2 = axes_of(result)
    return float((found1 @ axis1) * (found2 @ axis2)) > 0.0


def rotation(seed: int) -> Array:
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return np.asarray(q * np.linalg.det(q))


def one_after_another(*sims: HingeSimulation) -> tuple[Imu, Imu]:
    """Recordings joined without a gap."""
    gyr1, acc1, gyr2, acc2 = (np.concatenate([getattr(sim, name) for sim in sims]) for name in ("gyr1", "acc1", "gyr2", "acc2"))
    return Imu(gyr1, acc1, 50.0), Imu(gyr2, acc2, 50.0)


@cache
def mixed() -> HingeSimulation:
    return simulate_hinge("mixed", duration_s=40, seed=1)


@cache
def knee(seed: int = 0) -> HingeSimulation:
    return simulate_hinge("walking", duration_s=40, seed=seed, soft_tissue=SoftTissue())


def check_consistent(result: HingeCalibration, first_s: float = 0.0, last_s: float = np.inf) -> None:
    """What must hold for every result."""
    settings = result.settings
    assert result.accepted == (result.accepted_at_s is not None)
    if result.accepted:
        assert result.verdict in HINGES
        assert result.bound95_deg is not None
        limit = settings.max_error_deg if result.verdict is Verdict.HINGE else settings.max_error_approximate_deg
        assert result.bound95_deg.max() < limit
        assert result.why == ()
        # The moment of acceptance is the step at which the present accepted run began.
        assert result.accepted_at_s is not None
        assert first_s < result.accepted_at_s <= last_s
        before = [step.time_s for step in result.history if not step.accepted]
        run = [step.time_s for step in result.history if step.time_s > max(before, default=-np.inf)]
        assert result.accepted_at_s == run[0]
    else:
        assert result.why
    assert all(first_s < step.time_s <= last_s for step in result.history)
    if result.history:
        assert bits(result.history[-1].axis1) == bits(result.axis1)
        assert result.history[-1].verdict is result.verdict
        assert result.history[-1].accepted == result.accepted


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("kind", ["mixed", "free", "planar", "walking", "sit_to_stand"])
def test_hinges_that_move_are_accepted_with_the_right_axes(kind: str, seed: int) -> None:
    sim = simulate_hinge(kind, duration_s=40, seed=seed)
    result = calibrate(sim)
    check_consistent(result, 0.0, 40.0)
    assert result.verdict is Verdict.HINGE
    assert result.accepted
    assert result.accepted_at_s is not None
    assert result.accepted_at_s <= 30.0  # measured: 15 and 16 s, sit-to-stand (a rise every few seconds) 22 s
    assert (errors_deg(result, *truth(sim)) <= np.asarray(result.bound95_deg)).all()
    assert errors_deg(result, *truth(sim)).max() < 0.5  # measured: up to 0.4 deg in walking
    assert paired_right(result, *truth(sim))


def still_halves(duration_s: float, half: int) -> Motion:
    """Only segment 1 (half 0) or only segment 2 (half 1) turns; the other sensor rests."""
    motion = Motion("sequential", duration_s=2 * duration_s)
    return motion.stretch(half * duration_s, (half + 1) * duration_s)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(Motion("stationary", duration_s=40.0), id="stationary"),
        pytest.param(Motion("stiff", duration_s=40.0), id="stiff"),
        pytest.param(Motion("stiff", duration_s=40.0, tempo=2.5), id="stiff and fast"),
        pytest.param(Motion("mixed", duration_s=40.0).stretch(0.0, 4.0), id="four seconds"),
    ],
)
def test_what_cannot_tell_is_not_enough_information(motion: Motion, seed: int) -> None:
    result = calibrate(simulate_hinge(motion, seed=seed, **random_biases(seed, acc_m_s2=0.3)))
    check_consistent(result)
    assert result.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert not any(step.accepted for step in result.history)


@pytest.mark.parametrize("half", [0, 1])
def test_one_sensor_at_rest_is_never_enough(half: int) -> None:
    for seed in range(6):
        result = calibrate(simulate_hinge(still_halves(40.0, half), seed=seed, **random_biases(seed, acc_m_s2=0.3)))
        check_consistent(result)
        assert not any(step.accepted for step in result.history)


@pytest.mark.parametrize(("half", "seed"), [(0, 1), (0, 2), (1, 1)])
def test_one_sensor_at_rest_is_not_enough_information(half: int, seed: int) -> None:
    result = calibrate(simulate_hinge(still_halves(40.0, half), seed=seed, **random_biases(seed, acc_m_s2=0.3)))
    assert result.verdict is Verdict.NOT_ENOUGH_INFORMATION


@pytest.mark.parametrize("seed", range(6))
def test_segments_that_turn_one_after_the_other_do_not_tell_the_pairing(seed: int) -> None:
    # About a horizontal axis gravity does not tell it either; 17 deg of tilt are enough.
    assert calibrate(simulate_hinge("sequential", duration_s=60, seed=seed)).verdict is Verdict.NOT_ENOUGH_INFORMATION
    tilted = simulate_hinge(Motion("sequential", duration_s=60.0, axis_tilt_rad=0.3), seed=seed)
    result = calibrate(tilted)
    assert result.accepted
    assert paired_right(result, *truth(tilted))


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_a_gyroscope_bias_does_not_pair_the_axes(seed: int) -> None:
    sim = simulate_hinge("sequential", duration_s=60, seed=seed, **random_biases(seed, acc_m_s2=0.0))
    assert all(paired_right(step, *truth(sim)) for step in calibrate(sim).history if step.accepted)


@pytest.mark.parametrize("seed", [0, 14, 24])
def test_planar_motion_with_biases_is_never_accepted_with_the_wrong_pairing(seed: int) -> None:
    sim = simulate_hinge("planar", duration_s=60, seed=seed, **random_biases(seed))
    assert all(paired_right(step, *truth(sim)) for step in calibrate(sim).history if step.accepted)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("dof", [2, 3])
def test_free_motion_of_more_degrees_of_freedom_is_no_hinge(dof: Any, seed: int) -> None:
    result = calibrate(simulate_hinge("free", duration_s=60, seed=seed, dof=dof))  # misfit measured: 0.50-0.75
    check_consistent(result)
    assert result.verdict is Verdict.NOT_A_HINGE
    assert not any(step.accepted for step in result.history)
    # What is known best so far is shown all the same, with its wide bound.
    assert result.axis1 is not None
    assert result.bound95_deg is not None
    assert result.bound95_deg.min() > 20.0


@pytest.mark.parametrize("seed", range(4))
def test_a_second_freedom_that_appears_late_revokes_what_nobody_could_have_known_before(seed: int) -> None:
    # One joint with two degrees of freedom that for 40 s turns about one axis only: until then it is a hinge to anyone.
    sims = [simulate_hinge("free", duration_s=40, seed=seed, dof=2, extra_rad=extra) for extra in (0.0, 0.4)]
    honest, late = calibrate(sims[0]), calibrate_hinge(*one_after_another(*sims))
    assert honest.accepted
    assert honest.verdict is Verdict.HINGE
    check_consistent(late)
    assert late.verdict is Verdict.NOT_A_HINGE  # measured: from 3 to 13 s after the second axis begins to turn
    assert [step.accepted for step in late.history[:39]] == [step.accepted for step in honest.history]


def test_a_hinge_and_then_another_joint_is_revoked() -> None:
    sims = simulate_hinge("free", duration_s=40, seed=0), simulate_hinge("free", duration_s=60, seed=100, dof=3)
    result = calibrate_hinge(*one_after_another(*sims))
    assert any(step.accepted for step in result.history[:40])
    assert not result.accepted
    assert result.accepted_at_s is None
    assert result.verdict in (Verdict.NOT_A_HINGE, Verdict.MOUNTING_CHANGED)


def test_every_accepted_step_has_its_verdict_and_its_bound() -> None:
    sims = [simulate_hinge("free", duration_s=40, seed=0, dof=2, extra_rad=extra) for extra in (0.0, 0.4)]
    for step in calibrate_hinge(*one_after_another(*sims)).history:
        if step.accepted:
            assert step.verdict in HINGES
            assert step.bound95_deg is not None
            assert step.bound95_deg.max() < (3.0 if step.verdict is Verdict.HINGE else 12.0), step


@pytest.mark.parametrize("n_consistent", [2, 5, 10, 20])
def test_so_many_steps_agree_before_acceptance(n_consistent: int) -> None:
    result = calibrate(mixed(), n_consistent=n_consistent)
    first_good = next(step.time_s for step in result.history if step.verdict is Verdict.HINGE)
    assert result.accepted_at_s == first_good + n_consistent - 1  # the joint moves in every second


def test_acceptance_is_told_in_the_recordings_own_time() -> None:
    sim, result = mixed(), calibrate(mixed())
    for offset in (-100.0, 86400.0):
        late = calibrate_hinge(*(Imu(i.gyr, i.acc, time_s=offset + i.time_s) for i in (sim.imu1, sim.imu2)))
        check_consistent(late, offset, offset + 40.0)
        assert result.accepted_at_s is not None
        assert late.accepted_at_s == pytest.approx(offset + result.accepted_at_s, abs=1e-9)


@pytest.mark.parametrize("kind", ["mixed", "free", "planar", "walking"])
def test_the_sign_never_flips_inside_a_stream(kind: str) -> None:
    for seed in range(3):
        history = calibrate(simulate_hinge(kind, duration_s=40, seed=seed)).history
        axes = [(s.axis1, s.axis2) for s in history if s.axis1 is not None and s.axis2 is not None]
        assert len(axes) > 30
        for (before1, before2), (after1, after2) in pairwise(axes):
            assert before1 @ after1 + before2 @ after2 > 0.0
        told = [(s.axis1, s.axis2) for s in history if s.verdict in HINGES and s.axis1 is not None and s.axis2 is not None]
        for (before1, before2), (after1, after2) in pairwise(told):
            assert before1 @ after1 > 0.9
            assert before2 @ after2 > 0.9


# The paper's scenarios with motions of 20 s and biases of 1 deg/s and 1 m/s² (section 7.5), 30 seeds each. Measured: accepted
# 30, 30, 27, 30; all of them paired right and within the bound; largest error 0.08 deg, median bound 0.5 to 2.1 deg (it
# considers biases that were not there to hurt); accepted after 56, 115, 15 and 77 s (median).
@pytest.mark.parametrize("scenario", [*(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2)), 3, 4])
def test_bounds_hold_the_truth_in_the_papers_scenarios(scenario: Any) -> None:
    held = []
    for seed in range(30):
        sim = simulate_hinge(scenario=scenario, duration_s=20, seed=seed, **random_biases(seed))
        result = calibrate(sim)
        check_consistent(result)
        assert result.verdict in HINGES
        if result.accepted:
            assert paired_right(result, *truth(sim))
            held.append(bool((errors_deg(result, *truth(sim)) <= np.asarray(result.bound95_deg)).all()))
    assert len(held) >= 24
    assert np.mean(held) >= 0.9


@pytest.mark.parametrize("seed", range(4))
def test_a_knee_with_soft_tissue_is_an_approximate_hinge_and_paired_right(seed: int) -> None:
    result = calibrate(knee(seed))
    check_consistent(result)
    assert result.verdict in HINGES
    assert result.accepted
    assert paired_right(result, *truth(knee(seed)))
    assert errors_deg(result, *truth(knee(seed))).max() < 18.0  # measured: 15.4 and 4.0 deg


@pytest.mark.xfail(
    strict=True,
    reason="limit: the bound is of the axis that the skin shows; sliding skin turns it 15 deg off the bone, bound 5 (0 of 30)",
)
def test_the_bound_of_a_knee_with_soft_tissue_holds_the_bones_axis() -> None:
    results = [calibrate(knee(seed)) for seed in range(4)]
    errors = [errors_deg(result, *truth(knee(seed))) for seed, result in enumerate(results)]
    assert np.mean(np.array(errors) <= [np.asarray(result.bound95_deg) for result in results]) > 0.9


@pytest.mark.parametrize(
    "sim", [mixed, knee, lambda: simulate_hinge("free", duration_s=40, seed=3)], ids=["mixed", "knee", "free"]
)
def test_mountings_turn_the_axes_and_nothing_else(sim: Any) -> None:
    turn1, turn2 = rotation(1), rotation(2)
    imu1, imu2 = (Imu(i.gyr @ turn.T, i.acc @ turn.T, 50.0) for i, turn in ((sim().imu1, turn1), (sim().imu2, turn2)))
    plain, turned = calibrate(sim()), calibrate_hinge(imu1, imu2)
    assert [(s.verdict, s.accepted) for s in plain.history] == [(s.verdict, s.accepted) for s in turned.history]
    assert plain.accepted_at_s == turned.accepted_at_s
    np.testing.assert_allclose(np.asarray(turned.bound95_deg), np.asarray(plain.bound95_deg), atol=1e-6)
    axis1, axis2 = axes_of(plain)
    assert errors_deg(turned, turn1 @ axis1, turn2 @ axis2).max() < 1e-6
    assert paired_right(turned, turn1 @ axis1, turn2 @ axis2)


def test_exchanging_the_sensors_exchanges_the_axes() -> None:
    one, other = calibrate(mixed()), calibrate_hinge(mixed().imu2, mixed().imu1)
    assert one.accepted_at_s == other.accepted_at_s
    # Gyroscope samples whose scores tie at the edge of the selection are others.
    axis2, axis1 = axes_of(other)
    assert errors_deg(one, axis1, axis2).max() < 0.05


@pytest.mark.parametrize("seed", range(5))
def test_rest_shows_the_gyroscope_bias(seed: int) -> None:
    biases = random_biases(seed)
    motion = [Motion("stationary", duration_s=5.0), Motion("free", duration_s=20.0)]
    result = calibrate(simulate_hinge(motion, transition_s=0.0, seed=seed, **biases))
    for found, true in ((result.gyr_bias1, biases["gyr_bias1"]), (result.gyr_bias2, biases["gyr_bias2"])):
        assert found is not None
        assert np.degrees(np.linalg.norm(found - true)) < 0.1  # measured: up to 0.041 deg/s; the bias is 1 deg/s
    without = calibrate(simulate_hinge("free", duration_s=25, seed=seed, **biases))
    assert without.gyr_bias1 is None
    assert without.gyr_bias2 is None


def test_slow_turning_is_not_taken_for_rest() -> None:
    # 2 deg/s about a horizontal axis, as steady as a bias; gravity shows it. (About the vertical nothing would.)
    time, rate = np.arange(1000) / 50.0, np.radians(2.0)
    noise = np.random.default_rng(1).standard_normal((4, 1000, 3))
    angle = rate * time
    turning = np.column_stack([np.zeros(1000), 9.81 * np.sin(angle), 9.81 * np.cos(angle)])
    imu1 = Imu([rate, 0.0, 0.0] + 0.003 * noise[0], turning + 0.02 * noise[1], 50.0)
    imu2 = Imu([0.01, 0.0, 0.0] + 0.003 * noise[2], [0.0, 0.0, 9.81] + 0.02 * noise[3], 50.0)
    result = calibrate_hinge(imu1, imu2)
    assert result.gyr_bias1 is None
    np.testing.assert_allclose(np.asarray(result.gyr_bias2), np.array([0.01, 0.0, 0.0]), atol=5e-4)


def test_bias_from_rest_helps_and_can_be_left_out() -> None:
    sim = simulate_hinge("mixed", duration_s=40, seed=2, **random_biases(2, acc_m_s2=0.0))
    with_rest, without = calibrate(sim), calibrate(sim, bias_from_rest=False)
    assert with_rest.bound95_deg is not None
    assert without.bound95_deg is not None
    assert with_rest.bound95_deg.max() < without.bound95_deg.max()
    # What rest has shown is told either way.
    assert without.gyr_bias1 is not None


def test_what_is_no_pair_of_sensors_is_refused() -> None:
    sim = mixed()
    with pytest.raises(InputError, match="imu2"):
        calibrate_hinge(sim.imu1, sim.gyr2)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="same gyr data"):
        calibrate_hinge(sim.imu1, sim.imu1)
    with pytest.raises(InputError, match="1999"):
        calibrate_hinge(sim.imu1, sim.imu2[:1999])
    with pytest.raises(InputError, match="at least 4"):
        calibrate_hinge(sim.imu1[:3], sim.imu2[:3])
