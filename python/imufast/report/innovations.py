"""Whether a tracker errs as much as it says: its innovations, squared and normalised, against what they should be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.errors import InputError
from imufast.filters import plan
from imufast.imu import Imu
from imufast.smoother import Smoother

if TYPE_CHECKING:
    from imufast.track import RelativeOrientation

__all__ = ["innovations_plain", "limit_of_links", "normalised_squares"]

Array = NDArray[np.float64]

NOMINAL = 3.0
"""Mean of a normalised innovation squared with three channels."""
LIMIT95 = 7.814727903251179
"""Quantile of χ² with three degrees of freedom."""
BINS = 240
LEAST_S, LEAST_COUNT = 1.0, 8
"""Means are taken over at least so long, s, and over so many."""
CALM, WILD = 0.5, 1.5
"""Between these times the nominal mean the stated noise fits..."""
FEW, MANY = 0.01, 0.10
"""...and between these shares beyond the limit of 95 % its shape."""


def innovations_plain(rel: RelativeOrientation, pair: tuple[Imu, Imu] | None) -> dict[str, Any] | None:
    """Normalised innovations squared of a run: their mean, nominally 3; the share beyond the limit of 95 %, nominally 5 %;
    both over time; how much neighbours are alike, nominally not at all. None where there are fewer than `LEAST_COUNT`.

    Of a filter `eᵀ S⁻¹ e` of its innovations (`normalised_squares`), for which it runs once more over the recording. The
    smoother has no innovations; its residuals of the link stand for them. Their squares `u` over their scale are 3 F(3, ν)
    distributed; their mean is that of `(ν + 3) u/(ν + u)`, the weight that the smoother gives them, which is 3 for every ν.

    Args:
        rel: the orientations.
        pair: the two sensors; a filter needs them.
    """
    if isinstance(rel.method, Smoother):
        if rel.link_squares is None or rel.link_time_s is None:
            return None
        time, squares, tail = rel.link_time_s, rel.link_squares, rel.method.tail
        weighed, limit, alike = (tail + 3.0) * squares / (tail + squares), limit_of_links(tail), None
    else:
        if pair is None or rel.calibration.center is None:
            return None
        innovation, squares = normalised_squares(rel, *pair)
        time, weighed, limit = rel.time_s, squares, LIMIT95
        alike = _alike(innovation, squares)
    good = np.isfinite(squares)
    if good.sum() < LEAST_COUNT:
        return None
    time, squares, weighed = time[good], squares[good], weighed[good]
    start, stop = float(time[0]), float(time[-1])
    bins = max(1, min(BINS, len(time) // LEAST_COUNT, int((stop - start) / LEAST_S)))
    width = max((stop - start) / bins, 1e-9)
    at = np.clip(((time - start) / width).astype(np.int64), 0, bins - 1)
    counts = np.bincount(at, minlength=bins)
    some = counts >= LEAST_COUNT // 2
    mean = np.where(some, np.bincount(at, weighed, minlength=bins) / np.maximum(counts, 1), np.nan)
    beyond = np.where(some, np.bincount(at, squares > limit, minlength=bins) / np.maximum(counts, 1), np.nan)
    worst = int(np.nanargmax(mean)) if some.any() else None
    return {
        "kind": "residual" if isinstance(rel.method, Smoother) else "innovation",
        "count": len(squares),
        "nominal": NOMINAL,
        "mean": float(weighed.mean()),
        "limit95": limit,
        "beyond_limit95": float((squares > limit).mean()),
        "alike": alike,
        "trust": rel.link_trust,
        "over_s": width,
        "time_s": start + width * (np.arange(bins) + 0.5),
        "mean_over_time": mean,
        "beyond_over_time": beyond,
        "worst_mean": None if worst is None else float(mean[worst]),
        "worst_at_s": None if worst is None else start + width * (worst + 0.5),
        "words": _words(float(weighed.mean()), float((squares > limit).mean())),
    }


def normalised_squares(rel: RelativeOrientation, imu1: Imu, imu2: Imu) -> tuple[Array, Array]:
    """Innovations of a filter (N, 3), m/s² in the frame of sensor 2, and their normalised squares (N,): `eᵀ S⁻¹ e` with
    `e = R̂ᵀ a1 − a2`, `S = H P Hᵀ + σ² I`, `H = −[a2×]`. NaN where none was used: in starts, after gaps, where packets were
    lost.

    Raises:
        InputError: of the smoother, which has none.
    """
    if isinstance(rel.method, Smoother):
        raise InputError("rel is of the smoother, which has no innovations; give what a filter tracked")
    start, std_deg = None, 2.0
    if not rel.starts_s and len(rel) and 0.0 < float(rel.angle_std_deg[0]) <= 180.0:
        start, std_deg = rel.q_12[0], float(rel.angle_std_deg[0])  # it was given
    asked = plan(rel.method, rel.calibration, imu1.rate_hz, start, std_deg)
    innovation, squares = _core.filter_innovations(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, imu1.time_s, asked)
    return innovation, squares


def limit_of_links(tail: float) -> float:
    """The quantile of 95 % of 3 F(3, tail), the squares of residuals with three channels in Student's t."""
    # With u = t² the density is t² (1 + t²/ν)^−(ν+3)/2; on a logarithmic scale once more times t.
    t = np.exp(np.linspace(math.log(1e-4), math.log(1e9), 20001))
    density = np.exp(3.0 * np.log(t) - 0.5 * (tail + 3.0) * np.log1p(t * t / tail))
    shares = np.cumsum(density) - 0.5 * density
    return float(np.interp(0.95 * float(density.sum()), shares, t * t))


def _alike(innovation: Array, squares: Array) -> float | None:
    """Correlation of neighbouring innovations, large ones cut to the limit of 95 %."""
    cut = innovation * np.sqrt(np.minimum(1.0, LIMIT95 / np.maximum(squares, 1e-12)))[:, None]
    both = np.isfinite(squares[1:]) & np.isfinite(squares[:-1])
    before, after = cut[:-1][both], cut[1:][both]
    power = math.sqrt(float((before**2).sum()) * float((after**2).sum()))
    return float((before * after).sum()) / power if power > 0.0 else None


def _words(mean: float, beyond: float) -> str:
    """What the two numbers mean."""
    if mean > WILD * NOMINAL:
        return (
            "The sensors contradict each other by more than is counted on: soft tissue, impacts or a calibration that does not "
            "fit; take the standard deviation with care."
        )
    if mean < CALM * NOMINAL:
        return "The sensors agree better than is counted on: the standard deviation is careful."
    if beyond > MANY:
        return (
            "On the whole as large as is counted on, but with many outliers: impacts, soft tissue, or stretches in which the "
            "calibration does not fit."
        )
    if beyond < FEW:
        return "As large as is counted on, with fewer outliers than chance would have."
    return "As large and as often large as is counted on: what is stated of the errors fits the recording."
