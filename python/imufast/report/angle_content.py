"""What a report says of joint angles, as plain data."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.angles import AngleStatus, AngleStd, JointAngles
from imufast.imu import GAP_STEPS
from imufast.report.orientation_words import degrees
from imufast.report.thin import kept_samples, longest_spans

__all__ = ["angle_headline", "angles_plain", "band_words", "known_words", "name_words"]

Array = NDArray[np.float64]

_HEADLINES = {
    AngleStatus.FOUND: "{} known",
    AngleStatus.NOT_A_HINGE: "The joint turns off its axis nearly as much as about it: one angle does not tell how it stands",
    AngleStatus.GIMBAL_LOCK: "{} known, but for gimbal lock: near it two of the angles cannot be told apart",
    AngleStatus.NOT_OBSERVABLE: "The motion does not show the relative orientation, hence no angle",
    AngleStatus.UNCERTAIN: "The search for the orientations did not end as it should: take the angles with care",
}
PARTS = {
    "orientation": "orientation",
    "axis": "axis or frames",
    "zero": "zero",
    "soft_tissue": "soft tissue",
}
LIMITS_OF_USE = (
    "The axis is the one about which the sensors turn, the functional axis; an anatomical one, from palpated bones, may differ "
    "by several degrees, and with it the level and the crosstalk of adduction and rotation.",
    "What soft tissue does about the hinge axis itself no sensor on the skin can show. The band takes it to be as much as the "
    "joint is seen to leave its axis in the quieter of two directions; if the joint moves there by itself, too, the band is "
    "wider than need be.",
    "The zero is what was said to be zero. A standing knee is within several degrees of straight, not straight by itself.",
)
"""What the numbers do not cover."""


def name_words(name: str) -> str:
    """An angle's name for people."""
    plain = {"rotation_x": "rotation about x", "rotation_y": "rotation about y", "rotation_z": "rotation about z"}
    return plain.get(name, name.replace("_", " ")).capitalize()


def angle_headline(angles: JointAngles) -> str:
    """The status as one sentence without a full stop."""
    one = len(angles.names) == 1
    return _HEADLINES[angles.status].format("The joint angle is" if one else "The joint angles are")


def band_words(angles: JointAngles) -> str:
    """How certain each angle is, in one sentence."""
    medians = np.median(angles.std_deg, axis=0).tolist()
    each = ", ".join(f"{name_words(name).lower()} {degrees(std)}" for name, std in zip(angles.names, medians, strict=True))
    return f"Standard deviation, in the median: {each}."


def known_words(angles: JointAngles) -> str:
    """Zero, signs, side and convention, in one sentence without a full stop."""
    parts = [f"zero: {angles.zero}", f"positive: {angles.signs}"]
    parts += [f"{name}: {value}" for name, value in (("side", angles.side), ("joint", angles.joint)) if value]
    if angles.convention != "hinge":
        parts.append(f"convention {angles.convention}")
    return "; ".join(parts)


def angles_plain(angles: JointAngles, most: int | None) -> dict[str, Any]:
    """All that is told of joint angles; the curves thinned to about `most` samples, extremes kept."""
    kept = kept_samples((*angles.angles_deg.T, *angles.std_deg.T), len(angles), most)
    medians = np.median(angles.std_deg, axis=0)
    highest = angles.angles_deg.argmax(axis=0)
    lowest = angles.angles_deg.argmin(axis=0)
    return {
        "names": list(angles.names),
        "titles": [name_words(name) for name in angles.names],
        "status": angles.status,
        "status_name": angles.status.value.lower().replace("_", " "),
        "headline": angle_headline(angles),
        "band": band_words(angles),
        "known": known_words(angles),
        "convention": angles.convention,
        "signs": angles.signs,
        "zero": angles.zero,
        "side": angles.side,
        "joint": angles.joint,
        "why": angles.why,
        "off_axis_deg": angles.off_axis_deg,
        "std_median_deg": medians,
        "lowest_deg": angles.angles_deg.min(axis=0),
        "lowest_at_s": angles.time_s[lowest],
        "highest_deg": angles.angles_deg.max(axis=0),
        "highest_at_s": angles.time_s[highest],
        "std_parts_deg": {f.name: getattr(angles.parts, f.name) for f in fields(AngleStd)},
        "part_names": PARTS,
        "gimbal_lock_s": longest_spans(_spans(angles.time_s, angles.gimbal_lock)),
        "gaps_s": longest_spans(_gaps(angles.time_s)),
        "kept": len(kept),
        "samples": len(angles),
        "time_s": angles.time_s[kept],
        "angles_deg": [angles.angles_deg[kept, k] for k in range(len(angles.names))],
        "std_deg": [angles.std_deg[kept, k] for k in range(len(angles.names))],
        "limits_of_use": LIMITS_OF_USE,
    }


def _spans(time_s: Array, rows: NDArray[np.bool_]) -> Array:
    """(k, 2) first and last time of each unbroken run, s."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(np.int8)))
    return np.stack([time_s[edges[::2]], time_s[edges[1::2] - 1]], axis=1)


def _gaps(time_s: Array) -> Array:
    """(k, 2) times of the samples before and after each gap, s."""
    steps = np.diff(time_s)
    after = np.flatnonzero(steps > GAP_STEPS * np.median(steps)) if len(steps) else np.zeros(0, dtype=np.int64)
    return np.stack([time_s[after], time_s[np.minimum(after + 1, len(time_s) - 1)]], axis=1)
