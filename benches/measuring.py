"""What all benches share: a release build, recordings, peers, fair timing, tables."""

from __future__ import annotations

import contextlib
import functools
import io
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast import _core
from numpy.typing import NDArray

Array = NDArray[np.float64]


def refuse_debug_build() -> None:
    """A debug build must never be timed by mistake."""
    if _core.build_profile != "release":
        raise SystemExit(f"imufast._core is a {_core.build_profile} build; benches need a release build: make bench")


def data_folder() -> Path:
    """The folder of real recordings: IMUFAST_DATA, else ../shared/data beside the project."""
    folder = Path(os.environ.get("IMUFAST_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
    if not folder.is_dir():
        raise SystemExit(f"real recordings are missing: no folder {folder} (set IMUFAST_DATA)")
    return folder


def setting() -> str:
    """Where the numbers come from, in one line."""
    cpu = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        names = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if line.startswith("model name")]
        cpu = names[0].partition(":")[2].strip() if names else cpu
    return f"{cpu}, one core; Python {platform.python_version()}, numpy {np.__version__}; compare ratios, not times"


def one_core() -> None:
    """Everybody gets the same one core and one thread. Numpy asks for threads when it is loaded, so the script starts anew."""
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    if any(os.environ.get(name) != value for name, value in one_thread.items()):
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | one_thread)  # noqa: S606
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


QmtHinge = Callable[[Array, Array, Array, Array], tuple[Array, Array]]


@functools.cache
def qmt_hinge() -> QmtHinge | None:
    """qmt's `jointAxisEstHingeOlsson` with its default settings, or None, said plainly, where qmt is missing."""
    try:
        import qmt
    except ImportError as error:
        print(f"The peer qmt is missing ({error}): its columns stay empty. pip install 'imufast[bench]'", file=sys.stderr)
        return None

    def hinge(gyr1: Array, acc1: Array, gyr2: Array, acc2: Array) -> tuple[Array, Array]:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints every step
            axis1, axis2 = qmt.jointAxisEstHingeOlsson(acc1, acc2, gyr1, gyr2)
        return np.ravel(axis1), np.ravel(axis2)

    return hinge


DfjimuCenter = Callable[[Array, Array, Array, Array, float], tuple[Array, Array]]


@functools.cache
def dfjimu_center() -> DfjimuCenter | None:
    """dfjimu's `estimate_lever_arms` with its default settings, as the centre seen from the sensors; None, said plainly, where
    dfjimu is missing."""
    try:
        import dfjimu
    except ImportError as error:
        print(f"The peer dfjimu is missing ({error}): its columns stay empty. pip install 'imufast[bench]'", file=sys.stderr)
        return None

    def center(gyr1: Array, acc1: Array, gyr2: Array, acc2: Array, rate_hz: float) -> tuple[Array, Array]:
        estimate: Callable[..., tuple[Array, Array]] = dfjimu.estimate_lever_arms  # untyped
        r1, r2 = estimate(gyr1, gyr2, acc1, acc2, rate_hz)
        return -np.ravel(r1), -np.ravel(r2)

    return center


@dataclass(frozen=True)
class DfjimuOrientation:
    """dfjimu's filter and smoother from arrays to both orientations, told the lever arms; default settings else."""

    module: Any

    def mekf(self, arrays: Sequence[Array], rate_hz: float, center1: Array, center2: Array) -> tuple[Array, Array]:
        gyr1, acc1, gyr2, acc2 = arrays
        start = np.array([1.0, 0.0, 0.0, 0.0])
        q1, q2 = self.module.mekf_acc(gyr1, gyr2, acc1, acc2, -center1, -center2, rate_hz, start)
        return q1, q2

    def map(
        self, arrays: Sequence[Array], rate_hz: float, center1: Array, center2: Array, iterations: int = 10
    ) -> tuple[Array, Array]:
        gyr1, acc1, gyr2, acc2 = arrays
        start, rates, first, link = np.array([1.0, 0.0, 0.0, 0.0]), 0.01 * np.eye(6), 0.1 * np.eye(3), np.eye(3)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that ten iterations are not enough
            q1, q2 = self.module.map_acc(
                gyr1, gyr2, acc1, acc2, -center1, -center2, rate_hz, start, rates, first, link, iterations=iterations
            )
        return q1, q2


