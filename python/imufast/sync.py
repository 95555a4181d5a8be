"""The time offset between the two sensors of a joint, from the motion itself.

A hinge lets both segments turn at will, but at every instant the rates perpendicular to the axis are equally large in both
sensors (eq. 14 of Olsson et al. 2020). Shift one sensor in time and they no longer are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imufast.axis import HingeAxis, fit_axis
from imufast.errors import InputError
from imufast.imu import GAP_STEPS, Imu, Recording
from imufast.pairs import PairSignals, pair_signals
from imufast.settings import AxisSettings

__all__ = ["TimeOffset", "time_offset"]

Array = NDArray[np.float64]

LOWPASS_HZ = 5.0
"""Cut-off of the low-pass, Hz: above it straps and noise move, not limbs."""
STRETCH_S, MOST_S = 6.0, 60.0
"""The most active stretches of this length are used, s, up to this much in all."""
PIECE_S = 2.0
"""Residuals of one piece share their causes; the spread between pieces gives the standard deviation."""
FEWEST_PIECES = 5
LEAST_AGREEMENT = 0.3
"""Noise alone reaches an agreement of about 0.15 over a minute."""
COARSE_HZ = 50.0
"""Signals without anything above the low-pass are looked at this often, and the offset is searched in such steps."""
SETTINGS = AxisSettings(weight_ratio=1000.0)
# Gravity only decides where rates do not: at the published weight 50 accelerations of walking pull the offset by 1.7 ms.


@dataclass(frozen=True)
class TimeOffset:
    """How much later than its time stamps say sensor 2 samples, seen from sensor 1.

    Attributes:
        offset_s: positive: sensor 2's samples are taken late, their stamps are too early; add it to the stamps of sensor 2.
            It is `clock_offset_s` of `simulate_hinge`. None: the recording is too short or too broken to look.
        std_s: standard deviation of `offset_s`, s: from the differences between pieces of the recording, and from how much of
            an offset the misfit of the joint to a hinge could feign (soft tissue feigns 10 to 60 ms at knees and ankles).
        samples: `offset_s` in sampling steps.
        agreement: share of the perpendicular rates' variance that both sensors have in common at this offset; about 0 where
            only noise is there to compare, above 0.99 for a mechanical hinge.
        searched_s: offsets from minus to plus this were compared, s.
        determined: the motion tells the offset: a lone minimum within the range, known to half a sample or to a quarter of
            itself. Motion in one plane or at rest does not; a joint far from a hinge hardly does.
    """

    offset_s: float | None
    std_s: float | None
    samples: float | None
    agreement: float
    searched_s: float
    determined: bool
    rate_hz: float

    @property
    def significant(self) -> bool:
        """Whether the sensors are more than half a sample apart, beyond two standard deviations of doubt."""
        if not self.determined or self.offset_s is None or self.std_s is None:
            return False
        return abs(self.offset_s) - 2.0 * self.std_s > 0.5 / self.rate_hz


def time_offset(imu1: Imu, imu2: Imu, max_offset_s: float = 0.5) -> TimeOffset:
    """Estimate the time offset between the two sensors of a joint that is roughly a hinge.

    The hinge axis is estimated anew for offsets in steps of about 20 ms; from the best of them, Gauss-Newton on axis and
    offset together. Uses up to a minute of the most active data, low-passed at 5 Hz.

    Args:
        imu1, imu2: the sensors on the two segments, same time base.
        max_offset_s: largest offset looked for, s; default 0.5. Large values need longer unbroken stretches.

    Raises:
        InputError: not two Imus of one time base, the same data twice, or a range that is not positive.
    """
    if isinstance(max_offset_s, bool) or not isinstance(max_offset_s, (int, float)) or not 0.0 < max_offset_s <= 10.0:
        raise InputError(f"max_offset_s must be more than 0 and at most 10 s, got {max_offset_s!r}")
    whole = pair_signals(imu1, imu2)
    rate = whole.rate_hz
    window = _window(imu1, imu2, whole, float(max_offset_s))
    if window is None:
        return TimeOffset(None, None, None, 0.0, 0.0, False, rate)
    axes, offset, lone = window.coarse()
    offset, std, agreement = window.refined(axes, offset)
    if not np.isfinite(std):
        return TimeOffset(None, None, None, agreement, window.searched_s, False, rate)
    known = std < max(0.5 / rate, 0.25 * abs(offset))
    determined = lone and known and agreement > LEAST_AGREEMENT and abs(offset) < window.searched_s
    return TimeOffset(offset, std, offset * rate, agreement, window.searched_s, bool(determined), rate)


def _window(imu1: Imu, imu2: Imu, whole: PairSignals, max_offset_s: float) -> _Window | None:
    """The most active data, low-passed; searched as far as the unbroken stretches allow."""
    rate = whole.rate_hz
    rows = _most_active(whole)
    cut = Recording(
        {
            name: imu._replace(gyr=imu.gyr[rows], acc=imu.acc[rows], time_s=whole.time_s[rows], rate_hz=rate)
            for name, imu in (("1", imu1), ("2", imu2))
        }
    )
    try:
        signals = pair_signals(cut["1"], cut["2"], min(LOWPASS_HZ, rate / 8.0))
    except InputError:
        return None
    stride = max(1, round(rate / COARSE_HZ))
    for share in (1.0, 0.5, 0.25, 0.125):
        reach = int(np.ceil(share * max_offset_s * rate / stride)) * stride
        usable = _with_neighbours(signals.time_s, rate, reach + _TAPS)[::stride]
        window = _Window(signals, usable, reach, stride)
        if window.pieces >= FEWEST_PIECES and (share == 0.125 or len(usable) * stride > 10.0 * rate):
            return window
    return None


def _most_active(signals: PairSignals) -> NDArray[np.int64]:
    """Rows of the stretches in which both sensors turn the most."""
    stretch = np.floor((signals.time_s - signals.time_s[0]) / STRETCH_S).astype(np.int64)
    names, member, counts = np.unique(stretch, return_inverse=True, return_counts=True)
    member = member.reshape(-1)
    turning = [np.bincount(member, np.linalg.norm(gyr, axis=1)) / counts for gyr in (signals.gyr1, signals.gyr2)]
    # A stretch with many lost samples counts for what it holds.
    worth = np.minimum(*turning) * counts
    best = np.argsort(-worth, kind="stable")[: int(MOST_S / STRETCH_S)]
    chosen = np.zeros(len(names), bool)
    chosen[best] = True
    return np.flatnonzero(chosen[member])


def _with_neighbours(time_s: Array, rate_hz: float, reach: int) -> NDArray[np.int64]:
    """Rows that have `reach` samples on either side without a gap."""
    cuts = np.flatnonzero(np.diff(time_s) * rate_hz > GAP_STEPS) + 1
    edges = np.concatenate(([0], cuts, [len(time_s)]))
    return np.concatenate([np.arange(a + reach, b - reach) for a, b in pairwise(edges.tolist())])


_TAPS = 3  # samples that interpolation needs on either side


class _Window:
    """Conditioned signals, and the rows of sensor 1 that have partners at every offset searched."""

    def __init__(self, signals: PairSignals, rows: NDArray[np.int64], reach: int, stride: int) -> None:
        self.signals, self.rows, self.reach, self.stride = signals, rows, reach, stride
        self.rate = signals.rate_hz
        self.searched_s = reach / self.rate
        _, self.piece = np.unique(np.floor(signals.time_s[rows] / PIECE_S), return_inverse=True)
        self.piece = self.piece.reshape(-1)
        self.pieces = int(self.piece.max()) + 1 if len(rows) else 0

    def shifted(self, offset_s: float) -> PairSignals:
        """Sensor 1 at the chosen rows and sensor 2 at the same true instants, if it samples `offset_s` late."""
        shift = -offset_s * self.rate
        whole = int(np.floor(shift))
        at, weights = self.rows + whole, _lagrange(shift - whole)
        s = self.signals
        gyr2, acc2 = (
            sum(w * signal[at + k] for k, w in zip(range(1 - _TAPS, 1 + _TAPS), weights, strict=True) if w)
            for signal in (s.gyr2, s.acc2)
        )
        return PairSignals(s.time_s[self.rows], s.gyr1[self.rows], s.acc1[self.rows], gyr2, acc2, self.rate)

    def coarse(self) -> tuple[HingeAxis, float, bool]:
        """The best offset on the grid, the axes there, and whether no other minimum could as well be meant."""
        lags = np.arange(-self.reach, self.reach + 1, self.stride)
        fits = []
        for lag in lags:
            pair = self.shifted(lag / self.rate)
            fits.append(fit_axis(pair, SETTINGS))
        costs = np.array([fit.cost for fit in fits])
        best = int(costs.argmin())
        valleys = [i for i in range(len(lags)) if i != best and costs[i] <= costs[max(i - 1, 0) : i + 2].min()]
        lone = 0 < best < len(lags) - 1 and all(self._worse(lags, fits, i, best) for i in valleys)
        return fits[best], float(lags[best]) / self.rate, lone

    def _worse(self, lags: NDArray[np.int64], fits: list[HingeAxis], other: int, best: int) -> bool:
        """Whether the residuals at another minimum are larger in most pieces, beyond chance (two standard errors)."""
        at = [
            np.bincount(self.piece, self.shifted(lags[i] / self.rate).residual(fits[i].axis1, fits[i].axis2) ** 2)
            for i in (other, best)
        ]
        more = at[0] - at[1]
        return bool(more.mean() > 2.0 * more.std(ddof=1) / np.sqrt(self.pieces))

    def refined(self, axes: HingeAxis, offset_s: float) -> tuple[float, float, float]:
        """Offset and its standard deviation, s, by Gauss-Newton on both axes and the offset; and the agreement there."""
        limit = self.stride / self.rate
        for _ in range(20):
            pair = self.shifted(offset_s)
            axes = fit_axis(pair, SETTINGS)
            gradients, hessians = self._normal_equations(pair, axes, offset_s)
            step = -_solve(hessians.sum(0), gradients.sum(0))[4]
            if not abs(offset_s + step) <= self.searched_s:
                return offset_s, np.inf, 0.0
            offset_s += float(np.clip(step, -limit, limit))
            if abs(step) < 1e-3 / self.rate:
                break
        gradient, hessian = gradients.sum(0), hessians.sum(0)
        # Jackknife: one step from the solution without each piece in turn.
        without = np.array([-_solve(hessian - h, gradient - g)[4] for g, h in zip(gradients, hessians, strict=True)])
        spread = (self.pieces - 1) / self.pieces * ((without - without.mean()) ** 2).sum()
        sizes = [np.linalg.norm(np.cross(w, j), axis=1) for w, j in ((pair.gyr1, axes.axis1), (pair.gyr2, axes.axis2))]
        variance = sizes[0].var() + sizes[1].var()
        apart = sizes[0] - sizes[1]
        agreement = float(1.0 - apart.var() / variance) if variance > 0.0 else 0.0
        # A residual that follows the offset's derivative all along would shift the offset by the root of this; misfit does so
        # in part, the more the larger its share.
        shift = SETTINGS.weight_ratio * (apart**2).sum() * abs(_solve(hessian, np.eye(5)[4])[4])
        return offset_s, float(np.sqrt(spread + (1.0 - agreement) * shift)), agreement

    def _normal_equations(self, pair: PairSignals, axes: HingeAxis, offset_s: float) -> tuple[Array, Array]:
        """Jᵀe (K, 5) and JᵀJ (K, 5, 5) of each piece: two tangent components of either axis, then the offset."""
        h = 0.02 / self.rate
        rate2 = (self.shifted(offset_s + h).gyr2 - self.shifted(offset_s - h).gyr2) / (2.0 * h)
        perpendicular1, perpendicular2 = (np.cross(w, j) for w, j in ((pair.gyr1, axes.axis1), (pair.gyr2, axes.axis2)))
        size1, size2 = (np.maximum(np.linalg.norm(p, axis=1), 1e-12) for p in (perpendicular1, perpendicular2))
        # d‖w×j‖/dj = -(w·j) w / ‖w×j‖ in the tangent plane of j.
        by_axis1 = -(pair.gyr1 @ axes.axis1 / size1)[:, None] * pair.gyr1
        by_axis2 = (pair.gyr2 @ axes.axis2 / size2)[:, None] * pair.gyr2
        by_offset = -(perpendicular2 * np.cross(rate2, axes.axis2)).sum(1) / size2
        b1, b2 = _tangent(axes.axis1), _tangent(axes.axis2)
        gyr = np.column_stack([by_axis1 @ b1, by_axis2 @ b2, by_offset])
        acc = np.column_stack([pair.acc1 @ b1, -pair.acc2 @ b2, np.zeros(len(gyr))])
        gyr_weight, acc_weight = SETTINGS.weight_ratio, 1.0 / SETTINGS.weight_ratio
        gyr_residual, acc_residual = size1 - size2, pair.acc1 @ axes.axis1 - pair.acc2 @ axes.axis2
        per_row = gyr_weight * gyr * gyr_residual[:, None] + acc_weight * acc * acc_residual[:, None]
        squares = gyr_weight * gyr[:, :, None] * gyr[:, None, :] + acc_weight * acc[:, :, None] * acc[:, None, :]
        return _by_piece(self.piece, per_row), _by_piece(self.piece, squares)


def _lagrange(f: float) -> Array:
    """Weights of the samples -2..3 for the value at f within [0, 1)."""
    nodes = np.arange(1 - _TAPS, 1 + _TAPS)
    return np.array([np.prod([(f - m) / (k - m) for m in nodes if m != k]) for k in nodes])


def _tangent(axis: Array) -> Array:
    """(3, 2) orthonormal basis of the plane perpendicular to a unit vector."""
    first = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first)])


def _by_piece(piece: NDArray[np.int64], rows: Array) -> Array:
    """Sums of rows over each piece; pieces ascend."""
    starts = np.flatnonzero(np.diff(piece, prepend=-1))
    return np.add.reduceat(rows, starts, axis=0)


def _solve(matrix: Array, vector: Array) -> Array:
    """Solution in the directions that the matrix determines."""
    return np.linalg.pinv(matrix, rcond=1e-10, hermitian=True) @ vector
