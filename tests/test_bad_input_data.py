"""Wrong arguments and hostile files: each with its exception and a message that names the argument or the file."""

from __future__ import annotations

import io
import os
import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import imufast
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from imufast.errors import MissingFileError
from imufast.io import align

N = 20
GYR = np.random.default_rng(0).normal(size=(N, 3))
ACC = np.random.default_rng(1).normal(size=(N, 3)) + [0, 0, 9.81]
TIME = np.arange(N) / 100
Case: TypeAlias = tuple[str, Callable[[], object], type[Exception], str]


def imu(**changes: Any) -> Callable[[], object]:
    arguments: dict[str, Any] = {"gyr": GYR, "acc": ACC, "rate_hz": 100.0} | changes
    return lambda: imufast.Imu(**arguments)


def put(array: np.ndarray[Any, Any], row: int, value: float) -> np.ndarray[Any, Any]:
    changed: np.ndarray[Any, Any] = array.copy()
    changed[row, 1] = value
    return changed


def times(*changes: tuple[int, float]) -> Callable[[], object]:
    time = TIME.copy()
    for row, value in changes:
        time[row] = value
    return imu(rate_hz=None, time_s=time)


def sensor(name: str = "imu", rows: int = N, start: float = 0.0) -> imufast.Imu:
    return imufast.Imu(GYR[:rows], ACC[:rows], time_s=start + TIME[:rows], name=name)


Input, Unit, Format = imufast.InputError, imufast.UnitError, imufast.FileFormatError
GENTLE = np.tile([0.0, 0.0, 9.81], (300, 1)) + np.random.default_rng(2).normal(scale=0.05, size=(300, 3))
TURN = np.random.default_rng(3).normal(scale=0.1, size=(300, 3))

