"""Relative orientations as files: whole or not at all, with units and frames."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast.io import table_files
from imufast.io.orientation_files import write_orientation


@pytest.fixture(scope="module")
def rel() -> imufast.RelativeOrientation:
    s = imufast.simulate_hinge("mixed", duration_s=20, rate_hz=50, seed=2)
    tracked = imufast.track(s.imu1, s.imu2, method="mekf")
    return replace(tracked, time_s=tracked.time_s + 1.7e9)


def test_csv_states_units_and_frames_and_keeps_the_numbers(
    rel: imufast.RelativeOrientation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_files, "ROWS", 64)
    path = tmp_path / "q.CSV"
    imufast.write_orientation(rel, path)
    first, names, *rows = path.read_text("utf-8").splitlines()
    for said in ("imufast.orientation 1", "sensor frame 2 to sensor frame 1", "Hamilton, scalar first", "in s;", "degrees"):
        assert said in first
    assert first.startswith("#")
    assert names == "time_s,q_w,q_x,q_y,q_z,angle_std_deg"
    values = np.array([[float(x) for x in row.split(",")] for row in rows])
    np.testing.assert_array_equal(values[:, 0], rel.time_s)
    np.testing.assert_allclose(values[:, 1:5], rel.q_12, atol=1e-10)
    np.testing.assert_allclose(values[:, 5], rel.angle_std_deg, rtol=1e-5)


def test_parquet_states_them_in_its_schema(rel: imufast.RelativeOrientation, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "q.parquet"
    write_orientation(rel, path)
    table = parquet.read_table(path)
    assert table.column_names == ["time_s", "q_w", "q_x", "q_y", "q_z", "angle_std_deg"]
    about = json.loads(table.schema.metadata[b"imufast.orientation"])
    assert about["schema_version"] == 1
    assert about["status"] == "TRACKED"
    assert about["units"] == {"time_s": "s", "q_w": "1", "q_x": "1", "q_y": "1", "q_z": "1", "angle_std_deg": "deg"}
    assert "sensor frame 2 to sensor frame 1" in about["frames"]
    assert table.schema.field("angle_std_deg").metadata[b"unit"] == b"deg"
    np.testing.assert_array_equal(np.stack([table[name] for name in ("q_w", "q_x", "q_y", "q_z")], axis=1), rel.q_12)
    np.testing.assert_array_equal(table["time_s"], rel.time_s)


@pytest.mark.parametrize("name", ["q.csv", "q.parquet"])
def test_whole_or_not_at_all(
    rel: imufast.RelativeOrientation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow.parquet")
    path = tmp_path / name
    path.write_text("before", "utf-8")
    write_orientation(rel, path)
    whole = path.read_bytes()
    assert whole != b"before"

    def fail(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(imufast.InputError, match="No space left"):
        write_orientation(rel, path)
    assert path.read_bytes() == whole
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_other_things_and_names_are_refused(rel: imufast.RelativeOrientation, tmp_path: Path) -> None:
    for name in ("q.txt", "q", ".csv", "q.csv.gz"):
        with pytest.raises(imufast.InputError, match=r"must end in \.csv, \.parquet or \.sto"):
            write_orientation(rel, tmp_path / name)
    with pytest.raises(imufast.InputError, match="rel must be a RelativeOrientation"):
        write_orientation(rel.q_12, tmp_path / "q.csv")  # type: ignore[arg-type]
    with pytest.raises(imufast.InputError, match="no folder"):
        write_orientation(rel, tmp_path / "none" / "q.csv")
    assert not list(tmp_path.iterdir())
