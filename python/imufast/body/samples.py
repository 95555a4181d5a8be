"""A body at every sample: between two moments of the estimate the gyroscopes tell how each sensor turned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.body.bands import MCGRATH, angles_deg, between, pelvis_deg
from imufast.body.layout import JOINTS
from imufast.body.result import LowerBody
from imufast.imu import Imu, Recording
from imufast.quaternion import conjugate, exp, log, matrix, multiply

__all__ = ["at_samples", "unwound"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
WOUND_RAD, AROUND = 0.5 * np.pi, 5
"""No gyroscope misses a turn by more than this between two moments: the search has turned one of them the wrong way round. So
many to either side are found anew."""


def at_samples(body: LowerBody, recording: Recording) -> LowerBody:
    """The same at every sample: between two moments the gyroscopes tell how each sensor turned, and what they miss is spread
    over the time between. Places and standard deviations lie on straight lines; outside the moments they stay as they are.

    Args:
        body: at moments that are samples of the recording.
        recording: what it was found from.
    """
    time_s = recording.time_s
    at = np.searchsorted(time_s, body.time_s)
    # Before the first moment and after the last the gyroscopes alone tell.
    rows = np.arange(len(time_s))
    before = np.clip(np.searchsorted(at, rows, side="right") - 1, 0, max(len(at) - 2, 0))
    bridge_s = body.settings.bridge_s
    share = _share(time_s, at, before, bridge_s)
    q = {
        segment: _turned(recording[body.placement[segment]], own, at, before, share, bridge_s)
        for segment, own in body.q.items()
    }
    frames = {name: multiply(conjugate(body.q[name][0]), own[0]) for name, own in body.q_segment.items()}
    q_segment = {name: multiply(q[name], np.broadcast_to(frame, (len(rows), 4))) for name, frame in frames.items()}

    def spread(values: Array) -> Array:
        """(K, ...) rows by straight lines between moments; what is infinite on one side is so in between."""
        if len(at) < 2:
            return np.repeat(values, len(rows), axis=0)
        part = share.reshape(-1, *[1] * (values.ndim - 1))
        low, high = values[before], values[before + 1]
        finite = np.isfinite(low) & np.isfinite(high)
        low, high = np.where(finite, low, 0.0), np.where(finite, high, 0.0)
        return np.where(finite, low + part * (high - low), np.inf)

    turns = {name: (matrix(own) @ MCGRATH.T, np.eye(3)) for name, own in q_segment.items()}
    found: dict[str, Any] = {}
    for kind in ("hip", "knee", "ankle"):
        angles, stds = getattr(body, f"{kind}_angles_deg"), getattr(body, f"{kind}_std_deg")
        pairs = {side: JOINTS[f"{kind}_{side}"] for side in angles}
        found[f"{kind}_angles_deg"] = {
            side: angles_deg(kind, side, between(turns[upper], turns[lower])) for side, (upper, lower) in pairs.items()
        }
        found[f"{kind}_std_deg"] = {side: spread(std) for side, std in stds.items()}
    if body.pelvis_angles_deg.shape[1]:
        found["pelvis_angles_deg"] = pelvis_deg(turns["pelvis"])
    else:
        found["pelvis_angles_deg"] = np.zeros((len(rows), 0))
    return replace(
        body,
        time_s=time_s,
        q=q,
        q_segment=q_segment,
        position={name: spread(place) for name, place in body.position.items()},
        pelvis_std_deg=spread(body.pelvis_std_deg),
        joints={name: replace(joint, heading_std_deg=spread(joint.heading_std_deg)) for name, joint in body.joints.items()},
        **found,
    )


def unwound(imu: Imu, q: Array, at: Rows, bridge_s: float) -> Array:
    """(K, 4) the orientations of a sensor at the samples `at`; where the search has turned a moment the wrong way round, by
    more than a quarter turn against the gyroscope, as the gyroscope has it from the moments around; else `q` itself.

    An angle ends at half a turn: beyond it the cost falls again, and no small step leads back.
    """
    turn = _turns(imu, bridge_s)
    product = np.tile([1.0, 0.0, 0.0, 0.0], (len(at) - 1, 1))
    for step in range(int(np.diff(at).max(initial=0))):
        inside = at[:-1] + step < at[1:]
        product[inside] = multiply(product[inside], turn[at[:-1][inside] + step])
    missed = np.linalg.norm(log(multiply(conjugate(multiply(q[:-1], product)), q[1:])), axis=1)
    missed[np.maximum.reduceat(np.diff(imu.time_s), at[:-1]) > bridge_s] = 0.0
    kept = np.ones(len(at), dtype=bool)
    for k in np.flatnonzero(missed > WOUND_RAD):
        kept[max(k + 1 - AROUND, 1) : min(k + 1 + AROUND, len(at) - 1)] = False
    if kept.all():
        return q
    rows = np.arange(len(imu.time_s))
    before = np.clip(np.searchsorted(at[kept], rows, side="right") - 1, 0, int(kept.sum()) - 2)
    share = _share(imu.time_s, at[kept], before, bridge_s)
    return _turned(imu, q[kept], at[kept], before, share, bridge_s)[at]


def _share(time_s: Array, at: Rows, before: Rows, bridge_s: float) -> Array:
    """(N,) how much of the way from the moment before to the next has passed, 0 to 1; of a way across a longer gap than
    `bridge_s`, that gap is all."""
    if len(at) < 2:
        return np.zeros(len(time_s))
    steps = np.diff(time_s)
    passed = np.concatenate([[0.0], np.cumsum(np.where(steps > bridge_s, 1e6 * steps, steps))])
    way = passed[at]
    share: Array = np.clip((passed - way[before]) / (way[before + 1] - way[before]), 0.0, 1.0)
    return share


def _turned(imu: Imu, q: Array, at: Rows, before: Rows, share: Array, bridge_s: float) -> Array:
    """(N, 4) sensor to world at all samples, from q (K, 4) at the samples `at`.

    From each moment on the gyroscope's turns are multiplied up (trapezoids); what they miss of the next moment, bias and noise,
    is one turn of which each sample takes its share. Nothing turns across gaps longer than `bridge_s`.
    """
    turn = _turns(imu, bridge_s)
    found = np.empty((len(imu.time_s), 4))
    found[at] = q
    rows = np.arange(len(found))
    far = rows - at[before]
    inside = (rows > at[0]) & ~np.isin(rows, at)
    for step in range(1, int(far.max(initial=0)) + 1):
        now = rows[inside & (far == step)]
        found[now] = multiply(found[now - 1], turn[now - 1])
    for row in range(int(at[0]) - 1, -1, -1):
        found[row] = multiply(found[row + 1], conjugate(turn[row]))
    if len(at) > 1:
        ends = at[1:]
        missed = log(multiply(conjugate(multiply(found[ends - 1], turn[ends - 1])), q[1:]))
        now = rows[inside]
        found[now] = multiply(found[now], exp(share[now, None] * missed[before[now]]))
    unit: Array = found / np.linalg.norm(found, axis=1, keepdims=True)
    return unit


def _turns(imu: Imu, bridge_s: float) -> Array:
    """(N - 1, 4) how a sensor turns from each sample to the next, by its gyroscope; not at all across longer gaps."""
    steps = np.diff(imu.time_s)[:, None]
    return exp(np.where(steps <= max(bridge_s, 1.5 / imu.rate_hz), 0.5 * (imu.gyr[1:] + imu.gyr[:-1]) * steps, 0.0))
