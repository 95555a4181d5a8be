"""Every setting changes something, the same seed gives the same bits, and bad settings are refused by name."""

from __future__ import annotations

import inspect
from dataclasses import FrozenInstanceError, fields, replace
from typing import Any

import numpy as np
import pytest
from imufast.errors import SettingsError
from imufast.simulate import HingeSimulation, Motion, SoftTissue, paper_motion, random_biases, scenario_motions, simulate_hinge

IDENTITY = [1.0, 0.0, 0.0, 0.0]
LATE = np.array([1.0, 2.0, 3.0])

# Each setting with a value that must change the outcome, and the context in which it acts.
CHANGES: dict[str, tuple[Any, dict[str, Any]]] = {
    "motion": (5, {}),
    "scenario": (3, {"motion": None, "duration_s": 20.0, "rate_hz": 5.0}),
    "duration_s": (12.0, {}),
    "transition_s": (2.0, {"motion": [1, 2]}),
    "rate_hz": (100.0, {}),
    "time_s": (LATE, {}),
    "seed": (1, {}),
    "mount1": (IDENTITY, {}),
    "mount2": (IDENTITY, {}),
    "joint_in_sensor1": ([0.1, 0.0, 0.0], {}),
    "joint_in_sensor2": ([0.1, 0.0, 0.0], {}),
    "dof": (2, {}),
    "extra_rad": (0.5, {"dof": 3}),
    "soft_tissue": (SoftTissue(), {}),
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
    "kind": "planar",
    "label": "another",
    "duration_s": 9.0,
    "start_s": 1.0,
    "stop_s": 8.0,
    "tempo": 1.1,
    "size": 0.9,
    "axis_tilt_rad": 0.3,
    "sway_m": 0.05,
    "take": 1,
}
TISSUE_CHANGES = {
    "shift_rad": 0.02,
    "drag_rad": 0.02,
    "tilt_rad": 0.02,
    "wobble_rad_s": 3.0,
    "wobble_hz": 11.0,
    "drive_rad_s": 4.0,
    "segment2": 0.9,
}


def same(a: HingeSimulation, b: HingeSimulation) -> bool:
    return all(
        np.array_equal(getattr(a, field.name), getattr(b, field.name)) if field.name != "rate_hz" else a.rate_hz == b.rate_hz
        for field in fields(a)
    )


def readings_differ(a: HingeSimulation, b: HingeSimulation) -> bool:
    return any(not np.array_equal(getattr(a, name), getattr(b, name)) for name in ("gyr1", "acc1", "gyr2", "acc2", "time_s"))


@pytest.mark.parametrize("name", CHANGES)
def test_every_setting_of_simulate_hinge_changes_the_readings(name: str) -> None:
    value, context = CHANGES[name]
    base: dict[str, Any] = {"motion": 7, "duration_s": 10.0} | context
    changed = base | {name: value}
    assert readings_differ(simulate_hinge(**base | ({"motion": 1} if name == "scenario" else {})), simulate_hinge(**changed))


def test_no_setting_is_forgotten() -> None:
    assert set(CHANGES) == set(inspect.signature(simulate_hinge).parameters)
    assert set(MOTION_CHANGES) == {field.name for field in fields(Motion)}
    assert set(TISSUE_CHANGES) == {field.name for field in fields(SoftTissue)}


@pytest.mark.parametrize("name", MOTION_CHANGES)
@pytest.mark.parametrize("kind", ["free", "walking", "sit_to_stand"])
def test_every_setting_of_a_motion_changes_the_readings(name: str, kind: str) -> None:
    base = Motion(kind, duration_s=10.0)
    changed = replace(base, **{name: MOTION_CHANGES[name]})
    assert readings_differ(simulate_hinge(base), simulate_hinge(changed))


@pytest.mark.parametrize("name", TISSUE_CHANGES)
@pytest.mark.parametrize("motion", ["walking", 7])
def test_every_setting_of_soft_tissue_changes_the_readings(name: str, motion: str | int) -> None:
    base = SoftTissue()
    changed = replace(base, **{name: TISSUE_CHANGES[name]})
    one, other = (simulate_hinge(motion, duration_s=10.0, soft_tissue=tissue) for tissue in (base, changed))
    assert not np.array_equal(one.gyr2, other.gyr2)


def test_each_noise_and_bias_touches_its_own_signal_only() -> None:
    base = simulate_hinge(7, duration_s=10.0)
    for name in ("gyr_bias1", "gyr_bias2", "acc_bias1", "acc_bias2"):
        bias = np.array([0.1, -0.2, 0.3])
        biased = simulate_hinge(7, duration_s=10.0, **{name: bias})  # type: ignore[arg-type]
        signal = name.replace("_bias", "")
        np.testing.assert_allclose(getattr(biased, signal) - getattr(base, signal), np.broadcast_to(bias, (500, 3)), atol=1e-14)
        assert np.array_equal(getattr(biased, name), bias)
        for other in {"gyr1", "gyr2", "acc1", "acc2"} - {signal}:
            assert np.array_equal(getattr(biased, other), getattr(base, other))
    quiet = simulate_hinge(7, duration_s=10.0, gyr_noise=0.0)
    assert np.array_equal(quiet.gyr1, quiet.gyr1_true)
    assert np.array_equal(quiet.acc1, base.acc1)


