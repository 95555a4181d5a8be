"""CSV and its relatives: names, units, clocks, delimiters, and files that are a little broken."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest

NAMES = "gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z"


def samples(rows: int = 20, seed: int = 0) -> np.ndarray[Any, Any]:
    x: np.ndarray[Any, Any] = (np.random.default_rng(seed).normal(size=(rows, 6)) + [0, 0, 0, 0, 0, 9.81]).round(6)
    return x


def table(names: str, *columns: Any, delimiter: str = ",") -> str:
    rows = np.column_stack(columns)
    return "\n".join([names.replace(",", delimiter), *(delimiter.join(map(repr, row)) for row in rows.tolist())]) + "\n"


@pytest.fixture
def write(tmp_path: Path) -> Any:
    def write_text(text: str | bytes, name: str = "walk.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write_text


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_every_delimiter_and_line_end_gives_back_the_same_arrays(write: Any, delimiter: str, newline: str) -> None:
    x, time = samples(), 5 + np.arange(20) / 64
    rec = imufast.read(write(table(f"time,{NAMES}", time, x, delimiter=delimiter).replace("\n", newline)))
    imu = rec["walk"]
    np.testing.assert_array_equal(imu.gyr, x[:, :3])
    np.testing.assert_array_equal(imu.acc, x[:, 3:])
    np.testing.assert_array_equal(imu.time_s, time)
    assert imu.rate_hz == 64


@pytest.mark.parametrize(
    "names",
    [
        "Gyr_X,Gyr_Y,Gyr_Z,Acc_X,Acc_Y,Acc_Z",
        "gyro x,gyro y,gyro z,accel x,accel y,accel z",
        "GyroX,GyroY,GyroZ,AccelX,AccelY,AccelZ",
        "Gyroscope X (rad/s),Gyroscope Y (rad/s),Gyroscope Z (rad/s),Accelerometer X,Accelerometer Y,Accelerometer Z",
        "gx,gy,gz,ax,ay,az",
        "wx,wy,wz,ax,ay,az",
        "angular_velocity.x,angular_velocity.y,angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z",
        '"gyr_x","gyr_y","gyr_z","acc_x","acc_y","acc_z"',
    ],
)
def test_spellings_of_column_names(write: Any, names: str) -> None:
    x = samples()
    imu = imufast.read(write(table(names, x)), rate_hz=100)["walk"]
    np.testing.assert_array_equal(np.hstack([imu.gyr, imu.acc]), x)


@pytest.mark.parametrize(
    ("names", "sensors"),
    [
        ("gyr1_x,gyr1_y,gyr1_z,acc1_x,acc1_y,acc1_z,gyr2_x,gyr2_y,gyr2_z,acc2_x,acc2_y,acc2_z", ["sensor1", "sensor2"]),
        (",".join(f"{s}.{c}" for s in ("Thigh", "Shank") for c in NAMES.split(",")), ["Thigh", "Shank"]),
        (",".join(f"{c}_{s}" for s in ("thigh_left", "shank_left") for c in NAMES.split(",")), ["thigh_left", "shank_left"]),
        (",".join(f"imu{s}_{c}" for s in "ab" for c in NAMES.split(",")), ["imua", "imub"]),
    ],
)
def test_two_sensors_side_by_side(write: Any, names: str, sensors: list[str]) -> None:
    x, y = samples(), samples(seed=1)
    rec = imufast.read(write(table(names, x, y)), rate_hz=50)
    assert list(rec) == sensors
    np.testing.assert_array_equal(rec[sensors[0]].gyr, x[:, :3])
    np.testing.assert_array_equal(rec[sensors[1]].acc, y[:, 3:])


@pytest.mark.parametrize(
    ("title", "per_second"),
    [("time_s", 1), ("t", 1), ("time_ms", 1e3), ("Timestamp (us)", 1e6), ("timestamp_ns", 1e9), ("Time [ms]", 1e3)],
)
def test_units_of_time(write: Any, title: str, per_second: float) -> None:
    time = np.arange(20) * 0.01
    imu = imufast.read(write(table(f"{title},{NAMES}", time * per_second, samples())))["walk"]
    np.testing.assert_allclose(imu.time_s, time, atol=1e-12)


def test_units_in_the_header_and_the_users_word_above_them(write: Any) -> None:
    names = "gyr_x [deg/s],gyr_y [deg/s],gyr_z [deg/s],acc_x (g),acc_y (g),acc_z (g)"
    x = samples()
    path = write(table(names, x))
    imu = imufast.read(path, rate_hz=100)["walk"]
    np.testing.assert_allclose(imu.gyr, np.radians(x[:, :3]))
    np.testing.assert_allclose(imu.acc, x[:, 3:] * 9.80665)
    imu = imufast.read(path, rate_hz=100, units="rad/s")["walk"]
    np.testing.assert_array_equal(imu.gyr, x[:, :3])
    np.testing.assert_allclose(imu.acc, x[:, 3:] * 9.80665)


def test_columns_by_mapping(write: Any) -> None:
    x, time = samples(), np.arange(20) * 10.0
    path = write(table("a,b,c,d,e,f,clock", x, time))
    rec = imufast.read(path, columns={"gyr": ["c", "b", "a"], "acc": ("d", "e", "f"), "time_ms": "clock"})
    np.testing.assert_array_equal(rec["walk"].gyr, x[:, 2::-1])
    assert rec.rate_hz == pytest.approx(100)
    rec = imufast.read(path, rate_hz=10, columns={"thigh": {"gyr": ["a", "b", "c"], "acc": ["d", "e", "f"]}})
    np.testing.assert_array_equal(rec["thigh"].gyr, x[:, :3])


def test_what_else_is_tolerated(write: Any) -> None:
    """BOM, comments, blank lines, a trailing delimiter, quoted cells, an Excel hint, columns of text beside."""
    x = samples(4)
    lines = [",".join(['"note"', *map(repr, row), ""]) for row in x.tolist()]
    text = "\ufeff# made by hand\nsep=,\n\nlabel," + NAMES + ",\n" + "\n\n".join(lines) + "\n# end\n,,,,,,,\n"
    imu = imufast.read(write(text), rate_hz=100)["walk"]
    np.testing.assert_array_equal(np.hstack([imu.gyr, imu.acc]), x)


def test_names_in_a_comment_as_numpy_writes_them(tmp_path: Path) -> None:
    x = samples()
    np.savetxt(tmp_path / "walk.csv", x, header=NAMES, delimiter=",")
    np.testing.assert_array_equal(imufast.read(tmp_path / "walk.csv", rate_hz=100)["walk"].gyr, x[:, :3])


def test_decimal_commas(write: Any) -> None:
    x = samples()
    text = table(NAMES, x, delimiter=";").replace(".", ",")
    np.testing.assert_array_equal(imufast.read(write(text), rate_hz=100)["walk"].acc, x[:, 3:])


def test_latin1_degree_signs(write: Any) -> None:
    names = NAMES.replace("gyr_x", "gyr_x (°/s)").replace("gyr_y", "gyr_y (°/s)").replace("gyr_z", "gyr_z (°/s)")
    x = samples()
    for encoding in ("latin-1", "utf-8"):
        imu = imufast.read(write(table(names, x).encode(encoding)), rate_hz=100)["walk"]
        np.testing.assert_allclose(imu.gyr, np.radians(x[:, :3]))


def test_empty_cells_are_counted_gaps(write: Any) -> None:
    x = samples(10)
    lines = table(NAMES, x).splitlines()
    lines[4] = ",,,,," + lines[4].rsplit(",", 1)[1]
    lines[8] = "nan" + lines[8][lines[8].index(",") :]
    rec = imufast.read(write("\n".join(lines)), rate_hz=100)
    kept = np.delete(np.arange(10), [3, 7])
    np.testing.assert_array_equal(rec["walk"].gyr, x[kept, :3])
    np.testing.assert_allclose(rec.time_s, kept / 100, atol=1e-15)
    assert rec["walk"].lost == 2
    assert rec.info["walk"].invalid_rows == 2


def test_a_last_line_that_is_cut_off_is_left_out_with_a_warning(write: Any) -> None:
    x = samples(10)
    path = write(table(NAMES, x)[:-30])
    with pytest.warns(imufast.ImufastWarning, match="last line .11. is cut off"):
        rec = imufast.read(path, rate_hz=100)
    np.testing.assert_array_equal(rec["walk"].gyr, x[:9, :3])
    assert "cut off" in rec.info["walk"].notes[0]


def test_rows_in_many_chunks_keep_their_line_numbers(write: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("imufast.io.table._CHUNK", 200)
    x = samples(500)
    text = table(NAMES, x)
    np.testing.assert_array_equal(imufast.read(write(text), rate_hz=100)["walk"].gyr, x[:, :3])
    lines = text.splitlines()
    lines[333] = lines[333].replace(".", "oops", 1)
    with pytest.raises(imufast.FileFormatError, match="line 334, column 'gyr_x'"):
        imufast.read(write("\n".join(lines)), rate_hz=100)
    lines[333] = lines[100][: lines[100].rindex(",")]
    with pytest.raises(imufast.FileFormatError, match="line 334 has 5 cells where the header has 6"):
        imufast.read(write("\n".join(lines)), rate_hz=100)


def test_gravity_free_columns_are_passed_over(write: Any) -> None:
    x = samples()
    names = f"user_acc_x,user_acc_y,user_acc_z,{NAMES}"
    np.testing.assert_array_equal(imufast.read(write(table(names, 0 * x[:, :3], x)), rate_hz=100)["walk"].acc, x[:, 3:])
