"""What a report says of a relative orientation, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError
from imufast.imu import GAP_STEPS, Imu
from imufast.report import orientation_words as words
from imufast.report.link import heading_plain, residual_plain
from imufast.track import VAGUE_DEG, RelativeOrientation

__all__ = ["orientation_plain"]

Array = NDArray[np.float64]

AXIS_KNOWN_DEG = 20.0
"""Turns are told about the hinge axis where its bound is below this."""
MOST_MARKS = 200
"""Gaps and starts that are listed, the longest of them."""


def orientation_plain(
    rel: RelativeOrientation, pair: tuple[Imu, Imu] | None, warnings: Sequence[str], most: int | None
) -> dict[str, Any]:
    """All that is told of it but for schema, title and calibration.

    Raises:
        InputError: the recording is not the one that was tracked.
    """
    if pair and not np.array_equal(pair[0].time_s, rel.time_s):
        raise InputError("recording is not the one that was tracked: the times of its samples differ")
    std = rel.angle_std_deg
    sound = len(rel) > 0 and bool(np.isfinite(rel.q_12).all())
    residual = residual_plain(rel, *pair) if pair and sound else None
    spread = None if residual is None else float(residual["robust_std_m_s2"])
    return {
        "status": rel.status,
        "status_name": words.state_name(rel),
        "headline": words.headline(rel),
        "advice": words.advice(rel),
        "certainty": words.certainty(rel),
        "start": words.start(rel),
        "calibration_words": words.calibration(rel.calibration),
        "why": rel.why,
        "method": words.method_name(rel),
        "samples": len(rel),
        "angle_std_median_deg": float(np.median(std)) if len(rel) else None,
        "angle_std_95_deg": float(np.quantile(std, 0.95)) if len(rel) else None,
        "vague_deg": VAGUE_DEG,
        "vague_share": words.vague_share(rel),
        "starting_s": rel.starting_s,
        "restarts": rel.restarts,
        "starts_s": _longest(np.array(rel.starts_s, dtype=np.float64).reshape(-1, 2)),
        "gaps_s": _longest(_gaps(rel, pair)),
        "start_s": float(rel.time_s[0]) if len(rel) else 0.0,
        "stop_s": float(rel.time_s[-1]) if len(rel) else None,
        "curve": _curve(rel, most) if sound else None,
        "residual": residual,
        "heading": heading_plain(rel, pair[0], spread) if pair and sound else None,
        "link_std_m_s2": rel.link_std,
        "drift_std_rad_sqrt_s": rel.drift_std,
        "iterations": rel.iterations,
        "warnings": list(warnings),
        "settings": asdict(rel.method),
        "limits_of_use": words.LIMITS_OF_USE,
    }


def _curve(rel: RelativeOrientation, most: int | None) -> dict[str, Any]:
    """How the joint turned, thinned with extremes kept: about the hinge axis where it is known, else away from the mean."""
    axis = rel.calibration.axis
    known = axis is not None and bool(np.max(axis.bound95_deg) < AXIS_KNOWN_DEG)
    fair = rel.angle_std_deg <= VAGUE_DEG
    fair = fair if fair.any() else np.ones(len(rel), dtype=bool)
    std = rel.angle_std_deg
    band = "whole"
    if axis is not None and known:
        angle = np.degrees(_about(rel.q_12, axis.axis1, axis.axis2))
        angle = angle - angle[fair].mean()
        if rel.covariance is not None:
            variance = np.einsum("i,nij,j->n", axis.axis2, rel.covariance, axis.axis2)
            band, std = "about_axis", np.minimum(np.degrees(np.sqrt(np.maximum(variance, 0.0))), 180.0)
    else:
        mean = np.linalg.eigh(rel.q_12[fair].T @ rel.q_12[fair])[1][:, -1]
        away = np.abs(rel.q_12 @ mean)
        # The sine of half the angle, from what is across: exact also for small angles.
        across = np.linalg.norm(rel.q_12 - (rel.q_12 @ mean)[:, None] * mean, axis=1)
        angle = np.degrees(2.0 * np.arctan2(across, away))
    kept = _kept((angle, rel.angle_std_deg), len(rel), most)
    return {
        "about_axis": known,
        "zero": "mean",
        "band": band,
        "range_deg": float(np.ptp(angle)),
        "kept": len(kept),
        "time_s": rel.time_s[kept],
        "angle_deg": angle[kept],
        "band_std_deg": std[kept],
        "angle_std_deg": rel.angle_std_deg[kept],
    }


def _about(q: Array, axis1: Array, axis2: Array) -> Array:
    """(N,) turn of sensor 2 against sensor 1 about the hinge axis, unwrapped, rad; its rate is axis2·gyr2 − axis1·gyr1."""
    # The shortest turn that takes axis2 to axis1, then what is left about axis2.
    across, along = np.cross(axis2, axis1), float(axis2 @ axis1)
    if along > -1.0 + 1e-9:
        zero = np.array([1.0 + along, *across])
    else:
        side = np.cross(axis2, np.eye(3)[int(np.abs(axis2).argmin())])
        zero = np.array([0.0, *side])
    w, x, y, z = zero / np.linalg.norm(zero)
    # The product zero⁻¹ q.
    left = np.array([[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])
    rest = q @ left.T
    turn: Array = np.unwrap(2.0 * np.arctan2(rest[:, 1:] @ axis2, rest[:, 0]))
    return turn


def _kept(curves: Sequence[Array], count: int, most: int | None) -> NDArray[np.int64]:
    """The samples that are drawn: of equal stretches those with the extremes of each curve, the first and the last."""
    if most is None or count <= most:
        return np.arange(count, dtype=np.int64)
    stretches = max(1, (most - 2) // (2 * len(curves)))
    edges = np.linspace(0, count, stretches + 1).astype(int).tolist()
    keep = {0, count - 1}
    for curve in curves:
        for start, stop in pairwise(edges):
            part = curve[start:stop]
            keep.update((start + int(part.argmin()), start + int(part.argmax())))
    return np.array(sorted(keep), dtype=np.int64)


def _gaps(rel: RelativeOrientation, pair: tuple[Imu, Imu] | None) -> Array:
    """(k, 2) where samples are missing: the times of those before and after, s."""
    steps = np.diff(rel.time_s)
    if not len(steps):
        return np.zeros((0, 2))
    step = 1.0 / pair[0].rate_hz if pair else float(np.median(steps))
    after = np.flatnonzero(steps > GAP_STEPS * step)
    return np.stack([rel.time_s[after], rel.time_s[after + 1]], axis=1)


def _longest(spans: Array) -> dict[str, Any]:
    """How many stretches of time there are, how long in all, and the longest of them in order."""
    order = np.argsort(spans[:, 0] - spans[:, 1], kind="stable")[:MOST_MARKS]
    total = float((spans[:, 1] - spans[:, 0]).sum())
    return {"count": len(spans), "total_s": total, "spans": spans[np.sort(order)]}
