"""Every setting of simulate_ball_joint changes something, seeds reproduce, and bad settings are refused by name."""

from __future__ import annotations

import inspect
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest
from imufast.errors import SettingsError
from imufast.simulate import (
    BallJointSimulation,
    BallMotion,
    Collisions,
    Motion,
    SoftTissue,
    paper_segment,
    random_positions,
    random_tissue,
    simulate_ball_joint,
    simulate_hinge,
)

IDENTITY = [1.0, 0.0, 0.0, 0.0]
LATE = np.array([1.0, 2.0, 3.0])

# Each setting with a value that must change the outcome, and the context in which it acts.
CHANGES: dict[str, tuple[Any, dict[str, Any]]] = {
    "motion": ("S3", {}),
    "duration_s": (12.0, {}),
    "transition_s": (2.0, {"motion": ("S3", "S4")}),
    "rate_hz": (50.0, {}),
    "time_s": (LATE, {}),
    "seed": (1, {}),
    "mount1": (IDENTITY, {}),
    "mount2": (IDENTITY, {}),
    "joint_in_sensor1": ([0.1, 0.0, 0.0], {}),
    "joint_in_sensor2": ([0.1, 0.0, 0.0], {}),
    "dof": (2, {}),
    "soft_tissue": (SoftTissue(), {}),
    "tissue_matrix1": (0.01 * np.eye(3), {}),
    "tissue_matrix2": (0.01 * np.eye(3), {}),
    "collisions": (Collisions(), {}),
    "gyr_noise": (0.006, {}),
    "acc_noise": (0.06, {}),
    "gyr_bias1": ([0.0, 0.0, 0.01], {}),
    "gyr_bias2": ([0.0, 0.0, 0.01], {}),
    "acc_bias1": ([0.0, 0.0, 0.1], {}),
    "acc_bias2": ([0.0, 0.0, 0.1], {}),
    "gyr_sampling": ("interval_mean", {}),
    "clock_offset_s": (0.004, {}),
    "packet_loss": (0.05, {}),
    "burst_length": (10.0, {"packet_loss": 0.05}),
    "gravity": (1.62, {}),
}
MOTION_CHANGES: dict[str, Any] = {
    "kind": "held",
    "label": "another",
    "duration_s": 9.0,
    "start_s": 1.0,
    "stop_s": 8.0,
    "tempo": 1.1,
    "size": 0.9,
    "axis_tilt_rad": 0.3,
    "sway_m": 0.05,
    "take": 1,
    "grip_m": 0.1,
}
COLLISION_CHANGES: dict[str, Any] = {
    "per_s": 3.0,
    "least_m_s2": 15.0,
    "most_m_s2": 50.0,
    "most_samples": 5,
    "sensors": (1,),
    "motions": ("S6",),
}
READINGS = ("gyr1", "acc1", "gyr2", "acc2", "time_s")


def same(a: BallJointSimulation, b: BallJointSimulation) -> bool:
    return all(np.array_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a))


def readings_differ(a: BallJointSimulation, b: BallJointSimulation) -> bool:
    return any(not np.array_equal(getattr(a, name), getattr(b, name)) for name in READINGS)


def test_no_setting_is_forgotten() -> None:
    assert set(CHANGES) == set(inspect.signature(simulate_ball_joint).parameters)
    assert set(MOTION_CHANGES) == {field.name for field in fields(BallMotion)}
    assert set(COLLISION_CHANGES) == {field.name for field in fields(Collisions)}


def test_both_simulations_call_the_same_things_the_same() -> None:
    ball, hinge = (inspect.signature(f).parameters for f in (simulate_ball_joint, simulate_hinge))
    assert set(hinge) - set(ball) == {"scenario", "extra_rad"}
    for name in set(ball) & set(hinge) - {"motion", "dof"}:
        assert (ball[name].default, ball[name].kind) == (hinge[name].default, hinge[name].kind)


