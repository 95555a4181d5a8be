"""Physical laws of the simulated lower body, each checked by means that the simulator does not use itself; its settings."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imufast.errors import SettingsError
from imufast.simulate import Anatomy, BodyMotion, LegTissue, LowerBodySimulation, random_anatomy, simulate_lower_body
from imufast.simulate.body_tree import JOINTS, SEGMENTS, SIDES
from imufast.simulate.checks import FloatArray
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parent / "simulate"))
from laws import differ, joint_acceleration, rotation, slope

TISSUE = LegTissue(wobble_rad_s=3.0)
CASES: list[dict[str, Any]] = [
    {"motion": "profile"},
    {"motion": "ankles_and_knees"},
    {"motion": "walking"},
    {"motion": "sit_to_stand"},
    {"motion": "standing"},
    {"motion": "profile", "soft_tissue": TISSUE},
    {"motion": "walking", "soft_tissue": TISSUE},
]


def case_name(case: dict[str, Any]) -> str:
    return "-".join(str(v) if isinstance(v, str) else "tissue" for v in case.values())


def at(case: dict[str, Any], start_s: float, step_s: float, n: int, **more: Any) -> LowerBodySimulation:
    motion = BodyMotion(case["motion"], duration_s=30.0)
    return simulate_lower_body(time_s=start_s + step_s * np.arange(n), **{"seed": 11, **case, "motion": motion, **more})


@pytest.mark.parametrize("case", CASES, ids=case_name)
@pytest.mark.parametrize("start_s", [4.0, 8.3])
def test_readings_are_derivatives_of_the_pose(case: dict[str, Any], start_s: float) -> None:
    # At the seams of smooth steps a central difference is off by more than rounding.
    step = 1e-3
    s = at(case, start_s, step, 240, gravity=9.7)
    up = np.array([0.0, 0.0, 9.7])
    for segment in SEGMENTS:
        turned = rotation(s.q[segment])
        matrix = turned.as_matrix()
        skew = np.swapaxes(matrix[4:-4], 1, 2) @ slope(matrix, step)
        rate = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        scale = 1.0 + np.abs(s.gyr_true[segment]).max()
        assert differ(rate, s.gyr_true[segment][4:-4]) < 3e-6 * scale
        assert differ(slope(s.sensor_position[segment], step), s.sensor_velocity[segment][4:-4]) < 1e-6
        acceleration = slope(s.sensor_velocity[segment], step)
        assert differ(turned[4:-4].inv().apply(acceleration + up), s.acc_true[segment][4:-4]) < 4e-3


@pytest.mark.parametrize("case", [CASES[0], CASES[2]], ids=case_name)
def test_integrated_readings_give_the_pose(case: dict[str, Any]) -> None:
    """Strapdown by the midpoint rule: half the step, a quarter of the error."""

    def miss(step: float) -> tuple[float, float]:
        n = round(3.0 / step)
        ends, middles = at(case, 5.0, step, n + 1), at(case, 5.0 + 0.5 * step, step, n)
        turned_off, moved_off = [], []
        for segment in ("pelvis", "foot_right"):
            r = rotation(ends.q[segment][0])
            p, v = ends.sensor_position[segment][0].copy(), ends.sensor_velocity[segment][0].copy()
            for gyr, acc in zip(middles.gyr_true[segment], middles.acc_true[segment], strict=True):
                a = (r * Rotation.from_rotvec(0.5 * step * gyr)).apply(acc) - [0.0, 0.0, 9.81]
                p, v, r = p + step * v + 0.5 * step**2 * a, v + step * a, r * Rotation.from_rotvec(step * gyr)
            turned_off.append((r.inv() * rotation(ends.q[segment][-1])).magnitude())
            moved_off.append(np.linalg.norm(p - ends.sensor_position[segment][-1]))
        return max(turned_off), float(max(moved_off))

    coarse, fine = miss(0.008), miss(0.004)
    assert fine[0] < 5e-3
    assert fine[1] < 1e-2
    assert max(fine[0] / coarse[0], fine[1] / coarse[1]) < 0.35


@pytest.mark.parametrize("case", CASES[:5], ids=case_name)
def test_joints_hold_together(case: dict[str, Any]) -> None:
    s = simulate_lower_body(case["motion"], seed=2, duration_s=25.0, rate_hz=50.0)
    for joint, segments in JOINTS.items():
        for segment in segments:
            seen = s.sensor_position[segment] + rotation(s.q[segment]).apply(s.joint_in_sensor[segment, joint])
            assert differ(seen, s.joint_position[joint]) < 1e-12
    for side in SIDES:
        for bone, ends in (("femur", ("hip", "knee")), ("tibia", ("knee", "ankle"))):
            length = np.linalg.norm(s.joint_position[f"{ends[0]}_{side}"] - s.joint_position[f"{ends[1]}_{side}"], axis=1)
            assert differ(length, np.full_like(length, s.lengths_m[f"{bone}_{side}"])) < 1e-12
        # The knee is a hinge about its axis, which both sensors see at one place (eqs 6-8 with m_k).
        thigh, shank = f"thigh_{side}", f"shank_{side}"
        axis = rotation(s.q[thigh]).apply(s.knee_axis[thigh])
        assert differ(axis, rotation(s.q[shank]).apply(s.knee_axis[shank])) < 1e-12
        relative = rotation(s.q[shank]).apply(s.gyr_true[shank]) - rotation(s.q[thigh]).apply(s.gyr_true[thigh])
        assert differ(np.cross(relative, axis), np.zeros_like(axis)) < 1e-10
        # Table 1: the axis against the bone.
        for segment, far, angle in ((thigh, "hip", s.anatomy.femur_axis_deg), (shank, "knee", s.anatomy.tibia_axis_deg)):
            near = "knee" if far == "hip" else "ankle"
            up = s.joint_in_sensor[segment, f"{far}_{side}"] - s.joint_in_sensor[segment, f"{near}_{side}"]
            cosine = up @ s.knee_axis[segment] / np.linalg.norm(up)
            assert np.degrees(np.arccos(cosine)) == pytest.approx(angle[SIDES.index(side)], abs=1e-9)
    hips = np.linalg.norm(s.joint_position["hip_right"] - s.joint_position["hip_left"], axis=1)
    assert differ(hips, np.full_like(hips, s.lengths_m["hips"])) < 1e-12


@pytest.mark.parametrize("motion", ["profile", "walking"])
def test_both_sensors_agree_on_the_acceleration_of_a_joint(motion: str) -> None:
    step = 1e-3
    s = at({"motion": motion}, 6.0, step, 200)
    for joint, (upper, lower) in JOINTS.items():
        felt = []
        for segment in (upper, lower):
            gyr_rate = slope(s.gyr_true[segment], step)
            inner = slice(4, -4)
            a = joint_acceleration(
                s.acc_true[segment][inner], s.gyr_true[segment][inner], gyr_rate, s.joint_in_sensor[segment, joint]
            )
            felt.append(rotation(s.q[segment][inner]).apply(a))
        assert differ(felt[0], felt[1]) < 5e-3


def test_angles_are_those_of_grood_and_suntay() -> None:
    """An independent route: Cardan angles by scipy, in ISB axes (X forward, Y up, Z right), then the signs of a left leg."""
    s = simulate_lower_body("profile", seed=4, duration_s=40.0, rate_hz=25.0)
    isb = Rotation.from_matrix(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))  # ISB to x right, y forward, z up
    for kind in ("hip", "knee", "ankle"):
        for side in SIDES:
            upper, lower = (rotation(s.q_segment[name]) * isb for name in JOINTS[f"{kind}_{side}"])
            flexion, adduction, inward = (upper.inv() * lower).as_euler("ZXY", degrees=True).T
            sign = 1.0 if side == "right" else -1.0
            expected = np.stack([-flexion if kind == "knee" else flexion, sign * adduction, sign * inward], axis=1)
            assert differ(getattr(s, f"{kind}_angles_deg")[side], expected) < 1e-9
    knees = np.concatenate([s.knee_angles_deg[side][:, 0] for side in SIDES])
    assert -5.0 < knees.min() < 10.0
    assert 80.0 < knees.max() < 130.0
    # Swinging the leg to the front is flexion, out to the side is negative adduction.
    assert s.hip_angles_deg["left"][:, 0].max() > 40.0
    assert s.hip_angles_deg["left"][:, 1].min() < -20.0
    assert s.hip_angles_deg["right"][:, 1].min() < -20.0


def test_feet_on_the_ground_stand_still() -> None:
    s = simulate_lower_body("walking", seed=6, duration_s=20.0)
    walking = (s.time_s > 4.0) & (s.time_s < 16.0)
    for side in SIDES:
        assert 0.3 < s.contact[side][walking].mean() < 0.7
        for name in ("gyr_true",):
            assert np.abs(getattr(s, name)[f"foot_{side}"][s.contact[side]]).max() < 1e-8
        still = s.sensor_velocity[f"foot_{side}"][s.contact[side]]
        assert np.abs(still).max() < 1e-8
        assert np.ptp(s.sensor_position[f"foot_{side}"][:, :2], axis=0).max() > 3.0
    assert (s.contact["left"] | s.contact["right"])[walking].mean() > 0.6
    seated = simulate_lower_body("sit_to_stand", seed=6, duration_s=10.0)
    assert all(seated.contact[side].all() for side in SIDES)


def test_the_foot_that_stands_in_the_profile_keeps_its_ankle() -> None:
    s = simulate_lower_body("profile", seed=1, duration_s=45.0)
    swinging = np.abs(s.gyr_true["foot_right"]).max(axis=1) > 2.0
    assert swinging.sum() > 100
    assert np.abs(slope(s.joint_position["ankle_left"], 0.01))[swinging[4:-4]].max() < 1e-6


def test_ankles_and_knees_leave_the_hips_alone() -> None:
    s = simulate_lower_body("ankles_and_knees", seed=3)
    assert max(np.ptp(s.hip_angles_deg[side][:, 1:], axis=0).max() for side in SIDES) < 9.0
    assert all(np.ptp(s.knee_angles_deg[side][:, 0]) > 80.0 for side in SIDES)


def test_soft_tissue_has_its_size_and_leaves_the_bones() -> None:
    turned = LegTissue(turn_deg_per_rad=3.0, slide_m_per_rad=0.01)
    bare, worn = (simulate_lower_body("profile", seed=5, duration_s=40.0, soft_tissue=t) for t in (None, turned))
    assert np.array_equal(bare.q_segment["thigh_left"], worn.q_segment["thigh_left"])
    assert np.array_equal(bare.gyr_true["foot_left"], worn.gyr_true["foot_left"])
    slip = np.degrees((rotation(bare.q["shank_left"]).inv() * rotation(worn.q["shank_left"])).magnitude())
    knee = np.radians(np.abs(bare.knee_angles_deg["left"][:, 0]))
    assert differ(slip, 3.0 * knee) < 0.35
    away = np.linalg.norm(bare.sensor_position["shank_left"] - worn.sensor_position["shank_left"], axis=1)
    assert differ(away, 0.01 * knee) < 1e-3
    none = LegTissue(turn_deg_per_rad=0.0, slide_m_per_rad=0.0)
    zero = simulate_lower_body("profile", seed=5, duration_s=40.0, soft_tissue=none)
    assert differ(zero.gyr["thigh_left"], bare.gyr["thigh_left"]) < 1e-12


def test_several_motions_have_gaps_between_them_and_lost_packets_only_take_rows_away() -> None:
    whole = simulate_lower_body(("walking", "sit_to_stand"), duration_s=15.0, transition_s=2.0)
    assert whole.rate_hz is None
    assert np.diff(whole.time_s).max() == pytest.approx(2.01)
    assert list(dict.fromkeys(whole.motion)) == ["walking", "sit_to_stand"]
    lossy = simulate_lower_body(("walking", "sit_to_stand"), duration_s=15.0, transition_s=2.0, packet_loss=0.02)
    assert 0.8 < len(lossy.time_s) / len(whole.time_s) < 0.92
    assert np.array_equal(lossy.acc["pelvis"], whole.acc["pelvis"][lossy.row])


def test_a_recording_has_every_sensor_and_the_same_seed_gives_the_same_bits() -> None:
    one, other = (simulate_lower_body("standing", seed=8, duration_s=3.0) for _ in range(2))
    assert sorted(one.recording) == sorted(SEGMENTS)
    assert one.placement["pelvis"] == "pelvis"
    assert all(np.array_equal(one.acc[s], other.acc[s]) for s in SEGMENTS)
    still = np.linalg.norm(one.recording["pelvis"].acc, axis=1).mean()
    assert still == pytest.approx(9.81, abs=0.05)


IDENTITY = [1.0, 0.0, 0.0, 0.0]
CHANGES: dict[str, tuple[Any, dict[str, Any]]] = {
    "motion": ("walking", {}),
    "duration_s": (25.0, {}),
    "transition_s": (2.0, {"motion": ("walking", "standing")}),
    "rate_hz": (50.0, {}),
    "time_s": (np.array([1.0, 2.0, 3.0]), {}),
    "seed": (1, {}),
    "anatomy": (Anatomy(), {}),
    "mounts": ({"pelvis": IDENTITY}, {}),
    "mount_deg": (20.0, {}),
    "places": ({"pelvis": [0.0, -0.1, 0.1]}, {}),
    "soft_tissue": (LegTissue(), {}),
    "gyr_noise": (0.002, {}),
    "acc_noise": (0.02, {}),
    "gyr_bias": (0.01, {}),
    "acc_bias": ({"foot_left": [0.1, 0.0, 0.0]}, {}),
    "packet_loss": (0.05, {}),
    "burst_length": (10.0, {"packet_loss": 0.05}),
    "gravity": (1.62, {}),
}


def readings(s: LowerBodySimulation) -> FloatArray:
    return np.concatenate([s.time_s[:, None], *s.gyr.values(), *s.acc.values()], axis=1)


def test_every_setting_changes_something() -> None:
    assert set(CHANGES) == set(inspect.signature(simulate_lower_body).parameters)
    for name, (value, context) in CHANGES.items():
        usual: dict[str, Any] = {"motion": "profile", "duration_s": 20.0, "rate_hz": 20.0}
        without = {"time_s": ("rate_hz",)}.get(name, ())
        context = {key: v for key, v in (usual | context).items() if key not in without}
        plain, changed = simulate_lower_body(**context), simulate_lower_body(**context | {name: value})
        assert not np.array_equal(readings(plain), readings(changed)), name


@pytest.mark.parametrize("name", ["kind", "label", "duration_s", "start_s", "stop_s", "tempo", "size", "sway_m", "take"])
def test_every_setting_of_a_motion_changes_something(name: str) -> None:
    value: dict[str, Any] = {"kind": "sit_to_stand", "label": "b", "duration_s": 12.0, "start_s": 1.0, "stop_s": 9.0}
    value |= {"tempo": 1.1, "size": 0.9, "sway_m": 0.02, "take": 1}
    given: dict[str, Any] = {"kind": "walking", "duration_s": 14.0}
    plain, changed = (simulate_lower_body(BodyMotion(**g), rate_hz=20.0) for g in (given, given | {name: value[name]}))
    assert len(plain.time_s) != len(changed.time_s) or not np.array_equal(readings(plain), readings(changed))


@pytest.mark.parametrize(
    "name", ["turn_deg_per_rad", "slide_m_per_rad", "wobble_rad_s", "wobble_hz", "drive_rad_s", "segments"]
)
def test_every_setting_of_the_tissue_changes_something(name: str) -> None:
    value = {"segments": ("thigh_left",)}.get(name, 5.0)
    given: dict[str, Any] = {"wobble_rad_s": 1.0}
    plain, changed = (
        simulate_lower_body("profile", duration_s=20.0, rate_hz=20.0, soft_tissue=LegTissue(**g))
        for g in (given, given | {name: value})
    )
    assert not np.array_equal(readings(plain), readings(changed))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"motion": "dancing"}, "motion"),
        ({"motion": BodyMotion("walking"), "duration_s": 5.0}, "duration_s"),
        ({"anatomy": 3}, "anatomy"),
        ({"mounts": {"elbow": IDENTITY}}, "elbow"),
        ({"mounts": {"pelvis": [2.0, 0.0, 0.0, 0.0]}}, "pelvis"),
        ({"mount_deg": -1.0}, "mount_deg"),
        ({"places": {"pelvis": [0.0, 1.0]}}, "pelvis"),
        ({"soft_tissue": 1}, "soft_tissue"),
        ({"gyr_bias": "much"}, "gyr_bias"),
        ({"acc_noise": -1.0}, "acc_noise"),
        ({"packet_loss": 0.7}, "packet_loss"),
        ({"rate_hz": 0.0}, "rate_hz"),
        ({"seed": -1}, "seed"),
        ({"motion": BodyMotion("walking", size=3.0)}, "size"),
    ],
)
def test_bad_settings_are_refused_by_name(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(SettingsError, match=says):
        simulate_lower_body(**settings)


def test_bad_parts_are_refused_by_name() -> None:
    for wrong in ({"femur_m": (0.4, -0.4)}, {"tibia_m": 0.4}, {"femur_axis_deg": (10.0, 90.0)}):
        with pytest.raises(SettingsError, match=next(iter(wrong))):
            Anatomy(**wrong)
    with pytest.raises(SettingsError, match="segments"):
        LegTissue(segments=("pelvis",))
    with pytest.raises(SettingsError, match="axis_tilt_rad"):
        BodyMotion("walking", axis_tilt_rad=0.1)
    subject = random_anatomy(3)
    assert 0.33 < subject.femur_m[0] < 0.46
    assert subject.femur_m[0] != subject.femur_m[1]
