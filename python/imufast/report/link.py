"""What both sensors tell of the joint's acceleration, held against each other over a tracked recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imufast.imu import Imu
from imufast.quaternion import multiply, rotate

if TYPE_CHECKING:
    from imufast.track import RelativeOrientation

__all__ = ["heading_plain", "residual_plain"]

Array = NDArray[np.float64]

AVERAGE_S = 0.2
"""Residuals and accelerations are averaged over so long, s: the smoother's default window."""
POWER_S = 10.0
"""Windows over which the heading's observability is judged, s."""
BINS, HISTOGRAM_BINS = 500, 61
MOST_WINDOWS = 500
GOOD_DEG = 5.0
"""Ten seconds that show the heading at least so well, taken alone, show it; degrees."""
GRAVITY = 9.81
FASTEST_HZ = 100.0
"""Rate at which windows are turned to one frame."""


def residual_plain(rel: RelativeOrientation, imu1: Imu, imu2: Imu) -> dict[str, Any] | None:
    """The residual of the link constraint, a_jc,1 − R12 a_jc,2, m/s², averaged over 0.2 s: rms and largest norm in equal
    intervals of time, and the histogram of its three channels. None where no stretch is long enough."""
    known = rel.calibration
    center1, center2 = (np.zeros(3),) * 2 if known.center is None else (known.center.in_sensor1, known.center.in_sensor2)
    acc1 = joint_acc(imu1, center1, known.gyr_bias1, known.acc_bias1)
    acc2 = joint_acc(imu2, center2, known.gyr_bias2, known.acc_bias2)
    residual = _averaged(acc1 - rotate(rel.q_12, acc2), imu1)
    norm = np.linalg.norm(residual, axis=1)
    good = np.isfinite(norm)
    if good.sum() < 4:
        return None
    time, norm, residual = rel.time_s[good], norm[good], residual[good]
    scale = float(np.median(np.abs(residual))) * 1.4826
    start, stop = float(time[0]), float(time[-1])
    bins = max(1, min(BINS, len(time) // 4))
    width = max((stop - start) / bins, 1e-9)
    at = np.clip(((time - start) / width).astype(np.int64), 0, bins - 1)
    counts = np.bincount(at, minlength=bins)
    peaks = np.zeros(bins)
    np.maximum.at(peaks, at, norm)
    rms = np.where(counts > 0, np.sqrt(np.bincount(at, norm**2, minlength=bins) / np.maximum(counts, 1)), np.nan)
    top = max(float(np.quantile(np.abs(residual), 0.995)), 4.0 * scale, 1e-9)
    histogram, edges = np.histogram(np.clip(residual, -top, top), bins=HISTOGRAM_BINS, range=(-top, top))
    return {
        "averaged_over_s": AVERAGE_S,
        "rms_m_s2": float(np.sqrt((norm**2).mean())),
        "robust_std_m_s2": scale,
        "beyond_3_std": float((np.abs(residual) > 3.0 * scale).mean()) if scale > 0.0 else None,
        "time_s": start + width * (np.arange(bins) + 0.5),
        "rms": rms,
        "peak": np.where(counts > 0, peaks, np.nan),
        "histogram": {"edges_m_s2": edges, "counts": histogram},
    }


def heading_plain(rel: RelativeOrientation, imu1: Imu, robust_std: float | None) -> dict[str, Any] | None:
    """How well the motion shows the relative heading, over windows of ten seconds: the smallest eigenvalue of the mean of
    [a×]ᵀ[a×], with a the joint's specific force in a frame that does not turn: the mean square of its horizontal part,
    (m/s²)², less what noise and drift feign of it; its root is told. None for recordings too short to say.

    Args:
        rel: the orientations and their calibration.
        imu1: sensor 1.
        robust_std: of a channel of the link's residual, m/s²; sets the level from which on the heading shows.
    """
    known, rate = rel.calibration, imu1.rate_hz
    center = np.zeros(3) if known.center is None else known.center.in_sensor1
    acc = joint_acc(imu1, center, known.gyr_bias1, known.acc_bias1)
    # Where a lone sample has no derivative, its own acceleration will do.
    acc = np.where(np.isfinite(acc), acc, imu1.acc)
    stride = max(1, round(rate / FASTEST_HZ))
    steps = min(round(POWER_S * rate), len(imu1)) // stride
    mean_over = max(1, round(AVERAGE_S * rate / stride))
    blocks = steps // mean_over
    if blocks < 5:
        return None
    time = imu1.time_s
    first, last = float(time[0]), float(time[len(time) - steps * stride])
    starts = np.searchsorted(time, np.linspace(first, last, int(min(MOST_WINDOWS, max(2, 5.0 * (last - first) / POWER_S)))))
    starts = np.minimum(np.unique(starts), len(time) - steps * stride)
    # Turns from one used sample to the next, added up: between samples the rate is the mean of its neighbours'.
    turns = 0.5 * np.diff(time)[:, None] * (imu1.gyr[1:] + imu1.gyr[:-1] - 2.0 * known.gyr_bias1)
    summed = np.vstack([np.zeros(3), np.cumsum(turns, axis=0)])
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(starts), 1))
    level = np.empty((len(starts), steps, 3))
    for k in range(steps):
        now = starts + k * stride
        if k:
            q = multiply(q, _exp(summed[now] - summed[now - stride]))
        level[:, k] = rotate(q, acc[now])
    mean = level[:, : blocks * mean_over].reshape(len(starts), blocks, mean_over, 3).mean(axis=2)
    outer = np.einsum("wki,wkj->wij", mean, mean) / blocks
    power = np.linalg.eigvalsh(np.trace(outer, axis1=1, axis2=2)[:, None, None] * np.eye(3) - outer)[:, 0]
    length = time[starts + (steps - 1) * stride] - time[starts]
    whole = length < 1.1 * steps * stride / rate + 0.5
    # What noise and drift feign: both channels of half the residual's variance, and gravity that seems to tip over.
    feigned = (robust_std or 0.0) ** 2 + (GRAVITY * known.gyr_bias_std * steps * stride / rate) ** 2 / 6.0
    root = np.where(whole, np.sqrt(np.maximum(power - feigned, 0.0)), np.nan)
    needed = None
    if robust_std is not None:
        needed = max(robust_std, 1e-3) / (np.radians(GOOD_DEG) * np.sqrt(blocks))
    seen = root[np.isfinite(root)]
    if not len(seen):
        return None
    return {
        "window_s": steps * stride / rate,
        "time_s": time[starts] + 0.5 * length,
        "horizontal_acc_rms_m_s2": root,
        "needed_m_s2": needed,
        "needed_for_deg": GOOD_DEG,
        "shown_share": None if needed is None else float((seen >= needed).mean()),
    }


