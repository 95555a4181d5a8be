"""How well each kind of term fits, sensor by sensor, joint by joint and bone by bone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.layout import Layout
from imufast.body.settings import Anthropometry, LowerBodySettings

__all__ = ["KINDS", "over_windows", "residuals"]

Array = NDArray[np.float64]

KINDS = (
    "dynamics",
    "gyr_bias_walk",
    "acc_bias_walk",
    "joint_center",
    "hinge",
    "knee_axes",
    "segment_length",
    "axis_angle",
    "length_difference",
)
"""What the posterior is made of: of sensors the first three, of joints the next three, of bones the rest."""


def residuals(
    layout: Layout,
    time_s: Array,
    fit: _core.BodyFit,
    measures: Anthropometry,
    settings: LowerBodySettings,
    lengths: Mapping[str, tuple[float, float]],
) -> dict[str, dict[str, float]]:
    """Kind of term to sensor's segment, joint or bone to the root mean square of its residual over its standard deviation, a
    component at a time; of what is there once alone the residual itself over its standard deviation. What is not there is
    left out.

    Args:
        layout, measures, settings: what was asked for.
        time_s: (K,) of the moments, s.
        fit: what was found.
        lengths: of the bones, (length, standard deviation), m.
    """
    found: dict[str, dict[str, float]] = {kind: {} for kind in KINDS}
    squares, walks = fit.link_squares[:, :, 0], (settings.gyr_walk, settings.acc_walk)
    # Nine numbers from moment to moment, where samples lead there.
    found["dynamics"] = _root(layout.segments, squares.sum(axis=0) / 9.0, (squares > 0.0).sum(axis=0))
    spans = np.diff(time_s)[:, None, None]
    for kind, biases, walk in zip(KINDS[1:3], (fit.gyr_bias, fit.acc_bias), walks, strict=True):
        steps = (np.diff(biases, axis=0) ** 2 / (walk**2 * spans)).mean(axis=2)
        found[kind] = _root(layout.segments, steps.sum(axis=0), np.full(len(layout.segments), len(spans)))
    # A centre has three components, what is across an axis two: of a hinge from either side.
    joints, count = fit.joint_squares.sum(axis=0), np.full(len(layout.names), len(fit.joint_squares))
    knees = np.array([name.startswith("knee") for name in layout.names])
    found["joint_center"] = _root(layout.names, joints[:, 0] / 3.0, count)
    found["hinge"] = _root(layout.names, (joints[:, 1] + joints[:, 2]) / 4.0, count * knees)
    found["knee_axes"] = _root(layout.names, joints[:, 3] / 2.0, count * (knees & (settings.axes_std_deg is not None)))
    ends = layout.bones()
    for name, (length, _) in lengths.items():
        kind, _, side = name.partition("_")
        mean, std = getattr(measures, f"{kind}_m")
        found["segment_length"][name] = (length - mean) / std
        if not side:
            continue
        axis = fit.axes[layout.names.index(f"knee_{side}"), 0 if kind == "femur" else 1]
        bone = fit.centers[ends[name][0]] - fit.centers[ends[name][1]]
        mean, std = getattr(measures, f"{kind}_axis_deg")
        angle = float(np.degrees(np.arccos(np.clip(axis @ bone / max(np.linalg.norm(bone), 1e-9), -1.0, 1.0))))
        found["axis_angle"][name] = (angle - (mean if side == "right" else 180.0 - mean)) / std
        other = f"{kind}_left"
        if side == "right" and other in lengths:
            std = getattr(measures, f"{kind}_difference_m")
            found["length_difference"][kind] = (length - lengths[other][0]) / std
    return {kind: values for kind, values in found.items() if values}


def over_windows(parts: Sequence[Mapping[str, Mapping[str, float]]], moments: Sequence[int]) -> dict[str, dict[str, float]]:
    """Residuals of a recording from those of its windows, which have so many moments each; what all have alike stays."""
    found: dict[str, dict[str, float]] = {}
    for kind, first in parts[0].items():
        for name in first:
            pairs = [(part[kind][name], n) for part, n in zip(parts, moments, strict=True) if name in part.get(kind, {})]
            values, weights = (np.array(column, dtype=np.float64) for column in zip(*pairs, strict=True))
            mean = float(np.sqrt(np.average(values**2, weights=weights)))
            found.setdefault(kind, {})[name] = mean if kind in KINDS[:6] else float(values[0])
    return found


def _root(names: Iterable[str], sums: Array, counts: NDArray[np.int64]) -> dict[str, float]:
    """Root mean squares of what is there."""
    pairs = zip(names, sums.tolist(), counts.tolist(), strict=True)
    return {name: float(np.sqrt(total / number)) for name, total, number in pairs if number > 0}
