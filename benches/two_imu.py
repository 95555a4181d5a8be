"""imufast beside its peers on real recordings of a mechanical joint with optical truth.

    python benches/two_imu.py [--markdown] [--rounds 7]

Hinge axis from all samples, default settings on both sides, same arrays, same run. Recordings: `two_imu_joint` in the folder
IMUFAST_DATA (else ../shared/data). Errors are the worse of both axes; times are medians of interleaved runs,
from checked sensors (imufast) or arrays (qmt) to the axes.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from pathlib import Path

import imufast
import numpy as np
from measuring import (
    QmtHinge,
    data_folder,
    imus,
    interleaved,
    one_core,
    pair_error_deg,
    qmt_hinge,
    refuse_debug_build,
    setting,
    table,
)

ARRAYS = ("gyr1", "acc1", "gyr2", "acc2")
HEADINGS = ("recording", "samples", "imufast, °", "bound, °", "qmt, °", "imufast, ms", "qmt, ms", "times faster")


def measure(path: Path, qmt: QmtHinge | None, rounds: int) -> tuple[int, list[float | None]]:
    """Number of samples, and the numbers of one row."""
    with np.load(path) as recording:
        arrays = [np.ascontiguousarray(recording[name], np.float64) for name in ARRAYS]
        truth = recording["hinge_axis1_reference"], recording["hinge_axis2_reference"]
        pair = imus(float(recording["rate_hz"]), *arrays)
    axis = imufast.estimate_hinge_axis(*pair)
    error = pair_error_deg(axis.axis1, axis.axis2, *truth)
    theirs = None if qmt is None else pair_error_deg(*qmt(*arrays), *truth)
    calls: list[Callable[[], object]] = [lambda: imufast.estimate_hinge_axis(*pair)]
    if qmt is not None:
        calls.append(lambda: qmt(*arrays))
    times = np.array(interleaved(calls, rounds))
    ours_ms, *their_ms = (1e3 * np.median(times, axis=0)).tolist()
    ratio = None if qmt is None else float(np.median(times[:, 1] / times[:, 0]))
    values = [error, float(np.max(axis.bound95_deg)), theirs, ours_ms, their_ms[0] if their_ms else None, ratio]
    return len(arrays[0]), values


def hinge_rows(files: list[Path], rounds: int) -> list[list[str | None]]:
    """One row a recording and one of means."""
    qmt = qmt_hinge()
    rows: list[list[str | None]] = []
    numbers = []
    for path in files:
        samples, values = measure(path, qmt, rounds)
        numbers.append(values)
        rows.append([path.stem, str(samples), *written(values)])
    columns = [[value for value in column if value is not None] for column in zip(*numbers, strict=True)]
    return [*rows, ["mean", None, *written([statistics.fmean(column) if column else None for column in columns])]]


def written(values: list[float | None]) -> list[str | None]:
    """Numbers as they are printed."""
    forms = (".2f", ".2f", ".2f", ".2f", ".0f", ".0f")
    return [None if value is None else format(value, form) for value, form in zip(values, forms, strict=True)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the table for README")
    parser.add_argument("--rounds", type=int, default=7, help="interleaved rounds of timed runs; default 7")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    folder = data_folder() / "two_imu_joint"
    files = sorted(path for path in folder.glob("*.npz") if "hinge_axis1_reference" in np.load(path).files)
    if not files:
        raise SystemExit(f"no recordings of a hinge with reference axes in {folder}")
    print("Hinge axis from all samples, the worse of both axes: error against optics (itself good to about 0.2°), and time.")
    print(setting(), end="\n\n")
    print(table(HEADINGS, hinge_rows(files, max(1, chosen.rounds)), markdown=chosen.markdown))


if __name__ == "__main__":
    main()
