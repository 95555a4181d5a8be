"""CSV and its relatives (tab, semicolon, comma, white space) with a header row: columns by their names or by mapping.

Recognised names are a word for the signal and an axis, in most spellings: `gyr_x`, `GyroX`, `Gyroscope X (deg/s)`, `gx`,
`acc_z`, `Accelerometer Z [g]`. What stands before or after tells sensors apart: `thigh.gyr_x`, `gyr_x_thigh`, `gyr1_x`.
Time is `time`, `timestamp` or `t`, in seconds unless the name says ms, us or ns. Units in brackets are honoured.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from imufast.errors import InputError
from imufast.io.source import Format, RawSensor, Source
from imufast.io.table import Table, head_lines, read_header, read_numbers
from imufast.plausibility import Units, parse_unit

__all__ = ["DELIMITED"]

_COMMENT = "#"
_GYR_WORDS = "gyr|gyro|gyros|gyroscope|angular_velocity|angularvelocity|angular_rate|ang_vel|angvel|omega"
_ACC_WORDS = "acc|accel|accelerometer|acceleration|linear_acceleration"
_SIGNAL = re.compile(
    rf"(?:(?P<before>.+?)_)??(?:(?P<gyr>{_GYR_WORDS})|(?P<acc>{_ACC_WORDS}))_?(?P<number>\d*)_?(?P<axis>[xyz])(?:_?(?P<after>\d+)|_(?P<word>.+))?",
    re.IGNORECASE,
)
_SHORT = re.compile(
    r"(?:(?P<before>.+?)_)?(?:(?P<gyr>[gw])|(?P<acc>a))(?P<axis>[xyz])(?P<number>)(?P<after>\d*)(?P<word>)", re.IGNORECASE
)
_TIME = re.compile(r"(?:unix_?)?(?:time|time_?stamp|t)(?:_(?P<unit>s|sec|seconds|ms|us|µs|ns))?", re.IGNORECASE)
_PER_SECOND = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e3, "us": 1e6, "µs": 1e6, "ns": 1e9}
_TIME_KEYS = {"time_s": 1.0, "time_ms": 1e3, "time_us": 1e6, "time_ns": 1e9}
# Beyond this a title is no name, and patterns would take their time.
_LONGEST_TITLE = 200
_BRACKETS = re.compile(r"[\[(](.*)[\])]")


@dataclass
class _Columns:
    """Which columns make one sensor: column index by axis, for each signal, and the units its header states."""

    gyr: dict[str, int] = field(default_factory=dict)
    acc: dict[str, int] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        return len(self.gyr) == 3 and len(self.acc) == 3


@dataclass(frozen=True)
class _Clock:
    """The time column and how many of its units make a second."""

    column: int
    per_second: float
    is_stated: bool


def _detect(head: bytes) -> bool:
    return b"\0" not in head and any(re.search(r"[A-Za-z]", line) for line in head_lines(head))


def _read(source: Source) -> list[RawSensor]:
    table = read_header(source, _COMMENT)
    sensors, clock = _by_mapping(source, table) if source.columns is not None else _by_name(source, table)
    use = [sensor_columns[axis] for s in sensors.values() for sensor_columns in (s.gyr, s.acc) for axis in "xyz"]
    values, notes = read_numbers(source, table, use + ([clock.column] if clock else []), _COMMENT)
    time_s = None
    if clock is not None:
        time_s = values[:, -1] / clock.per_second
        steps = np.diff(time_s[np.isfinite(time_s)])
        if not clock.is_stated and len(steps) and np.median(steps) > 0.5:
            raise source.error(
                f"the time column {table.columns[clock.column]!r} has steps of {np.median(steps):.6g} and names no unit; "
                "write it as 'time_ms' or 'time (us)' in the header, or give columns={'time_ms': ...}"
            )
    return [
        RawSensor(
            name=name or source.path.stem,
            gyr=values[:, 6 * k : 6 * k + 3],
            acc=values[:, 6 * k + 3 : 6 * k + 6],
            time_s=time_s,
            units=Units(columns.units.get("gyr"), columns.units.get("acc")),
            notes=notes,
        )
        for k, (name, columns) in enumerate(sensors.items())
    ]


def _by_name(source: Source, table: Table) -> tuple[dict[str, _Columns], _Clock | None]:
    found: dict[str, _Columns] = {}
    clock: _Clock | None = None
    for index, title in enumerate(table.columns):
        if len(title) > _LONGEST_TITLE:
            continue
        brackets = _BRACKETS.search(title)
        unit = brackets.group(1).strip() if brackets else ""
        word = re.sub(r"\W+", "_", _BRACKETS.sub("", title)).strip("_")
        if time := _TIME.fullmatch(word):
            stated = (time.group("unit") or unit).lower()
            if stated not in _PER_SECOND:
                raise source.error(f"column {title!r}: {stated!r} is not a unit of time known here (s, ms, us, ns)")
            # Several clocks in one file: the first one is the recording's.
            clock = clock or _Clock(index, _PER_SECOND[stated], is_stated=bool(stated))
        elif match := _SIGNAL.fullmatch(word) or _SHORT.fullmatch(word):
            _add(source, found, match, index, title, unit)
    complete = {name: columns for name, columns in found.items() if columns.is_complete}
    if not complete:
        has_acc = any(len(columns.acc) == 3 for columns in found.values())
        has_gyr = any(len(columns.gyr) == 3 for columns in found.values())
        missing = "accelerometer" if has_gyr else "gyroscope"
        lack = f"no {missing} columns" if has_acc or has_gyr else "neither gyroscope nor accelerometer columns"
        raise source.error(
            f"the header (line {table.header_line}) has {lack} under a recognised name such as gyr_x, acc_x; "
            f"name them with columns={{'gyr': [...], 'acc': [...], 'time_s': ...}}. There are {_listed(table)}. "
            f"Formats known: {', '.join(source.formats)}"
        )
    return complete, clock


def _add(source: Source, found: dict[str, _Columns], match: re.Match[str], index: int, title: str, unit: str) -> None:
    before = match.group("before") or ""
    if before.lower().split("_")[-1] in {"free", "user", "lin"}:
        return  # gravity was removed from these; no accelerometer measured them
    number = match.group("number") or match.group("after") or ""
    word = match.group("word") or ""
    name = "_".join(part for part in (before, word) if part)
    name = (f"{name}{number}" if name else f"sensor{number}") if number else name
    kind = "gyr" if match.group("gyr") else "acc"
    sensor = found.setdefault(name, _Columns())
    axes: dict[str, int] = getattr(sensor, kind)
    if match.group("axis").lower() in axes:
        raise source.error(
            f"column {title!r}: a second column for this axis; choose with columns={{'gyr': [...], 'acc': [...]}}"
        )
    axes[match.group("axis").lower()] = index
    if unit:
        known = parse_unit(unit)
        if known is None or sensor.units.setdefault(kind, known) != known:
            raise source.error(f"column {title!r}: {unit!r} is not a unit known for {kind}, or not that of its other axes")


def _by_mapping(source: Source, table: Table) -> tuple[dict[str, _Columns], _Clock | None]:
    mapping = dict(source.columns or {})
    clock: _Clock | None = None
    for key, per_second in _TIME_KEYS.items():
        if key in mapping:
            clock = _Clock(_index(source, table, key, mapping.pop(key)), per_second, is_stated=True)
    named: dict[str, Any] = {"": mapping} if "gyr" in mapping or "acc" in mapping else mapping
    sensors = {}
    for name, signals in named.items():
        if not isinstance(signals, Mapping) or set(signals) != {"gyr", "acc"}:
            raise InputError(
                "columns must be {'gyr': [x, y, z], 'acc': [x, y, z], 'time_s': t} with column names, or "
                f"{{'thigh': {{'gyr': ..., 'acc': ...}}, 'time_s': t}}; got {source.columns!r}"
            )
        sensor = _Columns()
        for kind, titles in signals.items():
            if isinstance(titles, str) or not hasattr(titles, "__len__") or len(titles) != 3:
                raise InputError(f"columns: {kind!r} must name three columns, x, y and z; got {titles!r}")
            getattr(sensor, kind).update(
                {axis: _index(source, table, kind, title) for axis, title in zip("xyz", titles, strict=True)}
            )
        sensors[name] = sensor
    if not sensors:
        raise InputError("columns is empty; name the columns of 'gyr' and 'acc'")
    return sensors, clock


def _index(source: Source, table: Table, key: str, title: object) -> int:
    if not isinstance(title, str) or title not in table.columns:
        raise InputError(f"columns: {source.label} has no column {title!r} for {key!r}; there are {_listed(table)}")
    return table.columns.index(title)


def _listed(table: Table) -> str:
    titles = [repr(title[:40]) for title in table.columns if title]
    return ", ".join(titles[:20]) + (f" and {len(titles) - 20} more" if len(titles) > 20 else "")


DELIMITED = Format("csv", _detect, _read)
