"""The checks that speak: each on data that are wrong in one way, and silence on data that are right."""

from __future__ import annotations

import time
import warnings
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest

RATE = 100.0


def gentle(seconds: float = 30.0, seed: int = 0) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """A sensor turned to and fro about two axes in the field of gravity, with a sensor's noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    roll, pitch = 0.8 * np.sin(2 * np.pi * 0.4 * t), 0.5 * np.sin(2 * np.pi * 0.3 * t)
    roll_rate, pitch_rate = np.gradient(roll, t), np.gradient(pitch, t)
    # Pitch about y first, then roll about the x axis that moved with it.
    gyr = np.stack([roll_rate, pitch_rate * np.cos(roll), -pitch_rate * np.sin(roll)], axis=1)
    acc = 9.81 * np.stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=1)
    return gyr + rng.normal(scale=0.01, size=gyr.shape), acc + rng.normal(scale=0.05, size=acc.shape)


def test_good_data_pass_in_silence() -> None:
    imufast.Imu(*gentle(), rate_hz=RATE)


@pytest.mark.parametrize(("divisor", "unit"), [(9.80665, "g"), (9.80665e-3, "mg")])
def test_acc_in_g_or_mg_is_an_error_that_names_the_unit(divisor: float, unit: str) -> None:
    gyr, acc = gentle()
    with pytest.raises(imufast.UnitError, match=f"acc looks like {unit}; give units='{unit}'"):
        imufast.Imu(gyr, acc / divisor, RATE)
    imufast.Imu(gyr, acc / divisor, RATE, units=unit)
    with pytest.warns(imufast.ImufastWarning, match=f"acc looks like {unit}"):
        imufast.Imu(gyr, acc / divisor, RATE, units="m/s^2")


def test_gravity_removed_is_an_error() -> None:
    gyr, _ = gentle()
    free = np.random.default_rng(0).normal(scale=0.05, size=gyr.shape)
    with pytest.raises(imufast.InputError, match="FreeAcc"):
        imufast.Imu(gyr, free, RATE)


def test_other_levels_of_gravity_warn() -> None:
    gyr, acc = gentle()
    with pytest.warns(imufast.ImufastWarning, match="check the unit and the scale of acc"):
        imufast.Imu(gyr, acc * 3.28, RATE)  # feet


def test_gyr_in_degrees_warns() -> None:
    gyr, acc = gentle()
    with pytest.warns(imufast.ImufastWarning, match="deg/s looks likely"):
        imufast.Imu(np.degrees(gyr), acc, RATE)


def test_a_range_that_no_gyroscope_has_warns() -> None:
    gyr, acc = gentle()
    gyr[500] = [0, 45, 0]
    imufast.Imu(gyr, acc, RATE)  # elsewhere gravity confirms the scale
    with pytest.warns(imufast.ImufastWarning, match="gyr reaches 45 rad/s"):
        imufast.Imu(gyr[450:], acc[:-450], RATE)


def test_slow_gyr_in_degrees_is_told_by_gravity_alone() -> None:
    """At 0.3 rad/s degrees stay below 40: only d(acc)/dt = −ω × acc tells."""
    rng = np.random.default_rng(1)
    t = np.arange(6000) / RATE
    angle = 0.9 * np.sin(2 * np.pi * 0.05 * t)
    gyr = np.stack([np.gradient(angle, t), 0 * t, 0 * t], axis=1) + rng.normal(scale=0.002, size=(len(t), 3))
    acc = 9.81 * np.stack([0 * t, np.sin(angle), np.cos(angle)], axis=1) + rng.normal(scale=0.02, size=(len(t), 3))
    imufast.Imu(gyr, acc, RATE)
    degrees = np.degrees(gyr)
    assert np.abs(degrees).max() < 40
    with pytest.warns(imufast.ImufastWarning, match="gyr turns 5. times faster than gravity"):
        imufast.Imu(degrees, acc, RATE)
    with pytest.warns(imufast.ImufastWarning, match="converted from deg/s twice"):
        imufast.Imu(np.radians(gyr) + rng.normal(scale=1e-5, size=gyr.shape), acc, RATE)


def test_clipping_warns_with_axis_and_level() -> None:
    gyr, acc = gentle()
    with pytest.warns(imufast.ImufastWarning, match=r"gyr\[:, 0\] \(x\) is clipped at ±2 rad/s"):
        imufast.Imu(np.clip(gyr * [2, 1, 1], [-2, -9, -9], [2, 9, 9]), acc, RATE)


def test_stuck_and_dead_sensors_warn() -> None:
    gyr, acc = gentle()
    with pytest.warns(imufast.ImufastWarning, match="gyr is zero throughout"):
        imufast.Imu(0 * gyr, acc, RATE)
    with pytest.warns(imufast.ImufastWarning, match="gyr never changes"):
        imufast.Imu(0 * gyr + [0.1, 0, 0], acc, RATE)
    with pytest.warns(imufast.ImufastWarning, match="acc never changes"):
        imufast.Imu(gyr, 0 * acc + [0, 0, 9.8], RATE)
    frozen = gyr.copy(), acc.copy()
    for signal in frozen:
        signal[1000:1100] = signal[1000]
    with pytest.warns(imufast.ImufastWarning, match=r"rows repeat the row before, up to 99 in a row"):
        imufast.Imu(*frozen, RATE)
    with pytest.warns(imufast.ImufastWarning, match="50 % of the rows repeat"):
        imufast.Imu(np.repeat(gyr, 2, axis=0), np.repeat(acc, 2, axis=0), 2 * RATE)


def test_milliseconds_warn() -> None:
    gyr, acc = gentle(1.0)
    with pytest.warns(imufast.ImufastWarning, match="must be in seconds"):
        imufast.Imu(gyr[:9], acc[:9], time_s=np.arange(9) * 10.0)


def test_warnings_name_the_imu_and_point_at_the_caller() -> None:
    gyr, acc = gentle()
    with pytest.warns(imufast.ImufastWarning, match="imu 'foot'") as caught:
        imufast.Imu(0 * gyr, acc, RATE, name="foot")
    assert caught[0].filename == __file__


def test_less_than_a_second_is_not_judged() -> None:
    imufast.Imu(np.zeros((90, 3)), np.ones((90, 3)), RATE)


def test_a_long_recording_is_judged_quickly() -> None:
    gyr, acc = (np.tile(x, (500, 1)) for x in gentle(20.0))
    start = time.perf_counter()
    imufast.Imu(gyr, acc, RATE)
    # A million rows take about 0.01 s; looking at each of them closely took ten times that.
    assert time.perf_counter() - start < 1.0
    with pytest.raises(imufast.UnitError, match="'g'"):
        imufast.Imu(gyr, acc / 9.81, RATE)
    acc[777_777, 1] = np.nan
    with pytest.raises(imufast.InputError, match=r"acc has NaN.*1 of 1000000 rows, first in row 777777"):
        imufast.Imu(gyr, acc, RATE)


def test_every_real_recording_loads_in_silence_and_in_degrees_or_g_does_not(shared_data: Path) -> None:
    xsens = sorted((shared_data / "formats/xsens_mt_manager").glob("MT_012005D6*.txt"))
    files = [*sorted(shared_data.glob("*/*.npz")), *xsens]
    assert len(files) >= 12
    for file in files:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            recording = imufast.read(file)
        for imu in recording.values():
            with pytest.warns(imufast.ImufastWarning, match="deg/s"):
                imufast.Imu(np.degrees(imu.gyr), imu.acc, imu.rate_hz)
            for unit, size in (("g", 9.80665), ("mg", 9.80665e-3)):
                with pytest.raises(imufast.UnitError, match=f"'{unit}'"):
                    imufast.Imu(imu.gyr, imu.acc / size, imu.rate_hz)
