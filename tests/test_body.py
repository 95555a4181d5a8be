"""The lower body: simulated subjects with known truth, smaller models, and what must be refused."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from imufast.body import JOINTS, SEGMENTS, BodyStatus, LowerBody, estimate_lower_body
from imufast.body.frames import angles_deg, frame
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.errors import InputError, SettingsError
from imufast.imu import Imu, Recording
from imufast.quaternion import matrix
from imufast.simulate import LegTissue, LowerBodySimulation, simulate_lower_body
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


def test_ankles_and_knees_alone_leave_the_hips_open_and_say_so() -> None:
    truth = simulate_lower_body("ankles_and_knees", seed=1, duration_s=45.0, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert found.status is BodyStatus.CONVERGED
    assert not any(found.joints[f"hip_{side}"].determined for side in SIDES)
    assert "hip_right" in found.why[-1]
    for side in SIDES:
        assert rms(error(found, truth, "knee", side))[0] < 1.5


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
    ]
    for recording, placement, says in cases:
        with pytest.raises(InputError, match=says):
            estimate_lower_body(recording, placement)
    with pytest.raises(SettingsError, match="anthropometry"):
        estimate_lower_body(rec, place, {"femur": 0.4})  # type: ignore[arg-type]
    with pytest.raises(SettingsError, match="settings"):
        estimate_lower_body(rec, place, settings=3)  # type: ignore[arg-type]


def test_a_subject_who_stands_still_shows_nothing() -> None:
    truth = simulate_lower_body("standing", seed=1, duration_s=12.0, rate_hz=50.0)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert not any(joint.determined for joint in found.joints.values())
    assert found.status in (BodyStatus.NOT_OBSERVABLE, BodyStatus.MAX_ITERATIONS)


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


def test_frames_are_right_handed_and_flexion_is_positive_on_both_sides() -> None:
    turn = frame(np.array([1.0, 0.1, 0.3]), np.array([0.0, 0.0, 2.0]))
    assert np.allclose(turn.T @ turn, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert np.allclose(turn[:, 2], [0.0, 0.0, 1.0])
    c, s = np.cos(0.5), np.sin(0.5)
    bent = np.array([[[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]])  # the shank swings back about x
    inwards = np.array([[[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]])  # toes of the right foot to the left
    for side, sign in (("right", 1.0), ("left", -1.0)):
        assert angles_deg("knee", side, bent)[0] == pytest.approx([np.degrees(0.5), 0.0, 0.0])
        assert angles_deg("hip", side, inwards)[0] == pytest.approx([0.0, 0.0, sign * np.degrees(0.5)])
