"""Whether a sensor is behind the others in time, or ahead of them, by how its joints fit together when it is shifted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.body.checks import misfit
from imufast.body.layout import Layout
from imufast.body.stance import STILL
from imufast.imu import Recording

__all__ = ["out_of_step"]

Array = NDArray[np.float64]
STEP_S, MOST_S = 0.02, 0.2
"""Shifts that are tried, s; no finer than the samples."""
PIECE_S, FEWEST, MOST = 6.0, 4, 20
"""A shift is judged by pieces of the recording this long, s, that are not at rest for half of it: by so many of them."""
CLEAR, SURE = 0.2, 2.0
"""A sensor is out of step where a shift lowers the logarithms of its joints' misfits by so much on average, after so many
standard errors of doubt are taken off. In step up to 0.07 was seen, 30 ms out of it on walking persons 0.3 to 5."""


def out_of_step(recording: Recording, layout: Layout) -> dict[str, float]:
    """Segment to how far its sensor's data are behind those of most others, s, where that is clear.

    At every instant the two sensors of a joint feel the same acceleration where the joint is (Seel et al. 2012), so that the
    misfit of their common point has a sharp minimum where both are in step. Sensors, alone or with all that hang on them, are
    shifted one after the other, that first whose joints gain most; a gain counts by its mean over pieces of the recording and
    the spread between these. What rests, such as a foot in sit-to-stand, is not told, and pieces full of gaps tell nothing.
    """
    rate_hz, names = recording.rate_hz, list(layout.placed.values())
    one, other = next(iter(layout.joints.values()))
    pieces = [
        (start, stop)
        for start, stop in _pieces(recording, names)
        # All pairs have the same gaps.
        if not np.isnan(misfit(recording[names[one]][start:stop], recording[names[other]][start:stop]))
    ]
    if len(pieces) < FEWEST:
        return {}
    stride = max(round(STEP_S * rate_hz), 1)
    reach = int(MOST_S * rate_hz) // stride
    shifts = stride * np.arange(-reach, reach + 1)
    known: dict[tuple[str, int], Array] = {}

    def joint(name: str, behind: int) -> Array:
        """(P,) misfits of a joint whose lower sensor is taken to be so many samples behind the upper one."""
        if (name, behind) not in known:
            upper, lower = (recording[names[k]] for k in layout.joints[name])
            found = []
            for start, stop in pieces:
                rows = stop - start - abs(behind)
                one, other = upper[start + max(-behind, 0) :][:rows], lower[start + max(behind, 0) :][:rows]
                found.append(misfit(one, other._replace(time_s=one.time_s)))
            known[name, behind] = np.array(found)
        return known[name, behind]

    alone = list(np.eye(len(names), dtype=np.intp))
    moved = alone + [layout.beyond(name) for name in layout.joints]
    found = np.zeros(len(names), dtype=np.intp)
    for _ in names:
        gains = np.zeros((len(moved), len(shifts), len(pieces)))
        for gain, which in zip(gains, moved, strict=True):
            for name, (upper, lower) in layout.joints.items():
                turn = int(which[lower] - which[upper])
                before = int(found[lower] - found[upper])
                if turn and abs(before) <= shifts[-1]:
                    gain += [joint(name, before) - joint(name, before + turn * shift) for shift in shifts.tolist()]
        doubt = gains.std(axis=2, ddof=1) / np.sqrt(len(pieces))
        sure = np.nan_to_num(gains.mean(axis=2) - SURE * doubt, nan=-np.inf)
        move, best = np.unravel_index(int(np.argmax(sure)), sure.shape)
        if sure[move, best] < CLEAR:
            break
        found += moved[move] * shifts[best]
    usual = np.bincount(found - found.min()).argmax() + found.min()
    return {s: float(late - usual) / rate_hz for s, late in zip(layout.segments, found, strict=True) if late != usual}


def _pieces(recording: Recording, names: list[str]) -> list[tuple[int, int]]:
    """First sample, and the one after the last, of those pieces in which somebody moves, at most `MOST` of them."""
    length = round(PIECE_S * recording.rate_hz)
    fastest = np.max([np.linalg.norm(recording[name].gyr, axis=1) for name in names], axis=0)
    starts = range(0, len(fastest) - length + 1, length)
    busy = [start for start in starts if np.mean(fastest[start : start + length] > STILL) > 0.5]
    chosen = sorted({round(k * (len(busy) - 1) / (MOST - 1)) for k in range(MOST)}) if busy else []
    return [(busy[k], busy[k] + length) for k in chosen]
