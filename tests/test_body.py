"""The lower body: simulated subjects with known truth, smaller models, and what must be refused."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from imufast.body import JOINTS, SEGMENTS, BodyStatus, LowerBody, estimate_lower_body
from imufast.body.bands import angles_deg, between, pelvis_deg, pelvis_std_deg, std_deg
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.errors import InputError, SettingsError
from imufast.frames import segment_frame
from imufast.imu import Imu, Recording
from imufast.quaternion import matrix
from imufast.simulate import BodyMotion, LegTissue, LowerBodySimulation, simulate_lower_body
from numpy.typing import NDArray

SIDES = ("right", "left")
WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05}


def error(found: LowerBody, truth: LowerBodySimulation, kind: str, side: str) -> NDArray[np.float64]:
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    return np.asarray(getattr(found, f"{kind}_angles_deg")[side] - getattr(truth, f"{kind}_angles_deg")[side][rows])


def rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


@pytest.fixture(scope="module")
def profile() -> tuple[LowerBodySimulation, LowerBody, list[tuple[Any, ...]]]:
    truth = simulate_lower_body("profile", seed=1, duration_s=45.0, **WORN)
    told: list[tuple[Any, ...]] = []
    found = estimate_lower_body(truth.recording, truth.placement, progress=lambda *trial: told.append(trial))
    return truth, found, told


def test_the_motion_profile_determines_everything(
    profile: tuple[LowerBodySimulation, LowerBody, list[tuple[Any, ...]]],
) -> None:
    truth, found, told = profile
    assert found.status is BodyStatus.CONVERGED
    assert found.why == ()
    assert found.iterations == len(found.history) == len(told) <= 12
    assert told[0][0] == 1
    for side in SIDES:
        flexion, adduction, rotation = rms(error(found, truth, "knee", side))
        assert flexion < 1.0
        assert adduction < 2.5
        assert rotation < 1.0
        assert rms(error(found, truth, "hip", side)).max() < 4.0
        # A sensor's place on a rigid foot does not say where its sole is; what moves does.
        assert np.std(error(found, truth, "ankle", side), axis=0).max() < 2.0
        for segment in (f"thigh_{side}", f"shank_{side}"):
            assert found.knee_axis[segment] @ truth.knee_axis[segment] > np.cos(np.radians(1.0))
    for name, joint in found.joints.items():
        assert joint.determined
        assert joint.why == ()
        assert joint.heading_drift_deg < 3.0
        for k, segment in enumerate(JOINTS[name]):
            assert np.linalg.norm(joint.in_sensors[k] - truth.joint_in_sensor[segment, name]) < 0.015
    for name, (length, std) in found.lengths_m.items():
        assert abs(length - truth.lengths_m[name]) < 3.0 * std + 0.003
        assert std < 0.02
    assert set(found.q) == set(found.q_segment) == set(found.position) == set(SEGMENTS)


def test_bands_hold_the_truth(profile: tuple[LowerBodySimulation, LowerBody, list[tuple[Any, ...]]]) -> None:
    truth, found, _ = profile
    for side in SIDES:
        off, std = error(found, truth, "knee", side), found.knee_std_deg[side]
        assert std.shape == off.shape
        assert np.isfinite(std).all()
        assert (np.abs(off) < 2.0 * std).mean() > 0.9


def test_relative_orientations_are_those_of_the_sensors(
    profile: tuple[LowerBodySimulation, LowerBody, list[tuple[Any, ...]]],
) -> None:
    truth, found, _ = profile
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    for upper, lower in JOINTS.values():
        said = np.swapaxes(matrix(found.q[upper]), 1, 2) @ matrix(found.q[lower])
        true = np.swapaxes(matrix(truth.q[upper][rows]), 1, 2) @ matrix(truth.q[lower][rows])
        trace = np.einsum("kij,kij->k", said, true)
        assert np.degrees(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))).max() < 3.0


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 10))])
def test_ankles_and_knees_alone_leave_the_hips_open_and_say_so(seed: int) -> None:
    truth = simulate_lower_body("ankles_and_knees", seed=seed, duration_s=45.0, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert found.status is BodyStatus.CONVERGED
    assert not any(found.joints[f"hip_{side}"].determined for side in SIDES)
    assert "hip_right" in found.why[-1]
    for side in SIDES:
        off, std = error(found, truth, "knee", side), found.knee_std_deg[side]
        assert rms(off)[0] < 1.5
        assert (np.abs(off) < 2.0 * std).mean() > 0.9


@pytest.mark.parametrize("seed", [3, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 2, 4))])
def test_who_only_sits_is_told_from_who_stands(seed: int) -> None:
    truth = simulate_lower_body("seated", seed=seed, duration_s=45.0, rate_hz=50.0, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert any("only sits" in why for why in found.why)
    assert not any(found.joints[f"hip_{side}"].determined for side in SIDES)
    for side in SIDES:
        assert rms(error(found, truth, "knee", side))[0] < 6.0
        for kind in ("knee", "ankle"):
            off, std = error(found, truth, kind, side), getattr(found, f"{kind}_std_deg")[side]
            assert (np.abs(off) < 2.0 * std).mean() > 0.9


@pytest.mark.parametrize("seed", [0, 1])
def test_thighs_that_never_move_may_stand_or_lie(seed: int) -> None:
    seated = BodyMotion("seated", duration_s=25.0, sway_m=0.0)
    truth = simulate_lower_body(seated, seed=seed, rate_hz=50.0, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement, settings=LowerBodySettings(max_iterations=40))
    assert found.status is BodyStatus.NOT_OBSERVABLE
    assert any("stands or sits is open" in why for why in found.why)
    assert not any(joint.determined for joint in found.joints.values())
    for side in SIDES:
        for kind in ("hip", "knee"):
            off = (error(found, truth, kind, side) + 180.0) % 360.0 - 180.0
            assert (np.abs(off) < 2.0 * getattr(found, f"{kind}_std_deg")[side]).mean() > 0.7


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_no_wrong_sign_whatever_the_mounting(seed: int) -> None:
    truth = simulate_lower_body("profile", seed=seed, duration_s=60.0, soft_tissue=LegTissue(), **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert found.status is BodyStatus.CONVERGED
    for side in SIDES:
        assert found.knee_axis[f"thigh_{side}"] @ truth.knee_axis[f"thigh_{side}"] > 0.95
        assert np.std(error(found, truth, "knee", side)[:, 0]) < 3.0


def test_walking_with_gaps_and_lost_packets() -> None:
    truth = simulate_lower_body("walking", seed=2, duration_s=25.0, packet_loss=0.01, **WORN)
    keep = (truth.time_s < 11.0) | (truth.time_s > 12.0)
    imus = {name: Imu(truth.gyr[name][keep], truth.acc[name][keep], time_s=truth.time_s[keep], name=name) for name in SEGMENTS}
    found = estimate_lower_body(Recording(imus), truth.placement)
    assert found.status is BodyStatus.CONVERGED
    for side in SIDES:
        assert rms(error(found, truth, "knee", side))[0] < 2.0


def test_impacts_between_samples_are_survived() -> None:
    """Every twentieth sample is off by 2 g, as heel strikes at 100 Hz are: increments over them count for less."""
    truth = simulate_lower_body("profile", seed=1, duration_s=40.0, **WORN)
    rng = np.random.default_rng(5)
    imus = {}
    for name in SEGMENTS:
        hit = rng.random((len(truth.time_s), 1)) < (0.0 if name == "pelvis" else 0.05)
        acc = truth.acc[name] + hit * rng.normal(0.0, 20.0, truth.acc[name].shape)
        imus[name] = Imu(truth.gyr[name], acc, time_s=truth.time_s, name=name)
    found = estimate_lower_body(Recording(imus), truth.placement)
    assert found.status is BodyStatus.CONVERGED
    for side in SIDES:
        off = error(found, truth, "knee", side)
        assert np.std(off, axis=0).max() < 1.0
        assert (np.abs(off) < 2.0 * found.knee_std_deg[side]).mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["profile", "walking"])
def test_bands_hold_the_bones_under_soft_tissue(motion: str) -> None:
    inside = []
    for seed in range(5):
        truth = simulate_lower_body(motion, seed=seed, duration_s=60.0, soft_tissue=LegTissue(), **WORN)
        found = estimate_lower_body(truth.recording, truth.placement)
        assert found.status is BodyStatus.CONVERGED
        for kind in ("knee", "hip", "ankle"):
            for side in SIDES:
                columns = slice(0, 1 if kind == "ankle" else 3)  # where a foot's sole heads, no sensor shows
                off, std = error(found, truth, kind, side)[:, columns], getattr(found, f"{kind}_std_deg")[side][:, columns]
                inside.append((np.abs(off) < 1.645 * std).mean())
    assert np.mean(inside) > 0.9


@pytest.mark.parametrize(
    ("missing", "joints"),
    [
        (("foot_left", "foot_right"), 4),
        (("thigh_left", "shank_left", "foot_left"), 3),
        (("pelvis", "thigh_left", "shank_left", "foot_left"), 2),
    ],
)
def test_missing_sensors_make_a_smaller_model(missing: tuple[str, ...], joints: int) -> None:
    truth = simulate_lower_body("profile", seed=3, duration_s=40.0, rate_hz=50.0, **WORN)
    placement = {segment: name for segment, name in truth.placement.items() if segment not in missing}
    found = estimate_lower_body(truth.recording, placement)
    assert found.status is BodyStatus.CONVERGED
    assert len(found.joints) == joints
    assert np.std(error(found, truth, "knee", "right")[:, 0]) < 1.0


@pytest.mark.parametrize("segments", [("pelvis", "thigh_left"), ("shank_left", "foot_left")])
def test_two_sensors_without_a_knee_have_a_centre_and_no_angles(segments: tuple[str, ...]) -> None:
    truth = simulate_lower_body("profile", seed=3, duration_s=30.0, rate_hz=50.0, **WORN)
    found = estimate_lower_body(truth.recording, {name: truth.placement[name] for name in segments})
    assert found.status is BodyStatus.CONVERGED
    (joint,) = found.joints.values()
    assert np.isfinite(joint.in_sensors).all()
    assert not found.hip_angles_deg
    assert not found.ankle_angles_deg


def test_what_must_be_refused_is_refused_by_name() -> None:
    truth = simulate_lower_body("standing", seed=1, duration_s=6.0, rate_hz=50.0)
    rec, place = truth.recording, truth.placement
    unconnected = {k: v for k, v in place.items() if k != "shank_left"}
    cases: list[tuple[Any, Any, str]] = [
        (rec["pelvis"], place, "Recording"),
        (rec, ["pelvis"], "placement"),
        (rec, place | {"arm": "pelvis"}, "arm"),
        (rec, place | {"pelvis": "lumbar"}, "lumbar"),
        (rec, place | {"pelvis": "foot_left"}, "foot_left"),
        (rec, {"pelvis": "pelvis"}, "two segments"),
        (rec, unconnected, "unconnected"),
        (rec.between(0.0, 3.0), place, "at least 5 s"),
        (rec.between(0.0, 0.01), place, "at least 5 s"),
        (_slow(rec), place, "5 samples a second"),
        (_copied(rec), place, "'foot_left' on foot_left hold the same gyr data"),
    ]
    for recording, placement, says in cases:
        with pytest.raises(InputError, match=says):
            estimate_lower_body(recording, placement)
    with pytest.raises(SettingsError, match="anthropometry"):
        estimate_lower_body(rec, place, {"femur": 0.4})  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="settings"):
        estimate_lower_body(rec, place, settings=3)  # type: ignore[arg-type]


def _slow(rec: Recording) -> Recording:
    return Recording({name: Imu(imu.gyr, imu.acc, rate_hz=5.0, name=name) for name, imu in rec.items()})


def _copied(rec: Recording) -> Recording:
    foot = rec["foot_right"]
    return Recording({**rec, "foot_left": Imu(foot.gyr, foot.acc, rate_hz=50.0, name="foot_left")})


def test_a_subject_who_stands_still_shows_nothing() -> None:
    truth = simulate_lower_body("standing", seed=1, duration_s=12.0, rate_hz=50.0)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert not any(joint.determined for joint in found.joints.values())
    assert found.status is BodyStatus.NOT_OBSERVABLE


def test_a_caller_may_stop_the_search() -> None:
    truth = simulate_lower_body("profile", seed=1, duration_s=25.0, rate_hz=50.0)

    class EnoughError(Exception):
        pass

    def stop(*_: object) -> None:
        raise EnoughError

    with pytest.raises(EnoughError):
        estimate_lower_body(truth.recording, truth.placement, progress=stop)


@pytest.mark.parametrize("name", [f.name for f in fields(LowerBodySettings)])
def test_every_setting_changes_something(name: str) -> None:
    truth = simulate_lower_body("profile", seed=4, duration_s=25.0, rate_hz=50.0, packet_loss=0.01, soft_tissue=LegTissue())
    usual = LowerBodySettings()
    other: dict[str, Any] = {
        "axes_std_deg": None,
        "max_iterations": 2,
        "tolerance": 5.0,
        "bridge_s": 0.05,
        "tail": 3.0,
        "window_s": 6.0,
    }
    changed = replace(usual, **{name: other.get(name, 1.7 * getattr(usual, name))})
    placement = {k: v for k, v in truth.placement.items() if k == "pelvis" or k.endswith("left")}
    one, two = (estimate_lower_body(truth.recording, placement, settings=s) for s in (usual, changed))
    same = one.cost == two.cost and len(one.time_s) == len(two.time_s) and one.iterations == two.iterations
    same = same and np.array_equal(one.knee_std_deg["left"], two.knee_std_deg["left"])
    assert not same


def test_the_subjects_own_lengths_are_taken() -> None:
    truth = simulate_lower_body("ankles_and_knees", seed=5, duration_s=30.0, rate_hz=50.0)
    own = Anthropometry(femur_m=(truth.lengths_m["femur_right"], 0.002), femur_difference_m=0.02)
    usual, better = (estimate_lower_body(truth.recording, truth.placement, a) for a in (None, own))
    off = [abs(found.lengths_m["femur_right"][0] - truth.lengths_m["femur_right"]) for found in (usual, better)]
    assert off[1] < 0.004
    assert better.lengths_m["femur_right"][1] < usual.lengths_m["femur_right"][1]
    child = Anthropometry.of_height(1.2)
    assert child.femur_m[0] == pytest.approx(0.394 * 1.2 / 1.69)
    assert not child.limits


def test_lengths_that_are_not_told_follow_those_that_are() -> None:
    usual = Anthropometry()
    child = Anthropometry(femur_m=(0.30, 0.015))
    assert child.femur_m == (0.30, 0.015)
    assert child.tibia_m[0] / usual.tibia_m[0] == pytest.approx(0.30 / 0.394)
    assert child.hips_m[0] / usual.hips_m[0] == pytest.approx(0.30 / 0.394)
    assert not child.limits
    # About as uncertain as an adult's, of whom nothing is told; less so where more is told.
    assert 0.8 < child.tibia_m[1] / usual.tibia_m[1] < 1.2
    both = replace(child, tibia_m=(0.31, 0.01))
    assert both.tibia_m == (0.31, 0.01)
    assert both.hips_m == child.hips_m
    assert Anthropometry(femur_m=(0.30, 0.015), tibia_m=(0.31, 0.015)).hips_m[1] < child.hips_m[1]
    # An adult's femur leaves the limits, and one of which next to nothing is known says nothing of the others.
    assert Anthropometry(femur_m=(0.42, 0.015)).limits
    assert Anthropometry(femur_m=(0.394, 0.2)).tibia_m == usual.tibia_m
    assert Anthropometry(femur_axis_deg=(80.0, 3.0)).tibia_m == usual.tibia_m
    for height_m in (1.1, 1.69, 1.9):
        known = Anthropometry.of_height(height_m)
        assert replace(known, femur_m=(0.33, 0.01)).tibia_m == known.tibia_m


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (Anthropometry, {"femur_m": 0.4}),
        (Anthropometry, {"tibia_m": (0.4, 0.0)}),
        (Anthropometry, {"femur_axis_deg": (10.0, 1.0)}),
        (Anthropometry, {"limits": 1}),
        (LowerBodySettings, {"key_step_s": 0.0}),
        (LowerBodySettings, {"tail": "heavy"}),
        (LowerBodySettings, {"max_iterations": 0}),
        (LowerBodySettings, {"axes_std_deg": -1.0}),
    ],
)
def test_bad_settings_are_refused_by_name(kind: Any, given: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=next(iter(given))):
        kind(**given)
    with pytest.raises(SettingsError, match="height_m"):
        Anthropometry.of_height(17.8)


def turn(axis: int, angle: float) -> NDArray[np.float64]:
    """(1, 3, 3) about X, Y or Z."""
    vector = np.zeros(4)
    vector[0], vector[1 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return matrix(vector)[None]


def test_flexion_adduction_and_internal_rotation_are_positive_on_both_sides() -> None:
    for side, sign in (("right", 1.0), ("left", -1.0)):
        # The shank swings back about Z, the right one; the thigh swings forward; toes of the right foot turn to the left.
        assert angles_deg("knee", side, turn(2, -0.5))[0] == pytest.approx([np.degrees(0.5), 0.0, 0.0])
        assert angles_deg("hip", side, turn(2, 0.5))[0] == pytest.approx([np.degrees(0.5), 0.0, 0.0])
        assert angles_deg("hip", side, turn(1, 0.5))[0] == pytest.approx([0.0, 0.0, sign * np.degrees(0.5)])
        assert angles_deg("ankle", side, turn(0, 0.5))[0] == pytest.approx([0.0, sign * np.degrees(0.5), 0.0])


def test_frames_are_those_of_segment_frame(profile: tuple[LowerBodySimulation, LowerBody, list[tuple[float, ...]]]) -> None:
    found = profile[1]
    hip, knee, ankle = (found.joints[f"{kind}_right"].in_sensors for kind in ("hip", "knee", "ankle"))
    # Right, forward, up of McGrath are Z, X, Y of ISB.
    to_isb = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    for segment, centers in (("thigh_right", (hip[1], knee[0])), ("shank_right", (knee[1], ankle[0]))):
        known = segment_frame("right", joint_centers=centers, right=found.knee_axis[segment], keep="proximal")
        between = np.swapaxes(matrix(found.q[segment]), 1, 2) @ matrix(found.q_segment[segment])
        np.testing.assert_allclose(between, np.broadcast_to(known.matrix @ to_isb, between.shape), atol=1e-9)


def test_a_pelvis_is_tilted_and_listed_whatever_its_heading() -> None:
    for heading in (0.0, 1.0, -2.5):
        # World z up; the segment's Y up, X ahead.
        ahead = matrix(np.array([np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)]))[None]
        upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        turned = ahead @ upright @ turn(2, -0.2) @ turn(0, 0.1)
        assert pelvis_deg((turned, np.eye(3)))[0] == pytest.approx(np.degrees([-0.2, 0.1]))


def test_bands_are_what_small_turns_make_of_the_angles() -> None:
    rng = np.random.default_rng(5)
    upper, lower = (matrix(q / np.linalg.norm(q))[None] for q in rng.normal(size=(2, 4)))
    frames = [matrix(q / np.linalg.norm(q)) for q in rng.normal(size=(2, 4))]
    turns = rng.normal(size=(2, 3, 4))
    root = 1e-3 * rng.normal(size=(10, 10))
    covariance = root @ root.T
    parts = covariance[None, :6, :6], covariance[None, :6, 6:], covariance[6:, 6:]
    loose = np.array([1e-4, 4e-4, 9e-4])
    given = (upper, frames[0]), (lower, frames[1]), (turns[0], turns[1]), parts
    stated = std_deg("hip", "left", *given, (loose, np.zeros(3)))[0]
    tilt = pelvis_std_deg((upper, frames[0]), turns[0], (parts[0][:, :3, :3], parts[1][:, :3], parts[2]))[0]
    drawn = root @ rng.normal(size=(10, 4000))
    angles = []
    for x in drawn.T:
        moved = [small(x[:3])[None] @ upper, small(x[3:6])[None] @ lower]
        made = [frame @ small(by @ x[6:]) for frame, by in zip(frames, turns, strict=True)]
        tilt_now = pelvis_deg((moved[0], made[0]))[0]
        made[0] = made[0] @ small(rng.normal(size=3) * np.sqrt(loose))
        relative = between((moved[0], made[0]), (moved[1], made[1]))
        angles.append([*angles_deg("hip", "left", relative)[0], *tilt_now])
    spread = np.std((np.array(angles) - angles[0] + 180.0) % 360.0, axis=0)
    np.testing.assert_allclose(spread, [*stated, *tilt], rtol=0.05)


def small(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) of a small rotation vector."""
    q = np.array([1.0, *(0.5 * vector)])
    return matrix(q / np.linalg.norm(q))
