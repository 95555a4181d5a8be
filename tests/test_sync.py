"""The time offset between two sensors: sign, size, doubt, and when it must not be believed."""

from __future__ import annotations

from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast.simulate import simulate_hinge
from imufast.sync import TimeOffset, time_offset

MOTIONS = ("mixed", "free", "stiff", "walking", "sit_to_stand", 14)


def offset_of(simulation: imufast.HingeSimulation) -> TimeOffset:
    return time_offset(simulation.imu1, simulation.imu2)


@pytest.mark.parametrize("rate_hz", [30.0, 50.0, 100.0, 200.0])
@pytest.mark.parametrize("motion", MOTIONS)
def test_half_a_sample_is_found_within_a_sixth(motion: int | str, rate_hz: float) -> None:
    for offset in (-0.5, 0.0, 0.5):
        found = offset_of(simulate_hinge(motion, duration_s=40, rate_hz=rate_hz, clock_offset_s=offset / rate_hz, seed=3))
        assert found.determined
        assert found.samples is not None
        assert found.std_s is not None
        assert found.samples == pytest.approx(offset, abs=0.15)
        assert abs(found.samples - offset) < max(5 * found.std_s * rate_hz, 0.01)


@pytest.mark.parametrize("offset_s", [-0.31, -0.05, 0.0137, 0.2])
def test_large_offsets_are_found_and_significant(offset_s: float) -> None:
    found = offset_of(simulate_hinge("mixed", rate_hz=100, clock_offset_s=offset_s))
    assert found.offset_s == pytest.approx(offset_s, abs=0.001)
    assert found.significant


def test_sign_positive_means_sensor_2_samples_late() -> None:
    """Rows of sensor 2 pushed down by three: what it read then now stands at a later stamp, so it samples early."""
    s = simulate_hinge("free", rate_hz=50)
    imu1 = imufast.Imu(s.gyr1[3:], s.acc1[3:], rate_hz=50, name="1")
    imu2 = imufast.Imu(s.gyr2[:-3], s.acc2[:-3], rate_hz=50, name="2")
    found = time_offset(imu1, imu2)
    assert found.samples == pytest.approx(-3.0, abs=0.05)
    swapped = time_offset(imu2, imu1)
    assert swapped.samples == pytest.approx(3.0, abs=0.05)


def test_adding_the_offset_to_the_stamps_of_sensor_2_removes_it() -> None:
    s = simulate_hinge("mixed", rate_hz=100, clock_offset_s=0.033)
    found = offset_of(s)
    assert found.offset_s is not None
    moved = imufast.Imu(s.gyr2, s.acc2, time_s=s.time_s + found.offset_s, name="2")
    with pytest.warns(imufast.ImufastWarning, match="interpolated"):
        joined = imufast.align([s.imu1, moved])
    assert abs(time_offset(*joined.pair()).offset_s or 0.0) < 5e-4


@pytest.mark.parametrize("motion", ["stationary", "planar", "sequential"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_motion_that_cannot_tell_is_not_believed(motion: str, seed: int) -> None:
    for noise in (1e-6, 0.005):
        found = offset_of(simulate_hinge(motion, duration_s=40, rate_hz=100, seed=seed, gyr_noise=noise, clock_offset_s=0.02))
        assert not found.determined
        assert not found.significant


def test_an_offset_outside_the_range_is_not_believed() -> None:
    s = simulate_hinge("free", rate_hz=50, clock_offset_s=0.7)
    assert not time_offset(s.imu1, s.imu2, max_offset_s=0.3).significant
    assert time_offset(s.imu1, s.imu2, max_offset_s=1.0).offset_s == pytest.approx(0.7, abs=0.001)


def test_packet_loss_and_biases_are_survived() -> None:
    s = simulate_hinge("mixed", rate_hz=100, packet_loss=0.02, clock_offset_s=0.006, **imufast.random_biases(3))
    found = offset_of(s)
    assert found.samples == pytest.approx(0.6, abs=0.15)


@pytest.mark.parametrize("samples", [4, 20, 200])
def test_short_recordings_give_none_and_no_exception(samples: int) -> None:
    s = simulate_hinge("mixed", rate_hz=50)
    found = time_offset(s.imu1[:samples], s.imu2[:samples])
    assert found.offset_s is found.std_s is found.samples is None
    assert not found.determined
    assert not found.significant


def test_a_long_recording_costs_no_more_than_its_best_minute() -> None:
    s = simulate_hinge("mixed", duration_s=600, rate_hz=50, clock_offset_s=0.01)
    assert offset_of(s).samples == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), 11.0, "0.5", True, None])
def test_wrong_range_is_refused_by_name(wrong: object) -> None:
    s = simulate_hinge("mixed", duration_s=10)
    with pytest.raises(imufast.InputError, match="max_offset_s"):
        time_offset(s.imu1, s.imu2, wrong)  # type: ignore[arg-type]


def test_real_hinges_are_synchronous_and_other_joints_do_not_raise_a_false_alarm(shared_data: Path) -> None:
    files = sorted((shared_data / "two_imu_joint").glob("*.npz"))
    assert files
    for file in files:
        found = time_offset(*imufast.read(file).pair())
        assert not found.significant, file.name
        if file.name.startswith("1D"):
            assert found.determined
            assert found.samples == pytest.approx(0.0, abs=0.15)


def test_a_walking_person_raises_no_false_alarm_but_a_large_offset_does(shared_data: Path) -> None:
    walk = imufast.read(shared_data / "lower_body" / "full_body_walk.npz")
    for side in ("left", "right"):
        for first, second in (("upper_leg", "lower_leg"), ("lower_leg", "foot")):
            imu1, imu2 = walk.pair(f"{first}_{side}", f"{second}_{side}")
            found = time_offset(imu1, imu2)
            assert not found.significant
            # What soft tissue feigns; documented in docs/reading.md.
            assert found.offset_s is not None
            assert 0.009 < found.offset_s < 0.06
    late = imufast.Imu(imu2.gyr[30:], imu2.acc[30:], rate_hz=100, name="late")
    found = time_offset(imu1[:-30], late)
    assert found.significant
    assert found.offset_s == pytest.approx(0.3, abs=0.03)


def test_the_result_is_deterministic() -> None:
    s = simulate_hinge("walking", rate_hz=100)
    assert offset_of(s) == offset_of(s)
    assert np.isfinite(offset_of(s).agreement)
