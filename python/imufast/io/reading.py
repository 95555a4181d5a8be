"""`read`: files to one Recording. Finds the format, names the sensors, counts what was lost, joins the sensors."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from imufast.errors import FileFormatError, InputError
from imufast.imu import GAP_STEPS, Imu, ReadInfo, Recording
from imufast.io.align import align
from imufast.io.registry import find_format, format_names
from imufast.io.source import RawSensor, open_source
from imufast.plausibility import Units, parse_units, read_rate, warn_user

__all__ = ["read"]

_COUNTER, _STAMPS, _ROWS = "packet counter", "time stamps", "row by row"


@dataclass(frozen=True)
class _Found:
    """A sensor, where it came from, what to call it if its name is taken, and the rate that gave it its times, if one did."""

    path: Path
    format: str
    raw: RawSensor
    long_name: str
    rate_hz: float | None = None


def read(
    paths: object,
    format: str | None = None,  # noqa: A002
    rate_hz: float | None = None,
    columns: Mapping[str, Any] | None = None,
    units: object = None,
) -> Recording:
    """Read the sensors of one recording from one file or several.

    Args:
        paths: a path, several, or a mapping from sensor name to path. Without given names a sensor is called as inside
            its file, else after the file (MT Manager: the sensor id at its end, such as "00B421AF"); where names clash,
            the file's name goes in front.
        format: name of the format, one of `imufast.io.format_names()`; default: detected from the first bytes.
        rate_hz: samples per second, for files that do not state it. It wins over a stated rate (ImufastWarning beyond
            2 %), but not over time stamps.
        columns: for csv, the column names: {"gyr": [x, y, z], "acc": [x, y, z], "time_s": t} or, with several sensors,
            {"thigh": {"gyr": ..., "acc": ...}, ..., "time_s": t}; also "time_ms", "time_us". Default: by recognised names.
        units: as for Imu; wins over what a header says.

    Sensors are joined by packet counter, else by time stamps (see `align`), else row by row if their lengths agree. Rows
    with a cell of gyr or acc that is empty or NaN are left out. What is missing in one sensor is a gap for all;
    `Recording.info` has the counts.

    Raises:
        FileFormatError: a file that cannot be read, with the place and the reason.
        InputError: arguments that do not fit, or files that are not one recording.
    """
    rate = None if rate_hz is None else read_rate(rate_hz)
    stated = parse_units(units)
    if columns is not None and not isinstance(columns, Mapping):
        raise InputError(f"columns must be a mapping such as {{'gyr': [...], 'acc': [...]}}, got {type(columns).__name__}")
    if format is not None and not isinstance(format, str):
        raise InputError(f"format must be a string or None, got {format!r}")
    found = _unique([sensor for name, path in _named_paths(paths) for sensor in _read_file(name, path, format, columns)])
    return _join(found, rate, stated)


def _named_paths(paths: object) -> list[tuple[str | None, Path]]:
    pairs: list[tuple[Any, Any]]
    if isinstance(paths, (str, os.PathLike)):
        pairs = [(None, paths)]
    elif isinstance(paths, Mapping):
        pairs = list(paths.items())
    elif isinstance(paths, Sequence) and not isinstance(paths, bytes):
        pairs = [(None, path) for path in paths]
    else:
        raise InputError(f"paths must be a path, a list of paths or a mapping from name to path, got {type(paths).__name__}")
    if not pairs:
        raise InputError("paths is empty; give at least one file")
    for name, path in pairs:
        if name is not None and (not isinstance(name, str) or not name.strip()):
            raise InputError(f"paths: a sensor name must be a non-empty string, got {name!r}")
        if not isinstance(path, (str, os.PathLike)) or isinstance(os.fspath(path), bytes):
            raise InputError(f"paths must hold strings or paths, got {type(path).__name__}")
    return [(name, Path(path)) for name, path in pairs]


def _read_file(name: str | None, path: Path, format_name: str | None, columns: Mapping[str, Any] | None) -> list[_Found]:
    source = open_source(path, columns, format_names())
    known = find_format(source, format_name)
    raws = known.read(source)
    if name is not None:
        raws = [replace(raw, name=name if len(raws) == 1 else f"{name}.{raw.name}") for raw in raws]
    return [
        _Found(path, known.name, raw, path.stem if len(raws) == 1 or raw.name == path.stem else f"{path.stem}.{raw.name}")
        for raw in raws
    ]


def _unique(found: list[_Found]) -> list[_Found]:
    """Names that clash give way to the longer ones."""
    taken = Counter(sensor.raw.name for sensor in found)
    renamed = [
        replace(sensor, raw=replace(sensor.raw, name=sensor.long_name)) if taken[sensor.raw.name] > 1 else sensor
        for sensor in found
    ]
    name, count = Counter(sensor.raw.name for sensor in renamed).most_common(1)[0]
    if count > 1:
        raise InputError(f"paths: {count} sensors would be called {name!r}; give a mapping from name to path")
    return renamed


def _join(found: list[_Found], rate: float | None, stated: Units) -> Recording:
    kinds = {_clock(sensor.raw) for sensor in found}
    if len(kinds) > 1:
        raise InputError(
            f"paths: the sensors cannot be aligned, for they have different clocks ({', '.join(sorted(kinds))}); "
            "read them one by one with rate_hz= and join them with imufast.align"
        )
    kind = kinds.pop()
    if kind != _STAMPS:
        found = _on_rows(found, rate, kind)
    built = [_build(sensor, rate, stated) for sensor in found]
    if len(built) == 1:
        joined = Recording([built[0][0]])
    else:
        try:
            joined = align([imu for imu, _ in built])
        except InputError as error:
            raise InputError(f"{', '.join(sorted({sensor.path.name for sensor in found}))}: {error}") from None
    if kind == _COUNTER:
        # Any origin will do for a counter: time starts with the first common sample.
        packets = np.rint(joined.time_s * joined.rate_hz)
        time_s = (packets - packets[0]) / joined.rate_hz
        joined = Recording([imu._replace(time_s=time_s) for imu in joined.values()])
    infos = {}
    for imu, info in built:
        dropped = len(imu) - len(joined.time_s)
        note = (f"{dropped} rows left out that another sensor does not have",) if dropped > 0 else ()
        infos[imu.name] = replace(info, notes=info.notes + note)
    return Recording(joined, info=infos)


def _clock(raw: RawSensor) -> str:
    if raw.counter is not None:
        return _COUNTER
    return _ROWS if raw.time_s is None else _STAMPS


def _on_rows(found: list[_Found], rate: float | None, kind: str) -> list[_Found]:
    """Sensors that count packets or rows get times: a count from a common origin over the rate."""
    rates = [_rate_of(sensor, rate) for sensor in found]
    if max(rates) > 1.001 * min(rates):
        raise InputError(f"paths: the files state different rates ({min(rates):g} and {max(rates):g} Hz); give rate_hz=")
    lengths = sorted({len(sensor.raw.gyr) for sensor in found})
    if kind == _ROWS and len(lengths) > 1:
        raise InputError(
            f"paths: the sensors have {lengths[0]} to {lengths[-1]} rows and neither packet counter nor time stamps, so "
            "nobody can tell which rows belong together; give files with time (columns={'time_s': ...}) or of equal length"
        )
    origin = 0 if found[0].raw.counter is None else int(found[0].raw.counter[0])
    placed = []
    for sensor in found:
        counts = np.arange(len(sensor.raw.gyr)) if sensor.raw.counter is None else sensor.raw.counter
        # Sensors that start on two sides of a wrap differ by a whole turn.
        turn = sensor.raw.counter_wraps_at
        turns = 0 if sensor.raw.counter is None else round((origin - int(counts[0])) / turn)
        time_s = (counts + turns * turn - origin) / rates[0]
        placed.append(replace(sensor, raw=replace(sensor.raw, time_s=time_s), rate_hz=rates[0]))
    return placed


def _rate_of(sensor: _Found, rate: float | None) -> float:
    header = sensor.raw.rate_hz
    if rate is None and header is None:
        raise InputError(
            f"{str(sensor.path)!r} states no rate (such as Update Rate) and has no time column; "
            "give rate_hz= (command line: --rate)"
        )
    if rate is not None and header is not None and abs(rate - header) > 0.02 * header:
        warn_user(f"{str(sensor.path)!r} states a rate of {header:g} Hz; rate_hz={rate:g} is used as given")
    return read_rate(header if rate is None else rate)


def _build(sensor: _Found, rate: float | None, stated: Units) -> tuple[Imu, ReadInfo]:
    """One Imu from the rows that hold numbers, and the counts."""
    raw, label = sensor.raw, repr(str(sensor.path))
    time_s = np.asarray(raw.time_s, dtype=np.float64)
    valid = np.isfinite(time_s) & np.isfinite(raw.gyr).all(axis=1) & np.isfinite(raw.acc).all(axis=1)
    kept = slice(None) if valid.all() else valid
    if not valid.any():
        raise FileFormatError(f"{label}: no row has numbers in all of gyr and acc")
    try:
        imu = Imu(
            raw.gyr[kept],
            raw.acc[kept],
            # A rate that gave the times is not held against them.
            rate if sensor.rate_hz is None else sensor.rate_hz if valid.sum() == 1 else None,
            time_s=time_s[kept],
            name=raw.name,
            units=stated.over(raw.units),
        )
    except InputError as error:
        raise type(error)(f"{label}: {error}") from None
    if nominal := sensor.rate_hz or _nominal_rate(sensor, imu):
        imu = imu._replace(rate_hz=nominal)
    steps = np.diff(time_s[np.isfinite(time_s)]) * imu.rate_hz
    info = ReadInfo(
        file=str(sensor.path),
        format=sensor.format,
        rows=len(raw.gyr),
        lost_rows=int((np.rint(steps[steps > GAP_STEPS]) - 1).sum()),
        invalid_rows=int((~valid).sum()),
        first_counter=None if raw.counter is None else int(raw.counter[0]),
        header_rate_hz=raw.rate_hz,
        notes=raw.notes,
    )
    return imu, info


def _nominal_rate(sensor: _Found, imu: Imu) -> float | None:
    """The rate that a header states beside time stamps, if the stamps agree with it or with every k-th sample lost."""
    header = sensor.raw.rate_hz
    if header is None:
        return None
    samples_a_step = header / imu.rate_hz
    if samples_a_step > 0.98 and abs(samples_a_step - round(samples_a_step)) < 0.02 * samples_a_step:
        return header
    warn_user(f"{str(sensor.path)!r} states {header:g} Hz, but its time stamps say {imu.rate_hz:.6g} Hz; these are used")
    return None
