"""The online filters: settings that act, cutting and saving that change nothing, errors that say what to do."""

from __future__ import annotations

import os
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imufast.calibration import JointCalibration
from imufast.center import JointCenter
from imufast.errors import InputError, SettingsError
from imufast.filters import Complementary, Mekf, OrientationFilter

RATE = 50.0


def samples(n: int = 1500) -> list[Any]:
    """A joint at the origin of both sensors: the same specific force in two frames that turn."""
    t = np.arange(n) / RATE
    rng = np.random.default_rng(1)
    angle1, angle2 = 0.8 * np.sin(1.7 * t), 1.1 * np.sin(2.3 * t + 1.0)
    rate1, rate2 = 0.8 * 1.7 * np.cos(1.7 * t), 1.1 * 2.3 * np.cos(2.3 * t + 1.0)
    force = np.stack([2.0 * np.sin(3.0 * t), 1.5 * np.cos(2.1 * t), 9.81 + np.sin(4.0 * t)], axis=1)

    def turned(angle: Any, axis: int) -> Any:
        c, s, out = np.cos(angle), np.sin(angle), force.copy()
        i, j = (axis + 1) % 3, (axis + 2) % 3
        out[:, i], out[:, j] = c * force[:, i] + s * force[:, j], -s * force[:, i] + c * force[:, j]
        return out

    gyr1, gyr2 = np.zeros((n, 3)), np.zeros((n, 3))
    gyr1[:, 0], gyr2[:, 1] = rate1, rate2
    clean = [gyr1, turned(angle1, 0), gyr2, turned(angle2, 1)]
    return [x + s * rng.normal(size=x.shape) for x, s in zip(clean, (0.003, 0.05, 0.003, 0.05), strict=True)]


@pytest.mark.parametrize("settings", [Mekf(), Complementary(), Mekf(precision="single"), Complementary.as_published()])
def test_cutting_and_saving_change_nothing(settings: Any) -> None:
    data = samples()
    whole = settings.start(JointCalibration(), rate_hz=RATE)
    expected = whole.update(*data)
    assert expected.shape == (1500, 4)
    np.testing.assert_allclose(np.linalg.norm(expected, axis=1), 1.0, atol=1e-6)
    pieces = settings.start(JointCalibration(), rate_hz=RATE)
    got = [pieces.update(*(x[:700] for x in data))]
    pieces = OrientationFilter.restore(pieces.state())
    got += [pieces.update(*(x[k] for x in data))[None] for k in range(700, 760)]
    got += [pieces.update(*(x[760:] for x in data))]
    assert np.array_equal(np.vstack(got), expected)
    assert pieces.state() == whole.state()


@pytest.mark.parametrize(
    ("settings", "changes"),
    [
        (
            Mekf(),
            {
                "outliers": "reject", "limit": 0.5, "adapt": False, "midpoint": False, "start_std": 0.3, "start_fade_s": 0.5,
                "scale_noise": 0.05, "precision": "single",
            },
        ),
        (
            Complementary(),
            {
                "beta": 0.001, "beta_extra": 1.0, "heading_gain": 1.0, "soft_angle": 0.3, "drift_limit": 0.1, "bias_gain": 0.5,
                "literal": True,
            },
        ),
        (Complementary(beta_extra=1.0), {"settle_s": 100.0}),
    ],
)  # fmt: skip
def test_every_setting_changes_something(settings: Any, changes: dict[str, Any]) -> None:
    data = samples()
    before = settings.start(JointCalibration(), rate_hz=RATE).update(*data)
    for name, value in changes.items():
        flt = replace(settings, **{name: value}).start(JointCalibration(), rate_hz=RATE)
        after = flt.update(*data)
        assert not np.array_equal(before, after), name


@pytest.mark.parametrize(("name", "value"), [("max_gap_s", 5.0), ("restart", False)])
def test_settings_of_gaps_change_what_follows_a_gap(name: str, value: Any) -> None:
    data = samples()
    time = np.arange(1500) / RATE + np.where(np.arange(1500) > 700, 2.0, 0.0)
    plain = Mekf().start(JointCalibration(), rate_hz=RATE)
    plain.update(data[0], data[1], data[2], data[3], time_s=time)
    other = replace(Mekf(), **{name: value}).start(JointCalibration(), rate_hz=RATE)
    other.update(data[0], data[1], data[2], data[3], time_s=time)
    assert (plain.restarts, other.restarts) == (1, 0)


