"""Long recordings of the lower body: constants from informative pieces, windows that join without a seam."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from imufast.body import BodyStatus, LowerBody, LowerBodySettings, estimate_lower_body
from imufast.body.layout import SEGMENTS, SIDES, layout
from imufast.body.settings import Anthropometry
from imufast.body.solve import Ask, solve
from imufast.body.start import BodyStart
from imufast.body.windows import excerpt
from imufast.imu import Imu, Recording
from imufast.quaternion import conjugate, multiply
from imufast.simulate import LegTissue, LowerBodySimulation, simulate_lower_body

WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05}
SHORT = LowerBodySettings(window_s=20.0)
FEW = replace(SHORT, max_iterations=2)
KINDS = ("knee", "hip", "ankle")


@pytest.fixture(scope="module")
def truth() -> LowerBodySimulation:
    return simulate_lower_body("profile", seed=1, duration_s=60.0, rate_hz=50.0, **WORN)


@pytest.fixture(scope="module")
def windowed(truth: LowerBodySimulation) -> tuple[LowerBody, list[tuple[Any, ...]]]:
    told: list[tuple[Any, ...]] = []
    return estimate_lower_body(truth.recording, truth.placement, settings=SHORT, progress=lambda *t: told.append(t)), told


def agree(parts: LowerBody, whole: LowerBody, truth: LowerBodySimulation) -> None:
    """That windows, which know less, say within their bands what one search over all says, and are no farther off the truth."""
    assert np.array_equal(parts.time_s, whole.time_s)
    rows = np.searchsorted(truth.time_s, whole.time_s - 1e-9)
    for side in SIDES:
        for kind in KINDS:
            one, other = (getattr(found, f"{kind}_angles_deg")[side] for found in (parts, whole))
            if not whole.joints[f"{kind}_{side}"].determined:
                continue
            std, apart = getattr(parts, f"{kind}_std_deg")[side], one - other
            if kind != "knee":
                # What is upright on pelvis and feet is what was so on average when it was quiet; no band counts that.
                apart = apart - apart.mean(axis=0)
            assert (np.abs(apart) < 2.0 * std).mean() > 0.9
        off = [found.knee_angles_deg[side][:, 0] - truth.knee_angles_deg[side][rows, 0] for found in (parts, whole)]
        # The slack is a quarter of what is stated.
        slack = 0.25 * parts.knee_std_deg[side][:, 0].mean()
        assert np.sqrt(np.mean(off[0] ** 2)) < np.sqrt(np.mean(off[1] ** 2)) + slack
        assert (np.abs(off[0]) < 2.0 * parts.knee_std_deg[side][:, 0]).mean() > 0.9
    for name, (length, std) in parts.lengths_m.items():
        assert abs(whole.lengths_m[name][0] - length) < 2.0 * std


def test_windows_agree_with_the_whole(truth: LowerBodySimulation, windowed: tuple[LowerBody, list[tuple[Any, ...]]]) -> None:
    parts, _ = windowed
    whole = estimate_lower_body(truth.recording, truth.placement)
    assert whole.windows == ()
    assert len(parts.windows) == 4
    assert parts.status is BodyStatus.CONVERGED
    agree(parts, whole, truth)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_windows_agree_with_the_whole_over_minutes(seed: int) -> None:
    motions = ["walking", "profile", "walking"]
    truth = simulate_lower_body(motions, seed=seed, duration_s=60.0, rate_hz=50.0, **WORN)
    parts, whole = (
        estimate_lower_body(truth.recording, truth.placement, settings=LowerBodySettings(window_s=s)) for s in (60.0, 1e4)
    )
    assert len(parts.windows) > 3
    agree(parts, whole, truth)


def test_windows_follow_each_other_without_a_seam(windowed: tuple[LowerBody, list[tuple[Any, ...]]]) -> None:
    found, _ = windowed
    assert (np.diff(found.time_s) > 0.0).all()
    for one, other in zip(found.windows, found.windows[1:], strict=False):
        assert 0.0 < other.start_s - one.stop_s < 0.11
    steps = {}
    for segment in SEGMENTS:
        turn = multiply(found.q[segment][1:], conjugate(found.q[segment][:-1]))
        steps[segment] = np.degrees(2.0 * np.arcsin(np.minimum(np.linalg.norm(turn[:, 1:], axis=1), 1.0)))
        place = np.linalg.norm(np.diff(found.position[segment], axis=0), axis=1)
        seams = np.searchsorted(found.time_s, [window.start_s for window in found.windows[1:]]) - 1
        usual = steps[segment][np.abs(np.arange(len(steps[segment]))[:, None] - seams).min(axis=1) == 1]
        # Where windows meet a segment moves hardly farther than right before and after.
        assert (steps[segment][seams] < usual.max() + 3.0).all()
        assert (place[seams] < 0.5).all()


def test_progress_says_where_it_is(windowed: tuple[LowerBody, list[tuple[Any, ...]]]) -> None:
    found, told = windowed
    assert list(dict.fromkeys(stage for *_, stage in told)) == ["constants", *(f"window {n} of 4" for n in (1, 2, 3, 4))]
    assert len(told) == found.iterations == len(found.history)


def test_a_caller_may_stop_in_a_window(truth: LowerBodySimulation) -> None:
    def stop(*trial: object) -> None:
        if trial[-1] == "window 2 of 4":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        estimate_lower_body(truth.recording, truth.placement, settings=FEW, progress=stop)


def test_held_constants_stay_and_their_covariance_enters_all_else(truth: LowerBodySimulation) -> None:
    recording = truth.recording.between(0.0, 15.0)
    place = {segment: segment for segment in ("thigh_left", "shank_left", "foot_left")}
    ask = Ask(layout(recording, place), Anthropometry(), LowerBodySettings(), None)
    start = BodyStart(recording, ask.layout)
    whole = solve(recording, ask, start, "whole")
    free = whole.fit

    class Known:
        centers, axes, skins = free.centers + 0.003, free.axes, free.skins * 1.1

        def __init__(self, share: float) -> None:
            self.constants_covariance = share * np.asarray(free.constants_covariance)

    # The core's result cannot be made in Python; what is held needs these four of it.
    held = [replace(whole, fit=Known(share)) for share in (0.0, 1.0, 2.0)]  # type: ignore[arg-type]
    none, once, twice = (solve(recording, ask, start, "held", known).fit for known in held)
    assert np.abs(once.centers - Known.centers).max() < 1e-9
    assert np.abs(once.axes - Known.axes).max() < 1e-9
    assert np.abs(once.skins - Known.skins).max() < 1e-9
    assert np.array_equal(np.asarray(once.constants_covariance), np.asarray(free.constants_covariance))
    a, b, c = (np.asarray(fit.joint_covariance) for fit in (none, once, twice))
    assert np.allclose(c - a, 2.0 * (b - a), atol=1e-6 * np.abs(b).max())
    assert np.diagonal((b - a).reshape(-1, 2, 6, 6), axis1=2, axis2=3).min() > -1e-9


def test_pieces_are_chosen_where_there_is_motion() -> None:
    motions = ["standing", "walking", "standing", "walking"]
    truth = simulate_lower_body(motions, seed=2, duration_s=30.0, rate_hz=50.0, **WORN)
    chosen = excerpt(truth.recording, list(SEGMENTS), LowerBodySettings(window_s=20.0))
    assert chosen is not None
    moving = np.isin(truth.part[np.searchsorted(truth.time_s, chosen.time_s)], [1, 3])
    assert 0.75 < moving.mean() < 1.0  # and one in which the subject stands
    assert len(chosen.time_s) <= 9 * 5.0 * 50.0
    assert excerpt(truth.recording, list(SEGMENTS), LowerBodySettings(window_s=60.0)) is None


def test_a_still_window_and_breaks_do_no_harm() -> None:
    motions = ["walking", "standing", "profile"]
    truth = simulate_lower_body(motions, seed=4, duration_s=30.0, rate_hz=50.0, **WORN)
    time_s = truth.time_s + 1000.0 * truth.part
    keep = (truth.time_s < 10.0) | (truth.time_s > 10.5)
    imus = {name: Imu(truth.gyr[name][keep], truth.acc[name][keep], time_s=time_s[keep], name=name) for name in SEGMENTS}
    recording = Recording(imus)
    place = {segment: name for segment, name in truth.placement.items() if segment == "pelvis" or segment.endswith("left")}
    few = LowerBodySettings(window_s=15.0, max_iterations=15)
    parts = estimate_lower_body(recording, place, settings=few)
    assert len(parts.windows) == 7
    assert parts.status in (BodyStatus.CONVERGED, BodyStatus.MAX_ITERATIONS)
    rows = np.searchsorted(time_s[keep], parts.time_s - 1e-9)
    part = truth.part[keep][rows]
    off = parts.knee_angles_deg["left"][:, 0] - truth.knee_angles_deg["left"][keep][rows, 0]
    for n in range(3):
        assert np.sqrt(np.mean(off[part == n] ** 2)) < 3.0
    assert (np.abs(off) < 2.0 * parts.knee_std_deg["left"][:, 0]).mean() > 0.9


def test_legs_without_a_pelvis_and_swapped_legs_in_windows(truth: LowerBodySimulation) -> None:
    legs = {segment: name for segment, name in truth.placement.items() if segment.startswith(("thigh", "shank"))}
    found = estimate_lower_body(truth.recording, legs, settings=FEW)
    assert set(found.joints) == {"knee_right", "knee_left"}
    assert len(found.windows) == 4
    swapped = {s if s == "pelvis" else _other(s): n for s, n in truth.placement.items()}
    assert estimate_lower_body(truth.recording, swapped, settings=FEW).status is BodyStatus.PLACEMENT_CONTRADICTED


def _other(segment: str) -> str:
    kind, _, side = segment.partition("_")
    return f"{kind}_{'left' if side == 'right' else 'right'}"


def test_a_foot_that_rests_after_a_break_spoils_no_other_moment() -> None:
    """Its heading is open there: bands say so, and its frame comes from where it is not."""
    motions = ("walking", "sit_to_stand")
    truth = simulate_lower_body(motions, seed=1, duration_s=30.0, rate_hz=50.0, soft_tissue=LegTissue(), **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    rests = np.array(truth.motion)[rows] == "sit_to_stand"
    for side in SIDES:
        turned = found.ankle_angles_deg[side][:, 2] - truth.ankle_angles_deg[side][rows, 2]
        assert np.abs(turned[~rests]).max() < 8.0
        assert (np.abs((turned + 180.0) % 360.0 - 180.0) < 2.0 * found.ankle_std_deg[side][:, 2]).mean() > 0.95
