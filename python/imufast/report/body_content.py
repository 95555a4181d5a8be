"""What a report says of a lower body, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import SIDES
from imufast.body.result import UNSEEN_DEG, LowerBody
from imufast.body.skeleton import skeleton
from imufast.imu import GAP_STEPS
from imufast.report import body_words as words
from imufast.report.thin import kept_samples, longest_spans

__all__ = ["body_plain", "liveliest"]

Array = NDArray[np.float64]

CLOSE_S = 8.0
"""So much of the recording is shown from near, s."""
FIGURES, FIGURE_STEP_S = 6, 0.2
"""Stick figures, and the time from one to the next, s."""


def body_plain(body: LowerBody, warnings: Sequence[str], most: int | None) -> dict[str, Any]:
    """All that is told of it but for schema and title; curves thinned to about `most` moments, extremes kept."""
    time = body.time_s
    start = float(time[0])
    lively = liveliest(body, CLOSE_S)
    close = _close(time, lively)
    return {
        "status": body.status,
        "status_name": words.status_name(body),
        "headline": words.headline(body),
        "advice": words.advice(body),
        "certainty": words.certainty(body),
        "why": body.why,
        "placement": body.placement,
        "moments": len(time),
        "step_s": float(np.median(np.diff(time))) if len(time) > 1 else None,
        "start_s": start,
        "stop_s": float(time[-1]),
        "gaps_s": longest_spans(_gaps(time)),
        "angles": _angles(body, most),
        "pelvis": _pelvis(body, most),
        "close_s": [float(time[close][0]), float(time[close][-1])],
        "close": {"time_s": time[close], **_close_angles(body, close)},
        "figures": _figures(body, lively),
        "joints": {name: _joint(body, name, most) for name in body.joints},
        "lengths": _lengths(body),
        "knee_axis": body.knee_axis,
        "residuals": body.residuals,
        "residual_names": words.RESIDUALS,
        "contradicted": words.CONTRADICTED,
        "unseen_deg": UNSEEN_DEG,
        "residual_words": words.residual_words(body),
        "cost": body.cost,
        "iterations": body.iterations,
        "history": {
            "cost": body.history[:, 0],
            "tried": body.history[:, 1],
            "promised": body.history[:, 2],
            "damping": body.history[:, 3],
            "taken": [bool(taken) for taken in body.history[:, 4]],
        },
        "warnings": list(warnings),
        "settings": asdict(body.settings),
        "anthropometry": asdict(body.anthropometry),
        "limits_of_use": words.LIMITS_OF_USE,
    }


def _joints_with_angles(body: LowerBody) -> list[tuple[str, str]]:
    """(kind, side) of all that have angles."""
    return [(kind, side) for kind in words.ANGLES for side in SIDES if side in getattr(body, f"{kind}_angles_deg")]


def _angles(body: LowerBody, most: int | None) -> list[dict[str, Any]]:
    found = []
    for kind, side in _joints_with_angles(body):
        angles, std = getattr(body, f"{kind}_angles_deg")[side], getattr(body, f"{kind}_std_deg")[side]
        kept = kept_samples((*angles.T, *_finite(std).T), len(angles), most)
        found.append(
            {
                "joint": f"{kind}_{side}",
                "kind": kind,
                "side": side,
                "titles": words.ANGLES[kind],
                "lowest_deg": angles.min(axis=0),
                "highest_deg": angles.max(axis=0),
                "std_median_deg": np.median(std, axis=0),
                "time_s": body.time_s[kept],
                "angles_deg": [angles[kept, k] for k in range(3)],
                "std_deg": [std[kept, k] for k in range(3)],
            }
        )
    return found


def _pelvis(body: LowerBody, most: int | None) -> dict[str, Any] | None:
    angles, std = body.pelvis_angles_deg, body.pelvis_std_deg
    if not angles.shape[1]:
        return None
    kept = kept_samples((*angles.T, *_finite(std).T), len(angles), most)
    return {
        "titles": ("Tilt, front up", "List, right side down"),
        "lowest_deg": angles.min(axis=0),
        "highest_deg": angles.max(axis=0),
        "std_median_deg": np.median(std, axis=0),
        "time_s": body.time_s[kept],
        "angles_deg": [angles[kept, k] for k in range(2)],
        "std_deg": [std[kept, k] for k in range(2)],
    }


def _finite(std: Array) -> Array:
    return np.where(np.isfinite(std), std, 180.0)


def liveliest(body: LowerBody, over_s: float) -> int:
    """The moment about which knees (else whatever there is) move most, over so long."""
    with_angles = _joints_with_angles(body)
    knees = [pair for pair in with_angles if pair[0] == "knee"]
    every = [getattr(body, f"{kind}_angles_deg")[side][:, 0] for kind, side in knees or with_angles]
    if not every or len(body.time_s) < 3:
        return 0
    speed = np.abs(np.diff(np.stack(every), axis=1)).sum(axis=0)
    total = np.concatenate([[0.0], np.cumsum(speed)])
    first = np.searchsorted(body.time_s, body.time_s - 0.5 * over_s)
    last = np.minimum(np.searchsorted(body.time_s, body.time_s + 0.5 * over_s), len(total) - 1)
    # Not of a jump across a gap.
    return int(np.argmax((total[last] - total[first]) * ((last - first) > 0.5 * (last - first).max())))


def _close(time: Array, middle: int) -> slice:
    start = min(max(time[middle] - 0.5 * CLOSE_S, time[0]), max(time[-1] - CLOSE_S, time[0]))
    return slice(int(np.searchsorted(time, start)), int(np.searchsorted(time, start + CLOSE_S, side="right")))


def _close_angles(body: LowerBody, rows: slice) -> dict[str, Any]:
    return {
        "angles": [
            {
                "kind": kind,
                "side": side,
                "angles_deg": [getattr(body, f"{kind}_angles_deg")[side][rows, k] for k in range(3)],
                "std_deg": [getattr(body, f"{kind}_std_deg")[side][rows, k] for k in range(3)],
            }
            for kind, side in _joints_with_angles(body)
        ],
    }


def _figures(body: LowerBody, middle: int) -> dict[str, Any]:
    """Stick figures at moments a fifth of a second apart, from the one in which a knee bends most."""
    time = body.time_s
    rows = _close(time, middle)
    bends = [angles[rows, 0] for angles in body.knee_angles_deg.values()]
    peak = rows.start + int(np.max(bends, axis=0).argmax()) if bends else middle
    wanted = time[peak] + FIGURE_STEP_S * (np.arange(FIGURES) - FIGURES // 2)
    wanted += max(float(time[0] - wanted[0]), 0.0) - max(float(wanted[-1] - time[-1]), 0.0)
    kept = np.unique([int(np.abs(time - moment).argmin()) for moment in wanted])
    drawn = skeleton(body)
    return {
        "time_s": time[kept],
        "points_m": {name: place[kept] for name, place in drawn.points.items()},
        "bones": {name: list(ends) for name, ends in drawn.bones.items()},
        "assumed": sorted(drawn.assumed),
    }


def _joint(body: LowerBody, name: str, most: int | None) -> dict[str, Any]:
    joint = body.joints[name]
    heading = joint.heading_std_deg
    kept = kept_samples((_finite(heading),), len(heading), most)
    return {
        "name": words.name_words(name),
        "determined": joint.determined,
        "words": words.joint_words(joint),
        "why": joint.why,
        "heading_std_median_deg": float(np.median(heading)),
        "heading_drift_deg": joint.heading_drift_deg,
        "in_sensors_m": joint.in_sensors,
        "in_sensors_std_m": joint.in_sensors_std,
        "time_s": body.time_s[kept],
        "heading_std_deg": heading[kept],
    }


def _lengths(body: LowerBody) -> list[dict[str, Any]]:
    found = []
    for name, (length, std) in body.lengths_m.items():
        mean, spread = getattr(body.anthropometry, f"{name.partition('_')[0]}_m")
        found.append(
            {
                "name": "between the hips" if name == "hips" else words.name_words(name),
                "length_m": length,
                "std_m": std,
                "expected_m": mean,
                "expected_std_m": spread,
                "off": (length - mean) / spread,
            }
        )
    return found


def _gaps(time_s: Array) -> Array:
    """(k, 2) times of the moments before and after each gap, s."""
    steps = np.diff(time_s)
    after = np.flatnonzero(steps > GAP_STEPS * np.median(steps)) if len(steps) else np.zeros(0, dtype=np.int64)
    return np.stack([time_s[after], time_s[np.minimum(after + 1, len(time_s) - 1)]], axis=1)