def test_every_setting_is_covered() -> None:
    covered = {"outliers", "limit", "adapt", "midpoint", "start_std", "start_fade_s", "scale_noise", "precision", "max_gap_s"}
    covered |= {"restart", "beta", "beta_extra", "heading_gain", "soft_angle", "bias_gain", "literal", "settle_s"}
    covered |= {"drift_limit"}
    assert {f.name for kind in (Mekf, Complementary) for f in fields(kind)} == covered


def test_a_given_start_wins_and_says_how_well_it_is_known() -> None:
    data = samples()
    q = np.array([0.5, 0.5, -0.5, 0.5])
    flt = Mekf().start(JointCalibration(), rate_hz=RATE, q_12=q, angle_std_deg=1.5)
    np.testing.assert_allclose(flt.update(*(x[0] for x in data)), q, atol=1e-12)
    assert flt.angle_std_deg == pytest.approx(1.5, rel=0.01)
    assert flt.status == "tracking"


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: Mekf(outliers="some"), SettingsError, "outliers must be one of"),
        (lambda: Complementary(beta=-1.0), SettingsError, "beta must be between"),
        (
            lambda: Mekf(restart=1),  # type: ignore[arg-type]
            SettingsError,
            "restart must be True or False",
        ),
        (
            lambda: Mekf().start("cal", rate_hz=50.0),  # type: ignore[arg-type]
            InputError,
            "calibration must be",
        ),
        (lambda: Mekf().start(JointCalibration(), rate_hz=0.0), InputError, "rate_hz must be"),
        (lambda: Mekf().start(JointCalibration(), rate_hz=50.0, q_12=[1, 2, 3, 4]), InputError, "unit quaternion"),
        (lambda: Mekf().start(JointCalibration(), rate_hz=50.0).update([0, 0], [0] * 3, [0] * 3, [0] * 3), InputError, "gyr1"),
        (
            lambda: Mekf().start(JointCalibration(), rate_hz=50.0).update([np.nan] * 3, [0] * 3, [0] * 3, [0] * 3),
            InputError,
            "gyr1 holds values",
        ),
        (lambda: OrientationFilter.restore(b"nonsense"), InputError, "damaged"),
    ],
)
def test_errors_say_what_to_do(call: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        call()


def test_the_published_filters_start_where_asked_and_run() -> None:
    for settings in (Mekf.as_published("none"), Mekf.as_published("reject"), Complementary.as_published()):
        flt = settings.start(JointCalibration(), rate_hz=RATE, q_12=[1.0, 0.0, 0.0, 0.0])
        assert np.isfinite(flt.update(*samples())).all()


DATA = Path(os.environ.get("IMUFAST_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "two_imu_joint"


@pytest.mark.skipif(not DATA.exists(), reason=f"no recordings in {DATA}")
@pytest.mark.parametrize(("settings", "most_deg"), [(Mekf(), 1.0), (Complementary(), 1.0)])
def test_the_latest_orientation_is_right_on_a_recording(settings: Any, most_deg: float) -> None:
    with np.load(DATA / "3D_02.npz") as z:
        rec = {k: z[k] for k in z.files}
    center = JointCenter(rec["joint_in_sensor1_optical"], rec["joint_in_sensor2_optical"], np.zeros((6, 6)), np.zeros((0, 6)))
    cal = JointCalibration(
        center=center,
        gyr_bias1=rec["gyr1"][:40].mean(0),
        gyr_bias2=rec["gyr2"][:40].mean(0),
        acc_bias1=rec["acc_bias1_optical"],
        acc_bias2=rec["acc_bias2_optical"],
    )
    flt = settings.start(cal, rate_hz=float(rec["rate_hz"]))
    q = flt.update(*(np.ascontiguousarray(rec[k]) for k in ("gyr1", "acc1", "gyr2", "acc2")))
    keep = rec["reference_valid"].astype(bool)
    keep[:750] = False
    angle = 2 * np.degrees(np.arccos(np.clip(np.abs(np.sum(q * rec["q_12_reference"], axis=1)), 0.0, 1.0)))
    assert np.sqrt(np.mean(angle[keep] ** 2)) < most_deg
