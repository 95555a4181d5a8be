"""Whether the sensors are alive, in SI units, moved at all, and sit where the placement says."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise, permutations

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import SIDES, Layout
from imufast.body.stance import STILL
from imufast.center import estimate_joint_center
from imufast.errors import InputError, UnitError
from imufast.imu import BREAK_STEPS, Imu, Recording
from imufast.pairs import identical
from imufast.plausibility import check_units, dead_channels
from imufast.quaternion import rotate

__all__ = ["Assignments", "alive", "legs_swapped", "misfit", "misplaced", "stands_still", "too_broken", "without_islands"]

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
FROZEN_S = 0.5
"""A sensor that repeats one row for so long, while others change, is frozen, s."""
ISLAND_S = 0.5
"""Less than this between two gaps says nothing, s."""
FLOOR = 0.01
"""Misfits of a joint centre are told apart down to this, m/s²: below, noise decides."""
WORST = 10.0
"""Where there is no misfit to be had, m/s²."""
FEWEST = 30
"""A misfit of twelve numbers, centres and biases, says nothing of fewer instants; 5 s at 10 Hz have so many."""
CLEAR = 1.1
"""Another placement is clearly better where the logarithms of its joints' misfits sum to so much less. With the right placement
up to 0.9 was seen (sit-to-stand, where both feet rest alike), with a wrong one 1.3 to 20 (benches/body/placements.py)."""
ACROSS_DEG, DOUBT = 90.0, 3.0
"""The line between the hips points against a knee's axis where it is farther from it than this, degrees, by so many standard
deviations of the hip's heading."""
OPPOSED = -0.5
"""The least cosine of both at which they are not opposed, however certain."""


def alive(recording: Recording, layout: Layout) -> tuple[Recording, list[str]]:
    """The recording without the stretches in which a placed sensor is frozen, and a sentence on each.

    Raises:
        InputError: a sensor that is dead, wholly, in one channel or for most of the recording, or holds another one's data; the
            message names segment and sensor.
        UnitError: a sensor whose numbers are not in SI, likewise.
    """
    for (one, name), (other, again) in combinations(layout.placed.items(), 2):
        if identical(recording[name].gyr, recording[again].gyr) and recording[name].gyr.any():
            raise InputError(
                f"placement: imus {name!r} on {one} and {again!r} on {other} hold the same gyr data: one is a copy"
            )
    held = {}
    for segment, name in layout.placed.items():
        imu, where = recording[name], f"placement[{segment!r}]: imu {name!r}"
        dead = dead_channels(imu.gyr, imu.acc)
        if dead:
            raise InputError(f"{where}: {'; '.join(dead)}. Leave {segment!r} out of the placement, or mend the data")
        try:
            doubt = check_units(imu.gyr, imu.acc, imu.rate_hz, name)
        except InputError as error:
            raise type(error)(f"placement[{segment!r}]: {error}") from None
        if doubt:
            raise UnitError(f"{where}: {doubt}")
        held[segment] = _held(imu)
    # Where every sensor repeats itself nothing was measured, or simulated without noise: that tells against none of them.
    all_held = np.logical_and.reduce(list(held.values()))
    bad, why = np.zeros(len(recording.time_s), dtype=bool), []
    for segment, rows in held.items():
        own = _long(rows & ~all_held, recording)
        name, time = layout.placed[segment], recording.time_s
        if own.mean() > 0.5:
            raise InputError(
                f"placement[{segment!r}]: imu {name!r} repeats one row for {100 * own.mean():.0f} % of the recording, first at "
                f"{time[own.argmax()]:.6g} s: it is dead. Leave {segment!r} out of the placement, or cut the recording"
            )
        edges = np.flatnonzero(np.diff(np.concatenate([[False], own, [False]])))
        why += [
            f"imu {name!r} on {segment} is frozen from {time[start]:.6g} to {time[stop - 1]:.6g} s: a gap to all"
            for start, stop in zip(edges[::2], edges[1::2], strict=True)
        ]
        bad |= own
    return _kept(recording, layout, ~bad), why


