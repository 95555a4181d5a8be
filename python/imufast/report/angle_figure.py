"""Joint angles with their bands, drawn from plain data: in the report, and as a picture of its own."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imufast.files import replacing
from imufast.report.axes_figure import BLUE, DARK, PALE
from imufast.report.figures import FONT, GREY, PURPLE, SKY, WIDTH_IN, Clock
from imufast.report.svg import inline_svg

if TYPE_CHECKING:
    from imufast.angles import JointAngles

__all__ = ["angle_figure", "angle_picture", "save_figure"]

Array = NDArray[np.float64]

MOST_POINTS = 8000
"""Samples that a picture of its own shows, extremes among them."""
DPI = 160


def angle_picture(plain: dict[str, Any], clock: Clock) -> str:
    """The figure as SVG for the report."""
    return inline_svg(angle_figure(plain, clock), "j", "Joint angles over time with bands of two standard deviations")


def save_figure(angles: JointAngles, path: str | os.PathLike[str], suffix: str, title: str | None) -> None:
    """The figure as a PNG or SVG file, whole or not at all."""
    from imufast.report.angle_content import angles_plain

    clock = Clock(float(angles.time_s[0]), float(angles.time_s[-1]))
    figure = angle_figure(angles_plain(angles, MOST_POINTS), clock, title)
    figure.set_facecolor("white")
    # Without a date, and with ids that no chance chooses, the same angles give the same bytes.
    about = {"Date": None} if suffix == ".svg" else {"Software": "imufast"}
    with replacing(path) as file, rc_context({"svg.hashsalt": "imufast"}):
        figure.savefig(file, format=suffix[1:], dpi=DPI, metadata=about)


def angle_figure(plain: dict[str, Any], clock: Clock, title: str | None = None) -> Figure:
    """One panel an angle, one below the other."""
    count = len(plain["names"])
    height = (2.35 if count == 1 else 1.75) * count + 0.75 + 0.25 * (title is not None)
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="none")
    top = 1.0 - (0.3 + 0.25 * (title is not None)) / height
    grid = {"hspace": 0.34, "left": 0.085, "right": 0.985, "top": top, "bottom": 0.52 / height}
    panels: list[Axes] = list(figure.subplots(count, 1, sharex=True, squeeze=False, gridspec_kw=grid)[:, 0])
    for k, panel in enumerate(panels):
        _panel(panel, plain, k, clock)
        panel.tick_params(labelbottom=k == count - 1)
    panels[-1].set_xlim(0.0, clock.stop)
    panels[-1].set_xlabel(f"time since the start of the recording, {clock.name}", fontsize=FONT, color=DARK)
    if title is not None:
        # A dollar sign would start a formula.
        figure.suptitle(title.replace("$", r"\$"), x=0.085, y=0.99, ha="left", va="top", fontsize=FONT + 2.0, color=DARK)
    return figure


def _panel(panel: Axes, plain: dict[str, Any], k: int, clock: Clock) -> None:
    panel.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    panel.grid(axis="y", color=PALE, alpha=0.25, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.set_title(plain["titles"][k], loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=4)
    time = _broken(plain["time_s"], plain)
    angle, std = _broken(plain["angles_deg"][k], plain), _broken(plain["std_deg"][k], plain)
    time = clock(time)
    panel.axhline(0.0, color=DARK, linewidth=0.7, zorder=1)
    panel.fill_between(time, angle - 2.0 * std, angle + 2.0 * std, color=SKY, alpha=0.45, linewidth=0.0, label="± 2 std")
    panel.plot(time, angle, color=BLUE, linewidth=0.9, label="angle")
    known = np.isfinite(angle)
    if known.any():
        # A band of half a turn says nothing, and must not flatten the curve.
        low, high = float(np.nanmin(angle)), float(np.nanmax(angle))
        room = max(0.06 * (high - low), min(2.2 * float(np.nanmax(std)), 0.6 * (high - low) + 5.0), 0.5)
        panel.set_ylim(low - room, high + room)
    for start, stop in plain["gaps_s"]["spans"]:
        panel.axvspan(*clock([start, stop]), facecolor=GREY, alpha=0.9, linewidth=0.0, zorder=0)
    for start, stop in plain["gimbal_lock_s"]["spans"]:
        panel.axvspan(*clock([start, stop]), facecolor=PURPLE, alpha=0.35, linewidth=0.0, zorder=0)
    panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
    panel.legend(
        loc="lower right",
        bbox_to_anchor=(1.004, 0.99),
        ncols=2,
        fontsize=FONT - 0.5,
        frameon=False,
        borderpad=0.1,
        handlelength=1.7,
        columnspacing=1.3,
    )


def _broken(values: Any, plain: dict[str, Any]) -> Array:
    """The values with a NaN inside each gap, so that no line crosses it."""
    array, time = np.array(values, dtype=np.float64), np.array(plain["time_s"], dtype=np.float64)
    starts = np.array([span[0] for span in plain["gaps_s"]["spans"]], dtype=np.float64)
    return np.insert(array, np.unique(np.searchsorted(time, starts, side="right")), np.nan) if len(starts) else array
