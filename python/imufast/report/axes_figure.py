"""A picture of each axis in its sensor's frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imufast.report.svg import inline_svg
from imufast.report.words import UNKNOWN_DEG

__all__ = ["axis_picture"]

Array = NDArray[np.float64]

BLUE, VERMILLION, DARK, PALE = "#0072B2", "#D55E00", "#333333", "#999999"
# Seen from the front right and above: columns are where x, y and z of the sensor point on the page.
AZIMUTH, ELEVATION = np.radians(35.0), np.radians(24.0)
VIEW = np.array(
    [
        [-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0],
        [-np.sin(ELEVATION) * np.cos(AZIMUTH), -np.sin(ELEVATION) * np.sin(AZIMUTH), np.cos(ELEVATION)],
    ]
)
HOUSING = np.array([0.36, 0.26, 0.1])
"""Half the size of the box that stands for the sensor."""


def axis_picture(report: dict[str, Any], sensor: int) -> str | None:
    """The axis of sensor 1 or 2 with the cone of its bound; None while there is none."""
    vector, bounds = report[f"axis{sensor}"], report["bound95_deg"]
    if vector is None:
        return None
    axis = np.array(vector, dtype=np.float64)
    figure = Figure(figsize=(3.3, 2.85), facecolor="none")
    panel: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set_axis_off()
    panel.set_aspect("equal")
    panel.set_xlim(-1.33, 1.33)
    panel.set_ylim(-1.15, 1.15)
    color = BLUE if sensor == 1 else VERMILLION
    _housing(panel)
    for direction, name in zip(np.eye(3), "xyz", strict=True):
        _line(panel, 0.0 * direction, direction, color=PALE, linewidth=1.2, zorder=2)
        at = VIEW @ (1.1 * direction)
        panel.text(at[0], at[1], name, fontsize=11, color="#555555", ha="center", va="center", zorder=2)
    # Its shadow on the plane of x and y tells where in depth the axis points.
    floor = axis * [1.0, 1.0, 0.0]
    _line(panel, -floor, floor, color=color, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=2)
    for sign in (1.0, -1.0):
        _line(panel, sign * floor, sign * axis, color=color, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=2)
    _line(panel, -axis, axis, color=color, linewidth=2.4, zorder=4)
    tip, before = (VIEW @ axis).tolist(), (VIEW @ (0.88 * axis)).tolist()
    if math.dist(tip, before) > 0.02:
        panel.annotate(
            "",
            tip,
            before,
            arrowprops={
                "arrowstyle": "-|>",
                "color": color,
                "linewidth": 2.0,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 16,
            },
            zorder=5,
        )
    else:
        panel.plot(*tip, "o", color=color, markersize=7, zorder=5)
    bound = None if bounds is None or bounds[sensor - 1] is None else float(bounds[sensor - 1])
    if bound is not None and bound < UNKNOWN_DEG:
        _cone(panel, axis, np.radians(bound), color)
    words = "unknown" if bound is None or bound >= UNKNOWN_DEG else f"within {bound:.2g} degrees"
    return inline_svg(figure, f"a{sensor}x", f"The axis in the frame of sensor {sensor}, {words}")


def _line(panel: Axes, start: Array, stop: Array, **style: Any) -> None:
    points = np.stack([VIEW @ start, VIEW @ stop])
    panel.plot(points[:, 0], points[:, 1], solid_capstyle="round", **style)


def _housing(panel: Axes) -> None:
    """The sensor as a flat box about the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    for i, a in enumerate(corners):
        for b in corners[i + 1 :]:
            if np.abs(a - b).sum() == 2:
                _line(panel, a * HOUSING, b * HOUSING, color="#BBBBBB", linewidth=0.9, zorder=1)
    top = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]) * HOUSING @ VIEW.T
    panel.fill(top[:, 0], top[:, 1], color="#EEEEEE", zorder=1)


def _cone(panel: Axes, axis: Array, bound_rad: float, color: str) -> None:
    """The circles in which the ends of the axis lie in 95 % of cases."""
    side = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    side /= np.linalg.norm(side)
    turn = np.linspace(0.0, 2.0 * np.pi, 49)[:, None]
    ring = np.cos(bound_rad) * axis + np.sin(bound_rad) * (np.cos(turn) * side + np.sin(turn) * np.cross(axis, side))
    for sign in (1.0, -1.0):
        points = sign * ring @ VIEW.T
        panel.fill(points[:, 0], points[:, 1], color=color, alpha=0.28, linewidth=0.0, zorder=3)