def without_islands(recording: Recording, layout: Layout, bridge_s: float) -> tuple[Recording, list[str]]:
    """The recording without what lies between two gaps of more than `bridge_s` s and is shorter than `ISLAND_S`, and a sentence
    on that: too little for gyroscopes to say anything, so that any posture would fit."""
    time = recording.time_s
    edges = np.flatnonzero(np.diff(time) > max(bridge_s, BREAK_STEPS / recording.rate_hz)) + 1
    stretches = list(pairwise([0, *edges.tolist(), len(time)]))
    islands = [(start, stop) for start, stop in stretches if time[stop - 1] - time[start] < ISLAND_S]
    rows = np.ones(len(time), dtype=bool)
    for start, stop in islands:
        rows[start:stop] = False
    if not islands or not rows.any():
        return recording, []
    many = "1 piece" if len(islands) == 1 else f"{len(islands)} pieces"
    return _kept(recording, layout, rows), [f"left out: {many} shorter than {ISLAND_S:g} s between gaps"]


def _kept(recording: Recording, layout: Layout, rows: Rows) -> Recording:
    """Some samples of the placed sensors; all: as it is."""
    if rows.all():
        return recording
    return Recording(
        {
            name: imu._replace(gyr=imu.gyr[rows], acc=imu.acc[rows], time_s=imu.time_s[rows])
            for name, imu in recording.items()
            if name in layout.placed.values()
        }
    )


def stands_still(recording: Recording, layout: Layout) -> bool:
    """Whether no placed sensor ever turns faster than one does when standing, single knocks aside."""
    fastest = [np.percentile(np.linalg.norm(recording[name].gyr, axis=1), 99) for name in layout.placed.values()]
    return bool(max(fastest) < STILL)


def misplaced(recording: Recording, layout: Layout) -> list[str]:
    """A sentence, where another assignment of the sensors makes much better joints than the placement; else none.

    Two sensors share a joint where some point, as seen from both, accelerates alike at every instant (Seel et al. 2012); of all
    assignments of the sensors to the placed segments the misfits tell the best. The mirror image of a placement is as good, so
    of assignments alike those are named that are the likeliest mistakes: few sensors, other side or same leg. Sensors that do
    not move, such as feet in sit-to-stand, are not told apart, and nothing is where gaps leave too little (`too_broken`).
    """
    found = Assignments.of(recording, layout)
    if not found.margin >= CLEAR:
        return []
    mistakes = _mistake(layout.segments)
    effort = np.sum([mistakes[k, found.worn[:, k]] for k in range(len(layout.segments))], axis=0)
    effort[found.total > found.total.min() + CLEAR] = np.inf
    likely = np.flatnonzero(effort == effort.min())
    told = [_told(layout, found.worn[k]) for k in likely[np.argsort(found.total[likely])]]
    told = [*told[:2], "another swap as good"] if len(told) > 2 else told
    return [f"the joints contradict the placement: {'; or '.join(told)} (or the mirror image of that)"]


@dataclass(frozen=True, eq=False)
class Assignments:
    """All ways in which the placed sensors may be worn on the placed segments.

    Attributes:
        worn: (A, S) the sensor of each segment; the first row is the placement.
        total: (A,) sum of the logarithms of all joints' misfits; NaN where gaps leave too little for one.
    """

    worn: NDArray[np.intp]
    total: Array

    @classmethod
    def of(cls, recording: Recording, layout: Layout) -> Assignments:
        """From how well each pair of sensors shares a point."""
        names = list(layout.placed.values())
        apart = np.zeros((len(names), len(names)))
        for a, b in combinations(range(len(names)), 2):
            apart[a, b] = apart[b, a] = misfit(recording[names[a]], recording[names[b]])
        worn = np.array(list(permutations(range(len(names)))))
        return cls(worn, np.sum([apart[worn[:, a], worn[:, b]] for a, b in layout.joints.values()], axis=0))

    @property
    def margin(self) -> float:
        """By how much the placement is worse than the best."""
        return float(self.total[0] - self.total.min())


