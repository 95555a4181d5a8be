"""Joint angles as files: OpenSim's `.mot` and `.sto`, CSV and Parquet."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from imufast.angles import JointAngles
from imufast.errors import InputError
from imufast.io.table_files import Column, check_names, check_suffix, opensim_storage, write_csv, write_parquet

__all__ = ["ANGLE_FORMATS", "check_angle_target", "write_angles"]

SCHEMA, SCHEMA_VERSION = "imufast.angles", 1
ANGLE_FORMATS = (".mot", ".sto", ".csv", ".parquet")
"""The ends of the names of files that can be written."""


def write_angles(angles: JointAngles, path: str | os.PathLike[str], *, names: Sequence[str] | None = None) -> None:
    """Write joint angles as `.mot`, `.sto`, `.csv` or `.parquet`, whole or not at all: one row a sample, degrees.

    `.mot` is a motion for OpenSim: time and the angles alone, for its GUI takes every column for a coordinate of the model.
    `.sto`, `.csv` and `.parquet` have each angle's standard deviation beside it. A csv file begins with one line after "#" that
    states units, signs, zero and side (`pandas.read_csv(path, comment="#")` reads it); Parquet holds the same in the metadata
    of its schema and columns, and needs the extra `io`; OpenSim's files hold it in their header. Lost samples are rows that are
    not there, as everywhere: OpenSim interpolates between rows.

    Args:
        angles: what `hinge_angle` or `joint_angles` gave.
        path: the file to write; an existing one is replaced.
        names: what the columns are called, one an angle, such as ("knee_angle_r",), the coordinate of an OpenSim model. A minus
            before a name turns that angle's sign: some models, such as gait2392, flex knees to negative angles. Default: the
            names of the angles.

    Raises:
        InputError: not joint angles, another end of the name, names that are none, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    if not isinstance(angles, JointAngles):
        raise InputError(f"angles must be JointAngles, what hinge_angle or joint_angles gave, got {type(angles).__name__}")
    suffix = check_angle_target(path)
    labels = check_names("names", angles.names if names is None else names, len(angles.names))
    signs = [-1.0 if label.startswith("-") else 1.0 for label in labels]
    labels = tuple(label.removeprefix("-") for label in labels)
    values = [sign * angles.angles_deg[:, k] for k, sign in enumerate(signs)]
    stds = list(angles.std_deg.T)
    meaning = _meaning(angles, labels, signs)
    if suffix in (".mot", ".sto"):
        columns = list(zip(labels, values, strict=True))
        if suffix == ".sto":
            pairs = zip(labels, values, stds, strict=True)
            columns = [part for label, value, std in pairs for part in ((label, value), (f"{label}_std", std))]
        said = [f"{SCHEMA} {SCHEMA_VERSION}", *(f"{name}: {text}" for name, text in meaning.items())]
        opensim_storage(path, said, angles.time_s, [name for name, _ in columns], [value for _, value in columns])
        return
    table = [Column("time_s", "s", "time of the sample", angles.time_s)]
    for label, value, std in zip(labels, values, stds, strict=True):
        table += [
            Column(f"{label}_deg", "deg", meaning["angles"], value, ".8f"),
            Column(f"{label}_std_deg", "deg", "one standard deviation", std, ".6g"),
        ]
    if len(labels) > 1:
        table.append(
            Column("gimbal_lock", "1", "1 where the middle angle is near 90 degrees", angles.gimbal_lock.astype(np.int8), "d")
        )
    if suffix == ".parquet":
        write_parquet(path, SCHEMA, {"schema_version": SCHEMA_VERSION, **meaning}, table)
        return
    write_csv(path, "; ".join([f"{SCHEMA} {SCHEMA_VERSION}", *(f"{n}: {t}" for n, t in meaning.items())]), table)


def check_angle_target(path: str | os.PathLike[str], name: str = "path") -> str:
    """The format that the name of the file asks for, one of `ANGLE_FORMATS`.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    return check_suffix(path, ANGLE_FORMATS, name)


def _meaning(angles: JointAngles, labels: Sequence[str], signs: Sequence[float]) -> dict[str, str]:
    """What the numbers mean, in words that need no other file."""
    called = ", ".join(
        label if (label, sign) == (name, 1.0) else f"{label} is {'minus ' * (sign < 0.0)}{name}"
        for label, name, sign in zip(labels, angles.names, signs, strict=True)
    )
    return {
        "angles": f"{called}; degrees, time in s",
        "std": "one standard deviation, degrees",
        "convention": angles.convention,
        "signs": angles.signs,
        "zero": angles.zero,
        "side": angles.side or "not told",
        "joint": angles.joint or "not told",
        "status": str(angles.status),
        "std_median_deg": ", ".join(f"{value:.3g}" for value in np.median(angles.std_deg, axis=0)),
    }
