"""A picture to scale of each sensor and the joint as it sees it, and of what the joint centre leaves unexplained."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imufast.report.axes_figure import BLUE, DARK, PALE, VERMILLION, VIEW
from imufast.report.figures import FONT, WIDTH_IN, clock_of
from imufast.report.svg import inline_svg

__all__ = ["center_picture", "residual_picture"]

Array = NDArray[np.float64]

HOUSING_MM = np.array([47.0, 30.0, 13.0])
"""Of a common sensor, as a symbol to compare lengths with: nobody told the report what the sensors look like."""
CHI_95 = math.sqrt(-2.0 * math.log(0.05))
"""Half axes of the ellipse that holds 95 % of a normal distribution in the plane, in standard deviations."""
SIZE_IN = (4.3, 3.5)
ARROW_MM = 45.0
WIDEST = 2.5
"""The picture grows with the uncertainty up to so many times the longer lever arm."""
CORNERS = ((-1, -1), (1, -1), (-1, 1), (1, 1))
DOTS = 800
"""Residuals that are drawn."""


@dataclass(frozen=True)
class _Seen:
    """What one sensor sees, on the page, mm."""

    center: Array
    shadow: Array
    ellipse: Array | None
    open: tuple[Array, ...]

    def extent(self) -> Array:
        points = [self.center, self.shadow, np.zeros(2), *(VIEW @ (ARROW_MM * v) for v in np.eye(3))]
        points += [VIEW @ (np.array(c) * HOUSING_MM / 2.0) for c in ((1, 1, 1), (1, -1, 1), (-1, 1, -1), (-1, -1, -1))]
        limit = max(1.0, WIDEST * float(np.linalg.norm(self.center)))
        if self.ellipse is not None:
            points += list(np.clip(self.ellipse, self.center - limit, self.center + limit))
        return np.array(points)


def center_picture(report: dict[str, Any], sensor: int) -> str | None:
    """The joint as sensor 1 or 2 sees it, both to the same scale; None while there is no centre."""
    center = report["center"]
    if center is None or center["in_sensor1_m"] is None:
        return None
    seen = [_seen(center, i) for i in (1, 2)]
    extents = [one.extent() for one in seen]
    half = max(float(np.ptp(extent[:, 0]) / SIZE_IN[0] * SIZE_IN[1]) for extent in extents) / 2.0
    half = 1.14 * max(half, *(float(np.ptp(extent[:, 1])) / 2.0 for extent in extents))
    extent, this = extents[sensor - 1], seen[sensor - 1]
    middle = (extent.min(axis=0) + extent.max(axis=0)) / 2.0
    figure = Figure(figsize=SIZE_IN, facecolor="none")
    panel: Axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set_axis_off()
    wide = half * SIZE_IN[0] / SIZE_IN[1]
    panel.set_xlim(middle[0] - wide, middle[0] + wide)
    panel.set_ylim(middle[1] - half, middle[1] + half)
    color = BLUE if sensor == 1 else VERMILLION
    point = 1e3 * np.array(center[f"in_sensor{sensor}_m"])
    _sensor(panel, half)
    _lever(panel, this, point, half, color)
    for direction in this.open:
        ends = np.stack([this.center - 4.0 * wide * direction, this.center + 4.0 * wide * direction])
        panel.plot(ends[:, 0], ends[:, 1], color=DARK, linewidth=1.3, linestyle=(0, (5, 3)), zorder=3)
    if this.ellipse is not None:
        panel.fill(this.ellipse[:, 0], this.ellipse[:, 1], color=color, alpha=0.3, linewidth=0.0, zorder=4)
        panel.plot(*this.ellipse.T, color=color, linewidth=0.8, zorder=4)
    panel.plot(*this.center, "o", color=color, markersize=6.5, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
    small = this.ellipse is not None and float(np.ptp(this.ellipse, axis=0).max()) < 0.16 * half
    bar, inset = _corners(this, middle, np.array([wide, half]), small)
    _scale_bar(panel, middle, (wide, half), right=bar[0] > 0)
    if small:
        _magnified(figure, this, color, inset)
    distance = float(np.linalg.norm(point))
    return inline_svg(figure, f"c{sensor}x", f"The joint centre in the frame of sensor {sensor}, {distance:.0f} mm away")


def _corners(seen: _Seen, middle: Array, size: Array, inset: bool) -> tuple[tuple[int, int], tuple[int, int]]:
    """A lower corner for the scale bar and another for the inset, so that the more crowded of the two is as free as can be."""
    bars = {corner: _room(seen, middle + np.array(corner) * size * [0.75, 0.9], size[1]) for corner in CORNERS[:2]}
    insets = {corner: _room(seen, middle + np.array(corner) * size * 0.72, size[1]) if inset else 9.0 for corner in CORNERS}
    pairs = [(bar, other) for bar in bars for other in insets if other != bar]
    # The inset is larger than the bar by about so much.
    return max(pairs, key=lambda pair: (min(bars[pair[0]] + 0.15, insets[pair[1]]), bars[pair[0]]))


def _room(seen: _Seen, at: Array, half: float) -> float:
    """How far a place keeps off all that is drawn, in half heights of the picture."""
    along = np.linspace(0.0, 1.0, 20)[:, None]
    drawn = [seen.extent(), along * seen.center, along * seen.shadow, seen.shadow + along * (seen.center - seen.shadow)]
    room = float(np.linalg.norm(np.vstack(drawn) - at, axis=1).min()) / half
    for direction in seen.open:
        # A dashed line may be covered, if it must be.
        off = at - seen.center
        room -= 0.2 * max(0.0, 1.0 - abs(float(off[0] * direction[1] - off[1] * direction[0])) / (0.3 * half))
    return room


def _seen(center: dict[str, Any], sensor: int) -> _Seen:
    point = 1e3 * np.array(center[f"in_sensor{sensor}_m"], dtype=np.float64)
    open_ = np.array(center["undetermined"], dtype=np.float64).reshape(-1, 6)
    block = slice(3 * sensor - 3, 3 * sensor)
    ellipse = None
    if center["covariance_m2"] is not None:
        covariance = 1e6 * np.array(center["covariance_m2"], dtype=np.float64)
        if np.isfinite(covariance).all():
            # Without the open directions: these are drawn as lines.
            across = np.eye(6) - open_.T @ open_
            on_page = VIEW @ (across @ covariance @ across)[block, block] @ VIEW.T
            values, vectors = np.linalg.eigh(on_page)
            turn = np.linspace(0.0, 2.0 * np.pi, 61)
            circle = np.stack([np.cos(turn), np.sin(turn)])
            ellipse = VIEW @ point + CHI_95 * (vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * circle)).T
    lines = tuple(VIEW @ d[block] / np.linalg.norm(d[block]) for d in open_ if float(np.linalg.norm(d[block])) > 0.2)
    return _Seen(VIEW @ point, VIEW @ (point * [1.0, 1.0, 0.0]), ellipse, lines)


def _line(panel: Axes, start: Array, stop: Array, **style: Any) -> None:
    panel.plot([start[0], stop[0]], [start[1], stop[1]], **style)


def _sensor(panel: Axes, half: float) -> None:
    """The housing as a box about the origin, its near faces shaded, and the axes of its frame."""
    for k, shade in ((2, "#EEEEEE"), (0, "#D9D9D9"), (1, "#E3E3E3")):
        i, j = [m for m in range(3) if m != k]
        face = np.zeros((4, 3))
        # x and z look at the reader from their positive side, y too.
        face[:, k] = 1.0
        face[:, i], face[:, j] = [-1, 1, 1, -1], [-1, -1, 1, 1]
        corners = (face * HOUSING_MM / 2.0) @ VIEW.T
        panel.fill(corners[:, 0], corners[:, 1], facecolor=shade, edgecolor="#AAAAAA", linewidth=0.8, zorder=1)
    for direction, name in zip(np.eye(3), "xyz", strict=True):
        length = max(ARROW_MM, 0.16 * half)
        tip = VIEW @ (length * direction)
        _line(panel, np.zeros(2), tip, color=PALE, linewidth=1.2, solid_capstyle="round", zorder=2)
        at = tip + 0.05 * half * tip / np.linalg.norm(tip)
        panel.text(at[0], at[1], name, fontsize=11, color="#555555", ha="center", va="center", zorder=2)


def _lever(panel: Axes, seen: _Seen, point: Array, half: float, color: str) -> None:
    """The lever arm with its length, and its shadow on the plane of x and y, which tells where in depth the joint is."""
    dotted: dict[str, Any] = {"color": color, "linewidth": 0.9, "linestyle": (0, (1, 1.5)), "zorder": 2}
    _line(panel, np.zeros(2), seen.shadow, **dotted)
    _line(panel, seen.shadow, seen.center, **dotted)
    _line(panel, np.zeros(2), seen.center, color=color, linewidth=2.0, solid_capstyle="round", zorder=5)
    aside = np.array([-seen.center[1], seen.center[0]])
    length = float(np.linalg.norm(aside))
    aside = np.array([0.0, 1.0]) if length < 1e-9 else aside / length
    if aside @ (seen.shadow - seen.center) > 0.0:
        aside = -aside
    at = 0.55 * seen.center + 0.1 * half * aside
    label = f"{np.linalg.norm(point):.0f} mm"
    box = {"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 1.0}
    panel.text(at[0], at[1], label, fontsize=10.5, color=color, fontweight="bold", ha="center", va="center", bbox=box, zorder=7)


def _scale_bar(panel: Axes, middle: Array, half: tuple[float, float], *, right: bool) -> None:
    length = _round_length(0.5 * half[1])
    left, low = middle[0] - 0.94 * half[0], middle[1] - 0.94 * half[1]
    left = middle[0] + 0.94 * half[0] - length if right else left
    panel.plot([left, left + length], [low, low], color=DARK, linewidth=2.2, solid_capstyle="butt", zorder=7)
    panel.text(left + length / 2.0, low + 0.03 * half[1], f"{length:g} mm", fontsize=9, color=DARK, ha="center", va="bottom")


def _magnified(figure: Figure, seen: _Seen, color: str, corner: tuple[int, int]) -> None:
    """An ellipse too small to be seen, on its own scale, in a corner."""
    if seen.ellipse is None:
        return
    size = 1.5 * float(np.abs(seen.ellipse - seen.center).max())
    if size < 1e-6:
        return
    place = (0.745 if corner[0] > 0 else 0.015, 0.685 if corner[1] > 0 else 0.02)
    inset: Axes = figure.add_axes((*place, 0.24, 0.24 * SIZE_IN[0] / SIZE_IN[1]))
    inset.set_xlim(-size, size)
    inset.set_ylim(-1.35 * size, 0.65 * size)
    inset.set_xticks([])
    inset.set_yticks([])
    inset.set_facecolor("white")
    for spine in inset.spines.values():
        spine.set_color(PALE)
    ring = 0.6 * (seen.ellipse - seen.center)
    for direction in seen.open:
        inset.plot(*np.stack([-4.0 * size * direction, 4.0 * size * direction]).T, color=DARK, linewidth=1.0, dashes=(5, 3))
    inset.fill(ring[:, 0], ring[:, 1], color=color, alpha=0.3, linewidth=0.0)
    inset.plot(*ring.T, color=color, linewidth=0.8)
    inset.plot(0.0, 0.0, "o", color=color, markersize=3.0)
    length = _round_length(1.2 * size / 0.6)
    inset.fill_between([-size, size], -1.35 * size, -0.8 * size, color="white", linewidth=0.0, zorder=3)
    bar = 0.6 * length / 2.0
    inset.plot([-bar, bar], [-1.2 * size, -1.2 * size], color=DARK, linewidth=1.8, solid_capstyle="butt", zorder=4)
    inset.text(0.0, -1.13 * size, f"{length:g} mm", fontsize=8, color=DARK, ha="center", va="bottom", zorder=4)


def _round_length(most: float) -> float:
    """1, 2 or 5 times a power of ten, at most this."""
    power = 10.0 ** math.floor(math.log10(max(most, 1e-9)))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most * (1.0 + 1e-9)))


def residual_picture(report: dict[str, Any]) -> str | None:
    """Residuals over time and their histogram; None where there are none."""
    center = report["center"]
    if center is None or center["residuals"] is None:
        return None
    time = clock_of(report)(center["residuals"]["time_s"])
    values = np.array(center["residuals"]["residual_m_s2"], dtype=np.float64)
    known = np.isfinite(values)
    if not known.any():
        return None
    time, values = time[known], values[known]
    std = center["residual_std_m_s2"]
    figure = Figure(figsize=(WIDTH_IN, 2.5), facecolor="none")
    widths = {"width_ratios": [2.6, 1.0], "wspace": 0.08, "left": 0.085, "right": 0.985, "top": 0.88, "bottom": 0.19}
    panels: list[Axes] = list(figure.subplots(1, 2, sharey=True, gridspec_kw=widths))
    for panel, heading in zip(panels, ("G  Residual over time", "H  Its histogram"), strict=True):
        panel.set_title(heading, loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=4)
        panel.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
        panel.axhline(0.0, color=PALE, linewidth=0.8, zorder=1)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
    # The limits are those of all but the strangest, which are set upon the edge.
    top = max(1.2 * float(np.quantile(np.abs(values), 0.995)), 3.3 * (std or 0.0), 1e-6)
    some = np.unique(np.linspace(0, len(values) - 1, DOTS).astype(int))
    panels[0].plot(time[some], np.clip(values[some], -top, top), ".", color=BLUE, markersize=2.6, zorder=2)
    panels[0].set_ylim(-1.03 * top, 1.03 * top)
    panels[0].set_ylabel("m/s²", fontsize=FONT, color=DARK)
    panels[0].set_xlabel("time since the start of the recording, " + clock_of(report).name, fontsize=FONT, color=DARK)
    panels[0].set_xlim(min(0.0, float(time.min())), max(clock_of(report).stop, float(time.max())))
    counts, edges = np.histogram(np.clip(values, -top, top), bins=41, range=(-top, top))
    panels[1].stairs(counts, edges, orientation="horizontal", fill=True, color=BLUE, alpha=0.45)
    if std:
        grid = np.linspace(-top, top, 121)
        normal = len(values) * (edges[1] - edges[0]) * np.exp(-0.5 * (grid / std) ** 2) / (std * math.sqrt(2.0 * math.pi))
        panels[1].plot(normal, grid, color=DARK, linewidth=1.0, linestyle=(0, (4, 2)))
    panels[1].set_xlim(left=0.0)
    panels[1].tick_params(labelleft=False)
    panels[1].set_xlabel("count", fontsize=FONT, color=DARK)
    return inline_svg(figure, "r", "Residual of the joint centre over time, and its histogram")
