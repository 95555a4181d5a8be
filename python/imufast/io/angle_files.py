"""Joint angles as files: OpenSim's `.mot` and `.sto`, CSV and Parquet."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.angles import JointAngles
from imufast.body.result import LowerBody
from imufast.errors import InputError
from imufast.io.body_files import body_columns, body_meaning
from imufast.io.table_files import Column, check_names, check_suffix, opensim_storage, write_csv, write_parquet

__all__ = ["ANGLE_FORMATS", "check_angle_target", "write_angles"]

Array = NDArray[np.float64]

SCHEMA, SCHEMA_VERSION = "imufast.angles", 1
BODY_SCHEMA, BODY_SCHEMA_VERSION = "imufast.body-angles", 1
ANGLE_FORMATS = (".mot", ".sto", ".csv", ".parquet")
"""The ends of the names of files that can be written."""


def write_angles(
    angles: JointAngles | LowerBody,
    path: str | os.PathLike[str],
    *,
    names: Sequence[str] | Mapping[str, str] | None = None,
) -> None:
    """Write joint angles as `.mot`, `.sto`, `.csv` or `.parquet`, whole or not at all: one row a sample, degrees.

    `.mot` is a motion for OpenSim: time and the angles alone, for its GUI takes every column for a coordinate of the model.
    `.sto`, `.csv` and `.parquet` have each angle's standard deviation beside it. A csv file begins with one line after "#" that
    states units, signs, zero and side (`pandas.read_csv(path, comment="#")` reads it); Parquet holds the same in the metadata
    of its schema and columns, and needs the extra `io`; OpenSim's files hold it in their header. Lost samples are rows that are
    not there, as everywhere: OpenSim interpolates between rows.

    All angles of a lower body go into one file, under the names of OpenSim's coordinates: pelvis_tilt and pelvis_list (whatever
    the heading), then of either side, r and l, hip_flexion_r, hip_adduction_r, hip_rotation_r, knee_angle_r (flexion positive,
    as Rajagopal's model has it), knee_adduction_r, knee_rotation_r, ankle_angle_r, ankle_inversion_r, ankle_rotation_r.

    Args:
        angles: what `hinge_angle`, `joint_angles` or `estimate_lower_body` gave.
        path: the file to write; an existing one is replaced.
        names: what the columns are called, one an angle, such as ("knee_angle_r",), the coordinate of an OpenSim model; of a
            lower body a mapping from the names above to others. A minus before a name turns that angle's sign: some models,
            such as gait2392, flex knees to negative angles, which {"knee_angle_r": "-knee_angle_r", ...} does. Default: the
            names of the angles.

    Raises:
        InputError: no joint angles, another end of the name, names that are none, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    if not isinstance(angles, (JointAngles, LowerBody)):
        raise InputError(
            "angles must be JointAngles, what hinge_angle or joint_angles gave, or a LowerBody, what estimate_lower_body gave, "
            f"got {type(angles).__name__}"
        )
    suffix = check_angle_target(path)
    if isinstance(angles, LowerBody):
        columns, meaning = body_columns(angles, names), body_meaning(angles)
        told = {"angles": ", ".join(f"{label} is {what}" for label, _, _, what in columns) + f"; {meaning['angles']}"}
        _write(path, suffix, (BODY_SCHEMA, BODY_SCHEMA_VERSION), {**meaning, **told}, angles.time_s, columns, [])
        return
    labels = check_names("names", angles.names if names is None else names, len(angles.names))
    signs = [-1.0 if label.startswith("-") else 1.0 for label in labels]
    labels = tuple(label.removeprefix("-") for label in labels)
    meaning = _meaning(angles, labels, signs)
    columns = [
        (label, sign * angles.angles_deg[:, k], angles.std_deg[:, k], meaning["angles"])
        for k, (label, sign) in enumerate(zip(labels, signs, strict=True))
    ]
    lock = angles.gimbal_lock.astype(np.int8)
    more = [Column("gimbal_lock", "1", "1 where the middle angle is near 90 degrees", lock, "d")] if len(labels) > 1 else []
    _write(path, suffix, (SCHEMA, SCHEMA_VERSION), meaning, angles.time_s, columns, more)


def _write(
    path: str | os.PathLike[str],
    suffix: str,
    schema: tuple[str, int],
    meaning: Mapping[str, Any],
    time_s: Array,
    columns: Sequence[tuple[str, Array, Array, str]],
    more: Sequence[Column],
) -> None:
    """Angles with name, values, standard deviations and meaning each, and `more` for tables, in the format of `suffix`."""
    name, version = schema
    said = [f"{name} {version}", *(f"{key}: {text}" for key, text in meaning.items())]
    if suffix in (".mot", ".sto"):
        shown = [(label, values) for label, values, _, _ in columns]
        if suffix == ".sto":
            shown = [part for label, values, std, _ in columns for part in ((label, values), (f"{label}_std", std))]
        opensim_storage(path, said, time_s, [label for label, _ in shown], [values for _, values in shown])
        return
    table = [Column("time_s", "s", "time of the sample", time_s)]
    for label, values, std, what in columns:
        table += [
            Column(f"{label}_deg", "deg", what, values, ".8f"),
            Column(f"{label}_std_deg", "deg", "one standard deviation", std, ".6g"),
        ]
    if suffix == ".parquet":
        write_parquet(path, name, {"schema_version": version, **meaning}, [*table, *more])
        return
    write_csv(path, "; ".join(said), [*table, *more])


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
