"""Movella (Xsens) DOT csv exports: one file a sensor, acc in m/s², gyr in deg/s, time in µs that wraps at 2³²."""

from __future__ import annotations

import re

from imufast.io.counter import unwrap_counter
from imufast.io.source import Format, RawSensor, Source
from imufast.io.table import head_lines, read_header, read_numbers
from imufast.io.xsens_mt_manager import has_imu_columns
from imufast.plausibility import Units

__all__ = ["MOVELLA_DOT"]

_WANTED = ("Gyr_X", "Gyr_Y", "Gyr_Z", "Acc_X", "Acc_Y", "Acc_Z", "SampleTimeFine")


def _detect(head: bytes) -> bool:
    lines = head_lines(head)[:20]
    tagged = any(line.startswith("DeviceTag:") for line in lines)
    return tagged or (bool(lines) and lines[0].startswith("PacketCounter,SampleTimeFine,Quat_W"))


def _read(source: Source) -> list[RawSensor]:
    table = read_header(source, "#")
    has_imu_columns(source, table)
    if "SampleTimeFine" not in table.columns:
        raise source.error("there is no column SampleTimeFine, the only one that shows lost samples in a DOT export")
    values, notes = read_numbers(source, table, [table.columns.index(name) for name in _WANTED], "#")
    time_us, rows, repeats = unwrap_counter(source, "SampleTimeFine", values[:, 6], 2**32)
    rate = next((match for line in table.preamble if (match := re.match(r"OutputRate:,\s*(\d+)\s*Hz", line))), None)
    return [
        RawSensor(
            name=source.path.stem,
            gyr=values[rows, 0:3],
            acc=values[rows, 3:6],
            time_s=time_us / 1e6,
            rate_hz=float(rate.group(1)) if rate and int(rate.group(1)) > 0 else None,
            units=Units(gyr="deg/s"),
            notes=notes + repeats,
        )
    ]


MOVELLA_DOT = Format("movella_dot", _detect, _read)