ARRAYS: list[Case] = [
    ("gyr-none", imu(gyr=None), Input, "^gyr must hold real numbers.*NoneType"),
    ("gyr-string", imu(gyr="1 2 3"), Input, "^gyr must hold real numbers.*str"),
    ("gyr-ragged", imu(gyr=[[1, 2, 3], [1, 2]]), Input, "^gyr cannot be made an array"),
    ("gyr-1d", imu(gyr=GYR[:, 0]), Input, r"^gyr must have the shape \(N, 3\).*got \(20,\)"),
    ("gyr-transposed", imu(gyr=GYR.T), Input, r"^gyr .*got \(3, 20\); transpose it \(gyr.T\)"),
    ("acc-four-columns", imu(acc=np.ones((N, 4))), Input, r"^acc must have the shape \(N, 3\).*got \(20, 4\)"),
    ("acc-3d", imu(acc=np.ones((N, 3, 1))), Input, r"^acc must have the shape"),
    ("acc-scalar", imu(acc=9.81), Input, r"^acc must have the shape \(N, 3\).*got \(\)"),
    ("acc-bool", imu(acc=ACC > 0), Input, "^acc must hold real numbers.*bool"),
    ("acc-complex", imu(acc=ACC + 0j), Input, "^acc must hold real numbers.*complex128"),
    ("acc-object", imu(acc=ACC.astype(object)), Input, "^acc must hold real numbers.*object"),
    ("acc-dates", imu(acc=ACC.astype("datetime64[s]")), Input, "^acc must hold real numbers.*datetime64"),
    ("acc-huge-integers", imu(acc=[[10**30] * 3] * N), Input, "^acc must hold real numbers.*object"),
    ("gyr-masked", imu(gyr=np.ma.masked_greater(GYR, 0.5)), Input, "^gyr has masked values"),
    ("empty", imu(gyr=np.empty((0, 3)), acc=np.empty((0, 3))), Input, "^gyr is empty"),
    ("lengths", imu(acc=ACC[:-1]), Input, "^gyr and acc must have the same length, got 20 and 19"),
    ("gyr-nan", imu(gyr=put(GYR, 7, np.nan)), Input, "^gyr has NaN.* in 1 of 20 rows, first in row 7"),
    ("acc-inf", imu(acc=put(put(ACC, 3, np.inf), 9, -np.inf)), Input, "^acc has NaN or inf.* 2 of 20 rows, first in row 3"),
    ("acc-absurd", imu(acc=put(ACC, 3, -1e300)), Input, r"^acc reaches 1e\+300"),
    ("acc-float128", imu(acc=put(ACC.astype(np.longdouble), 0, np.longdouble(10) ** 308 * 10)), Input, "^acc has NaN or inf"),
    ("neither-rate-nor-time", imu(rate_hz=None), Input, "^give rate_hz .* or time_s"),
    *[
        (f"rate-{rate}", imu(rate_hz=rate), Input, "^rate_hz must be a positive number")
        for rate in (0, -100.0, np.nan, np.inf, 1e-300, "100", True, [100.0], 1j)
    ],
    ("time-back", times((8, 0.01)), Input, "^time_s must increase strictly, but row 8 .0.01 s. .* row 7"),
    ("time-repeats", times((5, 0.04)), Input, "^time_s must increase strictly, but row 5"),
    ("time-nan", times((5, np.nan)), Input, "^time_s has NaN.* first in row 5"),
    ("time-inf", times((19, np.inf)), Input, "^time_s has NaN or inf"),
    ("time-short", imu(rate_hz=None, time_s=TIME[1:]), Input, r"^time_s must have the shape \(20,\).*got \(19,\)"),
    ("time-column", imu(rate_hz=None, time_s=TIME[:, None]), Input, r"^time_s must have the shape.*got \(20, 1\)"),
    ("time-strings", imu(rate_hz=None, time_s=["0"] * N), Input, "^time_s must hold real numbers"),
    ("time-beyond-any-clock", times((0, -1e300), (19, 1e300)), Input, "^time_s must be in seconds"),
    ("time-nanoseconds", imu(rate_hz=None, time_s=np.arange(N) * 1e7), Input, "^time_s must be in seconds"),
    ("time-of-one", imu(gyr=GYR[:1], acc=ACC[:1], rate_hz=None, time_s=[0.0]), Input, "^time_s has one sample"),
    ("name-empty", imu(name=" "), Input, "^name must be a non-empty string"),
    ("name-number", imu(name=3), Input, "^name must be a non-empty string, got 3"),
    ("units-unknown", imu(units="furlong"), Input, "^units: 'furlong' is not a unit.*known are rad/s"),
    ("units-twice", imu(units="g, m/s^2"), Input, "^units: acc is stated twice"),
    ("units-wrong-signal", imu(units={"gyr": "g"}), Input, "^units: 'gyr' cannot be in 'g'"),
    ("units-key", imu(units={"mag": "g"}), Input, "^units: 'mag'"),
    ("units-type", imu(units=9.81), Input, "^units must be a string or a mapping, got float"),
    ("acc-in-g", imu(gyr=TURN, acc=GENTLE / 9.81), Unit, "^imu 'imu': .*give units='g'"),
    ("acc-in-mg", imu(gyr=TURN, acc=GENTLE * 102), Unit, "^imu 'imu': .*give units='mg'"),
    ("acc-gravity-free", imu(gyr=TURN, acc=GENTLE - [0, 0, 9.81]), Input, "^imu 'imu': .*FreeAcc"),
    ("gyr-zero", imu(gyr=0 * TURN, acc=GENTLE), imufast.ImufastWarning, "gyr is zero throughout"),
    ("gyr-stuck", imu(gyr=0 * TURN + 0.1, acc=GENTLE), imufast.ImufastWarning, "gyr never changes"),
    ("acc-stuck", imu(gyr=TURN, acc=0 * GENTLE + 5.6), imufast.ImufastWarning, "acc never changes"),
    ("slice-step", lambda: sensor()[::2], Input, r"imu\[100:200\].*slice"),
    ("slice-index", lambda: sensor()[3], Input, "slices"),  # type: ignore[index]
    ("slice-floats", lambda: sensor()[0.5:2.0], Input, "slices of whole numbers"),
    ("slice-empty", lambda: sensor()[15:5], Input, r"imu\[15:5\] holds no sample"),
    ("between-empty", lambda: sensor().between(5, 6), Input, "^start_s=5, stop_s=6 hold no sample; .* 0 to 0.19 s"),
    ("between-nan", lambda: sensor().between(float("nan")), Input, "^start_s must be a time"),
    ("recording-empty", lambda: imufast.Recording({}), Input, "^imus is empty"),
    ("recording-none", lambda: imufast.Recording(None), Input, "^imus must be a mapping"),  # type: ignore[arg-type]
    ("recording-one-imu", lambda: imufast.Recording(sensor()), Input, "^imus must be a mapping"),  # type: ignore[arg-type]
    ("recording-arrays", lambda: imufast.Recording([GYR]), Input, "^imus must hold Imu"),  # type: ignore[list-item]
    ("recording-same-name", lambda: imufast.Recording([sensor(), sensor()]), Input, "^imus: two sensors are named 'imu'"),
    ("recording-lengths", lambda: imufast.Recording([sensor("a"), sensor("b", 9)]), Input, "^imus: 'a' and 'b' .*20 and 9"),
    ("recording-times", lambda: imufast.Recording([sensor("a"), sensor("b", start=1e-3)]), Input, "'a' and 'b'.*align"),
    ("recording-key", lambda: imufast.Recording({"": sensor()}), Input, "^imus: a name must be a non-empty string"),
    ("pair-of-one", lambda: imufast.Recording([sensor()]).pair(), Input, "^name1, name2: .*'imu'"),
    ("pair-unknown", lambda: imufast.Recording([sensor("a"), sensor("b")]).pair("a", "c"), Input, "^name1, name2.*'c'"),
    ("pair-same", lambda: imufast.Recording([sensor("a"), sensor("b")]).pair("a", "a"), Input, "two different sensors"),
    ("align-nothing", lambda: align([]), Input, "^imus must be a non-empty list"),
    ("align-apart", lambda: align([sensor("a"), sensor("b", start=9)]), Input, "'a'.*'b'.*no time in common"),
]


