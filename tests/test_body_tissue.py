"""Soft tissue beneath the sensors of a lower body: what of it follows the flexion is found, and bands hold the rest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imufast.body import BodyStatus, LowerBody, LowerBodySettings, estimate_lower_body
from imufast.body.layout import layout
from imufast.body.tissue import Tissue, skins
from imufast.simulate import BodyMotion, LegTissue, LowerBodySimulation, simulate_lower_body
from numpy.typing import NDArray

SIDES = ("right", "left")
WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05, "soft_tissue": LegTissue()}
RIGID = LowerBodySettings(soft_tissue_deg=0.0, soft_tissue_m=0.0)
"""As if all that soft tissue does came and went from moment to moment."""


def off_deg(found: LowerBody, truth: LowerBodySimulation, side: str) -> NDArray[np.float64]:
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    return np.asarray((found.knee_angles_deg[side] - truth.knee_angles_deg[side][rows])[:, 0])


def test_thighs_answer_to_two_joints_and_shanks_to_one() -> None:
    truth = simulate_lower_body("profile", seed=1, duration_s=20.0, rate_hz=50.0)
    whole = layout(truth.recording, truth.placement)
    usual = LowerBodySettings()
    moved = skins(whole, usual)
    assert sorted(whole.segments[skin.sensor] for skin in moved) == sorted(
        2 * ["thigh_right", "thigh_left"] + ["shank_right", "shank_left"]
    )
    assert skins(whole, RIGID) == []
    # Without a knee there is no axis that anything could bend about, without a pelvis no hip that bends.
    hip = layout(truth.recording, {k: truth.placement[k] for k in ("pelvis", "thigh_left")})
    leg = layout(truth.recording, {k: truth.placement[k] for k in ("thigh_left", "shank_left", "foot_left")})
    assert skins(hip, usual) == []
    assert [leg.segments[skin.sensor] for skin in skins(leg, usual)] == ["thigh_left", "shank_left"]


def test_what_moves_the_skin_is_the_flexion_from_the_same_zero_always() -> None:
    truth = simulate_lower_body("profile", seed=1, duration_s=40.0, rate_hz=50.0)
    whole = layout(truth.recording, truth.placement)
    moved = skins(whole, LowerBodySettings())
    q = np.stack([truth.q[segment] for segment in whole.segments], axis=1)
    axes = np.zeros((6, 2, 3))
    for side in SIDES:
        axes[whole.names.index(f"knee_{side}")] = [truth.knee_axis[f"thigh_{side}"], truth.knee_axis[f"shank_{side}"]]
    tissue = Tissue(moved, q)
    driven = np.degrees(tissue.drives(q, axes)[..., 0])
    for n, skin in enumerate(moved):
        joint = next(name for name, pair in whole.joints.items() if pair == skin.pair)
        kind, side = joint.split("_")
        true = getattr(truth, f"{kind}_angles_deg")[side][:, 0]
        # A knee bends backwards about its axis, which points to the right; of a hip that turns and spreads it is nearly that.
        sign = -1.0 if kind == "knee" else 1.0
        assert np.std(sign * driven[:, n] - true) < (1.0 if kind == "knee" else 4.0)
        assert np.std(true) > 5.0
    # Of a part of the recording, and of quaternions of the other sign, it is the same.
    np.testing.assert_allclose(np.degrees(tissue.drives(-q[300:400], axes)[..., 0]), driven[300:400], atol=1e-9)


@pytest.mark.parametrize("seed", [1, 2])
def test_joint_centres_that_move_with_the_flexion_do_not_bend_the_bones(seed: int) -> None:
    truth = simulate_lower_body("profile", seed=seed, duration_s=60.0, **WORN)
    found, rigid = (
        estimate_lower_body(truth.recording, truth.placement, settings=settings, every_sample=False)
        for settings in (LowerBodySettings(), RIGID)
    )
    assert found.status is BodyStatus.CONVERGED
    rms = [np.sqrt(np.mean([off_deg(body, truth, side) ** 2 for side in SIDES])) for body in (found, rigid)]
    assert rms[0] < 0.6 * rms[1]
    assert rms[0] < 2.0


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_six_minutes_solved_whole_are_not_more_certain_than_true() -> None:
    motions = [
        BodyMotion(kind, duration_s=60.0, label=f"{kind} {n}")
        for n in range(2)
        for kind in ("profile", "walking", "sit_to_stand")
    ]
    truth = simulate_lower_body(motions, seed=1, rate_hz=50.0, **WORN)
    found = estimate_lower_body(
        truth.recording, truth.placement, settings=LowerBodySettings(window_s=1e3, max_iterations=90), every_sample=False
    )
    assert found.status is BodyStatus.CONVERGED
    assert len(found.windows) <= 1
    for side in SIDES:
        off, std = off_deg(found, truth, side), found.knee_std_deg[side][:, 0]
        assert np.mean(np.abs(off) < 1.645 * std) > 0.9
        assert abs(off.mean()) < 1.5
