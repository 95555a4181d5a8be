"""When the subject stands, what is upwards in each sensor then (the zero of all that has no two joint centres), and which way
its knees bend."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imufast.body.anatomy import frames
from imufast.body.bands import angles_deg, between
from imufast.body.layout import SIDES, Layout
from imufast.imu import BREAK_STEPS, Recording
from imufast.quaternion import matrix

__all__ = ["STILL", "Rests", "resting", "signed"]

Array = NDArray[np.float64]
STILL = 0.3
"""No sensor turns faster while the subject stands still, rad/s."""
LEAST_S, MOST_S = 0.25, 1.0
"""Rests are between so long, s: what is shorter lies between two movements, what is longer may hold a slow one."""
ENOUGH_S = 1.0
"""So long must the subject stand in all, s."""
STRAIGHT_DEG = 25.0
"""Who sits is quiet, too: who stands has knees that bend no more than this beyond the straightest at rest..."""
STEEP_DEG = 45.0
"""...and thighs, where both their ends are known, no farther from the upright than this."""


class Rests:
    """The P pieces of a recording in which all S sensors are quiet.

    Args:
        recording, layout: the sensors and where they are.
        acc_bias: (S, 3) accelerometer biases, m/s²; default 0.

    Attributes:
        felt: (P, S, 3) what is upwards in each sensor.
    """

    def __init__(self, recording: Recording, layout: Layout, acc_bias: Array | float = 0.0) -> None:
        imus = [recording[name] for name in layout.placed.values()]
        quiet = np.max([np.linalg.norm(imu.gyr, axis=1) for imu in imus], axis=0) < STILL
        self.layout, self.count = layout, len(quiet)
        self.enough = ENOUGH_S * recording.rate_hz
        self.spans = _spans(recording, quiet)
        felt = np.array([[imu.acc[start:stop].mean(axis=0) for imu in imus] for start, stop in self.spans])
        felt = felt.reshape(-1, len(imus), 3) - acc_bias
        self.felt: Array = felt / np.linalg.norm(felt, axis=2, keepdims=True)

    def standing(self, centers: Array, axes: Array, up: Array, sides: Sequence[str] = SIDES) -> NDArray[np.bool_]:
        """(P,) whether the subject stands, by the legs of some sides; false throughout where that is not for long enough.

        Args:
            centers, axes: (J, 2, 3) joint centres, m, and knee axes, pointing to the right.
            up: (S, 3) about what is upwards in each sensor, for the frames of what has no bone.
        """
        stands = self.all
        if not self.spans:
            return stands
        known, bones = frames(self.layout, centers, axes, up), self.layout.bones()
        for side in sides:
            if f"knee_{side}" in self.layout.joints:
                thigh, shank = (_lean_deg(self.felt[:, k], known[k]) for k in self.layout.joints[f"knee_{side}"])
                bent = (thigh - shank + 180.0) % 360.0 - 180.0
                stands &= bent < bent.min() + STRAIGHT_DEG
                if f"femur_{side}" in bones:
                    stands &= np.abs(thigh) < STEEP_DEG
        return stands & self.long_enough(stands)

    def sitting(self, centers: Array, axes: Array, up: Array) -> bool:
        """Whether the subject sits for long enough: its thighs, those both of whose ends are known, lie. Arguments as of
        `standing`."""
        thighs = [k for k, s in enumerate(self.layout.segments) if f"femur_{s.removeprefix('thigh_')}" in self.layout.bones()]
        if not (self.spans and thighs):
            return False
        known = frames(self.layout, centers, axes, up)
        lies = np.all([np.abs(_lean_deg(self.felt[:, k], known[k])) > STEEP_DEG for k in thighs], axis=0)
        return self.long_enough(lies)

    @property
    def all(self) -> NDArray[np.bool_]:
        """(P,) all of them."""
        return np.ones(len(self.spans), dtype=bool)

    def long_enough(self, of: NDArray[np.bool_]) -> bool:
        """Whether some rests (P,) make up a second."""
        return bool(self._lengths() @ of >= self.enough)

    def up(self, of: NDArray[np.bool_]) -> Array:
        """(S, 3) what is upwards in each sensor, on average over some rests (P,), not none."""
        mean = np.einsum("p,psi->si", self._lengths() * of, self.felt)
        unit: Array = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        return unit

    def samples(self, of: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(N,) the samples of some rests (P,)."""
        rows = np.zeros(self.count, dtype=bool)
        for (start, stop), wanted in zip(self.spans, of, strict=True):
            rows[start:stop] = wanted
        return rows

    def _lengths(self) -> Array:
        return np.array([stop - start for start, stop in self.spans], dtype=np.float64)


def resting(recording: Recording, layout: Layout, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """(K,) whether all sensors are quiet from each of the moments at `rows` to the next; of the last one: at it."""
    fast = np.max([(recording[name].gyr ** 2).sum(axis=1) for name in layout.placed.values()], axis=0) >= STILL**2
    still: NDArray[np.bool_] = np.add.reduceat(fast, rows) == 0
    return still


def signed(layout: Layout, q: Array, centers: Array, axes: Array, up: Array, rests: Rests) -> Array:
    """The axes, both of a knee to the right: section 3.9, but by the extremes of flexion instead of its median, which
    standing decides: that way round which overextends the knee less.

    Where a bone is not known, zero is how the subject stands, and which of its rests that is depends on the way round.
    """
    axes = axes.copy()
    turned = matrix(q)
    for side in SIDES:
        name = f"knee_{side}"
        if name not in layout.joints:
            continue
        j, (upper, lower) = layout.names.index(name), layout.joints[name]
        one, other = turned[:, upper] @ axes[j, 0], turned[:, lower] @ axes[j, 1]
        if float(np.median(np.einsum("ki,ki->k", one, other))) < 0.0:
            axes[j, 1] = -axes[j, 1]
        least = []
        for sign in (1.0, -1.0):
            tried = axes.copy()
            tried[j] *= sign
            stands = rests.standing(centers, tried, up, (side,))
            found = frames(layout, centers, tried, rests.up(stands) if stands.any() else up)
            relative = between((turned[:, upper], found[upper]), (turned[:, lower], found[lower]))
            least.append(float(np.percentile(angles_deg("knee", side, relative)[:, 0], 1)))
        if least[1] > least[0]:
            axes[j] = -axes[j]
    return axes


def _lean_deg(up: Array, frame: Array) -> Array:
    """(P,) by how much a segment's lower end is ahead of its upper one, from (P, 3) the upright in its sensor, degrees."""
    ahead, along, _ = (up @ frame).T
    lean: Array = np.degrees(np.arctan2(ahead, along))
    return lean


def _spans(recording: Recording, quiet: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of all rests."""
    rate_hz = recording.rate_hz
    longest = max(round(MOST_S * rate_hz), 1)
    broken = np.flatnonzero(np.diff(recording.time_s) > BREAK_STEPS / rate_hz) + 1
    edges = np.unique(np.concatenate([[0], np.flatnonzero(np.diff(quiet)) + 1, broken, [len(quiet)]])).tolist()
    found = []
    for first, last in pairwise(edges):
        found += [(start, min(start + longest, last)) for start in range(first, last, longest) if quiet[first]]
    return [(start, stop) for start, stop in found if stop - start >= LEAST_S * rate_hz]
