"""Olsson et al. 2020 (Sensors, doi 10.3390/s20123534) as published: Algorithms 1 to 4 in plain numpy, for comparison only.

Equation numbers are the paper's, its slips mended (eq. 25 takes the second accelerometer; where a rate is parallel to its axis,
eq. 37 is zero; a window has 21 samples in all). What the paper leaves open is decided here:

- Steps are taken on the tangent planes of both unit spheres: same cost and minima, no poles. The accelerometers enter through
  their Gram matrix, which is an identity, and many random starts are followed at once.
- V_tol is 1e-9 of the cost; the line search halves the step at most 30 times.
- Algorithm 3 goes on from what it kept a second ago (section 5.3): what was removed never comes back. The leading eigenvector
  of AᵀA is w_1; `prune` downdates AᵀA and `prune_by_svd` decomposes A again for every removal. Where no row's coherence exceeds
  0.5, the largest score goes.
- A sample whose window is not complete yet has an infinite penalty (eq. 45), and no s_ω.
- μ_z and σ_z of eqs 64-65 are those of the norm of a Gaussian in the plane, by quadrature instead of Monte Carlo.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
V_TOL, MAX_ITERATIONS, HALVINGS = 1e-9, 100, 30


@dataclass(frozen=True, eq=False)
class Batch:
    """Rates (N, 3) and accelerations (M, 3) that Algorithm 1 is given."""

    gyr1: Array
    gyr2: Array
    acc1: Array
    acc2: Array
    weight_ratio: float = 50.0


@dataclass(frozen=True, eq=False)
class Estimates:
    """Axes (R, 3), cost (R,) and local uncertainty μ_z + 2σ_z (R, 2), degrees, of R runs of Algorithm 1."""

    axis1: Array
    axis2: Array
    cost: Array
    bound_deg: Array


def plane(axes: Array) -> Array:
    """(R, 3, 2) two unit vectors across each axis: the first columns of the reflection that takes ±z to the axis."""
    mirror = axes.copy()
    mirror[:, 2] += np.where(axes[:, 2] >= 0.0, 1.0, -1.0)
    square = 2.0 * (1.0 + np.abs(axes[:, 2]))
    both = -2.0 / square[:, None, None] * mirror[:, :, None] * mirror[:, None, :2]
    both[:, [0, 1], [0, 1]] += 1.0
    return np.asarray(both)


class Problem:
    """Cost (eq. 23) and its derivatives for many pairs of axes at once; pairs are (R, 6)."""

    def __init__(self, batch: Batch) -> None:
        self.gyr = (np.ascontiguousarray(batch.gyr1), np.ascontiguousarray(batch.gyr2))
        self.energy = [np.einsum("ni,ni->n", gyr, gyr)[:, None] for gyr in self.gyr]
        self.gyr_weight, self.acc_weight = batch.weight_ratio**0.5, batch.weight_ratio**-0.5  # eq. 70
        rows = np.hstack([batch.acc1, -batch.acc2])
        self.gram, self.total, self.n_acc = rows.T @ rows, rows.sum(axis=0), len(rows)

    def lengths(self, pairs: Array) -> tuple[list[Array], list[Array]]:
        """‖y × j‖ and y·j of either sensor, (N, R)."""
        along = [gyr @ pairs[:, 3 * i : 3 * i + 3].T for i, gyr in enumerate(self.gyr)]
        return [np.sqrt(np.maximum(e - a * a, 0.0)) for e, a in zip(self.energy, along, strict=True)], along

    def cost(self, pairs: Array) -> Array:
        """Eq. 23."""
        across, _ = self.lengths(pairs)
        e = across[0] - across[1]
        acc = np.einsum("ri,ij,rj->r", pairs, self.gram, pairs)
        return np.asarray(self.gyr_weight**2 * np.einsum("nr,nr->r", e, e) + self.acc_weight**2 * acc)

    def slopes(self, pairs: Array) -> tuple[Array, Array, Array]:
        """Residuals of eq. 24 (R, N), their derivatives (R, N, 4) in the tangent planes, and the planes (R, 6, 4)."""
        across, along = self.lengths(pairs)
        planes = np.zeros((len(pairs), 6, 4))
        slope = np.empty((len(pairs), len(self.gyr[0]), 4))
        for i, sign in ((0, 1.0), (1, -1.0)):
            t = plane(pairs[:, 3 * i : 3 * i + 3])
            planes[:, 3 * i : 3 * i + 3, 2 * i : 2 * i + 2] = t
            # Eq. 37 within the plane: ((y × j) × y)·t / ‖y × j‖ = -(y·j)(y·t) / ‖y × j‖.
            factor = np.divide(-sign * along[i], across[i], out=np.zeros_like(along[i]), where=across[i] > 0.0)
            slope[:, :, 2 * i : 2 * i + 2] = factor.T[:, :, None] * (self.gyr[i] @ t)
        return self.gyr_weight * (across[0] - across[1]).T, self.gyr_weight * slope, planes

    def step(self, pairs: Array) -> Array:
        """Line 7 of Algorithm 1, in coordinates of the pairs (R, 6)."""
        e, slope, planes = self.slopes(pairs)
        turned = np.swapaxes(slope, 1, 2)
        acc = np.swapaxes(planes, 1, 2) @ self.gram * self.acc_weight**2
        hessian = turned @ slope + acc @ planes
        gradient = turned @ e[:, :, None] + acc @ pairs[:, :, None]
        return np.asarray((planes @ (np.linalg.pinv(hessian, hermitian=True) @ gradient))[:, :, 0])

    def bound_deg(self, pairs: Array) -> Array:
        """Eqs 57-65: μ_z + 2σ_z, (R, 2), degrees."""
        e, slope, planes = self.slopes(pairs)
        gyr_std = np.std(e, axis=1, ddof=1)
        mean = self.acc_weight * (pairs @ self.total) / self.n_acc
        square = self.acc_weight**2 * np.einsum("ri,ij,rj->r", pairs, self.gram, pairs)
        acc_std = np.sqrt(np.maximum(square - self.n_acc * mean**2, 1e-300) / max(self.n_acc - 1, 1))
        gyr = np.swapaxes(slope, 1, 2) @ slope / np.maximum(gyr_std, 1e-150)[:, None, None] ** 2
        acc = np.swapaxes(planes, 1, 2) @ self.gram @ planes * (self.acc_weight / acc_std)[:, None, None] ** 2
        p = np.linalg.pinv(gyr + acc, rcond=1e-15, hermitian=True)
        return np.degrees(np.stack([deviation(p[:, :2, :2]), deviation(p[:, 2:, 2:])], axis=1))


def deviation(p: Array) -> Array:
    """μ + 2σ of the norm of plane Gaussians with covariances (R, 2, 2)."""
    spread = np.maximum(np.linalg.eigvalsh(p), 0.0)
    turn = (np.arange(512) + 0.5) * (np.pi / 512)
    mean = np.sqrt(np.pi / 2) * np.sqrt(spread @ np.stack([np.cos(turn) ** 2, np.sin(turn) ** 2])).mean(axis=1)
    return np.asarray(mean + 2.0 * np.sqrt(np.maximum(spread.sum(axis=1) - mean**2, 0.0)))


def unit(pairs: Array) -> Array:
    """Both axes of each pair, of length one."""
    halves = pairs.reshape(-1, 2, 3)
    return np.asarray((halves / np.linalg.norm(halves, axis=2, keepdims=True)).reshape(-1, 6))


def gauss_newton(problem: Problem, pairs: Array) -> tuple[Array, Array]:
    """Lines 2-14 of Algorithm 1 from many starts (R, 6): where they end, and the cost there."""
    pairs, cost = unit(pairs), problem.cost(unit(pairs))
    going = np.arange(len(pairs))
    for _ in range(MAX_ITERATIONS):
        step, alpha = problem.step(pairs[going]), np.ones(len(going))
        best, found = pairs[going].copy(), cost[going].copy()
        trying = np.arange(len(going))
        for _ in range(HALVINGS):  # backtracking line search
            there = unit(pairs[going[trying]] - alpha[trying, None] * step[trying])
            value = problem.cost(there)
            lower = value < cost[going[trying]]
            best[trying[lower]], found[trying[lower]] = there[lower], value[lower]
            trying = trying[~lower]
            if not len(trying):
                break
            alpha[trying] *= 0.5
        gained = cost[going] - found
        pairs[going], cost[going] = best, found
        going = going[gained > V_TOL * found]
        if not len(going):
            break
    return pairs, cost


def algorithm_1(batch: Batch, starts: Array) -> Estimates:
    """Algorithm 1 from each initial estimate (R, 6): both sign pairings, the better one (eqs 28 and 29)."""
    problem = Problem(batch)
    first, first_cost = gauss_newton(problem, starts)
    second, second_cost = gauss_newton(problem, first * np.repeat([1.0, -1.0], 3))
    better = (second_cost < first_cost)[:, None]
    pairs = np.where(better, second, first)
    return Estimates(pairs[:, :3], pairs[:, 3:], np.minimum(first_cost, second_cost), problem.bound_deg(pairs))


def windowed(values: Array, window: int) -> NDArray[np.float64]:
    """(N - window + 1, window) all whole windows."""
    return np.lib.stride_tricks.sliding_window_view(values, window)


def scores(gyr1: Array, gyr2: Array, window: int) -> tuple[Array, Array]:
    """s_ω (eqs 42-44) and s_a (eqs 45-46) of every sample; NaN and infinite where the window is not complete."""
    half, n = window // 2, len(gyr1)
    gyr_score, acc_score = np.full(n, np.nan), np.full(n, np.inf)
    difference = windowed(np.linalg.norm(gyr1, axis=1) - np.linalg.norm(gyr2, axis=1), window)
    smallest = np.abs(difference).argmin(axis=1)
    gyr_score[half : n - half] = np.take_along_axis(difference, smallest[:, None], axis=1)[:, 0]
    energies = [windowed(np.einsum("ni,ni->n", gyr, gyr), window).mean(axis=1) for gyr in (gyr1, gyr2)]
    acc_score[half : n - half] = np.minimum(*energies)
    return gyr_score, acc_score


def algorithm_2(score: Array, max_samples: int) -> Index:
    """Gyroscope samples to keep, of those with a score: the `max_samples` / 2 highest and lowest."""
    known = np.flatnonzero(np.isfinite(score))
    if len(known) <= max_samples:
        return known
    order = known[np.argsort(score[known], kind="stable")]
    return np.sort(np.concatenate([order[: max_samples // 2], order[-(max_samples - max_samples // 2) :]]))


def worst_row(rows: Array, lengths: Array, score: Array, leading: Array) -> int:
    """Line 8 of Algorithm 3: the largest score among rows with coherence above 0.5 (eq. 52)."""
    coherent = np.abs(rows @ leading) > 0.5 * lengths
    return int(np.where(coherent, score, -1.0).argmax()) if coherent.any() else int(score.argmax())


def prune(rows: Array, score: Array, max_samples: int) -> Index:
    """Lines 5-10 of Algorithm 3 with rank-one downdates: indices of the rows that stay."""
    kept, lengths = np.arange(len(rows)), np.linalg.norm(rows, axis=1)
    gram = rows.T @ rows
    while len(kept) > max_samples:
        out = worst_row(rows, lengths, score, np.linalg.eigh(gram)[1][:, -1])
        gram = gram - np.outer(rows[out], rows[out])
        stay = np.arange(len(kept)) != out
        kept, rows, lengths, score = kept[stay], rows[stay], lengths[stay], score[stay]
    return kept


def prune_by_svd(rows: Array, score: Array, max_samples: int) -> Index:
    """Lines 5-10 of Algorithm 3 letter by letter: one singular value decomposition a removal."""
    kept = np.arange(len(rows))
    while len(kept) > max_samples:
        leading = np.linalg.svd(rows, full_matrices=False)[2][0]
        out = worst_row(rows, np.linalg.norm(rows, axis=1), score, leading)
        kept, rows, score = np.delete(kept, out), np.delete(rows, out, axis=0), np.delete(score, out)
    return kept


class Selection:
    """Algorithms 2 and 3 second by second over one recording."""

    def __init__(
        self, gyr1: Array, acc1: Array, gyr2: Array, acc2: Array, max_samples: int, window: int, energy_threshold: float
    ) -> None:
        self.arrays = gyr1, acc1, gyr2, acc2
        self.max_samples, self.half, self.threshold = max_samples, window // 2, energy_threshold
        self.gyr_score, self.acc_score = scores(gyr1, gyr2, window)
        self.rows = np.hstack([acc1, -acc2])
        self.gyr_kept = self.acc_kept = np.zeros(0, np.int64)
        self.scored = 0

    def batch(self, n: int, weight_ratio: float) -> Batch:
        """What is chosen from the first `n` samples; `n` must grow from call to call."""
        gyr1, acc1, gyr2, acc2 = self.arrays
        done = max(n - self.half, 0)
        new = np.arange(self.scored, done)
        self.scored = done
        self.gyr_kept, self.acc_kept = np.concatenate([self.gyr_kept, new]), np.concatenate([self.acc_kept, new])
        if n <= self.max_samples:
            return Batch(gyr1[:n], gyr2[:n], acc1[:n], acc2[:n], weight_ratio)
        self.gyr_kept = self.gyr_kept[algorithm_2(self.gyr_score[self.gyr_kept], self.max_samples)]
        quiet = self.acc_kept[self.acc_score[self.acc_kept] <= self.threshold]
        self.acc_kept = quiet[prune(self.rows[quiet], self.acc_score[quiet], self.max_samples)]
        g, a = self.gyr_kept, self.acc_kept
        return Batch(gyr1[g], gyr2[g], acc1[a], acc2[a], weight_ratio)


def apart_deg(a: Array, b: Array) -> Array:
    """Eq. 59, (R,), degrees, exact also for small angles."""
    return np.asarray(np.degrees(2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))))


class Algorithm4:
    """Algorithm 4 for R repetitions at once, which differ in their random initial estimates only."""

    def __init__(self, repeats: int, max_error_deg: float, n_min: int) -> None:
        self.limit, self.n_min = max_error_deg, n_min
        self.before: tuple[Array, Array] | None = None
        self.run = np.zeros(repeats, int)

    def step(self, estimates: Estimates) -> NDArray[np.bool_]:
        """Take one estimate a repetition; returns (R,) which of them are acceptable now."""
        axis1, axis2 = estimates.axis1, estimates.axis2
        change = np.full(len(axis1), 180.0)  # eq. 67
        if self.before is not None:
            plus = [apart_deg(a, b) for a, b in zip((axis1, axis2), self.before, strict=True)]
            # Eq. 66: the sign with which either axis is nearest to what it was.
            turn = np.maximum(*plus) > 180.0 - np.minimum(*plus)
            axis1, axis2 = (np.where(turn[:, None], -axis, axis) for axis in (axis1, axis2))
            change = np.where(turn, 180.0 - np.minimum(*plus), np.maximum(*plus))
        self.before = axis1, axis2
        self.run = np.where(change < self.limit, self.run + 1, 0)
        return np.asarray((estimates.bound_deg.max(axis=1) < self.limit) & (self.run >= self.n_min))