def test_noise_has_the_stated_size_and_no_memory() -> None:
    s = simulate_hinge("stationary", duration_s=400.0, gyr_noise=0.02, acc_noise=0.3)
    noises = [s.gyr1 - s.gyr1_true, s.gyr2 - s.gyr2_true, s.acc1 - s.acc1_true, s.acc2 - s.acc2_true]
    for noise, std in zip(noises, (0.02, 0.02, 0.3, 0.3), strict=True):
        unit = noise / std
        assert unit.std(axis=0) == pytest.approx(1.0, abs=0.03)
        assert (np.abs(unit.mean(axis=0)) < 0.03).all()
        assert (np.abs((unit[1:] * unit[:-1]).mean(axis=0)) < 0.03).all()
    together = np.corrcoef(np.hstack(noises).T) - np.eye(12)
    assert np.abs(together).max() < 0.04


@pytest.mark.parametrize("motion", [7, "walking", (1, 3, "mixed")])
def test_seeds_reproduce_to_the_bit(motion: Any) -> None:
    settings: dict[str, Any] = {"soft_tissue": SoftTissue(), "packet_loss": 0.02, "duration_s": 10.0}
    assert same(simulate_hinge(motion, seed=3, **settings), simulate_hinge(motion, seed=3, **settings))
    assert not same(simulate_hinge(motion, seed=3, **settings), simulate_hinge(motion, seed=4, **settings))


def test_random_biases_have_the_papers_size_and_fit_the_call() -> None:
    biases = random_biases(5)
    for i in "12":
        assert np.linalg.norm(biases[f"gyr_bias{i}"]) == pytest.approx(np.deg2rad(1.0))  # type: ignore[literal-required]
        assert np.linalg.norm(biases[f"acc_bias{i}"]) == pytest.approx(1.0)  # type: ignore[literal-required]
    assert not np.array_equal(biases["acc_bias1"], biases["acc_bias2"])
    assert np.array_equal(random_biases(5)["acc_bias1"], biases["acc_bias1"])
    assert not np.array_equal(random_biases(6)["acc_bias1"], biases["acc_bias1"])
    s = simulate_hinge(1, **biases)
    assert np.array_equal(s.acc_bias2, biases["acc_bias2"])
    assert np.linalg.norm(random_biases(5, gyr_rad_s=0.5, acc_m_s2=0.1)["gyr_bias1"]) == pytest.approx(0.5)


def test_random_mounts_are_unit_and_differ() -> None:
    sims = [simulate_hinge(1, duration_s=1.0, seed=seed) for seed in range(20)]
    axes = np.array([[s.axis1, s.axis2] for s in sims]).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(axes, axis=1), 1.0, atol=1e-15)
    assert np.linalg.matrix_rank(axes) == 3
    assert np.abs(axes.mean(axis=0)).max() < 0.4


def test_settings_and_results_are_frozen() -> None:
    s = simulate_hinge(1, duration_s=1.0)
    for frozen in (s, Motion("free"), SoftTissue()):
        with pytest.raises(FrozenInstanceError):
            setattr(frozen, fields(frozen)[0].name, 0)
    for unknown in (lambda: SoftTissue(wiggle=1), lambda: Motion("free", wiggle=1), lambda: simulate_hinge(1, wiggle=1)):  # type: ignore[call-arg]
        with pytest.raises(TypeError, match="wiggle"):
            unknown()


