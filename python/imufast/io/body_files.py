"""What the columns of a lower body's angles are called in files, and what they mean."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.angles import MOST_STD_DEG
from imufast.body.result import LowerBody
from imufast.errors import InputError
from imufast.io.table_files import check_names

__all__ = ["body_columns", "body_meaning", "check_body_names"]

Array = NDArray[np.float64]

COORDINATES = {
    "hip": (("hip_flexion", "flexion"), ("hip_adduction", "adduction"), ("hip_rotation", "internal rotation")),
    "knee": (("knee_angle", "flexion"), ("knee_adduction", "adduction"), ("knee_rotation", "internal rotation")),
    "ankle": (("ankle_angle", "dorsiflexion"), ("ankle_inversion", "inversion"), ("ankle_rotation", "internal rotation")),
}
"""The first of each joint, and all of the hip, are coordinates of OpenSim's models; the others are named alike."""
PELVIS = (("pelvis_tilt", "front up"), ("pelvis_list", "right side down"))
COLUMNS = (
    *(name for name, _ in PELVIS),
    *(f"{name}_{side}" for side in "rl" for joint in COORDINATES.values() for name, _ in joint),
)


def body_columns(body: LowerBody, names: object) -> list[tuple[str, Array, Array, str]]:
    """Name, angle (K,), standard deviation (K,), degrees, and meaning of each column.

    Raises:
        InputError: `names` is no mapping from these names to others.
    """
    found = []
    if body.pelvis_angles_deg.shape[1]:
        for k, (name, meaning) in enumerate(PELVIS):
            found.append((name, body.pelvis_angles_deg[:, k], body.pelvis_std_deg[:, k], f"pelvis {meaning}"))
    for side in ("right", "left"):
        for kind, coordinates in COORDINATES.items():
            angles, stds = getattr(body, f"{kind}_angles_deg"), getattr(body, f"{kind}_std_deg")
            if side not in angles:
                continue
            for k, (name, meaning) in enumerate(coordinates):
                found.append((f"{name}_{side[0]}", angles[side][:, k], stds[side][:, k], f"{side} {kind} {meaning}"))
    if not found:
        raise InputError("angles holds no joint angle: no joint has both its segments' frames")
    # Where nothing is known a band of half a turn says so, in every format.
    found = [(name, angle, np.minimum(std, MOST_STD_DEG), what) for name, angle, std, what in found]
    if names is None:
        return found
    checked = check_body_names(names)
    labels = [checked.get(name, name) for name, *_ in found]
    return [
        (label.removeprefix("-"), -angle if label.startswith("-") else angle, std, f"minus {what}" if label[0] == "-" else what)
        for label, (_, angle, std, what) in zip(labels, found, strict=True)
    ]


def check_body_names(names: object, argument: str = "names") -> dict[str, str]:
    """Other names for columns, checked; those of joints that a smaller model does not have may be among them.

    Raises:
        InputError: no mapping from columns to names, or names that are none.
    """
    if not isinstance(names, Mapping):
        raise InputError(f"{argument} must map columns to names, such as {{'knee_angle_r': '-knee_angle_r'}}, got {names!r}")
    for name in names:
        if name not in COLUMNS:
            raise InputError(f"{argument}: there is no column {name!r}; there are {', '.join(COLUMNS)}")
    check_names(argument, [names.get(name, name) for name in COLUMNS], len(COLUMNS))
    return {str(name): str(label) for name, label in names.items()}


def body_meaning(body: LowerBody) -> dict[str, Any]:
    """What the numbers mean, in words that need no other file."""
    open_ = [name for name, joint in body.joints.items() if not joint.determined]
    return {
        "angles": "degrees, time in s",
        "std": "one standard deviation, degrees",
        "convention": "ISB: turns about Z of the proximal segment (right), then the floating X, then Y of the distal segment",
        "signs": "on both sides flexion, dorsiflexion, adduction, inversion and internal rotation are positive, and of the "
        "pelvis front up and right side down",
        "frames": "thigh and shank by joint centres and knee axis, pelvis by the line of the hips and the upright when "
        "standing, foot by the upright and the knee's direction when standing",
        "zero": "the segments' axes parallel, of the ankle and of the pelvis's tilt as when standing",
        "status": str(body.status),
        "undetermined": ", ".join(open_) or "none",
        "placement": ", ".join(f"{segment}: {sensor}" for segment, sensor in body.placement.items()),
    }