def _mistake(segments: list[str]) -> NDArray[np.float64]:
    """How unlikely a mistake is, segment by segment: other side or same leg 1, anything else 2."""
    parts = [segment.partition("_") for segment in segments]
    return np.array(
        [[0.0 if a == b else 1.0 if a[0] == b[0] or (a[2] == b[2] and a[2]) else 2.0 for b in parts] for a in parts]
    )


def _told(layout: Layout, worn: NDArray[np.intp]) -> str:
    """An assignment in words: where it differs from the placement."""
    moved = [
        (segment, layout.segments[k]) for segment, k in zip(layout.segments, worn, strict=True) if segment != layout.segments[k]
    ]
    return ", ".join(f"imu {layout.placed[placed]!r}, placed on {placed}, moves as on {like}" for like, placed in moved)


def legs_swapped(
    layout: Layout, q: dict[str, Array], centers: dict[str, Array], axes: dict[str, Array], heading_std_deg: dict[str, float]
) -> list[str]:
    """A sentence, where the right hip lies on the left as the knees see it, which bend one way only; else none. Nor is there
    one where the motion, or what gaps have left of it, hardly shows how the thighs are turned against the pelvis.

    Args:
        layout: the placement.
        q: segment to (K, 4), sensor to world.
        centers: hip to (3,) as the pelvis's sensor sees it.
        axes: thigh to (3,), its knee's axis, pointing to the right.
        heading_std_deg: hip to the standard deviation of its heading, degrees.
    """
    hips = [f"hip_{side}" for side in SIDES]
    seen = [side for side in SIDES if f"thigh_{side}" in axes]
    if not (all(hip in centers for hip in hips) and seen):
        return []
    across = rotate(q["pelvis"], centers[hips[0]] - centers[hips[1]])
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1e-12
    for side in seen:
        thigh = f"thigh_{side}"
        cosine = float(np.median(np.einsum("ki,ki->k", across, rotate(q[thigh], axes[thigh]))))
        beyond_deg = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))) - ACROSS_DEG
        if cosine > OPPOSED or not beyond_deg > DOUBT * heading_std_deg[f"hip_{side}"]:
            return []
    sides = {side: [n for s, n in layout.placed.items() if s.endswith(side)] for side in SIDES}
    right, left = (", ".join(map(repr, sides[side])) for side in SIDES)
    return [f"right and left look swapped: by the way the knees bend, {right} are on the left leg and {left} on the right"]


def too_broken(recording: Recording, layout: Layout) -> bool:
    """Whether gaps leave so little in one piece that nothing says which sensors share a joint, or which is behind another."""
    upper, lower = (recording[list(layout.placed.values())[k]] for k in next(iter(layout.joints.values())))
    return bool(np.isnan(misfit(upper, lower)))


def misfit(imu1: Imu, imu2: Imu) -> float:
    """Logarithm of how far the best common point of two sensors is from accelerating alike; NaN where that rests on fewer than
    `FEWEST` instants."""
    found = estimate_joint_center(imu1, imu2, "sa")
    if found.n_samples < FEWEST:
        return float("nan")
    return float(np.log(np.hypot(found.residual_std if np.isfinite(found.residual_std) else WORST, FLOOR)))


def _held(imu: Imu) -> Rows:
    """(N,) whether a row repeats the one before, or is repeated."""
    same = (imu.gyr[1:] == imu.gyr[:-1]).all(axis=1) & (imu.acc[1:] == imu.acc[:-1]).all(axis=1)
    held = np.zeros(len(imu), dtype=bool)
    held[1:] |= same
    held[:-1] |= same
    return held


def _long(rows: Rows, recording: Recording) -> Rows:
    """Of true rows the runs that last `FROZEN_S` or more."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]])))
    kept = np.zeros_like(rows)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if recording.time_s[stop - 1] - recording.time_s[start] >= FROZEN_S:
            kept[start:stop] = True
    return kept
