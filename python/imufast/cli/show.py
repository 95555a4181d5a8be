"""What the commands print: tables and plain words. Nothing that comes from a file is taken as markup or terminal control."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from imufast.axis import HingeAxis, SolveStatus
from imufast.imu import Imu, Recording
from imufast.simulate import HingeSimulation
from imufast.sync import TimeOffset

__all__ = ["axis", "beside_truth", "demo_intro", "error", "offset", "recording", "waiting", "warn_of_offset", "warning"]

Array = NDArray[np.float64]

PIPE_WIDTH = 120  # characters; where the output is not a terminal, tables may be this wide
WORTH_WAITING_BYTES = 2_000_000

_STATUS = {
    SolveStatus.CONVERGED: "the motion determines the axis",
    SolveStatus.STALLED: "the search stalled before its end: take the numbers with care",
    SolveStatus.MAX_ITERATIONS: "the search ran out of iterations: take the numbers with care",
    SolveStatus.NOT_IDENTIFIABLE: "the motion does not determine the axis: bend the joint more, in more than one posture",
    SolveStatus.NUMERICAL_ERROR: "the numbers overflow",
}


def _console(*, stderr: bool = False) -> Console:
    console = Console(stderr=stderr, markup=False, highlight=False, emoji=False, soft_wrap=stderr)
    if not console.is_terminal:
        console.width = max(console.width, PIPE_WIDTH)
    return console


def plain(text: str) -> str:
    """One line without control characters: what a file says must not steer the terminal."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "\N{REPLACEMENT CHARACTER}" for c in text)


def _say(text: str = "", style: str = "") -> None:
    _console().print(Text("\n".join(plain(line) for line in text.split("\n")), style), soft_wrap=True)


def error(message: str) -> None:
    """One line on stderr."""
    _console(stderr=True).print(Text("error: ", "bold red") + Text(plain(message)))


def warning(message: str) -> None:
    """One line on stderr."""
    _console(stderr=True).print(Text("warning: ", "bold yellow") + Text(plain(message)))


@contextmanager
def waiting(doing: str, files: Sequence[Path]) -> Iterator[None]:
    """A spinner with the time passed, on a terminal, where the files are large enough to wait for."""
    size = sum(file.stat().st_size for file in files if file.is_file())
    columns = SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    quick = size < WORTH_WAITING_BYTES
    with Progress(*columns, console=_console(stderr=True), transient=True, disable=quick) as progress:
        progress.add_task(doing, total=None)
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
    _console().print(table)
    first = next(iter(read.values()))
    common = f"{len(first)} samples" if len(read) == 1 else f"{len(first)} samples that all sensors have"
    missing = f", {first.lost} missing in {len(first.gaps)} gaps" if len(first.gaps) else ", no gaps"
    _say(f"{common}: {first.duration_s:.2f} s at {first.rate_hz:.6g} Hz{missing}")
    for note in notes:
        _say(f"note: {note}")


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
        _say("time offset: cannot be told, the recording is too short, too broken or too still")
        return
    if not found.determined:
        _say("time offset: this motion does not tell it (it takes a hinge that turns in more than one plane, firmly worn)")
        return
    _say(
        f"time offset: {name2} samples {1e3 * abs(found.offset_s):.2f} ms {'late' if found.offset_s >= 0 else 'early'} against "
        f"{name1}, give or take {2e3 * found.std_s:.2f} ms ({found.samples:+.2f} samples)"
    )
    warn_of_offset(found, name1, name2)


def warn_of_offset(found: TimeOffset | None, name1: str, name2: str) -> None:
    """A warning if two sensors are more than half a sample apart."""
    if found and found.significant and found.offset_s is not None and found.samples is not None:
        warning(
            f"{name2} is {found.samples:+.2f} samples off {name1}: synchronise the sensors, or add {found.offset_s:+.4f} s "
            f"to the times of {name2}"
        )


def axis(found: HingeAxis, imu1: Imu, imu2: Imu) -> None:
    """The axis in both sensor frames, how far to trust it, and from what."""
    _say()
    _say(f"Hinge axis of {imu1.name} and {imu2.name}", "bold")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("in the frame of", overflow="fold")
    for heading in ("x", "y", "z", "within\n95 % of cases"):
        table.add_column(heading, justify="right")
    for imu, vector, bound in ((imu1, found.axis1, found.bound95_deg[0]), (imu2, found.axis2, found.bound95_deg[1])):
        within = f"{bound:.2f}°" if bound < 90.0 else "unknown"
        table.add_row(Text(plain(imu.name)), *(f"{value:.4f}" for value in vector), within)
    _console().print(table)
    _say(f"status: {found.status}: {_STATUS[found.status]}")
    _say(
        f"residuals (standard deviation): gyroscope {found.gyr_residual_std:.3g} rad/s, "
        f"accelerometer {found.acc_residual_std:.3g} m/s²"
    )
    used = [str(count) for count in dict.fromkeys((found.n_gyr, found.n_acc))]
    _say(f"samples used: {' gyroscope, '.join(used)}{' accelerometer' if len(used) > 1 else ''} of {len(imu1)}")
    if found.status is SolveStatus.CONVERGED:
        _say("The bounds take the joint as a hinge; whether it is one is not judged here.")


def demo_intro(simulation: HingeSimulation) -> None:
    """What is about to be shown."""
    turn_deg = float(np.degrees(np.ptp(simulation.angle_rad)))
    _say("A simulated recording: two sensors, mounted anyhow, on two segments that a hinge joins", "bold")
    _say(
        f"It bends by {turn_deg:.0f}° while both segments move about. Gyroscope biases "
        f"{np.degrees(np.linalg.norm(simulation.gyr_bias1)):.1f} °/s, accelerometer biases "
        f"{np.linalg.norm(simulation.acc_bias1):.1f} m/s², noise. The estimate sees only the raw data."
    )


def beside_truth(found: HingeAxis, simulation: HingeSimulation, took_s: float) -> None:
    """Estimate against truth, degrees; the common sign of the pair is free."""
    turn = 1.0 if found.axis1 @ simulation.axis1 + found.axis2 @ simulation.axis2 > 0.0 else -1.0
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("", "truth x", "y", "z", "off by", "bound"):
        table.add_column(heading, justify="right")
    for name, vector, truth, bound in (
        ("sensor1", found.axis1, simulation.axis1, found.bound95_deg[0]),
        ("sensor2", found.axis2, simulation.axis2, found.bound95_deg[1]),
    ):
        table.add_row(
            name, *(f"{value:.4f}" for value in turn * truth), f"{angle_deg(turn * vector, truth):.2f}°", f"{bound:.2f}°"
        )
    _say()
    _say("Beside the truth", "bold")
    _console().print(table)
    _say(f"The estimate took {1e3 * took_s:.1f} ms. Next: imufast info FILE... and imufast calibrate FILE1 FILE2")


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
