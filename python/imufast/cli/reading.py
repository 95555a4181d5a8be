"""What all commands that read recordings share: options, errors as one line, warnings as lines."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO, TypeVar

import click

from imufast.cli import show
from imufast.errors import ImufastError, ImufastWarning, InputError
from imufast.imu import Imu, Recording
from imufast.io import format_names, read
from imufast.sync import TimeOffset, time_offset

__all__ = ["WRONG_INPUT", "guard", "offset_of", "read_files", "reading_options", "told_after"]

WRONG_INPUT = 2

Command = TypeVar("Command", bound=Callable[..., Any])


@contextmanager
def guard() -> Iterator[list[str]]:
    """Warnings of imufast become lines, and are listed; its errors become one line and exit code 2."""
    warned: list[str] = []
    with warnings.catch_warnings():
        usual = warnings.showwarning

        def say(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            if issubclass(category, ImufastWarning):
                warned.append(str(message))
                show.warning(str(message))
            else:
                usual(message, category, filename, lineno, file, line)

        warnings.showwarning = say
        warnings.simplefilter("always", ImufastWarning)
        try:
            yield warned
        except ImufastError as error:
            show.error(str(error))
            raise SystemExit(WRONG_INPUT) from None


@contextmanager
def told_after(tell: Callable[[], None]) -> Iterator[list[str]]:
    """Files are written before words are: a reader who stops after the first line takes none of them away. What was found is
    told even where writing fails."""
    written: list[str] = []
    try:
        yield written
    finally:
        tell()
        for line in written:
            show.say(line)


def reading_options(command: Command) -> Command:
    """The options that say how files are to be read."""
    for option in (
        click.option(
            "--columns",
            multiple=True,
            metavar="KEY=A,B,C",
            help="Columns of a csv file: gyr=GX,GY,GZ, acc=AX,AY,AZ and time_s=T (or time_ms, time_us), one --columns each; "
            "with several sensors thigh.gyr=... and so on. Or all of it as one JSON object.",
        ),
        click.option("--units", help="Units to convert from, such as 'deg/s, g'. Default: as the file states, else SI."),
        click.option("--format", "format_name", type=click.Choice(format_names()), help="Default: recognised by content."),
        click.option("--rate", "rate_hz", type=float, metavar="HZ", help="Samples per second, where the file does not say."),
    ):
        command = option(command)
    return command


def _parse_columns(given: Sequence[str]) -> dict[str, Any] | None:
    """The mapping that `read(columns=...)` takes, from JSON or key=a,b,c."""
    columns: dict[str, Any] = {}
    for text in given:
        if text.lstrip().startswith("{"):
            try:
                part = json.loads(text)
            except (ValueError, RecursionError) as error:
                raise InputError(f"--columns is not valid JSON ({error}): {text!r}") from None
            columns.update(part)
            continue
        key, equals, value = text.partition("=")
        names = [name.strip() for name in value.split(",")]
        if not equals or not key.strip() or not all(names):
            raise InputError(f"--columns must look like gyr=GX,GY,GZ, got {text!r}")
        *sensor, key = key.strip().rsplit(".", 1)
        place = columns.setdefault(sensor[0], {}) if sensor else columns
        place[key] = names if key in ("gyr", "acc") else ",".join(names)
    return columns or None


def read_files(
    files: Sequence[Path], rate_hz: float | None, format_name: str | None, units: str | None, columns: Sequence[str]
) -> Recording:
    """One recording of all files, with the options of `reading_options`."""
    chosen = _parse_columns(columns)
    with show.waiting(f"Reading {len(files)} file{'s' * (len(files) > 1)}", files):
        return read(list(files), format=format_name, rate_hz=rate_hz, columns=chosen, units=units)


def offset_of(imu1: Imu, imu2: Imu) -> TimeOffset | None:
    """The time offset, or None where the recording is not even fit to be asked."""
    try:
        return time_offset(imu1, imu2)
    except InputError:
        return None
