"""Relative orientations as files: CSV, Parquet, and OpenSim's `.sto` for OpenSense."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from imufast.errors import InputError
from imufast.io.table_files import Column, check_names, check_suffix, write_csv, write_parquet, write_rows

if TYPE_CHECKING:
    from imufast.track import RelativeOrientation

__all__ = ["ORIENTATION_FORMATS", "check_orientation_target", "write_orientation"]

SCHEMA, SCHEMA_VERSION = "imufast.orientation", 1
ORIENTATION_FORMATS = (".csv", ".parquet", ".sto")
"""The ends of the names of files that can be written."""
FRAMES = "q takes vectors of sensor frame 2 to sensor frame 1; Hamilton, scalar first"
STD = "one standard deviation: root of the trace of the 3x3 error covariance"
OPENSIM_VERSION = "4.6"
"""The version of OpenSim that the tests read the files with; its readers ask for one."""


def write_orientation(
    rel: RelativeOrientation, path: str | os.PathLike[str], *, names: Sequence[str] = ("sensor1_imu", "sensor2_imu")
) -> None:
    """Write a relative orientation as `.csv`, `.parquet` or `.sto`, whole or not at all: one row a sample with the columns
    time_s, q_w, q_x, q_y, q_z, angle_std_deg.

    A csv file begins with one line after "#" that states units and frames, then names its columns; `pandas.read_csv(path,
    comment="#")` reads it. Parquet holds the same in the metadata of its schema and columns, and needs the extra `io`. `.sto`
    is OpenSim's table of orientations, for OpenSense: two columns w,x,y,z, of which the first, sensor 1, stands still, and the
    second is q_12; standard deviations have no place in it.

    Args:
        rel: what `track` gave.
        path: the file to write; an existing one is replaced.
        names: of the two columns of `.sto`: OpenSense looks for the frames that its model has, such as
            ("femur_r_imu", "tibia_r_imu"). Default ("sensor1_imu", "sensor2_imu").

    Raises:
        InputError: not a relative orientation, another end of the name, names that are none, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    from imufast.track import RelativeOrientation

    if not isinstance(rel, RelativeOrientation):
        raise InputError(f"rel must be a RelativeOrientation, what track gave, got {type(rel).__name__}")
    suffix = check_orientation_target(path)
    labels = check_names("names", names, 2)
    if any(label.startswith("-") for label in labels):
        raise InputError(f"names: a minus turns the sign of an angle, not of an orientation; got {names!r}")
    if suffix == ".sto":
        _write_sto(rel, path, labels)
        return
    # Times to the last digit, for they may be a clock's; the rest far beyond what is known.
    columns = [Column("time_s", "s", "time of the sample", rel.time_s)]
    columns += [Column(f"q_{x}", "1", FRAMES, rel.q_12[:, i], ".10f") for i, x in enumerate("wxyz")]
    columns += [Column("angle_std_deg", "deg", STD, rel.angle_std_deg, ".6g")]
    if suffix == ".parquet":
        about = {"schema_version": SCHEMA_VERSION, "frames": FRAMES, "status": str(rel.status)}
        write_parquet(path, SCHEMA, about, columns)
        return
    units = "time_s in s; angle_std_deg: one standard deviation (root of the trace of the 3x3 error covariance), degrees"
    write_csv(path, f"{SCHEMA} {SCHEMA_VERSION}; {FRAMES}; {units}; status {rel.status}", columns)


def check_orientation_target(path: str | os.PathLike[str], name: str = "path") -> str:
    """The format that the name of the file asks for, one of `ORIENTATION_FORMATS`.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    return check_suffix(path, ORIENTATION_FORMATS, name)


def _write_sto(rel: RelativeOrientation, path: str | os.PathLike[str], names: Sequence[str]) -> None:
    """OpenSim's table of quaternions."""
    rate = 1.0 / float(np.median(np.diff(rel.time_s))) if len(rel) > 1 else 1.0
    head = [
        f"DataRate={rate:.6f}\n",
        "DataType=Quaternion\n",
        "version=3\n",
        f"OpenSimVersion={OPENSIM_VERSION}\n",
        "endheader\n",
        "\t".join(("time", *names)) + "\n",
    ]
    still = "1.0000000000,0.0000000000,0.0000000000,0.0000000000"
    turned = np.array([",".join(f"{x:.10f}" for x in q) for q in rel.q_12.tolist()])
    write_rows(path, head, [(rel.time_s, ""), (np.full(len(rel), still), "s"), (turned, "s")], "\t")
