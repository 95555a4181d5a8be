"""Algorithms 2 and 3 of Olsson et al. 2020 (Sensors, doi 10.3390/s20123534), literally: whole windows, whole sorts, one SVD a
removed row.

Equation numbers are the paper's. Its window of n = 21 samples is taken in all, and what it leaves open is settled here: a
window reaches across no break, the lowest index wins a tie, and where no row's coherence exceeds 0.5 the worst score goes.
Slow on purpose: nothing here shares a line or an idea with the code under test.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def middles(time_s: Array, rate_hz: float, length: int) -> list[int]:
    """Samples whose window of `length` is whole: inside the recording and without a step of more than 2.5 nominal ones."""
    half = length // 2
    whole = []
    for k in range(half, len(time_s) - half):
        window = time_s[k - half : k + half + 1]
        if all((after - before) * rate_hz <= 2.5 for before, after in pairwise(window)):
            whole.append(k)
    return whole


def gyr_scores(gyr1: Array, gyr2: Array, candidates: list[int], length: int) -> Array:
    """Eqs 42-44 of all samples (N,); 0 where the window is not whole."""
    half = length // 2
    difference = np.linalg.norm(gyr1, axis=1) - np.linalg.norm(gyr2, axis=1)
    scores = np.zeros(len(gyr1))
    for k in candidates:
        window = difference[k - half : k + half + 1]
        scores[k] = window[np.argmin(np.abs(window))]
    return scores


def acc_scores(gyr1: Array, gyr2: Array, candidates: list[int], length: int) -> Array:
    """Eqs 45-46 of all samples (N,); infinite where the window is not whole."""
    half = length // 2
    scores = np.full(len(gyr1), np.inf)
    for k in candidates:
        window = slice(k - half, k + half + 1)
        scores[k] = min(float(np.mean(np.sum(gyr[window] ** 2, axis=1))) for gyr in (gyr1, gyr2))
    return scores


def algorithm_2(scores: Array, candidates: list[int], max_samples: int) -> Index:
    """Ascending indices of the candidates kept: the ends of the sorted list; the upper end has the odd one."""
    chosen = np.array(candidates, np.int64)
    if len(chosen) > max_samples:
        ranked = chosen[np.argsort(scores[chosen], kind="stable")]
        low = max_samples // 2
        chosen = np.concatenate([ranked[:low], ranked[len(ranked) - (max_samples - low) :]])
    return np.sort(chosen)


def coherence(rows: Array) -> Array:
    """Eq. 52 for every row of A (eq. 27)."""
    leading = np.linalg.svd(rows, full_matrices=False)[2][0]
    return np.asarray(np.abs(rows @ leading) / np.linalg.norm(rows, axis=1))


def algorithm_3(
    acc1: Array, acc2: Array, scores: Array, candidates: list[int], max_samples: int, energy_threshold: float
) -> Index:
    """Ascending indices of the candidates kept, lines 3 to 10."""
    chosen = np.array([k for k in candidates if scores[k] <= energy_threshold], np.int64)
    while len(chosen) > max_samples:
        alike = coherence(np.hstack([acc1[chosen], -acc2[chosen]])) > 0.5
        if not alike.any():
            alike[:] = True
        worst = np.argmax(np.where(alike, scores[chosen], -np.inf))
        chosen = np.delete(chosen, worst)
    return chosen
