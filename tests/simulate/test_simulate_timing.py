"""Motions and scenarios have the paper's composition; time stamps, lost packets and clock offsets do what they say."""

from __future__ import annotations

from dataclasses import fields
from itertools import groupby
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast.simulate import HingeSimulation, Motion, SoftTissue, scenario_motions, simulate_hinge
from imufast.simulate.checks import FloatArray
from imufast.simulate.so3 import rotate

TRUTH = ("gyr1_true", "acc1_true", "gyr2_true", "acc2_true", "q_1", "q_2", "q_12", "angle_rad", "angle_rate", "joint_position")


def per_row(s: HingeSimulation) -> list[str]:
    return [f.name for f in fields(s) if np.ndim(getattr(s, f.name)) >= 1 and len(getattr(s, f.name)) == len(s.time_s)]


def tilt_deg(s: HingeSimulation) -> FloatArray:
    """Angle between the hinge axis and the horizontal plane, (N,)."""
    return np.asarray(np.degrees(np.arcsin(rotate(s.q_1, s.axis1)[:, 2])))


def speed(gyr: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((gyr**2).sum(axis=1)))


@pytest.mark.parametrize("number", [1, 8])
def test_stationary_motions_rest(number: int) -> None:
    s = simulate_hinge(number)
    assert speed(s.gyr1_true).max() == 0.0
    assert speed(s.gyr2_true).max() == 0.0
    np.testing.assert_allclose(np.linalg.norm(s.acc1_true, axis=1), 9.81, rtol=1e-14)
    assert (s.acc2_true == s.acc2_true[0]).all()


@pytest.mark.parametrize("number", [2, 9])
def test_stiff_motions_turn_freely_as_one_body(number: int) -> None:
    s = simulate_hinge(number)
    assert np.ptp(s.angle_rad) == 0.0
    assert (np.linalg.svd(s.gyr1_true, compute_uv=False) > 10.0).all()
    assert np.ptp(tilt_deg(s)) > 60.0


@pytest.mark.parametrize("number", [3, 4, 10, 11])
def test_sequential_motions_turn_one_segment_at_a_time(number: int) -> None:
    s = simulate_hinge(number)
    first = s.time_s < 25.0
    # What rests is the difference of equal angles: zero to rounding.
    assert speed(s.gyr2_true[first]).max() < 1e-13
    assert speed(s.gyr1_true[~first]).max() < 1e-13
    assert np.median(speed(s.gyr1_true[first])) > 0.5
    assert np.median(speed(s.gyr2_true[~first])) > 0.5
    assert np.ptp(s.joint_position, axis=0).max() == 0.0


@pytest.mark.parametrize("number", [3, 5, 10, 12])
def test_horizontal_axes_are_horizontal(number: int) -> None:
    assert np.abs(tilt_deg(simulate_hinge(number))).max() < 1e-12


@pytest.mark.parametrize("number", [4, 6, 11, 13])
def test_tilted_axes_keep_45_degrees(number: int) -> None:
    np.testing.assert_allclose(tilt_deg(simulate_hinge(number)), 45.0, atol=1e-12)


@pytest.mark.parametrize("number", [5, 6, 12, 13])
def test_planar_motions_turn_both_segments_about_the_axis(number: int) -> None:
    s = simulate_hinge(number)
    assert speed(np.cross(s.gyr1_true, s.axis1)).max() < 1e-13
    assert np.ptp(rotate(s.q_1, s.axis1), axis=0).max() < 1e-13
    assert min(np.median(speed(s.gyr1_true)), np.median(speed(s.gyr2_true))) > 0.5


@pytest.mark.parametrize("number", [7, 14])
def test_free_motions_turn_everything(number: int) -> None:
    s = simulate_hinge(number)
    assert np.ptp(s.angle_rad) > 1.0
    assert np.ptp(tilt_deg(s)) > 60.0


