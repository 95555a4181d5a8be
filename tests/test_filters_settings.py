"""Settings of the filters: frozen, checked by name, and every one of them changes something."""

from __future__ import annotations

import math
import pickle
from dataclasses import FrozenInstanceError, fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from imufast import (
    Complementary,
    Imu,
    JointCalibration,
    Mekf,
    RelativeOrientation,
    SettingsError,
    TrackStatus,
    calibrate_joint,
    simulate_ball_joint,
    track,
)
from track_cases import apart_deg, ball, known, pair, sound


@cache
def gapped() -> tuple[tuple[Imu, Imu], JointCalibration]:
    """Half a minute with a gap of 0.3 s and one of 1.5 s."""
    sim = ball(5, 30.0)
    t = sim.time_s
    rows = ~(((t > 10.0) & (t < 10.3)) | ((t > 20.0) & (t < 21.5)))
    return pair(sim, rows), calibrate_joint(sim.imu1, sim.imu2)


def tracked(settings: Any) -> RelativeOrientation:
    imus, calibration = gapped()
    return track(*imus, calibration, settings)


def told(found: RelativeOrientation) -> tuple[object, ...]:
    return found.q_12.tobytes(), found.angle_std_deg.tobytes(), found.restarts


SHARED: dict[str, tuple[Any, dict[str, Any]]] = {
    "midpoint": (False, {}),
    "start_std": (0.1, {}),
    "start_fade_s": (2.0, {}),
    "max_gap_s": (0.1, {}),
    "restart": (False, {}),
    "scale_noise": (0.01, {}),
    "precision": ("single", {}),
}
CHANGES: dict[type, dict[str, tuple[Any, dict[str, Any]]]] = {
    Mekf: SHARED | {"outliers": ("none", {}), "limit": (1.0, {}), "adapt": (False, {})},
    Complementary: SHARED
    | {
        "beta": (0.3, {}),
        "beta_extra": (1.0, {}),
        "settle_s": (1.0, {"beta_extra": 1.0}),
        "heading_gain": (1.0, {}),
        "soft_angle": (0.0, {}),
        "drift_limit": (0.1, {}),
        "bias_gain": (0.02, {}),
        "literal": (True, {}),
    },
}


@pytest.mark.parametrize(("kind", "name"), [(kind, f.name) for kind in (Mekf, Complementary) for f in fields(kind)])
def test_every_setting_changes_something(kind: Any, name: str) -> None:
    value, beside = CHANGES[kind][name]
    assert getattr(kind(), name) != value
    before, after = tracked(kind(**beside)), tracked(kind(**beside, **{name: value}))
    assert told(before) != told(after)
    assert getattr(after.method, name) == value
    sound(after, gapped()[0][0])


@pytest.mark.parametrize("kind", [Mekf, Complementary])
def test_settings_do_what_they_say(kind: Any) -> None:
    plain = tracked(kind())
    assert plain.restarts == 1
    assert tracked(kind(max_gap_s=0.1)).restarts == 2
    assert tracked(kind(restart=False)).restarts == 0
    assert tracked(kind(max_gap_s=2.0)).restarts == 0
    assert tracked(kind(start_std=0.1)).starting_s < plain.starting_s
    assert tracked(kind(scale_noise=0.01)).angle_std_deg[-1] > plain.angle_std_deg[-1]
    # Just after a gap the orientation is a matter of luck.
    known_well = plain.angle_std_deg < 5.0
    assert 0.0 < apart_deg(tracked(kind(precision="single")).q_12, plain.q_12)[known_well].max() < 2.0


@pytest.mark.parametrize("outliers", ["none", "reject", "downweight"])
def test_outliers_are_kept_rejected_or_weighed_down(outliers: str) -> None:
    # Blows that the accelerometer feels, for a fiftieth of the time.
    sim = simulate_ball_joint(seed=2, duration_s=40.0)
    rng = np.random.default_rng(0)
    acc = sim.acc1 + (rng.random((len(sim.acc1), 1)) < 0.02) * rng.normal(0.0, 30.0, sim.acc1.shape)
    blown = Imu(sim.gyr1, acc, 100.0)
    calibration = calibrate_joint(sim.imu1, sim.imu2)
    found = track(blown, sim.imu2, calibration, Mekf(outliers=outliers))
    sound(found, blown)
    rms = math.sqrt(np.mean(apart_deg(found.q_12, sim.q_12)[500:] ** 2))
    kept = track(blown, sim.imu2, calibration, Mekf(outliers="none"))
    if outliers == "none":
        assert told(kept) == told(found)
    else:
        assert rms < math.sqrt(np.mean(apart_deg(kept.q_12, sim.q_12)[500:] ** 2))