NAN, INF = float("nan"), float("inf")
BAD: list[tuple[str, dict[str, Any]]] = [
    ("motion", {"motion": 0}),
    ("motion", {"motion": 15}),
    ("motion", {"motion": 3.0}),
    ("motion", {"motion": True}),
    ("motion", {"motion": "dancing"}),
    ("motion", {"motion": []}),
    ("motion", {"motion": [1, None]}),
    ("motion", {"motion": [1, [2, 3]]}),
    ("motion", {"motion": {"free": 1}}),
    ("duration_s", {"duration_s": 1e300, "rate_hz": 1e300}),
    ("rate_hz", {"rate_hz": 1e9}),
    ("scenario", {"scenario": 5}),
    ("scenario", {"scenario": "1"}),
    ("scenario", {"scenario": True}),
    ("scenario", {"motion": 1, "scenario": 1}),
    ("duration_s", {"duration_s": 0.0}),
    ("duration_s", {"duration_s": NAN}),
    ("duration_s", {"duration_s": "long"}),
    ("duration_s", {"duration_s": 0.01}),
    ("duration_s", {"scenario": 2, "duration_s": 19.0}),
    ("duration_s", {"motion": Motion("free"), "duration_s": 5.0}),
    ("transition_s", {"transition_s": -1.0}),
    ("rate_hz", {"rate_hz": 0.0}),
    ("rate_hz", {"rate_hz": -50.0}),
    ("rate_hz", {"rate_hz": INF}),
    ("rate_hz", {"rate_hz": 50.0, "time_s": LATE}),
    ("time_s", {"time_s": [0.0, 1.0, 1.0]}),
    ("time_s", {"time_s": [[0.0, 1.0]]}),
    ("time_s", {"time_s": [0.0]}),
    ("time_s", {"time_s": [0.0, NAN]}),
    ("time_s", {"time_s": [-0.1, 1.0]}),
    ("time_s", {"time_s": [0.0, 6.0], "duration_s": 5.0}),
    ("seed", {"seed": -1}),
    ("seed", {"seed": 1.5}),
    ("seed", {"seed": None}),
    ("mount1", {"mount1": [1.0, 0.0, 0.0]}),
    ("mount2", {"mount2": [2.0, 0.0, 0.0, 0.0]}),
    ("mount2", {"mount2": [0.0, 0.0, 0.0, 0.0]}),
    ("joint_in_sensor1", {"joint_in_sensor1": [0.1, 0.2]}),
    ("joint_in_sensor2", {"joint_in_sensor2": [0.1, INF, 0.0]}),
    ("joint_in_sensor2", {"joint_in_sensor2": "here"}),
    ("dof", {"dof": 0}),
    ("dof", {"dof": 4}),
    ("extra_rad", {"extra_rad": -0.1}),
    ("soft_tissue", {"soft_tissue": True}),
    ("gyr_noise", {"gyr_noise": -0.1}),
    ("acc_noise", {"acc_noise": NAN}),
    ("gyr_bias1", {"gyr_bias1": 0.1}),
    ("gyr_bias2", {"gyr_bias2": [[0.1, 0.1, 0.1]]}),
    ("acc_bias1", {"acc_bias1": [0.1, 0.1, NAN]}),
    ("acc_bias2", {"acc_bias2": [0.1, 0.1, None]}),
    ("gyr_sampling", {"gyr_sampling": "mean"}),
    ("clock_offset_s", {"clock_offset_s": INF}),
    ("packet_loss", {"packet_loss": 0.5}),
    ("packet_loss", {"packet_loss": -0.1}),
    ("burst_length", {"burst_length": 0.5}),
    ("gravity", {"gravity": -9.81}),
]


@pytest.mark.parametrize(("name", "settings"), BAD, ids=lambda value: str(value)[:40])
def test_bad_settings_are_refused_by_name(name: str, settings: dict[str, Any]) -> None:
    with pytest.raises(SettingsError, match=name):
        simulate_hinge(**settings)


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("kind", lambda: Motion("dance")),
        ("label", lambda: Motion("free", label=3)),  # type: ignore[arg-type]
        ("duration_s", lambda: Motion("free", duration_s=0.0)),
        ("start_s", lambda: Motion("free", start_s=50.0)),
        ("start_s", lambda: Motion("free", start_s=-1.0)),
        ("stop_s", lambda: Motion("free", start_s=5.0, stop_s=5.0)),
        ("stop_s", lambda: Motion("free", stop_s=51.0)),
        ("tempo", lambda: Motion("free", tempo=0.0)),
        ("size", lambda: Motion("free", size=-1.0)),
        ("axis_tilt_rad", lambda: Motion("free", axis_tilt_rad=NAN)),
        ("sway_m", lambda: Motion("free", sway_m=-0.1)),
        ("take", lambda: Motion("free", take=-1)),
        ("shift_rad", lambda: SoftTissue(shift_rad=-1.0)),
        ("drag_rad", lambda: SoftTissue(drag_rad=NAN)),
        ("wobble_rad_s", lambda: SoftTissue(wobble_rad_s=-1.0)),
        ("wobble_hz", lambda: SoftTissue(wobble_hz=0.0)),
        ("drive_rad_s", lambda: SoftTissue(drive_rad_s=0.0)),
        ("segment2", lambda: SoftTissue(segment2=-0.1)),
        ("motion", lambda: paper_motion(15)),
        ("scenario", lambda: scenario_motions(0)),
        ("acc_m_s2", lambda: random_biases(acc_m_s2=-1.0)),
        ("gyr_rad_s", lambda: random_biases(gyr_rad_s=NAN)),
        ("seed", lambda: random_biases(-1)),
    ],
)
def test_bad_parts_are_refused_by_name(name: str, make: Any) -> None:
    with pytest.raises(SettingsError, match=name):
        make()