@pytest.mark.parametrize("number", range(2, 8))
def test_fast_motions_are_the_same_but_faster(number: int) -> None:
    slow, fast = simulate_hinge(number), simulate_hinge(number + 7)
    ratio = np.sqrt((fast.gyr1_true**2).mean() / (slow.gyr1_true**2).mean())
    assert 1.7 < ratio < 3.7
    assert speed(fast.gyr2_true).max() < 35.0


def test_walking_looks_like_walking() -> None:
    s = simulate_hinge("walking", duration_s=40.0, rate_hz=100.0)  # 38 whole strides
    knee = np.degrees(s.angle_rad)
    assert 0.0 < knee.min() < 10.0
    assert 55.0 < knee.max() < 75.0
    spectrum = np.abs(np.fft.rfft(knee - knee.mean()))
    assert np.fft.rfftfreq(len(knee), 0.01)[spectrum.argmax()] == pytest.approx(0.95)
    assert 20.0 < np.linalg.norm(s.acc1_true, axis=1).max() < 60.0
    assert np.linalg.norm(s.joint_position[-1] - s.joint_position[0]) == pytest.approx(1.3 * 40, rel=0.05)


def test_sit_to_stand_bends_the_knee_to_a_right_angle() -> None:
    knee = np.degrees(simulate_hinge("sit_to_stand").angle_rad)
    assert -5.0 < knee.min() < 10.0
    assert 85.0 < knee.max() < 110.0


COMPOSITION = {
    1: [(k, 50) for k in range(1, 15)],
    2: [(1, 50), (3, 10), (10, 10)] + [(k, 50) for k in (8, 2, 9, 3, 10, 4, 11, 5, 12, 6, 13, 7, 14)],
    3: [(6, 20), (1, 50), (8, 50), (2, 50), (9, 50)],
    4: [(1, 50), (8, 50), (2, 25), (9, 25), (6, 20), (2, 25), (9, 25)],
}


@pytest.mark.parametrize("scenario", [1, 2, 3, 4])
def test_scenarios_have_the_papers_composition(scenario: Any) -> None:
    s = simulate_hinge(scenario=scenario)
    runs = [(int(label), len(list(rows))) for (label, _), rows in groupby(zip(s.motion, s.part, strict=True))]
    assert runs == [(motion, 50 * seconds) for motion, seconds in COMPOSITION[scenario]]
    # Between motions there is a second in which nothing was recorded, and nowhere else.
    jumps = np.flatnonzero(np.diff(s.part))
    np.testing.assert_allclose(np.diff(s.time_s)[jumps], 1.02, atol=1e-9)
    np.testing.assert_allclose(np.delete(np.diff(s.time_s), jumps), 0.02, atol=1e-9)
    assert [m.recorded_s for m in scenario_motions(scenario)] == [seconds for _, seconds in COMPOSITION[scenario]]


def test_stretches_of_one_motion_are_pieces_of_the_same() -> None:
    """Scenario 4 halves motions 2 and 9; scenario 2 takes 10 s of motion 3 before all of it."""
    whole, four, two = simulate_hinge(2), simulate_hinge(scenario=4), simulate_hinge(scenario=2)
    halves = np.concatenate([four.gyr1_true[four.part == 2], four.gyr1_true[four.part == 5]])
    np.testing.assert_allclose(halves, whole.gyr1_true, atol=1e-11)
    np.testing.assert_allclose(two.gyr1_true[two.part == 1], two.gyr1_true[two.part == 6][:500], atol=1e-12)
    alone = (two.part == 1) | (two.part == 2)
    assert speed(two.gyr2_true[alone]).max() < 1e-13
    assert np.median(speed(two.gyr1_true[alone])) > 0.5


def test_motions_without_transitions_abut() -> None:
    s = simulate_hinge([1, 2, Motion("planar", duration_s=3.0)], duration_s=4.0, transition_s=0.0)
    assert s.rate_hz == 50.0
    assert len(s.time_s) == 550
    assert list(dict.fromkeys(s.motion.tolist())) == ["1", "2", "planar"]