@functools.cache
def dfjimu_orientation() -> DfjimuOrientation | None:
    """dfjimu's relative orientation, or None, said plainly, where it is missing."""
    try:
        import dfjimu
    except ImportError as error:
        print(f"The peer dfjimu is missing ({error}): its columns stay empty. pip install 'imufast[bench]'", file=sys.stderr)
        return None
    return DfjimuOrientation(dfjimu)


def relative(q1: Array, q2: Array) -> Array:
    """q_12 (N, 4) of two orientations to one frame, scalar first."""
    (a, b, c, d), (w, x, y, z) = (q1 * [1.0, -1.0, -1.0, -1.0]).T, q2.T
    rows = [
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ]
    return np.stack(rows, axis=1)


def quaternion_errors_deg(q_12: Array, truth: Array) -> Array:
    """Angle between two orientations, (N,), degrees."""
    if q_12.shape != truth.shape or not np.isfinite(q_12).all() or np.abs(np.linalg.norm(q_12, axis=1) - 1.0).max() > 1e-6:
        raise SystemExit("q_12 is not one unit quaternion a sample")
    off = relative(truth, q_12)
    return np.asarray(np.degrees(2.0 * np.arctan2(np.linalg.norm(off[:, 1:], axis=1), np.abs(off[:, 0]))))


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def imus(rate_hz: float, gyr1: Array, acc1: Array, gyr2: Array, acc2: Array) -> tuple[imufast.Imu, imufast.Imu]:
    """Both sensors, checked for plausibility, which costs time too."""
    return imufast.Imu(gyr1, acc1, rate_hz=rate_hz, name="1"), imufast.Imu(gyr2, acc2, rate_hz=rate_hz, name="2")


def seconds(call: Callable[[], object], least_s: float = 0.01) -> float:
    """Wall time of one call, s: the mean over as many as fill `least_s`."""
    runs, spent = 0, 0.0
    started = time.perf_counter()
    while runs == 0 or spent < least_s:
        call()
        runs += 1
        spent = time.perf_counter() - started
    return spent / runs


def interleaved(calls: Sequence[Callable[[], object]], rounds: int) -> list[list[float]]:
    """Times of each call, s, taken in turns, so that what disturbs the machine disturbs all alike; a round a row."""
    for call in calls:
        call()
    return [[seconds(call) for call in calls] for _ in range(rounds)]


def pair_error_deg(axis1: Array, axis2: Array, truth1: Array, truth2: Array) -> float:
    """The worse of both axes' errors, degrees; the sign of the pair as a whole is free, not that of one alone."""

    def angle(a: Array, b: Array) -> float:
        return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))

    for axis in (axis1, axis2):
        if axis.shape != (3,) or not abs(np.linalg.norm(axis) - 1.0) < 1e-6:
            raise SystemExit(f"not a unit vector: {axis}")
    return min(max(angle(sign * axis1, truth1), angle(sign * axis2, truth2)) for sign in (1.0, -1.0))


def begin(*, markdown: bool) -> Callable[[str, Sequence[str], Sequence[Sequence[Any]]], None]:
    """What every bench begins with: a release build, one core, quiet, and where it runs. Gives what shows a table."""
    refuse_debug_build()
    one_core()
    warnings.simplefilter("ignore", imufast.ImufastWarning)
    print(setting(), end="\n\n")

    def show(title: str, headings: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        print(f"{title}\n\n{table(headings, rows, markdown=markdown)}\n", flush=True)

    return show


def table(headings: Sequence[str], rows: Sequence[Sequence[Any]], *, markdown: bool) -> str:
    """A table as text; the first column is words, None is a dash."""
    cells = [list(headings)] + [["–" if cell is None else str(cell) for cell in row] for row in rows]
    widths = [max(len(row[i]) for row in cells) for i in range(len(headings))]
    lines = [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width) for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    if not markdown:
        return "\n".join([lines[0], "  ".join("-" * width for width in widths), *lines[1:]])
    piped = ["| " + " | ".join(row) + " |" for row in cells]
    return "\n".join([piped[0], "|" + "|".join([" --- "] + [" ---: "] * (len(headings) - 1)) + "|", *piped[1:]])
