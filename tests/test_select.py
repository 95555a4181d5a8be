"""Algorithms 2 and 3: the streaming selection chooses exactly what the literal one does."""

from __future__ import annotations

from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import Imu, Motion, SampleSelection, calibrate_hinge, estimate_hinge_axis, select_samples, simulate_hinge
from numpy.typing import NDArray
from reference import selection as reference

Array = NDArray[np.float64]

WINDOW = 21  # samples in all: 0.42 s at 50 Hz

# The real files repeat a few rows where packets were lost; that the Imu says so is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")


@cache
def simulated(kind: str) -> tuple[Imu, Imu]:
    if kind == "irregular":
        steps = np.random.default_rng(4).uniform(0.6, 1.4, 1000) / 50.0
        sim = simulate_hinge("mixed", time_s=np.cumsum(steps), seed=4)
    elif kind == "gaps":
        sim = simulate_hinge("mixed", duration_s=30, seed=5, packet_loss=0.02, burst_length=6.0)
    elif kind == "parts":
        sim = simulate_hinge([3, 1, Motion("planar", duration_s=8.0)], duration_s=8, seed=6)
    else:
        sim = simulate_hinge(kind, duration_s=20, seed=7)
    return sim.imu1, sim.imu2


def real(data: Path, name: str, rows: slice = slice(None)) -> tuple[Imu, Imu]:
    path = data / "two_imu_joint" / f"{name}.npz"
    if not path.is_file():
        pytest.skip(f"the real recording {name} is missing (set IMUFAST_DATA)")
    with np.load(path) as z:
        first, second = (Imu(z[f"gyr{i}"][rows], z[f"acc{i}"][rows], rate_hz=50.0) for i in (1, 2))
    return first, second


def check_against_the_literal_algorithms(
    pair: tuple[Imu, Imu], max_samples: int, energy_threshold: float = 1.0, length: int = WINDOW
) -> SampleSelection:
    imu1, imu2 = pair
    rate = imu1.rate_hz
    got = select_samples(*pair, max_samples=max_samples, window_s=length / rate, energy_threshold=energy_threshold)
    assert len(imu1) > max_samples, "the algorithms would return at once"
    candidates = reference.middles(imu1.time_s, rate, length)
    np.testing.assert_allclose(got.gyr_score, reference.gyr_scores(imu1.gyr, imu2.gyr, candidates, length), atol=1e-14)
    # Sums in another order: the last bits differ.
    np.testing.assert_allclose(got.acc_score, reference.acc_scores(imu1.gyr, imu2.gyr, candidates, length), rtol=1e-12)
    # So the order is judged by the scores that were used, which the lines above have shown to be right.
    np.testing.assert_array_equal(got.gyr_index, reference.algorithm_2(got.gyr_score, candidates, max_samples))
    expected = reference.algorithm_3(imu1.acc, imu2.acc, got.acc_score, candidates, max_samples, energy_threshold)
    np.testing.assert_array_equal(got.acc_index, expected)
    np.testing.assert_array_equal(got.time_s, imu1.time_s)
    return got


@pytest.mark.parametrize("kind", ["mixed", "sequential", "stiff", "stationary", "irregular", "gaps", "parts"])
def test_simulations_are_selected_as_the_literal_algorithms_select(kind: str) -> None:
    pair = simulated(kind)
    check_against_the_literal_algorithms(pair, 200)
    check_against_the_literal_algorithms(pair, 37, energy_threshold=0.3, length=5)


@pytest.mark.parametrize("name", ["1D_02", "2D_01", "3D_01"])
def test_recordings_are_selected_as_the_literal_algorithms_select(shared_data: Path, name: str) -> None:
    check_against_the_literal_algorithms(real(shared_data, name, slice(0, 1000)), 150)


def test_pruning_waits_for_all_candidates() -> None:
    sim = simulate_hinge([3, 10], duration_s=25, seed=1)  # 2460 candidates, of which 1000 remain
    check_against_the_literal_algorithms((sim.imu1, sim.imu2), 1000)


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", ["1D_01", "1D_04", "2D_05", "3D_04"])
def test_whole_recordings_are_selected_as_the_literal_algorithms_select(shared_data: Path, name: str) -> None:
    got = check_against_the_literal_algorithms(real(shared_data, name), 1000)
    # Quiet candidates: 182, 4768, 6826, 5185.
    assert len(got.gyr_index) == 1000
    assert len(got.acc_index) == min(1000, int((got.acc_score <= 1.0).sum()))


