"""Relative orientations as files: CSV for eyes and spreadsheets, Parquet for programs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imufast.errors import ImufastError, InputError
from imufast.files import check_target, replacing

if TYPE_CHECKING:
    from imufast.track import RelativeOrientation

__all__ = ["ORIENTATION_FORMATS", "check_orientation_target", "write_orientation"]

Array = NDArray[np.float64]

SCHEMA, SCHEMA_VERSION = "imufast.orientation", 1
ORIENTATION_FORMATS = (".csv", ".parquet")
"""The ends of the names of files that can be written."""
FRAMES = "q takes vectors of sensor frame 2 to sensor frame 1; Hamilton, scalar first"
COLUMNS = {
    "time_s": ("s", "time of the sample"),
    "q_w": ("1", FRAMES),
    "q_x": ("1", FRAMES),
    "q_y": ("1", FRAMES),
    "q_z": ("1", FRAMES),
    "angle_std_deg": ("deg", "one standard deviation: root of the trace of the 3x3 error covariance"),
}
ROWS = 65_536
"""Written at a time."""


def write_orientation(rel: RelativeOrientation, path: str | os.PathLike[str]) -> None:
    """Write a relative orientation as `.csv` or `.parquet`, whole or not at all: one row a sample with the columns time_s, q_w,
    q_x, q_y, q_z, angle_std_deg.

    A csv file begins with one line after "#" that states units and frames, then names its columns; `pandas.read_csv(path,
    comment="#")` reads it. Parquet holds the same in the metadata of its schema and columns, and needs the extra `io`.

    Args:
        rel: what `track` gave.
        path: the file to write; an existing one is replaced.

    Raises:
        InputError: not a relative orientation, another end of the name, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    from imufast.track import RelativeOrientation

    if not isinstance(rel, RelativeOrientation):
        raise InputError(f"rel must be a RelativeOrientation, what track gave, got {type(rel).__name__}")
    if check_orientation_target(path) == ".parquet":
        _write_parquet(rel, path)
        return
    with replacing(path) as file:
        for text in _csv(rel):
            file.write(text.encode())


def check_orientation_target(path: str | os.PathLike[str], name: str = "path") -> str:
    """The format that the name of the file asks for, one of `ORIENTATION_FORMATS`.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    check_target(path, name)
    suffix = Path(path).suffix.lower()
    if suffix not in ORIENTATION_FORMATS:
        raise InputError(f"{name} {str(path)!r} must end in {' or '.join(ORIENTATION_FORMATS)}: that says what to write")
    if suffix == ".parquet":
        try:
            import pyarrow.parquet  # noqa: F401
        except ImportError:
            raise ImufastError("a Parquet file needs pyarrow: pip install 'imufast[io]'") from None
    return suffix


def _csv(rel: RelativeOrientation) -> Iterator[str]:
    units = "time_s in s; angle_std_deg: one standard deviation (root of the trace of the 3x3 error covariance), degrees"
    yield f"# {SCHEMA} {SCHEMA_VERSION}; {FRAMES}; {units}; status {rel.status}\n"
    yield ",".join(COLUMNS) + "\n"
    for start in range(0, len(rel), ROWS):
        part = slice(start, start + ROWS)
        # Times to the last digit, for they may be a clock's; the rest far beyond what is known.
        rows = zip(rel.time_s[part].tolist(), rel.q_12[part].tolist(), rel.angle_std_deg[part].tolist(), strict=True)
        yield "".join(f"{t!r},{w:.10f},{x:.10f},{y:.10f},{z:.10f},{std:.6g}\n" for t, (w, x, y, z), std in rows)


def _write_parquet(rel: RelativeOrientation, path: str | os.PathLike[str]) -> None:
    import pyarrow
    import pyarrow.parquet

    about = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "frames": FRAMES,
        "units": {name: unit for name, (unit, _) in COLUMNS.items()},
        "status": str(rel.status),
    }
    fields = [
        pyarrow.field(name, pyarrow.float64(), nullable=False, metadata={"unit": unit, "description": what})
        for name, (unit, what) in COLUMNS.items()
    ]
    columns = [rel.time_s, *np.ascontiguousarray(rel.q_12.T), rel.angle_std_deg]
    schema = pyarrow.schema(fields, metadata={SCHEMA: json.dumps(about)})
    table = pyarrow.table([pyarrow.array(column) for column in columns], schema=schema)
    with replacing(path) as file:
        pyarrow.parquet.write_table(table, file)
