"""How well each kind of term fits, sensor by sensor, joint by joint and bone by bone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.layout import Layout
from imufast.body.settings import Anthropometry

__all__ = ["KINDS", "residuals"]

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
    layout: Layout, fit: _core.BodyFit, measures: Anthropometry, lengths: Mapping[str, tuple[float, float]]
) -> dict[str, dict[str, float]]:
    """Kind of term to sensor's segment, joint or bone to the root mean square of its residual over its standard deviation, a
    component at a time; of what is there once alone the residual itself over its standard deviation. What is not there is
    left out."""
    found: dict[str, dict[str, float]] = {kind: {} for kind in KINDS}
    for k, kind in enumerate(KINDS[:3]):
        found[kind] = _finite(zip(layout.segments, fit.sensor_residuals[:, k], strict=True))
    for k, kind in enumerate(KINDS[3:6]):
        found[kind] = _finite(zip(layout.names, fit.joint_residuals[:, k], strict=True))
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


def _finite(pairs: Iterable[tuple[str, float]]) -> dict[str, float]:
    return {name: float(value) for name, value in pairs if np.isfinite(value)}