@pytest.mark.parametrize("max_samples", [4, 5, 10, 57, 200])
def test_ties_are_settled_as_in_the_literal_algorithms(max_samples: int) -> None:
    # Rates of one axis in halves: differences, squares and their sums are exact, so scores tie in crowds.
    rng = np.random.default_rng(8)
    gyr1, gyr2 = np.zeros((300, 3)), np.zeros((300, 3))
    gyr1[:, 2], gyr2[:, 0] = rng.integers(0, 3, 300) / 2, rng.integers(0, 3, 300) / 2
    acc = rng.integers(-1, 2, (2, 300, 3)) + np.array([0.0, 0.0, 9.0])
    imu1, imu2 = Imu(gyr1, acc[0], 50.0), Imu(gyr2, acc[1], 50.0)
    got = check_against_the_literal_algorithms((imu1, imu2), max_samples, length=3)
    assert len(np.unique(got.gyr_score)) < 10
    assert len(np.unique(got.acc_score)) < 20


def test_where_coherence_is_spread_evenly_the_worst_score_goes() -> None:
    # Every combination of signs, one channel a little louder: the leading direction is that channel's, and no row has more
    # than 1.1/√6.21 = 0.44 of its length in it.
    signs = np.array(list(product((-1.0, 1.0), repeat=6)) * 4) * 5.66
    signs[:, 0] *= 1.1
    signs = np.random.default_rng(9).permutation(signs)
    assert (reference.coherence(signs) < 0.5).all()
    gyr = np.random.default_rng(10).uniform(-0.4, 0.4, (2, len(signs), 3))
    pair = Imu(gyr[0], signs[:, :3], 50.0), Imu(gyr[1], -signs[:, 3:], 50.0)
    # With windows of one sample every row is a candidate and the first round sees exactly the rows above.
    got = check_against_the_literal_algorithms(pair, len(signs) - 1, length=1)
    assert set(range(len(signs))) - set(got.acc_index.tolist()) == {int(np.argmax(got.acc_score))}
    check_against_the_literal_algorithms(pair, 60, length=1)


def test_the_window_has_21_samples_in_all() -> None:
    imu1, imu2 = simulated("free")
    before = select_samples(imu1, imu2, max_samples=100)
    louder = imu1.gyr.copy()
    louder[400] *= 3.0
    after = select_samples(Imu(louder, imu1.acc, 50.0), Imu(imu2.gyr * 1.0, imu2.acc, 50.0), max_samples=100)
    assert after.acc_score[390:411].shape == (21,)
    energy = np.array([[np.mean(np.sum(g[k - 10 : k + 11] ** 2, axis=1)) for g in (louder, imu2.gyr)] for k in range(385, 416)])
    np.testing.assert_allclose(after.acc_score[385:416], energy.min(axis=1), rtol=1e-12)
    same = np.arange(len(imu1))[(before.acc_score == after.acc_score) & (before.gyr_score == after.gyr_score)]
    assert set(range(390)) | set(range(411, len(imu1))) <= set(same.tolist())


@pytest.mark.parametrize("kind", ["free", "gaps", "parts"])
def test_samples_without_a_whole_window_are_never_chosen(kind: str) -> None:
    imu1, imu2 = simulated(kind)
    # More is allowed than there are candidates: everything that may be chosen is.
    got = select_samples(imu1, imu2, max_samples=len(imu1) - 1, energy_threshold=1e9)
    inside = [np.arange(a + 10, b - 10) for a, b in imu1.segments()]
    expected = np.concatenate([rows for rows in inside if len(rows)])
    np.testing.assert_array_equal(got.gyr_index, expected)
    np.testing.assert_array_equal(got.acc_index, expected)
    outside = np.setdiff1d(np.arange(len(imu1)), expected)
    assert (got.gyr_score[outside] == 0.0).all()
    assert np.isinf(got.acc_score[outside]).all()


def test_no_score_reaches_across_a_break() -> None:
    imu1, imu2 = simulated("gaps")
    whole = select_samples(imu1, imu2, max_samples=100)
    assert len(imu1.segments()) > 5
    for start, stop in imu1.segments():
        if stop - start > 4 + 2 * 10:
            alone = select_samples(imu1[start:stop], imu2[start:stop], max_samples=20)
            np.testing.assert_array_equal(alone.gyr_score, whole.gyr_score[start:stop])
            np.testing.assert_allclose(alone.acc_score, whole.acc_score[start:stop], rtol=1e-13)


