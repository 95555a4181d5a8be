"""Packet counters that wrap around, and what they say about lost packets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.io.source import Source

__all__ = ["unwrap_counter"]


def unwrap_counter(
    source: Source, column: str, values: NDArray[np.float64], modulus: int
) -> tuple[NDArray[np.int64], NDArray[np.intp], tuple[str, ...]]:
    """A counter modulo `modulus` made to count on, the rows it belongs to, and notes.

    A row whose counter repeats the one before was sent twice and is left out, as is a row without a counter.
    Raises FileFormatError where the counter steps by half its range or more: it went back, or so much was lost that
    nobody can tell how much.
    """
    rows = np.flatnonzero(np.isfinite(values))
    counter = values[rows]
    if not len(rows):
        raise source.error(f"{column} is empty throughout")
    wrong = (counter < 0) | (counter >= modulus) | (counter != np.floor(counter))
    if wrong.any():
        row = int(wrong.argmax())
        raise source.error(f"{column} must count from 0 to {modulus - 1}, but reads {counter[row]:.10g} in row {rows[row] + 1}")
    steps = np.mod(np.diff(counter.astype(np.int64)), modulus)
    if (steps >= modulus // 2).any():
        row = int((steps >= modulus // 2).argmax())
        raise source.error(
            f"{column} goes from {counter[row]:.0f} to {counter[row + 1]:.0f} in row {rows[row + 1] + 1}: back, or over a gap "
            f"of {steps[row] - 1} samples, too long to be counted; split the file there"
        )
    fresh = np.concatenate(([True], steps > 0))
    unwrapped = int(counter[0]) + np.concatenate(([0], np.cumsum(steps)))
    notes: tuple[str, ...] = ()
    if not fresh.all():
        notes = (f"{int((~fresh).sum())} rows repeat the {column} of the row before and were left out",)
    return unwrapped[fresh], rows[fresh], notes
