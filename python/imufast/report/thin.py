"""Long histories and curves made short: what a figure of a thousand points can show, extremes kept."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.decide import HingeStep
from imufast.pairs import PairSignals

__all__ = ["excitation", "kept_samples", "longest_spans", "spread_out", "thin_steps"]

Array = NDArray[np.float64]

BINS = 900
"""Intervals of the curve of the relative rate."""
MOST_MARKS = 200
"""Gaps and the like that are listed, the longest of them."""


def thin_steps(steps: Sequence[HingeStep], most: int | None) -> list[HingeStep]:
    """At most `most` steps: of equal stretches of the history those with the extremes of each curve; where verdict or
    acceptance turn; the first and the last. All of them if they are few enough or `most` is None."""
    count = len(steps)
    if most is None or count <= most:
        return list(steps)
    states = [(step.verdict, step.accepted) for step in steps]
    turns = [i for i in range(1, count) if states[i] != states[i - 1]]
    keep = {0, count - 1, *spread_out(turns, most // 8), *spread_out([i - 1 for i in turns], most // 8)}
    curves = [
        np.array([np.nan if step.bound95_deg is None else step.bound95_deg.max() for step in steps]),
        np.array([np.nan if step.change_deg is None else step.change_deg for step in steps]),
        np.array([np.nan if step.misfit is None else step.misfit for step in steps]),
    ]
    stretches = max(1, (most - len(keep)) // (2 * len(curves)))
    edges = np.linspace(0, count, stretches + 1).astype(int)
    for curve in curves:
        low, high = np.where(np.isfinite(curve), curve, np.inf), np.where(np.isfinite(curve), curve, -np.inf)
        for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            keep.update((start + int(low[start:stop].argmin()), start + int(high[start:stop].argmax())))
    return [steps[i] for i in sorted(keep)]


def spread_out(values: Sequence[int], most: int) -> list[int]:
    """At most `most` of the values, evenly spread over them."""
    if len(values) <= most:
        return list(values)
    return [values[i] for i in np.linspace(0, len(values) - 1, max(most, 0)).astype(int).tolist()]


def kept_samples(curves: Sequence[Array], count: int, most: int | None) -> NDArray[np.int64]:
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


def longest_spans(spans: Array) -> dict[str, Any]:
    """How many stretches of time there are, how long in all, and the longest of them in order; (k, 2) in, s."""
    order = np.argsort(spans[:, 0] - spans[:, 1], kind="stable")[:MOST_MARKS]
    total = float((spans[:, 1] - spans[:, 0]).sum())
    return {"count": len(spans), "total_s": total, "spans": spans[np.sort(order)]}


def excitation(pair: PairSignals, axis1: Array | None, axis2: Array | None) -> dict[str, list[float | None]]:
    """How the joint turned, in equal intervals of time: their middles, s, and the rms and the largest rate there, rad/s.

    The rate of the joint angle about the axes; without axes the larger of the two sensors' angular rates. None where there
    are no samples.
    """
    if axis1 is None or axis2 is None:
        rate = np.maximum(np.linalg.norm(pair.gyr1, axis=1), np.linalg.norm(pair.gyr2, axis=1))
    else:
        rate = np.abs(pair.relative_rate(axis1, axis2))
    start, stop = float(pair.time_s[0]), float(pair.time_s[-1])
    bins = max(1, min(BINS, len(rate) // 4, int((stop - start) * pair.rate_hz / 4.0)))
    width = (stop - start) / bins
    at = np.clip(((pair.time_s - start) / width).astype(np.int64), 0, bins - 1)
    counts = np.bincount(at, minlength=bins)
    squares = np.bincount(at, rate**2, minlength=bins)
    peaks = np.zeros(bins)
    np.maximum.at(peaks, at, rate)
    some = counts > 0
    rms = np.sqrt(squares / np.maximum(counts, 1))
    return {
        "time_s": (start + width * (np.arange(bins) + 0.5)).tolist(),
        "rms_rad_s": [value if there else None for value, there in zip(rms.tolist(), some.tolist(), strict=True)],
        "peak_rad_s": [value if there else None for value, there in zip(peaks.tolist(), some.tolist(), strict=True)],
    }
