"""The motions of the 2017 rig and random ones look as they are described; time stamps and losses do what they say."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
import pytest
from imufast.simulate import (
    BallJointSimulation,
    BallMotion,
    SoftTissue,
    paper_rig,
    paper_segment,
    random_biases,
    random_positions,
    random_tissue,
    simulate_ball_joint,
)
from imufast.simulate.checks import FloatArray
from laws import differ, rotation

SAMPLES = {"S1": 1354, "S2": 1132, "S3": 1625, "S4": 1372, "S5": 2213, "S6": 2666, "S7": 2698, "S8": 2159}


def rig(motion: Any, **more: Any) -> BallJointSimulation:
    return simulate_ball_joint(motion, **{**paper_rig(), **more})


def speed(gyr: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(gyr, axis=1))


def rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def test_the_experiment_has_the_papers_segments() -> None:
    s = rig(tuple(SAMPLES))
    assert [(name, len(list(rows))) for name, rows in groupby(s.motion)] == list(SAMPLES.items())
    assert len(s.time_s) == 15219
    assert [paper_segment(name).duration_s for name in SAMPLES] == [n / 100 for n in SAMPLES.values()]
    jumps = np.flatnonzero(np.diff(s.part))
    np.testing.assert_allclose(np.diff(s.time_s)[jumps], 1.01, atol=1e-9)
    np.testing.assert_allclose(np.delete(np.diff(s.time_s), jumps), 0.01, atol=1e-9)


def test_the_rig_has_the_papers_lever_arms() -> None:
    s = rig("S3")
    np.testing.assert_array_equal(s.joint_in_sensor1, [-0.334, 0.0, -0.028])
    np.testing.assert_array_equal(s.joint_in_sensor2, [0.325, 0.0, -0.028])
    assert s.dof == 2
    # The default is the same rig with sensors mounted at random.
    other = simulate_ball_joint("S3", mount1=[0, 0, 0, 1], mount2=[0, 0, 0, 1])
    np.testing.assert_allclose(other.joint_in_sensor1, s.joint_in_sensor1, atol=1e-15)
    np.testing.assert_allclose(other.joint_in_sensor2, s.joint_in_sensor2, atol=1e-15)


@pytest.mark.parametrize("segment", ["S1", "S8"])
def test_rest_is_rest(segment: str) -> None:
    s = rig(segment)
    assert not s.gyr1_true.any()
    assert not s.gyr2_true.any()
    np.testing.assert_allclose(speed(s.acc1_true), 9.81, rtol=1e-14)


def test_the_held_rig_hangs_and_hardly_moves() -> None:
    s = rig("S2")
    assert 0.0 < speed(s.gyr2_true).max() < 0.6
    for q in (s.q_1, s.q_2):
        assert rotation(q).apply([1.0, 0.0, 0.0])[:, 2].min() > 0.95  # the sensors' x points from link 2 up to link 1


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("segment", "axis"), [("S3", 1), ("S4", 2)])
def test_back_and_forth_is_mostly_about_one_axis_of_both_sensors(segment: str, axis: int, seed: int) -> None:
    s = rig(segment, seed=seed)
    for gyr in (s.gyr1_true, s.gyr2_true):
        sizes = rms(gyr)
        assert sizes[axis] > 2.5 * np.delete(sizes, axis).max()
        assert sizes[axis] > 1.0
    assert np.abs(s.joint_angles_rad).max() < 2.5


@pytest.mark.parametrize("seed", range(3))
def test_alternating_turns_about_one_axis_at_a_time(seed: int) -> None:
    s = rig("S5", seed=seed)
    y, z = np.abs(np.diff(s.joint_angles_rad[:, :2], axis=0)).T * 100.0
    size = [np.convolve(rate, np.ones(100) / 100.0, mode="valid") for rate in (y, z)]  # over about one stroke
    assert (size[0] > 5.0 * size[1]).mean() > 0.2
    assert (size[1] > 5.0 * size[0]).mean() > 0.2
    assert rms(y) > 0.8
    assert rms(z) > 0.8


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("segment", "sense"), [("S6", -1.0), ("S7", 1.0)])
def test_the_lower_link_goes_round_in_both_halves(segment: str, sense: float, seed: int) -> None:
    s = rig(segment, seed=seed)
    n = len(s.time_s)
    first, second = slice(200, n // 2 - 300), slice(n // 2 + 300, n - 200)
    # From the joint to the end of either link: the sensors' x points from link 2 to link 1.
    ends = {1: rotation(s.q_1).apply([1.0, 0.0, 0.0]), 2: rotation(s.q_2).apply([-1.0, 0.0, 0.0])}
    for half, lower, upper in ((first, 2, 1), (second, 1, 2)):
        assert ends[lower][half, 2].max() < -0.6
        assert ends[upper][half, 2].min() > 0.7
        # About the direction in which the held link points; positive is counterclockwise from above.
        across = ends[lower][half] + ends[upper][half]
        angle = np.unwrap(np.arctan2(across[:, 1], across[:, 0]))
        rounds = (angle[-1] - angle[0]) / (2.0 * np.pi)
        assert rounds * sense == pytest.approx(0.9 * (half.stop - half.start) / 100.0, rel=0.1)
        radius = np.hypot(across[:, 0], across[:, 1])
        assert radius.std() < 0.3 * radius.mean()
        moving = {1: s.gyr1_true, 2: s.gyr2_true}
        assert np.median(speed(moving[lower][half])) > 3.0 * np.median(speed(moving[upper][half]))


def test_about_as_much_of_the_experiment_is_fast_as_in_the_paper() -> None:
    """6280 of 10574 samples, 59 %, turned faster than 1.2 rad/s."""
    s = rig(("S3", "S4", "S5", "S6", "S7"))
    assert len(s.time_s) == 10574
    for gyr in (s.gyr1_true, s.gyr2_true):
        assert 0.4 < (speed(gyr) > 1.2).mean() < 0.7


@pytest.mark.parametrize("seed", range(5))
def test_random_motion_is_human_like_and_in_all_directions(seed: int) -> None:
    s = simulate_ball_joint("random", seed=seed)
    relative = rotation(s.q_12).inv().apply(s.gyr1_true) - s.gyr2_true
    for gyr in (s.gyr1_true, s.gyr2_true, relative):
        assert 1.5 < np.median(speed(gyr)) < 6.0
        assert speed(gyr).max() < 20.0
        assert np.linalg.svd(gyr, compute_uv=False)[-1] > 0.3 * np.linalg.svd(gyr, compute_uv=False)[0]
    assert speed(s.acc2_true).max() < 80.0
    assert (np.ptp(s.joint_position, axis=0) > 0.05).all()


def test_seeds_differ_in_frequency_and_size() -> None:
    found = [simulate_ball_joint("random", seed=seed) for seed in range(6)]
    assert np.std([rms(s.joint_angles_rad) for s in found], axis=0).min() > 0.02
    spectra = [np.abs(np.fft.rfft(s.joint_angles_rad[:, 0])).argmax() for s in found]
    assert len(set(spectra)) > 1


def test_mounts_are_random_rotations_and_positions_keep_their_distance() -> None:
    found = [simulate_ball_joint("S1", duration_s=1.0, seed=seed) for seed in range(20)]
    for s in found:
        for q in (s.q_1, s.q_2, s.q_12):
            np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, atol=1e-14)
            np.testing.assert_allclose(np.linalg.det(rotation(q).as_matrix()), 1.0, atol=1e-14)
        assert np.linalg.norm(s.joint_in_sensor1) == pytest.approx(np.hypot(0.334, 0.028))
    axes = np.array([[s.axis1, s.axis2] for s in found]).reshape(-1, 3)
    assert np.linalg.matrix_rank(axes) == 3
    assert np.abs(axes.mean(axis=0)).max() < 0.4


def test_what_is_drawn_for_a_call_fits_it() -> None:
    places, tissue = random_positions(3, least_m=0.1, most_m=0.2), random_tissue(3)
    s = simulate_ball_joint("S3", **places, **tissue, **random_biases(3))
    assert np.array_equal(s.joint_in_sensor2, places["joint_in_sensor2"])
    assert np.array_equal(s.tissue_matrix1, tissue["tissue_matrix1"])
    lengths = [np.linalg.norm(r) for seed in range(200) for r in random_positions(seed).values()]  # type: ignore[call-overload]
    assert 0.08 <= min(lengths) < 0.1
    assert 0.38 < max(lengths) <= 0.4


def test_random_tissue_has_the_papers_size() -> None:
    matrices = np.array([list(random_tissue(seed).values()) for seed in range(300)])
    assert matrices.std() == pytest.approx(0.018 / np.pi, rel=0.04)
    assert abs(matrices.mean()) < 0.0003
    assert np.array_equal(random_tissue(5)["tissue_matrix1"], random_tissue(5)["tissue_matrix1"])
    np.testing.assert_allclose(random_tissue(5, std_m_rad=1.0)["tissue_matrix2"], matrices[5, 1] * np.pi / 0.018)


@pytest.mark.parametrize("case", [{"motion": "random"}, {"motion": ("S4", "S5", "S6"), "soft_tissue": SoftTissue()}])
def test_irregular_times_see_the_same_motion(case: dict[str, Any]) -> None:
    regular = simulate_ball_joint(duration_s=10.0, **case)
    rows = np.sort(np.random.default_rng(0).choice(len(regular.time_s), 200, replace=False))
    irregular = simulate_ball_joint(duration_s=10.0, time_s=regular.time_s[rows], **case)
    assert irregular.rate_hz is None
    for name in ("gyr1_true", "acc2_true", "q_12", "joint_angles_rad", "joint_acc"):
        np.testing.assert_allclose(getattr(irregular, name), getattr(regular, name)[rows], atol=1e-9, rtol=0)


def test_given_times_lengthen_a_named_motion() -> None:
    assert len(simulate_ball_joint("S3", time_s=np.arange(0.0, 60.0, 0.5)).time_s) == 120
    longer = simulate_ball_joint("random", time_s=np.arange(0.0, 80.0, 0.5))
    assert longer.time_s[-1] == 79.5


def test_packet_loss_leaves_exactly_the_surviving_rows() -> None:
    full, lossy = (simulate_ball_joint(("S3", "S6"), packet_loss=loss, **random_tissue(1)) for loss in (0.0, 0.1))
    assert len(lossy.row) < len(full.row)
    for name in ("gyr1", "acc2", "tissue_acc1", "joint_angles_rad", "joint_acc", "time_s", "motion"):
        assert np.array_equal(getattr(lossy, name), getattr(full, name)[lossy.row]), name


def test_clock_offset_shifts_sensor_2_alone() -> None:
    base, late = (simulate_ball_joint("random", clock_offset_s=offset) for offset in (0.0, 0.01))
    for name in ("gyr2_true", "acc2_true", "gyr_rate2_true"):
        np.testing.assert_allclose(getattr(late, name)[:-1], getattr(base, name)[1:], atol=1e-9, rtol=0)
    for name in ("gyr1", "acc1", "q_1", "q_2", "q_12", "joint_acc"):
        assert np.array_equal(getattr(late, name), getattr(base, name))


def test_recordings_hold_the_readings() -> None:
    s = simulate_ball_joint("random")
    assert list(s.recording) == ["sensor1", "sensor2"]
    assert s.recording["sensor1"].rate_hz == s.rate_hz == 100.0
    assert np.array_equal(s.recording["sensor2"].gyr, s.gyr2)
    assert np.array_equal(s.imu1.acc, s.acc1)


def test_stretches_of_one_motion_are_pieces_of_the_same() -> None:
    motion = BallMotion("clockwise", duration_s=20.0)
    whole, piece = simulate_ball_joint(motion), simulate_ball_joint(motion.stretch(5.0, 15.0))
    assert differ(piece.gyr1_true, whole.gyr1_true[500:1500]) < 1e-11
