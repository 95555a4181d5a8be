"""Numpy archives in both layouts; hostile ones are in tests/test_bad_input_data.py."""

from __future__ import annotations

from pathlib import Path

import imufast
import numpy as np
import pytest


def test_numbered_and_named_arrays(tmp_path: Path) -> None:
    x = np.random.default_rng(0).normal(size=(4, 30, 3)) + np.array([[[0, 0, 0]], [[0, 0, 9.81]]] * 2)
    np.savez(tmp_path / "a.npz", rate_hz=50, gyr1=x[0], acc1=x[1], gyr2=x[2], acc2=x[3], q_gs1=np.ones((30, 4)))
    rec = imufast.read(tmp_path / "a.npz")
    assert list(rec) == ["sensor1", "sensor2"]
    np.testing.assert_array_equal(rec["sensor2"].acc, x[3])
    assert rec.rate_hz == 50
    time = np.cumsum(np.random.default_rng(1).uniform(0.009, 0.011, 30))
    named = {"left.thigh.gyr": x[0].astype(np.float32), "left.thigh.acc": np.asfortranarray(x[1]), "time_s": time}
    np.savez_compressed(tmp_path / "b.npz", **named)
    rec = imufast.read(tmp_path / "b.npz")
    assert list(rec) == ["left.thigh"]
    np.testing.assert_array_equal(rec["left.thigh"].acc, x[1])
    np.testing.assert_array_equal(rec.time_s, time)
    np.savez(tmp_path / "c.npz", gyr=x[0], acc=x[1])
    assert list(imufast.read(tmp_path / "c.npz", rate_hz=20)) == ["c"]
    assert list(imufast.read({"foot": tmp_path / "c.npz"}, rate_hz=20)) == ["foot"]


def test_rows_with_nan_become_gaps(tmp_path: Path) -> None:
    x = np.random.default_rng(0).normal(size=(2, 30, 3))
    x[0, 4, 1] = x[1, 9, 0] = np.nan
    np.savez(tmp_path / "a.npz", rate_hz=50, gyr=x[0], acc=x[1])
    rec = imufast.read(tmp_path / "a.npz")
    assert (len(rec.time_s), rec["a"].lost, rec.info["a"].invalid_rows) == (28, 2, 2)


@pytest.mark.parametrize(("file", "rows"), [("1D_01", 3007), ("1D_04", 15382), ("2D_05", 14966), ("3D_04", 15062)])
def test_rig_recordings(shared_data: Path, file: str, rows: int) -> None:
    path = shared_data / f"two_imu_joint/{file}.npz"
    rec = imufast.read(path)
    assert (list(rec), len(rec.time_s), rec.rate_hz) == (["sensor1", "sensor2"], rows, 50.0)
    np.testing.assert_array_equal(rec["sensor1"].gyr, np.load(path)["gyr1"])


def test_full_body_recording(shared_data: Path) -> None:
    rec = imufast.read(shared_data / "lower_body/full_body_walk.npz")
    assert (len(rec), len(rec.time_s), rec.rate_hz) == (16, 10000, 100.0)
    assert {"hip", "upper_leg_left", "foot_right"} <= set(rec)
