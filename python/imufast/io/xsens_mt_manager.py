"""Xsens MT Manager text exports (MTw Awinda and relatives): one file a sensor, m/s² and rad/s.

Old headers (`// Update Rate: 100.0Hz`) and new ones (2019 on, no rate); tab, comma, semicolon or space; NaN or empty cells.
PacketCounter wraps at 65536; a lost packet is a missing row.
"""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations

from imufast.io.counter import unwrap_counter
from imufast.io.source import Format, RawSensor, Source
from imufast.io.table import Table, head_lines, read_header, read_numbers

__all__ = ["XSENS_MT_MANAGER", "has_imu_columns"]

_COMMENT = "//"
_GYR = ("Gyr_X", "Gyr_Y", "Gyr_Z")
_ACC = ("Acc_X", "Acc_Y", "Acc_Z")
# Columns that MT Manager may leave empty, and then always together.
_OPTIONAL = (
    ("SampleTimeFine",),
    ("Year", "Month", "Day", "Second"),
    ("UTC_Nano", "UTC_Year", "UTC_Month", "UTC_Day", "UTC_Hour", "UTC_Minute", "UTC_Second", "UTC_Valid"),
)


def _detect(head: bytes) -> bool:
    lines = [line for line in head_lines(head)[:40] if line.strip()]
    if lines and lines[0].startswith(_COMMENT):
        return True
    return bool(lines) and bool(re.match(r'"?PacketCounter\b', lines[0])) and "Quat_W" not in lines[0]


def has_imu_columns(source: Source, table: Table) -> None:
    """Raise FileFormatError, with the reason, for an Xsens or Movella export without gyroscope or accelerometer."""
    names = set(table.columns)
    for kind, columns in (("gyroscope", _GYR), ("accelerometer", _ACC)):
        if missing := [column for column in columns if column not in names]:
            present = {
                "acceleration": "Acc_X" in names,
                "free acceleration": "FreeAcc_X" in names,
                "angular rate": "Gyr_X" in names,
                "orientation": bool(names & {"Quat_q0", "Quat_W", "Roll", "Euler_X", "Mat[1][1]"}),
            }
            holds = " and ".join(word for word, there in present.items() if there) or "other things"
            raise source.error(
                f"the file holds {holds} but no {kind} columns (missing {', '.join(missing)}); "
                "export it again with calibrated inertial data (angular rate and acceleration)"
            )


def _read(source: Source) -> list[RawSensor]:
    table = read_header(source, _COMMENT)
    has_imu_columns(source, table)
    if table.delimiter is None:
        table = _without_collapsed(source, table)
    has_counter = "PacketCounter" in table.columns
    wanted = [*_GYR, *_ACC, *(["PacketCounter"] if has_counter else [])]
    values, notes = read_numbers(source, table, [table.columns.index(name) for name in wanted], _COMMENT)
    sensor_id = re.search(r"_([0-9A-Fa-f]{8})$", source.path.stem)
    raw = RawSensor(
        name=sensor_id.group(1) if sensor_id else source.path.stem,
        gyr=values[:, 0:3],
        acc=values[:, 3:6],
        rate_hz=_header_rate(source, table),
        notes=notes,
    )
    if not has_counter:
        return [replace(raw, notes=(*notes, "there is no PacketCounter: lost packets cannot be seen"))]
    counter, rows, repeats = unwrap_counter(source, "PacketCounter", values[:, 6], 65536)
    return [
        replace(
            raw,
            gyr=raw.gyr[rows],
            acc=raw.acc[rows],
            counter=counter,
            counter_wraps_at=65536,
            notes=notes + repeats,
        )
    ]


def _header_rate(source: Source, table: Table) -> float | None:
    for line in table.preamble:
        if match := re.search(r"Update Rate:\s*([0-9.]+)\s*Hz", line):
            try:
                rate = float(match.group(1))
            except ValueError:
                rate = 0.0
            if not 0 < rate <= 1e5:
                raise source.error(f"the header's Update Rate is {match.group(1)} Hz")
            return rate
    return None


def _without_collapsed(source: Source, table: Table) -> Table:
    """With spaces as delimiter, empty cells vanish; say which ones, if only one answer is possible."""
    missing = len(table.columns) - table.cells(table.first_row)
    if missing <= 0:
        return table
    present = [[name for name in group if name in table.columns] for group in _OPTIONAL]
    groups = [group for group in present if group]
    fitting = [
        {name for group in chosen for name in group}
        for count in range(1, len(groups) + 1)
        for chosen in combinations(groups, count)
        if sum(map(len, chosen)) == missing
    ]
    if len(fitting) != 1:
        raise source.error(
            f"the first row has {missing} cells fewer than the header: empty columns vanish in an export delimited by spaces, "
            "and it is not clear which ones; export with tabs"
        )
    return replace(table, columns=tuple(name for name in table.columns if name not in fitting[0]))


XSENS_MT_MANAGER = Format("xsens_mt_manager", _detect, _read)