def test_as_published_is_the_papers_choice() -> None:
    mekf = Mekf.as_published()
    assert (mekf.outliers, mekf.limit, mekf.adapt) == ("reject", 7.81, False)
    assert (mekf.midpoint, mekf.restart, mekf.scale_noise) == (False, False, 0.0)
    assert Mekf.as_published("none") == replace(mekf, outliers="none")
    complementary = Complementary.as_published()
    assert complementary.beta == pytest.approx(math.sqrt(3.0) * math.radians(1.0))
    assert Complementary.as_published(gyr_std=0.01).beta == pytest.approx(math.sqrt(3.0) * 0.01)
    assert complementary.literal
    assert (complementary.heading_gain, complementary.soft_angle) == (1.0, 0.0)
    assert (complementary.drift_limit, complementary.bias_gain) == (0.0, 0.0)
    for settings in (mekf, complementary):
        found = track(ball().imu1, ball().imu2, known(), settings)
        sound(found, ball().imu1)
        assert found.status is TrackStatus.TRACKED
        assert apart_deg(found.q_12, ball().q_12).max() < 3.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Mekf.as_published("downwards"),
        lambda: Complementary.as_published(-1.0),
        lambda: Complementary.as_published("x"),  # type: ignore[arg-type]
    ],
)
def test_as_published_checks_its_arguments(make: Any) -> None:
    with pytest.raises(SettingsError):
        make()


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("midpoint", [1, 0, None, "yes"]),
        ("restart", [1, None]),
        ("start_std", [0.0, -1.0, 11.0, math.nan, "x", None, True]),
        ("start_fade_s", [0.0, math.inf, math.nan]),
        ("max_gap_s", [-0.1, math.inf, "long"]),
        ("scale_noise", [-1e-9, 1.1, math.nan]),
        ("precision", ["half", 64, None, ["double"]]),
    ],
)
@pytest.mark.parametrize("kind", [Mekf, Complementary])
def test_shared_settings_are_refused_by_name(kind: Any, name: str, values: list[Any]) -> None:
    for value in values:
        with pytest.raises(SettingsError, match=name):
            kind(**{name: value})


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (Mekf, "outliers", "drop"),
        (Mekf, "outliers", None),
        (Mekf, "limit", 0.0),
        (Mekf, "limit", math.nan),
        (Mekf, "adapt", 1),
        (Complementary, "beta", -0.1),
        (Complementary, "beta", 1e4),
        (Complementary, "beta", 10**400),
        (Complementary, "beta_extra", -0.1),
        (Complementary, "settle_s", 0.0),
        (Complementary, "heading_gain", -1.0),
        (Complementary, "soft_angle", 4.0),
        (Complementary, "drift_limit", -1.0),
        (Complementary, "bias_gain", "x"),
        (Complementary, "literal", "yes"),
    ],
)
def test_settings_are_refused_by_name(kind: Any, name: str, value: Any) -> None:
    with pytest.raises(SettingsError, match=name):
        kind(**{name: value})


@pytest.mark.parametrize("kind", [Mekf, Complementary])
def test_settings_are_frozen_and_plain(kind: Any) -> None:
    settings = kind(start_std=np.float64(0.05), max_gap_s=1)
    assert type(settings.start_std) is float
    assert type(settings.max_gap_s) is float
    with pytest.raises(FrozenInstanceError):
        settings.start_std = 1.0
    with pytest.raises(TypeError, match="unexpected"):
        kind(gain=1.0)
    with pytest.raises(TypeError):
        kind(0.1)
    assert pickle.loads(pickle.dumps(settings)) == settings
    assert hash(settings) == hash(kind(start_std=0.05, max_gap_s=1.0))
    assert repr(settings).startswith(kind.__name__ + "(")
    assert "array" not in repr(settings)


@pytest.mark.parametrize(
    "settings",
    [
        Complementary(beta=0.0),
        Complementary(beta=1e3, heading_gain=1e6, bias_gain=1e3),
        Complementary(soft_angle=math.pi, settle_s=1e-3),
        Complementary(start_std=10.0, start_fade_s=0.01, max_gap_s=0.0, scale_noise=1.0),
        Complementary(start_std=1e-6, start_fade_s=1e6, max_gap_s=1e6, scale_noise=0.0),
        Mekf(limit=1e9),
        Mekf(limit=1e-9, outliers="reject"),
        Mekf(start_std=10.0, start_fade_s=0.01, max_gap_s=0.0, scale_noise=1.0),
        Mekf(start_std=1e-6, start_fade_s=1e6, max_gap_s=1e6, scale_noise=0.0),
        Mekf(precision="single", scale_noise=1.0, limit=1e-6),
    ],
    ids=str,
)
def test_extreme_settings_leave_it_sound(settings: Any) -> None:
    sound(tracked(settings), gapped()[0][0])