@pytest.mark.parametrize(("call", "error", "message"), [case[1:] for case in ARRAYS], ids=[case[0] for case in ARRAYS])
def test_arrays(call: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message) as caught:  # warnings are errors here
        call()
    assert caught.type is error
    assert isinstance(caught.value, (imufast.ImufastError, imufast.ImufastWarning))


HEADER = "time,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z\n"
ROWS = "".join(f"{k / 100},1,2,3,4,5,{k}\n" for k in range(10))
XSENS = "// Update Rate: 100.0Hz\nPacketCounter\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n"


def npy(array: Any, shape: str | None = None, descr: str | None = None) -> bytes:
    """The bytes of an npy file, whose header may lie."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=True)
    data = buffer.getvalue()
    if shape is None and descr is None:
        return data
    body = data[10 + struct.unpack("<H", data[8:10])[0] :]
    header = (
        f"{{'descr': {descr or repr(array.dtype.str)}, 'fortran_order': False, 'shape': {shape or array.shape}, }}\n".encode()
    )
    return data[:8] + struct.pack("<H", len(header)) + header + body


def npz(**members: Any) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, member in ({"rate_hz": np.array(50.0), "gyr": GYR, "acc": ACC} | members).items():
            archive.writestr(f"{name}.npy", member if isinstance(member, bytes) else npy(member))
    return buffer.getvalue()


def lying_directory() -> bytes:
    """An archive whose directory claims terabytes for one member."""
    data = bytearray(npz())
    where = data.rindex(b"PK\x01\x02")
    data[where + 20 : where + 28] = struct.pack("<II", 0xFFFFFFF0, 0xFFFFFFF0)
    return bytes(data)


class Bomb:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("/tmp/a-pickle-was-run",)  # noqa: S108


FILES: list[tuple[str, bytes | str, dict[str, Any], type[Exception], str]] = [
    ("empty", "", {}, Format, "is empty"),
    ("blank", "\n\n  \r\n", {}, Format, "is empty"),
    ("header-only", HEADER, {}, Format, "no rows after the header in line 1"),
    ("one-cut-row", HEADER + "0.0,1,2", {}, imufast.ImufastWarning, "last line .2. is cut off"),
    ("no-header", ROWS, {}, Format, "not recognised; known are npz, movella_dot, xsens_mt_manager, csv"),
    ("no-header-but-asked", ROWS, {"format": "csv"}, Format, "neither gyroscope nor accelerometer"),
    ("binary", bytes(range(256)) * 50, {}, Format, "not recognised"),
    ("binary-inside", HEADER.encode() + ROWS.encode() * 1000 + b"\0" * 50, {}, Format, "binary file"),
    ("garbage-inside", HEADER.encode() + ROWS.encode() + b"\xff\xfe\x80,1,1,1,1,1,1\n", {}, Format, "line 12, column 'time'"),
    ("utf16", (HEADER + ROWS).encode("utf-16"), {}, Format, "UTF-16|not recognised"),
    ("endless-line", HEADER + "1" * 3_000_000, {}, Format, "a line is longer than"),
    ("endless-header", "gyr_x," * 500_000, {}, Format, "a line is longer than"),
    ("header-of-brackets", "gyr_x" + "(" * 60_000 + "\n1\n", {}, Format, "neither gyroscope nor accelerometer"),
    ("header-of-words", "a_" * 30_000 + "\n1\n", {}, Format, "neither gyroscope nor accelerometer"),
    ("gzip", b"\x1f\x8b\x08\0" + bytes(50), {}, Format, r"compressed \(gzip\); unpack it"),
    ("word-in-number", HEADER + ROWS + "0.5,1,2,3,4,five,6\n", {}, Format, "line 12, column 'acc_y': 'five' is not a number"),
    ("underscore", HEADER + ROWS + "0.5,1,2,3,4,1_0,6\n", {}, Format, "'1_0' is not a number"),
    ("row-too-short", HEADER + "0,1,2,3\n" + ROWS, {}, Format, "line 2 has 4 cells where the header has 7"),
    ("row-too-long", HEADER + ROWS + "0.5,1,2,3,4,5,6,7\n", {}, Format, "line 12 has 8 cells where the header has 7"),
    ("decimal-commas", HEADER + "0,0,1,0,2,0,3,0,4,0,5,0,6,0\n" * 9, {}, Format, "decimal commas"),
    ("no-gyroscope", "time,acc_x,acc_y,acc_z\n0,1,2,3\n1,2,3,4\n", {}, Format, "no gyroscope columns"),
    ("no-accelerometer", "time,gyr_x,gyr_y,gyr_z\n0,1,2,3\n1,2,3,4\n", {}, Format, "no accelerometer columns"),
    ("same-column-twice", HEADER.replace("gyr_y", "gyr_x") + ROWS, {}, Format, "'gyr_x': a second column"),
    ("unit-unknown", HEADER.replace("gyr_y", "gyr_y (rpm)") + ROWS, {}, Format, "'rpm' is not a unit known for gyr"),
    ("unit-of-time", HEADER.replace("time", "time (weeks)") + ROWS, {}, Format, "'weeks' is not a unit of time"),
    ("no-rate", HEADER.replace("time", "row") + ROWS, {}, Input, "data.txt' states no rate.*give rate_hz="),
    ("time-back", HEADER + ROWS + ROWS, {}, Input, "data.txt': time_s must increase strictly, but row 10"),
    ("time-in-ms-unsaid", HEADER + ROWS.replace("0.0", "10"), {}, Format, "'time' has steps of 1"),
    ("all-empty", HEADER + "0.1,,,,,,\n0.2,,,,,,\n", {}, Format, "no row has numbers in all of gyr and acc"),
    ("rate-zero", HEADER + ROWS, {"rate_hz": 0}, Input, "^rate_hz must be a positive number"),
    ("format-unknown", HEADER + ROWS, {"format": "c3d"}, Input, "^format must be one of npz,.*got 'c3d'"),
    ("format-type", HEADER + ROWS, {"format": 3}, Input, "^format must be a string"),
    ("format-wrong", HEADER + ROWS, {"format": "npz"}, Format, "the archive is broken"),
    ("columns-type", HEADER + ROWS, {"columns": ["gyr_x"]}, Input, "^columns must be a mapping"),
    ("columns-empty", HEADER + ROWS, {"columns": {}}, Input, "^columns is empty"),
    ("columns-lack", HEADER + ROWS, {"columns": {"gyr": ["gyr_x", "gyr_y", "gyr_z"]}}, Input, "^columns must be {'gyr'"),
    ("columns-two", HEADER + ROWS, {"columns": {"gyr": ["gyr_x", "gyr_y"], "acc": "abc"}}, Input, "^columns: 'gyr' must name"),
    (
        "columns-absent",
        HEADER + ROWS,
        {"columns": {"gyr": list("abc"), "acc": list("abc")}},
        Input,
        "^columns: .*'a' for 'gyr'",
    ),
    ("columns-nested", HEADER + ROWS, {"columns": {"thigh": 3}}, Input, "^columns must be"),
    ("units-unknown", HEADER + ROWS, {"units": "knots"}, Input, "^units: 'knots'"),
    ("xsens-no-rate", XSENS.split("\n", 1)[1] + "1\t1\t1\t1\t1\t1\t1\n", {}, Input, "give rate_hz= .command line: --rate"),
    ("xsens-rate-zero", XSENS.replace("100.0", "0.0") + "1\t1\t1\t1\t1\t1\t1\n", {}, Format, "Update Rate is 0.0 Hz"),
    ("xsens-counter-back", XSENS + "".join(f"{k}\t1\t1\t1\t1\t1\t1\n" for k in (5, 6, 3)), {}, Format, "from 6 to 3 in row 3"),
    ("xsens-counter-large", XSENS + "70000\t1\t1\t1\t1\t1\t1\n", {}, Format, "PacketCounter must count from 0 to 65535"),
    ("xsens-counter-fraction", XSENS + "1.5\t1\t1\t1\t1\t1\t1\n", {}, Format, "PacketCounter must count"),
    ("xsens-counter-empty", XSENS + "\t1\t1\t1\t1\t1\t1\n", {}, Format, "PacketCounter is empty throughout"),
    ("xsens-all-nan", XSENS + "1\tNaN\t1\t1\t1\t1\t1\n", {}, Format, "no row has numbers"),
    ("xsens-comments-only", XSENS.split("\n")[0] + "\n", {}, Format, "no header row"),
    ("npz-cut", npz()[:-40], {}, Format, "the archive is broken"),
    ("npz-flipped", npz().replace(GYR.tobytes()[:1], b"?"), {}, Format, "data.txt"),
    ("npz-pickle", npz(gyr=np.array([[Bomb()] * 3], dtype=object)), {}, Format, "gyr.npy: an array of pickled Python objects"),
    ("npz-raw-pickle", npz(acc=pickle.dumps(Bomb())), {}, Format, "acc.npy: cannot be read"),
    (
        "npz-lying-shape",
        npz(gyr=npy(GYR, shape="(1000000000000, 3)")),
        {},
        Format,
        "gyr.npy: the header promises 24000000000000",
    ),
    ("npz-negative-shape", npz(gyr=npy(GYR, shape="(-20, -3)")), {}, Format, "gyr.npy: the header promises"),
    ("npz-header-code", npz(gyr=npy(GYR, shape="__import__('os')")), {}, Format, "gyr.npy: cannot be read"),
    ("npz-deep-header", npz(gyr=npy(GYR, shape="(" * 5000)), {}, Format, "gyr.npy: cannot be read"),
    ("npz-bomb", npz(gyr=np.zeros((4_000_000, 3))), {}, Format, "gyr.npy: 96000128 bytes out of .* decompression bomb"),
    ("npz-lying-directory", lying_directory(), {}, Format, r"\.npy: .*(bomb|promises|cannot be read)"),
    ("npz-strings", npz(gyr=np.full((N, 3), "a")), {}, Format, "gyr.npy: must hold real numbers, got dtype <U1"),
    ("npz-records", npz(gyr=np.zeros(N, dtype="f8,f8,f8")), {}, Format, "gyr.npy: must hold real numbers"),
    ("npz-shape", npz(acc=ACC.T), {}, Format, r"acc must have the shape \(N, 3\), got \(3, 20\)"),
    ("npz-lengths", npz(acc=ACC[:9]), {}, Format, r"lengths differ: gyr \(20, 3\), acc \(9, 3\)"),
    ("npz-rate", npz(rate_hz=np.array([50.0, 60.0])), {}, Format, "rate_hz must be one positive number"),
    ("npz-rate-nan", npz(rate_hz=np.array(np.nan)), {}, Format, "rate_hz must be one positive number"),
    ("npz-time", npz(time_s=TIME[::-1]), {}, Input, "time_s must increase strictly"),
    ("npz-nothing", npz(gyr=b"", acc=b"").replace(b"gyr.npy", b"xyz.npy"), {}, Format, "no pair of gyroscope and acc"),
    ("npz-no-zip", b"PK\x03\x04" + bytes(100), {}, Format, "the archive is broken"),
]


@pytest.mark.parametrize(("content", "options", "error", "message"), [c[1:] for c in FILES], ids=[c[0] for c in FILES])
def test_files(tmp_path: Path, content: bytes | str, options: dict[str, Any], error: type[Exception], message: str) -> None:
    path = tmp_path / "data.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(error, match=message) as caught:
        imufast.read(path, **options)
    assert caught.type is error
    assert "data.txt" in str(caught.value) or error is Input
    assert not Path("/tmp/a-pickle-was-run").exists()  # noqa: S108


def test_a_time_column_in_nothing_but_zeros(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(HEADER + "0,1,2,3,4,5,6\n" * 5, encoding="utf-8")
    with pytest.raises(Input, match="time_s must increase strictly, but row 1"):
        imufast.read(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("paths", "error", "message"),
    [
        ("", Format, "is a folder"),
        (".", Format, "is a folder"),
        ("no/such/file.csv", MissingFileError, "no/such/file.csv': there is no such file"),
        ("a\0b", Format, "cannot be opened"),
        ("x" * 5000, Format, "cannot be opened"),
        ("/dev/zero", Format, "not a regular file"),
        ([], Input, "^paths is empty"),
        ({}, Input, "^paths is empty"),
        (None, Input, "^paths must be a path"),
        (3, Input, "^paths must be a path"),
        (b"walk.csv", Input, "^paths must be a path"),
        ([3], Input, "^paths must hold strings"),
        ({3: "walk.csv"}, Input, "^paths: a sensor name"),
    ],
    ids=str,
)
def test_paths(paths: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        imufast.read(paths)


def test_a_missing_file_is_also_pythons_own_error() -> None:
    with pytest.raises(FileNotFoundError):
        imufast.read("no/such/file.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")
def test_a_pipe_is_refused_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(Format, match="not a regular file"):
        imufast.read(tmp_path / "pipe")


def test_files_that_are_not_one_recording(tmp_path: Path) -> None:
    def write(name: str, text: str) -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    timed, plain = write("timed.csv", HEADER + ROWS), write("plain.csv", (HEADER + ROWS).replace("time", "row"))
    short = write("short.csv", (HEADER + ROWS[: len(ROWS) // 2].rsplit("\n", 1)[0]).replace("time", "row"))
    with pytest.raises(Input, match="different clocks"):
        imufast.read([timed, plain], rate_hz=100)
    with pytest.raises(Input, match="rows and neither packet counter nor time stamps"):
        imufast.read([plain, short], rate_hz=100)
    with pytest.raises(Input, match="2 sensors would be called 'timed'; give a mapping"):
        imufast.read([timed, timed])
    slow = write("slow.txt", XSENS.replace("100.0", "40.0") + "1\t1\t1\t1\t1\t1\t1\n2\t1\t1\t1\t1\t1\t1\n")
    fast = write("fast.txt", XSENS + "1\t1\t1\t1\t1\t1\t1\n2\t1\t1\t1\t1\t1\t1\n")
    far = write("far.txt", XSENS + "901\t1\t1\t1\t1\t1\t1\n902\t1\t1\t1\t1\t1\t1\n")
    with pytest.raises(Input, match=r"different rates \(40 and 100 Hz"):
        imufast.read([slow, fast])
    with pytest.raises(Input, match=r"far\.txt.*no time in common"):
        imufast.read([fast, far])


VALID = [(HEADER + ROWS).encode(), (XSENS + "".join(f"{k}\t1\t1\t1\t1\t1\t{k}\n" for k in range(9))).encode(), npz()]


@given(
    st.binary(max_size=400) | st.text(max_size=200).map(str.encode), st.sampled_from([None, "csv", "npz", "xsens_mt_manager"])
)
@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")
def test_no_bytes_get_through_but_as_an_imufast_error(tmp_path: Path, content: bytes, format_name: str | None) -> None:
    _read_or_refuse(tmp_path, content, format_name)


@given(st.sampled_from(VALID), st.data())
@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")
def test_no_damaged_file_gets_through_but_as_an_imufast_error(tmp_path: Path, content: bytes, data: st.DataObject) -> None:
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(content) - 1))
        cut = data.draw(st.integers(0, 8))
        content = content[:at] + data.draw(st.binary(max_size=8)) + content[at + cut :]
    _read_or_refuse(tmp_path, content, None)


def _read_or_refuse(folder: Path, content: bytes, format_name: str | None) -> None:
    path = folder / "data.bin"
    path.write_bytes(content)
    try:
        rec = imufast.read(path, format=format_name, rate_hz=100)
    except imufast.ImufastError:
        return
    assert all(np.isfinite(imu.gyr).all() and np.isfinite(imu.acc).all() for imu in rec.values())
