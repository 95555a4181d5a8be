"""Numpy archives with raw sensor arrays: gyr1, acc1, gyr2 ..., or `<name>.gyr`, `<name>.acc`, or gyr and acc alone.

The time base is `rate_hz` or `time_s`. Nothing is unpickled, and no array is allocated before its header has been held
against the size of what the archive really has.
"""

from __future__ import annotations

import math
import re
import tokenize
import zipfile
import zlib
from typing import IO, Any, TypeAlias

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from imufast.io.source import Format, RawSensor, Source

__all__ = ["NPZ"]

Array: TypeAlias = NDArray[np.float64]

_SIGNAL = re.compile(r"(?:(?P<name>.+)\.)?(?P<kind>gyr|acc)(?P<number>\d*)")
# Sensor data hardly compress tenfold; an archive that promises far more is a bomb.
_LARGEST_RATIO = 200
_ALWAYS_ALLOWED = 64 << 20
# What zipfile, zlib and numpy's header parser raise on broken or hostile bytes; RuntimeError: encrypted or nested too deep.
_BROKEN = (
    *(zipfile.BadZipFile, zlib.error, EOFError, ValueError, TypeError, KeyError, IndexError, AttributeError, OSError),
    *(NotImplementedError, RuntimeError, SyntaxError, tokenize.TokenError, MemoryError, OverflowError, UnicodeError),
)


def _detect(head: bytes) -> bool:
    return head.startswith((b"PK\x03\x04", b"PK\x05\x06"))


def _read(source: Source) -> list[RawSensor]:
    if source.columns is not None:
        raise source.error("columns= is for text with a header row, not for npz")
    try:
        archive = zipfile.ZipFile(source.path)
    except _BROKEN as error:
        raise source.error(f"the archive is broken: {error}") from None
    with archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist() if info.filename.endswith(".npy")}
        found: dict[str, dict[str, str]] = {}
        for key in members:
            if match := _SIGNAL.fullmatch(key):
                name = "".join(filter(None, (match["name"], match["number"] and f"sensor{match['number']}")))
                found.setdefault(name or source.path.stem, {})[match["kind"]] = key
        complete = {name: keys for name, keys in found.items() if len(keys) == 2}
        if not complete:
            raise source.error(
                f"no pair of gyroscope and accelerometer arrays (gyr1 and acc1, or <name>.gyr and <name>.acc) among "
                f"{', '.join(sorted(members)[:20]) or 'no arrays'}"
            )
        rate, time_s = (_array(source, archive, members[key]) if key in members else None for key in ("rate_hz", "time_s"))
        if rate is not None and (rate.size != 1 or not 0 < rate.item() < math.inf):
            raise source.error(f"rate_hz must be one positive number, got {rate.ravel()[:3]} of shape {rate.shape}")
        sensors = []
        for name, keys in complete.items():
            gyr, acc = (_array(source, archive, members[keys[kind]]) for kind in ("gyr", "acc"))
            for kind, array in (("gyr", gyr), ("acc", acc)):
                if array.ndim != 2 or array.shape[1] != 3 or not len(array):
                    raise source.error(f"{keys[kind]} must have the shape (N, 3), got {array.shape}")
            if len(gyr) != len(acc) or (time_s is not None and time_s.shape != (len(gyr),)):
                clock = "" if time_s is None else f", time_s {time_s.shape}"
                raise source.error(f"lengths differ: {keys['gyr']} {gyr.shape}, {keys['acc']} {acc.shape}{clock}")
            sensors.append(RawSensor(name, gyr, acc, time_s, rate_hz=None if rate is None else float(rate.item())))
        return sensors


def _array(source: Source, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Array:
    def error(reason: str) -> Exception:
        return source.error(f"{member.filename}: {reason}")

    packed = min(member.compress_size, source.path.stat().st_size)
    if member.file_size > max(_ALWAYS_ALLOWED, _LARGEST_RATIO * packed):
        raise error(f"{member.file_size} bytes out of {packed} compressed ones: refused as a decompression bomb")
    try:
        with archive.open(member) as file:
            shape, dtype = _header(file)
            header_bytes = file.tell()
        if dtype.hasobject:
            raise error("an array of pickled Python objects; only plain numbers are read")
        if dtype.kind not in "iuf":
            raise error(f"must hold real numbers, got dtype {dtype}")
        promised, held = math.prod(shape) * dtype.itemsize, member.file_size - header_bytes
        if min(shape, default=1) < 0 or promised != held:
            raise error(f"the header promises {promised} bytes (shape {shape}, {dtype}), the archive holds {held}")
        with archive.open(member) as file:
            array: NDArray[Any] = npy.read_array(file, allow_pickle=False)
    except _BROKEN as broken:
        if isinstance(broken, type(source.error(""))):
            raise
        raise error(f"cannot be read: {broken}") from None
    with np.errstate(over="ignore"):
        return array.astype(np.float64, copy=False)


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = npy.read_magic(file)
    readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in readers:
        raise ValueError(f"version {version} of the npy format")
    shape, _, dtype = readers[version](file)
    return shape, dtype


NPZ = Format("npz", _detect, _read)
