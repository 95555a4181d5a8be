"""What the commands print: tables and plain words. Nothing that comes from a file is taken as markup or terminal control."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from imufast.imu import Imu, Recording
from imufast.sync import TimeOffset

__all__ = ["console", "error", "offset", "offset_warning", "plain", "recording", "say", "waiting", "warning", "working"]

Array = NDArray[np.float64]

PIPE_WIDTH = 120  # characters; where the output is not a terminal, tables may be this wide
WORTH_WAITING_BYTES = 2_000_000


def console(*, stderr: bool = False) -> Console:
    """Where to print: no markup, and wide tables where it is not a terminal."""
    where = Console(stderr=stderr, markup=False, highlight=False, emoji=False, soft_wrap=stderr)
    if not where.is_terminal:
        where.width = max(where.width, PIPE_WIDTH)
    return where


def plain(text: str) -> str:
    """One line without control characters: what a file says must not steer the terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)


def say(text: str = "", style: str = "") -> None:
    """Lines on stdout."""
    console().print(Text("\n".join(plain(line) for line in text.split("\n")), style), soft_wrap=True)


def error(message: str) -> None:
    """One line on stderr."""
    console(stderr=True).print(Text("error: ", "bold red") + Text(plain(message)))


def warning(message: str) -> None:
    """One line on stderr."""
    console(stderr=True).print(Text("warning: ", "bold yellow") + Text(plain(message)))


@contextmanager
def working(doing: str, *, quick: bool = False) -> Iterator[Callable[[str], None]]:
    """A spinner with the time passed, on a terminal, unless it is quick. Gives what changes its text."""
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    where = console(stderr=True)
    with Progress(*columns, console=where, transient=True, disable=quick or not where.is_terminal) as progress:
        task = progress.add_task(doing, total=None)
        yield lambda text: progress.update(task, description=text)


@contextmanager
def waiting(doing: str, files: Sequence[Path]) -> Iterator[None]:
    """The same, where the files are large enough to wait for."""
    size = sum(file.stat().st_size for file in files if file.is_file())
    with working(doing, quick=size < WORTH_WAITING_BYTES):
        yield


def recording(read: Recording) -> None:
    """One row a sensor, then what they have in common."""
    from_files = bool(read.info)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("sensor", *(("file", "format") if from_files else ())):
        table.add_column(heading, overflow="fold")
    for heading in ("rows", "lost", "gaps", "invalid", "quietest |acc|\nm/s²", "gyr range\nrad/s"):
        table.add_column(heading, justify="right")
    notes = []
    for name, imu in read.items():
        info = read.info.get(name)
        row = [name, *((Path(info.file).name, info.format) if info else ("", "") if from_files else ())]
        row += [str(info.rows if info else len(imu)), str(info.lost_rows if info else imu.lost), str(len(imu.gaps))]
        row += [str(info.invalid_rows if info else 0), f"{quietest_acc(imu):.2f}"]
        row += [f"{imu.gyr.min():.2f} to {imu.gyr.max():.2f}"]
        table.add_row(*(Text(plain(cell)) for cell in row))
        notes += [f"{name}: {note}" for note in (info.notes if info else ())]
    console().print(table)
    first = next(iter(read.values()))
    common = f"{len(first)} samples" if len(read) == 1 else f"{len(first)} samples that all sensors have"
    missing = f", {first.lost} missing in {len(first.gaps)} gaps" if len(first.gaps) else ", no gaps"
    say(f"{common}: {first.duration_s:.2f} s at {first.rate_hz:.6g} Hz{missing}")
    for note in notes:
        say(f"note: {note}")


def quietest_acc(imu: Imu) -> float:
    """Median |acc| of the quietest twentieth of half-second windows, m/s²; 9.81 is expected."""
    size = np.linalg.norm(imu.acc, axis=1)
    window = max(1, min(len(size), round(0.5 * imu.rate_hz)))
    windows = size[: len(size) // window * window].reshape(-1, window)
    spread = windows.std(axis=1)
    return float(np.median(windows[np.argsort(spread, kind="stable")[: max(1, len(spread) // 20)]]))


def offset(found: TimeOffset | None, name1: str, name2: str) -> None:
    """The time offset of two sensors in words; a warning above half a sample."""
    if found is None or found.offset_s is None or found.std_s is None or found.samples is None:
        say("time offset: cannot be told, the recording is too short, too broken or too still")
        return
    if not found.determined:
        say("time offset: this motion does not tell it (it takes a hinge that turns in more than one plane, firmly worn)")
        return
    say(
        f"time offset: {name2} samples {1e3 * abs(found.offset_s):.2f} ms {'late' if found.offset_s >= 0 else 'early'} against "
        f"{name1}, give or take {2e3 * found.std_s:.2f} ms ({found.samples:+.2f} samples)"
    )
    text = offset_warning(found, name1, name2)
    if text:
        warning(text)


def offset_warning(found: TimeOffset | None, name1: str, name2: str) -> str | None:
    """What to say if two sensors are more than half a sample apart."""
    if found is None or not found.significant or found.offset_s is None or found.samples is None:
        return None
    return (
        f"{name2} is {found.samples:+.2f} samples off {name1}: synchronise the sensors, or add {found.offset_s:+.4f} s "
        f"to the times of {name2}"
    )