@pytest.mark.parametrize("case", [{"motion": 7}, {"motion": "walking", "soft_tissue": SoftTissue()}, {"motion": [1, 3, 7]}])
def test_irregular_times_see_the_same_motion(case: dict[str, Any]) -> None:
    regular = simulate_hinge(duration_s=20.0, **case)
    rows = np.sort(np.random.default_rng(0).choice(len(regular.time_s), 200, replace=False))
    irregular = simulate_hinge(duration_s=20.0, time_s=regular.time_s[rows], **case)
    assert irregular.rate_hz is None
    assert np.array_equal(irregular.time_s, regular.time_s[rows])
    for name in (*TRUTH, "motion", "part"):
        found, expected = getattr(irregular, name), getattr(regular, name)[rows]
        if name in ("motion", "part"):
            assert np.array_equal(found, expected)
        else:
            np.testing.assert_allclose(found, expected, atol=1e-9, rtol=0)


def test_given_times_in_a_transition_yield_no_sample() -> None:
    s = simulate_hinge([1, 2], duration_s=5.0, time_s=np.arange(0.0, 11.0, 0.25))
    inside = (np.arange(0.0, 11.0, 0.25) < 5.0) | (np.arange(0.0, 11.0, 0.25) >= 6.0)
    assert np.array_equal(s.time_s, np.arange(0.0, 11.0, 0.25)[inside])


@given(loss=st.floats(0.001, 0.4), burst=st.floats(1.0, 20.0), seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_packet_loss_leaves_exactly_the_surviving_rows(loss: float, burst: float, seed: int) -> None:
    full = simulate_hinge("walking", duration_s=10.0, seed=seed)
    lossy = simulate_hinge("walking", duration_s=10.0, seed=seed, packet_loss=loss, burst_length=burst)
    assert (np.diff(lossy.row) > 0).all()
    for name in per_row(full):
        assert np.array_equal(getattr(lossy, name), getattr(full, name)[lossy.row]), name
    assert lossy.rate_hz == (50.0 if len(lossy.row) == len(full.row) else None)


@pytest.mark.parametrize(("loss", "burst"), [(0.02, 1.0), (0.1, 3.0), (0.3, 8.0)])
def test_packets_are_lost_in_the_stated_number_and_bursts(loss: float, burst: float) -> None:
    s = simulate_hinge("stationary", duration_s=2000.0, packet_loss=loss, burst_length=burst)
    kept = len(s.row) / 100_000
    assert kept == pytest.approx((1 - loss) ** 2, abs=0.03)
    missing = np.diff(s.row) - 1
    assert missing[missing > 0].mean() >= 0.9 * burst


def test_a_recording_with_losses_has_gaps_in_time() -> None:
    s = simulate_hinge("walking", duration_s=20.0, packet_loss=0.05)
    assert s.recording["sensor1"].lost == s.row[-1] + 1 - s.row[0] - len(s.row)
    assert np.array_equal(s.recording.time_s, s.time_s)


def test_clock_offset_shifts_sensor_2_alone() -> None:
    step = 0.02
    base = simulate_hinge("walking", soft_tissue=SoftTissue())
    late = simulate_hinge("walking", soft_tissue=SoftTissue(), clock_offset_s=step)
    for name in ("gyr2_true", "acc2_true"):
        np.testing.assert_allclose(getattr(late, name)[:-1], getattr(base, name)[1:], atol=1e-9, rtol=0)
    for name in ("gyr1", "acc1", "q_1", "q_2", "q_12", "angle_rad", "time_s"):
        assert np.array_equal(getattr(late, name), getattr(base, name))


@pytest.mark.parametrize("motion", ["mixed", 1, 14, "walking", "sit_to_stand"])
def test_recordings_hold_the_readings(motion: Any) -> None:
    s = simulate_hinge(motion, rate_hz=100.0, soft_tissue=SoftTissue())
    assert list(s.recording) == ["sensor1", "sensor2"]
    assert s.recording["sensor1"].rate_hz == s.rate_hz == 100.0
    assert np.array_equal(s.recording["sensor2"].gyr, s.gyr2)
    assert np.array_equal(s.imu1.acc, s.acc1)
    np.testing.assert_allclose(s.imu1.time_s, s.time_s, rtol=0, atol=1e-12)