@pytest.mark.parametrize("name", CHANGES)
def test_every_setting_changes_the_readings(name: str) -> None:
    value, context = CHANGES[name]
    base: dict[str, Any] = {"motion": "random", "duration_s": 10.0} | context
    assert readings_differ(simulate_ball_joint(**base), simulate_ball_joint(**base | {name: value}))


@pytest.mark.parametrize("name", MOTION_CHANGES)
@pytest.mark.parametrize("kind", ["random", "bend_y", "bend_z", "alternate", "clockwise", "counterclockwise"])
def test_every_setting_of_a_motion_changes_the_readings(name: str, kind: str) -> None:
    base = BallMotion(kind, duration_s=10.0)
    changed = replace(base, **{name: MOTION_CHANGES[name]})
    assert readings_differ(simulate_ball_joint(base), simulate_ball_joint(changed))


@pytest.mark.parametrize("name", COLLISION_CHANGES)
def test_every_setting_of_collisions_changes_the_readings(name: str) -> None:
    base = Collisions(per_s=2.0)
    changed = replace(base, **{name: COLLISION_CHANGES[name]})
    one, other = (simulate_ball_joint(("S5", "S6"), duration_s=10.0, collisions=c) for c in (base, changed))
    assert readings_differ(one, other)


@pytest.mark.parametrize("motion", ["random", ("S3", "S6"), BallMotion("alternate", duration_s=8.0)])
def test_seeds_reproduce_to_the_bit(motion: Any) -> None:
    settings: dict[str, Any] = {
        "soft_tissue": SoftTissue(),
        "collisions": Collisions(),
        "packet_loss": 0.02,
        **random_tissue(1),
    }
    one, two, other = (simulate_ball_joint(motion, seed=seed, **settings) for seed in (3, 3, 4))
    assert same(one, two)
    assert not same(one, other)


def test_a_changed_setting_leaves_the_other_draws_alone() -> None:
    base = simulate_ball_joint("random", duration_s=10.0)
    changed = simulate_ball_joint("random", duration_s=10.0, mount2=IDENTITY, collisions=Collisions(sensors=(2,)))
    for name in ("gyr1", "acc1", "joint_angles_rad", "joint_position"):
        assert np.array_equal(getattr(base, name), getattr(changed, name))
    assert not np.array_equal(base.gyr2, changed.gyr2)


def test_more_frequent_collisions_keep_the_ones_there_were() -> None:
    rare, often = (simulate_ball_joint("S6", collisions=Collisions(per_s=r, most_samples=1)) for r in (0.5, 2.0))
    struck = rare.collision1.any(axis=1)
    assert np.array_equal(rare.collision1[struck], often.collision1[struck])
    assert np.count_nonzero(often.collision1.any(axis=1)) > np.count_nonzero(struck) > 0


def test_settings_and_results_are_frozen() -> None:
    s = simulate_ball_joint("S1", duration_s=1.0)
    for frozen in (s, BallMotion("random"), Collisions()):
        with pytest.raises(FrozenInstanceError):
            setattr(frozen, fields(frozen)[0].name, 0)
    for unknown in (lambda: Collisions(wiggle=1), lambda: BallMotion("held", wiggle=1), lambda: simulate_ball_joint(wiggle=1)):  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="wiggle"):
            unknown()


