"""Xsens MT Manager and Movella DOT: the real files by their counts, made files by what was put into them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

OLD = "// Start Time: Unknown\r\n// Update Rate: 40.0Hz\r\n// Filter Profile: human (46.1)\r\n"
NEW = "// General information:\n//  MT Manager version: 2022.2.0\n// Coordinate system: ENU\n"
UTC = "UTC_Nano UTC_Year UTC_Month UTC_Day UTC_Hour UTC_Minute UTC_Second UTC_Valid"
IMU = "Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z"


def export(
    counters: Any, x: Any, *, header: str = OLD, empty: str = "SampleTimeFine", delimiter: str = "\t", gap: str = ""
) -> str:
    """A file as MT Manager writes it: five digits of counter, columns that may stay empty, acc before gyr."""
    names = ["PacketCounter", *empty.split(), *IMU.split(), "Mat[1][1]"]
    lines = [delimiter.join(names)]
    for counter, row in zip(counters, x, strict=True):
        cells = [f"{counter % 65536:05d}", *[gap] * len(empty.split()), *map(repr, row.tolist()), "1.0"]
        if delimiter == " ":
            cells = [cell for cell in cells if cell]
        lines.append(delimiter.join(cells))
    return header + "\n".join(lines) + "\n"


def samples(rows: int, seed: int = 0) -> np.ndarray[Any, Any]:
    x: np.ndarray[Any, Any] = (np.random.default_rng(seed).normal(size=(rows, 6)) + [0, 0, 9.81, 0, 0, 0]).round(6)
    return x


# name: samples, first counter, rate in the header, rows with NaN
REAL = {
    "MT2022_ACC_GYRO_ROT_ALL_TAB_NAN_00B42D4B": (4, 51400, None, 1),
    "MT2022_ACC_GYRO_ROT_EULER_TAB_00B42D4F": (5, 51400, None, 0),
    "MT2022_ACC_GYRO_ROT_MAT_COMMA_00B42D4B": (5, 51400, None, 0),
    "MT2022_ACC_GYRO_ROT_MAT_SEMICOLON_00B42D4B": (5, 51400, None, 0),
    "MT46_01-000_00B42D4D": (5, 4097, 100.0, 0),
    "MT_012005D6_031-000_00B421AF": (3369, 3583, 100.0, 0),
    "MT_012005D6_031-000_00B4227B": (3369, 3583, 100.0, 0),
}


@pytest.mark.parametrize("name", REAL)
def test_real_exports_by_count_rate_and_gaps(shared_data: Path, name: str) -> None:
    count, first, rate, invalid = REAL[name]
    path = shared_data / f"formats/xsens_mt_manager/{name}.txt"
    if rate is None:
        with pytest.raises(imufast.InputError, match=rf"{name}.*give rate_hz= .command line: --rate"):
            imufast.read(path)
    rec = imufast.read(path, rate_hz=rate or 100)
    (imu,) = rec.values()
    info = rec.info[imu.name]
    assert imu.name == name[-8:]
    assert (len(imu), imu.rate_hz, imu.lost, imu.segments()) == (count, 100.0, 0, [(0, count)])
    assert (info.rows, info.invalid_rows, info.lost_rows) == (count + invalid, invalid, 0)
    assert (info.first_counter, info.header_rate_hz, info.format) == (first, rate, "xsens_mt_manager")
    assert imu.time_s[0] == 0


def test_two_real_sensors_of_one_recording(shared_data: Path) -> None:
    folder = shared_data / "formats/xsens_mt_manager"
    files = [folder / f"MT_012005D6_031-000_{name}.txt" for name in ("00B421AF", "00B4227B")]
    rec = imufast.read(files)
    assert (list(rec), len(rec.time_s)) == (["00B421AF", "00B4227B"], 3369)
    np.testing.assert_array_equal(rec["00B421AF"].acc[0], [3.030769, 5.254238, -7.714005])
    np.testing.assert_array_equal(rec["00B4227B"].gyr[0], [-0.002551, -0.016452, 0.036099])
    assert list(imufast.read({"thigh": files[0], "shank": files[1]})) == ["thigh", "shank"]


@pytest.mark.parametrize(
    "name",
    ["xsens_mt_manager/MT2022_ACC_00B42D4B.txt", "xsens_mt_manager/MT_01200312-002-000_00B474BA.txt"]
    + [f"movella_dot/{s}.csv" for s in ("Pelvis_20210820_202113_836", "LTibia_20210820_202113_811")],
)
def test_real_exports_without_gyroscope_are_refused_with_that_reason(shared_data: Path, name: str) -> None:
    with pytest.raises(imufast.FileFormatError, match=r"holds .*acceleration.* but no gyroscope columns"):
        imufast.read(shared_data / "formats" / name, rate_hz=60)


def test_an_unknown_vendor_is_refused_with_the_known_ones(shared_data: Path) -> None:
    with pytest.raises(imufast.FileFormatError, match="Formats known: npz, movella_dot, xsens_mt_manager, csv"):
        imufast.read(shared_data / "formats/apdm/apdm_format7.csv")


@pytest.mark.parametrize("delimiter", ["\t", ",", ";", " "])
@pytest.mark.parametrize("empty", ["", "SampleTimeFine", "SampleTimeFine Year Month Day Second", f"SampleTimeFine {UTC}"])
@pytest.mark.parametrize("gap", ["", "NaN"])
def test_every_delimiter_with_empty_columns(tmp_path: Path, delimiter: str, empty: str, gap: str) -> None:
    x = samples(12)
    path = tmp_path / "MT_0001-000_00B4AAAA.txt"
    path.write_text(export(range(100, 112), x, empty=empty, delimiter=delimiter, gap=gap), encoding="utf-8")
    imu = imufast.read(path)["00B4AAAA"]
    np.testing.assert_array_equal(np.hstack([imu.acc, imu.gyr]), x)
    assert imu.rate_hz == 40


def test_cells_lost_between_spaces_are_refused_where_two_answers_are_possible(tmp_path: Path) -> None:
    text = export(range(5), samples(5), empty="SampleTimeFine Year Month", delimiter=" ")
    path = tmp_path / "x.txt"
    path.write_text(text.replace("Mat[1][1]", "Mat[1][1] Mat[2][1]"), encoding="utf-8")
    with pytest.raises(imufast.FileFormatError, match=r"4 cells fewer than the header.*export with tabs"):
        imufast.read(path)


@given(
    first=st.integers(0, 65535),
    lost=st.tuples(*[st.sets(st.integers(1, 298), max_size=60)] * 2),
    holes=st.tuples(*[st.integers(0, 30000)] * 2),
    start=st.tuples(*[st.integers(0, 5)] * 2),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_exactly_the_surviving_samples_at_the_right_times(
    tmp_path: Path, first: int, lost: Any, holes: Any, start: Any
) -> None:
    """Law: whatever is lost, and wherever the counter wraps, a sample that all sensors have keeps its time and values."""
    x = [samples(300, seed) for seed in (0, 1)]
    # A long hole in the middle for both, in which the counter may wrap as well.
    packet = np.arange(300) + np.where(np.arange(300) >= 150, max(holes), 0)
    kept = [np.array([k for k in range(begin, 300) if k not in gone]) for gone, begin in zip(lost, start, strict=True)]
    for name, rows, values in zip("AB", kept, x, strict=True):
        text = export(first + packet[rows], values[rows])
        (tmp_path / f"MT_00B4000{name}.txt").write_text(text, encoding="utf-8")
    rec = imufast.read([tmp_path / "MT_00B4000A.txt", tmp_path / "MT_00B4000B.txt"])
    both = np.intersect1d(kept[0], kept[1])
    np.testing.assert_allclose(rec.time_s, (packet[both] - packet[both[0]]) / 40, rtol=1e-14)
    for name, values in zip("AB", x, strict=True):
        imu = rec[f"00B4000{name}"]
        np.testing.assert_array_equal(np.hstack([imu.acc, imu.gyr]), values[both])
        assert imu.lost == packet[both[-1]] - packet[both[0]] + 1 - len(both)
    for name, rows in zip("AB", kept, strict=True):
        info = rec.info[f"00B4000{name}"]
        assert info.lost_rows == packet[rows[-1]] - packet[rows[0]] + 1 - len(rows)
        assert info.first_counter == (first + packet[rows[0]]) % 65536


def test_repeated_packets_are_left_out(tmp_path: Path) -> None:
    x = samples(10)
    path = tmp_path / "MT_00B40001.txt"
    path.write_text(export([0, 1, 2, 2, 3, 4, 5, 6, 7, 8], x), encoding="utf-8")
    rec = imufast.read(path)
    np.testing.assert_array_equal(rec["00B40001"].acc, np.delete(x, 3, axis=0)[:, :3])
    assert "repeat the PacketCounter" in rec.info["00B40001"].notes[0]


def test_names_that_clash_give_way_to_the_files(tmp_path: Path) -> None:
    for name in ("first_00B40001", "second_00B40001"):
        (tmp_path / f"{name}.txt").write_text(export(range(5), samples(5)), encoding="utf-8")
    assert list(imufast.read(sorted(tmp_path.iterdir()))) == ["first_00B40001", "second_00B40001"]


def test_a_stated_rate_that_is_overruled_warns(tmp_path: Path) -> None:
    path = tmp_path / "MT_00B40001.txt"
    path.write_text(export(range(5), samples(5)), encoding="utf-8")
    with pytest.warns(imufast.ImufastWarning, match="states a rate of 40 Hz; rate_hz=100") as caught:
        rec = imufast.read(path, rate_hz=100)
    assert rec.rate_hz == 100
    assert caught[0].filename == __file__


def test_movella_dot_with_gyroscope(tmp_path: Path) -> None:
    """deg/s, µs that wrap at 2³², the nominal rate although every second row is lost."""
    head = "sep=,\nDeviceTag:,abc\nOutputRate:,60Hz\n© Xsens Technologies B. V. 2005-2021\n\n"
    names = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z,Status\n"
    x = samples(40)
    for tag, rows in (("a", range(40)), ("b", [0, *range(1, 40, 2)])):
        times = [(2**32 - 100_000 + k * 16667) % 2**32 for k in rows]
        lines = [f"{k + 1},{t},{','.join(map(repr, x[k].tolist()))},0" for k, t in zip(rows, times, strict=True)]
        (tmp_path / f"{tag}.csv").write_text(head + names + "\n".join(lines) + "\n", encoding="utf-8")
    rec = imufast.read([tmp_path / "a.csv", tmp_path / "b.csv"])
    kept = [0, *range(1, 40, 2)]
    assert rec.rate_hz == 60
    np.testing.assert_allclose(rec["a"].gyr, np.radians(x[kept, 3:]))
    np.testing.assert_array_equal(rec["b"].acc, x[kept, :3])
    assert rec["b"].lost == 40 - len(kept)
    assert rec.info["b"].format == "movella_dot"


def test_big_exports_are_read_fast(tmp_path: Path) -> None:
    """About a million rows a second; a reader that goes cell by cell takes five times as long."""
    import time

    x = samples(50_000)
    path = tmp_path / "MT_00B40001.txt"
    path.write_text(export(range(50_000), x), encoding="utf-8")
    start = time.perf_counter()
    assert len(imufast.read(path).time_s) == 50_000
    assert time.perf_counter() - start < 2.0
    assert os.path.getsize(path) > 3_000_000  # noqa: PTH202
