"""What a report says of a relative orientation, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.angles import quadratic
from imufast.errors import InputError
from imufast.hinge_angle import hinge_turn
from imufast.imu import GAP_STEPS, Imu
from imufast.report import orientation_words as words
from imufast.report.innovations import innovations_plain
from imufast.report.link import heading_plain, residual_plain
from imufast.report.thin import kept_samples, longest_spans
from imufast.track import VAGUE_DEG, RelativeOrientation

__all__ = ["orientation_plain"]

Array = NDArray[np.float64]

AXIS_KNOWN_DEG = 20.0
"""Turns are told about the hinge axis where its bound is below this."""


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
        "starts_s": longest_spans(np.array(rel.starts_s, dtype=np.float64).reshape(-1, 2)),
        "gaps_s": longest_spans(_gaps(rel, pair)),
        "start_s": float(rel.time_s[0]) if len(rel) else 0.0,
        "stop_s": float(rel.time_s[-1]) if len(rel) else None,
        "curve": _curve(rel, most) if sound else None,
        "residual": residual,
        "innovations": innovations_plain(rel, pair) if sound else None,
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
        turn, gradient, _ = hinge_turn(rel.q_12, axis.axis1, axis.axis2)
        angle = np.degrees(turn - turn[fair].mean())
        if rel.covariance is not None:
            variance = quadratic(gradient[:, None], rel.covariance)[:, 0]
            band, std = "about_axis", np.minimum(np.degrees(np.sqrt(variance)), 180.0)
    else:
        mean = np.linalg.eigh(rel.q_12[fair].T @ rel.q_12[fair])[1][:, -1]
        away = np.abs(rel.q_12 @ mean)
        # The sine of half the angle, from what is across: exact also for small angles.
        across = np.linalg.norm(rel.q_12 - (rel.q_12 @ mean)[:, None] * mean, axis=1)
        angle = np.degrees(2.0 * np.arctan2(across, away))
    kept = kept_samples((angle, rel.angle_std_deg), len(rel), most)
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


def _gaps(rel: RelativeOrientation, pair: tuple[Imu, Imu] | None) -> Array:
    """(k, 2) where samples are missing: the times of those before and after, s."""
    steps = np.diff(rel.time_s)
    if not len(steps):
        return np.zeros((0, 2))
    step = 1.0 / pair[0].rate_hz if pair else float(np.median(steps))
    after = np.flatnonzero(steps > GAP_STEPS * step)
    return np.stack([rel.time_s[after], rel.time_s[after + 1]], axis=1)