def joint_acc(imu: Imu, center: Array, gyr_bias: Array, acc_bias: Array) -> Array:
    """(N, 3) specific force at the joint centre in the sensor's frame, m/s²; NaN where a sample has no neighbour to
    differentiate the rate with."""
    rate = imu.gyr - gyr_bias
    turning = np.full_like(rate, np.nan)
    for start, stop in imu.segments():
        if stop - start > 1:
            turning[start:stop] = np.gradient(rate[start:stop], imu.time_s[start:stop], axis=0)
    acc: Array = imu.acc - acc_bias + np.cross(turning, center) + np.cross(rate, np.cross(rate, center))
    return acc


def _averaged(values: Array, imu: Imu) -> Array:
    """Moving average over `AVERAGE_S` within each unbroken stretch; NaN where it does not fit."""
    size = max(1, round(AVERAGE_S * imu.rate_hz))
    mean = np.full_like(values, np.nan)
    for start, stop in imu.segments():
        if stop - start >= max(size, 2):
            total = np.vstack([np.zeros(3), np.cumsum(values[start:stop], axis=0)])
            middle = start + size // 2
            mean[middle : middle + stop - start - size + 1] = (total[size:] - total[:-size]) / size
    return mean


def _exp(turn: Array) -> Array:
    half = 0.5 * np.linalg.norm(turn, axis=1, keepdims=True)
    # np.sinc(x) is sin(πx)/(πx).
    return np.hstack([np.cos(half), 0.5 * np.sinc(half / np.pi) * turn])