def test_one_missing_sample_is_no_break_and_two_are() -> None:
    imu1, imu2 = simulated("free")
    time = np.arange(len(imu1)) / 50.0
    for missing, broken in ((1, False), (2, True)):
        late = time.copy()
        late[500:] += missing / 50.0
        pair = [Imu(imu.gyr, imu.acc, time_s=late) for imu in (imu1, imu2)]
        got = select_samples(pair[0], pair[1], max_samples=100)
        assert np.isinf(got.acc_score[490:510]).all() == broken
        assert np.isinf(got.acc_score[10:-10]).any() == broken


def test_a_short_recording_keeps_all_of_itself() -> None:
    imu1, imu2 = simulated("mixed")
    got = select_samples(imu1, imu2)
    assert len(imu1) <= 1000
    np.testing.assert_array_equal(got.gyr_index, np.arange(len(imu1)))
    np.testing.assert_array_equal(got.acc_index, np.arange(len(imu1)))
    all_samples, chosen = estimate_hinge_axis(imu1, imu2), estimate_hinge_axis(imu1, imu2, got)
    assert all_samples.cost == chosen.cost


def test_no_loud_sample_is_chosen_for_its_gravity() -> None:
    imu1, imu2 = simulated("free")
    for threshold in (0.05, 0.5, 2.0):
        got = select_samples(imu1, imu2, max_samples=500, energy_threshold=threshold)
        assert (got.acc_score[got.acc_index] <= threshold).all()
        assert len(got.acc_index) == min(500, int((got.acc_score <= threshold).sum()))
    nothing = select_samples(imu1, imu2, max_samples=500, energy_threshold=1e-9)
    assert len(nothing.acc_index) == 0
    assert len(nothing.gyr_index) == 500


@pytest.mark.parametrize("kind", ["free", "parts"])
@pytest.mark.parametrize("max_samples", [100, 333])
def test_a_stream_chooses_the_same_gyroscope_samples(max_samples: int, kind: str) -> None:
    imu1, imu2 = simulated(kind)
    got = select_samples(imu1, imu2, max_samples=max_samples)
    whole = calibrate_hinge(imu1, imu2, max_samples=max_samples, lowpass_hz=None, bias_from_rest=False)
    assert set(whole.gyr_time_s) == set(got.time_s[got.gyr_index])
    assert len(whole.acc_time_s) <= max_samples


def test_both_sensors_choose_alike_whichever_comes_first() -> None:
    imu1, imu2 = simulated("mixed")
    one, other = (select_samples(*pair, max_samples=300) for pair in ((imu1, imu2), (imu2, imu1)))
    np.testing.assert_array_equal(one.gyr_score, -other.gyr_score)
    # Neighbours share a score (the smallest of a window), and of equals the other end of the list keeps others.
    np.testing.assert_array_equal(np.sort(one.gyr_score[one.gyr_index]), np.sort(one.gyr_score[other.gyr_index]))
    np.testing.assert_array_equal(one.acc_index, other.acc_index)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**16),
    count=st.integers(30, 90),
    length=st.sampled_from([1, 3, 9]),
    max_samples=st.integers(4, 29),
    scale=st.sampled_from([0.1, 1.0, 5.0]),
)
def test_any_numbers_are_selected_literally(seed: int, count: int, length: int, max_samples: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    gyr, acc = scale * rng.standard_normal((2, count, 3)), 9.81 * rng.standard_normal((2, count, 3))
    check_against_the_literal_algorithms((Imu(gyr[0], acc[0], 50.0), Imu(gyr[1], acc[1], 50.0)), max_samples, 2.0, length)


@pytest.mark.parametrize(
    ("keywords", "named"),
    [
        ({"max_samples": 3}, "max_samples"),
        ({"max_samples": 10.0}, "max_samples"),
        ({"window_s": -0.1}, "window_s"),
        ({"window_s": float("nan")}, "window_s"),
        ({"energy_threshold": 0.0}, "energy_threshold"),
        ({"energy": 1.0}, "energy"),
        ({"n_consistent": 3}, "n_consistent"),
    ],
)
def test_settings_are_refused_by_name(keywords: dict[str, Any], named: str) -> None:
    with pytest.raises(imufast.SettingsError, match=named):
        select_samples(*simulated("free"), **keywords)