NAN, INF = float("nan"), float("inf")
BAD: list[tuple[str, dict[str, Any]]] = [
    ("motion", {"motion": "S0"}),
    ("motion", {"motion": "S9"}),
    ("motion", {"motion": "walking"}),
    ("motion", {"motion": 3}),
    ("motion", {"motion": None}),
    ("motion", {"motion": []}),
    ("motion", {"motion": ["S3", ["S4"]]}),
    ("motion", {"motion": Motion("free")}),
    ("motion", {"motion": ["S3", Motion("free")]}),
    ("duration_s", {"duration_s": 0.0}),
    ("duration_s", {"motion": BallMotion("random"), "duration_s": 5.0}),
    ("duration_s", {"duration_s": 0.005}),
    ("transition_s", {"transition_s": -1.0}),
    ("rate_hz", {"rate_hz": 0.0}),
    ("rate_hz", {"rate_hz": 1e9}),
    ("rate_hz", {"rate_hz": 50.0, "time_s": LATE}),
    ("time_s", {"time_s": [0.0, 1.0, 1.0]}),
    ("time_s", {"time_s": [-0.1, 1.0]}),
    ("time_s", {"time_s": [0.0, 6.0], "duration_s": 5.0}),
    ("seed", {"seed": -1}),
    ("mount1", {"mount1": [1.0, 0.0, 0.0]}),
    ("mount2", {"mount2": [2.0, 0.0, 0.0, 0.0]}),
    ("joint_in_sensor1", {"joint_in_sensor1": [0.1, 0.2]}),
    ("joint_in_sensor2", {"joint_in_sensor2": [0.1, INF, 0.0]}),
    ("dof", {"dof": 0}),
    ("dof", {"dof": True}),
    ("soft_tissue", {"soft_tissue": True}),
    ("tissue_matrix1", {"tissue_matrix1": np.zeros(3)}),
    ("tissue_matrix2", {"tissue_matrix2": np.full((3, 3), NAN)}),
    ("tissue_matrix2", {"tissue_matrix2": "random"}),
    ("collisions", {"collisions": 0.5}),
    ("motions", {"motion": "S3", "collisions": Collisions(motions=("S6",))}),
    ("gyr_noise", {"gyr_noise": -0.1}),
    ("acc_noise", {"acc_noise": NAN}),
    ("gyr_bias1", {"gyr_bias1": 0.1}),
    ("gyr_bias2", {"gyr_bias2": [[0.1, 0.1, 0.1]]}),
    ("acc_bias1", {"acc_bias1": [0.1, 0.1, NAN]}),
    ("acc_bias2", {"acc_bias2": [0.1, 0.1, None]}),
    ("gyr_sampling", {"gyr_sampling": "mean"}),
    ("clock_offset_s", {"clock_offset_s": INF}),
    ("packet_loss", {"packet_loss": 0.5}),
    ("burst_length", {"burst_length": 0.5}),
    ("gravity", {"gravity": -9.81}),
]


@pytest.mark.parametrize(("name", "settings"), BAD, ids=lambda value: str(value)[:40])
def test_bad_settings_are_refused_by_name(name: str, settings: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=name):
        simulate_ball_joint(**settings)


def test_a_motion_of_the_ball_joint_is_none_of_the_hinge() -> None:
    with pytest.raises(SettingsError, match="motion"):
        simulate_hinge(BallMotion("random"))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("kind", lambda: BallMotion("walking")),
        ("duration_s", lambda: BallMotion("random", duration_s=0.0)),
        ("tempo", lambda: BallMotion("random", tempo=0.0)),
        ("grip_m", lambda: BallMotion("random", grip_m=-0.1)),
        ("segment", lambda: paper_segment("S9")),
        ("duration_s", lambda: paper_segment("S3", -1.0)),
        ("per_s", lambda: Collisions(per_s=-1.0)),
        ("least_m_s2", lambda: Collisions(least_m_s2=NAN)),
        ("most_m_s2", lambda: Collisions(least_m_s2=10.0, most_m_s2=5.0)),
        ("most_samples", lambda: Collisions(most_samples=0)),
        ("sensors", lambda: Collisions(sensors=())),
        ("sensors", lambda: Collisions(sensors=(3,))),  # type: ignore[arg-type]
        ("sensors", lambda: Collisions(sensors=np.array([1, 2]))),  # type: ignore[arg-type]
        ("motions", lambda: Collisions(motions="S6")),  # type: ignore[arg-type]
        ("std_m_rad", lambda: random_tissue(std_m_rad=-1.0)),
        ("seed", lambda: random_tissue(-1)),
        ("most_m", lambda: random_positions(least_m=0.3, most_m=0.2)),
        ("least_m", lambda: random_positions(least_m=-0.1)),
        ("seed", lambda: random_positions(1.5)),  # type: ignore[arg-type]
    ],
)
def test_bad_parts_are_refused_by_name(name: str, make: Any) -> None:
    with pytest.raises(SettingsError, match=name):
        make()
