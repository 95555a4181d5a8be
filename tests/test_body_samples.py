"""A lower body at every sample, beside its moments and the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imufast import LowerBodySimulation, estimate_lower_body, simulate_lower_body
from imufast.body import SEGMENTS, LowerBody
from imufast.body.samples import unwound
from imufast.imu import Imu, Recording
from imufast.quaternion import conjugate, exp, log, multiply

KINDS, SIDES = ("hip", "knee", "ankle"), ("right", "left")
WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05}


@pytest.fixture(scope="module")
def walk() -> LowerBodySimulation:
    return simulate_lower_body("walking", seed=1, duration_s=20.0, rate_hz=100.0, **WORN)


@pytest.fixture(scope="module")
def moments(walk: LowerBodySimulation) -> LowerBody:
    return estimate_lower_body(walk.recording, walk.placement, every_sample=False)


@pytest.fixture(scope="module")
def samples(walk: LowerBodySimulation) -> LowerBody:
    return estimate_lower_body(walk.recording, walk.placement)


def test_moments_stay_what_they_are(walk: LowerBodySimulation, moments: LowerBody, samples: LowerBody) -> None:
    assert np.array_equal(samples.time_s, walk.time_s)
    rows = np.searchsorted(samples.time_s, moments.time_s)
    for segment in SEGMENTS:
        for name in ("q", "q_segment"):
            turn = multiply(conjugate(getattr(moments, name)[segment]), getattr(samples, name)[segment][rows])
            assert np.abs(log(turn)).max() < 1e-9
        assert np.abs(samples.position[segment][rows] - moments.position[segment]).max() < 1e-12
    for kind in KINDS:
        for side in SIDES:
            for what in ("angles", "std"):
                few, many = (getattr(body, f"{kind}_{what}_deg")[side] for body in (moments, samples))
                assert np.abs(many[rows] - few).max() < 1e-7
    assert np.abs(samples.pelvis_angles_deg[rows] - moments.pelvis_angles_deg).max() < 1e-7
    for joint in moments.joints:
        assert np.allclose(samples.joints[joint].heading_std_deg[rows], moments.joints[joint].heading_std_deg)


def test_between_moments_angles_are_as_good_as_at_them(
    walk: LowerBodySimulation, moments: LowerBody, samples: LowerBody
) -> None:
    rows = np.searchsorted(walk.time_s, moments.time_s)
    for kind in KINDS:
        for side in SIDES:
            true = getattr(walk, f"{kind}_angles_deg")[side]
            at = np.std(getattr(moments, f"{kind}_angles_deg")[side] - true[rows], axis=0)
            found = getattr(samples, f"{kind}_angles_deg")[side]
            assert (np.std(found - true, axis=0) < 1.2 * at + 0.02).all()
            # Straight lines through ten moments a second miss what walking does.
            lines = np.interp(walk.time_s, moments.time_s, getattr(moments, f"{kind}_angles_deg")[side][:, 0])
            assert np.std(lines - true[:, 0]) > 1.0


def test_nothing_turns_across_a_break(walk: LowerBodySimulation) -> None:
    keep = (walk.time_s < 8.0) | (walk.time_s > 10.0)
    far = np.where(walk.time_s > 10.0, walk.time_s + 600.0, walk.time_s)[keep]
    imus = {name: Imu(walk.gyr[name][keep], walk.acc[name][keep], time_s=far, name=name) for name in SEGMENTS}
    found = estimate_lower_body(Recording(imus), walk.placement)
    assert np.array_equal(found.time_s, far)
    for side in SIDES:
        assert np.std(found.knee_angles_deg[side][:, 0] - walk.knee_angles_deg[side][keep, 0]) < 0.5
        assert np.abs(np.diff(found.knee_angles_deg[side][:, 0])[np.diff(far) < 1.0]).max() < 15.0


def test_turns_and_rotation_vectors_are_inverses() -> None:
    rng = np.random.default_rng(1)
    turns = rng.normal(size=(200, 3)) * np.geomspace(1e-15, 1.0, 200)[:, None]
    turns[0] = 0.0
    assert np.abs(np.linalg.norm(exp(turns), axis=1) - 1.0).max() < 1e-12
    assert np.allclose(log(exp(turns)), turns, rtol=1e-9, atol=1e-15)
    assert np.allclose(log(-exp(turns)), turns, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("wound", [1, 2, 3])
def test_a_moment_turned_the_wrong_way_round_is_put_right(walk: LowerBodySimulation, wound: int) -> None:
    at = np.arange(0, len(walk.time_s), 10)
    imu, truth = walk.recording["shank_left"], walk.q["shank_left"][at]
    assert unwound(imu, truth, at, 0.3) is truth
    # Some moments take a whole turn on the way from one to the next: only the gyroscope tells.
    wrong = truth.copy()
    for n in range(wound):
        angle = 2.0 * np.pi * (n + 1) / (wound + 1)
        wrong[80 + n] = multiply(truth[80 + n], exp(angle * np.array([0.6, 0.0, 0.8])))
    found = unwound(imu, wrong, at, 0.3)
    assert np.degrees(np.linalg.norm(log(multiply(conjugate(truth), found)), axis=1)).max() < 1.5
    untouched = np.r_[0:70, 93 : len(at)]
    assert np.abs(found[untouched] - truth[untouched]).max() < 1e-12


def test_a_turn_across_a_gap_is_nobodys_fault(walk: LowerBodySimulation) -> None:
    kept = np.r_[0:805, 905 : len(walk.time_s)]
    whole = walk.recording["shank_left"]
    imu = Imu(whole.gyr[kept], whole.acc[kept], time_s=whole.time_s[kept], name="shank_left")
    at = np.r_[0:805:10, 805 : len(kept) : 10]
    q = walk.q["shank_left"][kept][at]
    q[at >= 805] = multiply(np.broadcast_to(exp(np.array([[0.0, 0.0, 3.0]])), (int((at >= 805).sum()), 4)), q[at >= 805])
    assert unwound(imu, q, at, 0.3) is q
