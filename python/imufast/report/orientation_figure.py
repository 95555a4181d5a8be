"""The figures of a tracked orientation, drawn from the report's plain data."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from numpy.typing import NDArray

from imufast.report.axes_figure import BLUE, DARK, PALE, VERMILLION
from imufast.report.figures import FONT, GREEN, GREY, PURPLE, SKY, WIDTH_IN, Clock, clock_of
from imufast.report.svg import inline_svg

__all__ = ["histogram_picture", "orientation_timeline"]

Array = NDArray[np.float64]

LEAST_DEG = 0.01
LEAST_M_S2 = 0.005
"""Where logarithmic scales end."""


def orientation_timeline(report: dict[str, Any]) -> str | None:
    """Angle with its band, standard deviation, residual, what shows the heading and innovations, one below the other; None
    without curve."""
    if report["curve"] is None:
        return None
    clock = clock_of(report)
    drawn = [("A", 2.2, _angle), ("B", 1.5, _certainty)]
    if report["residual"] is not None:
        drawn.append(("C", 1.3, _residual))
    if report["heading"] is not None:
        drawn.append(("D", 1.3, _heading))
    if report["innovations"] is not None:
        drawn.append(("E", 1.3, _innovations))
    heights = [height for _, height, _ in drawn]
    size = 0.75 + 1.27 * sum(heights)
    figure = Figure(figsize=(WIDTH_IN, size), facecolor="none")
    grid = {"height_ratios": heights, "hspace": 0.34, "left": 0.085, "right": 0.985}
    grid |= {"top": 1.0 - 0.3 / size, "bottom": 0.52 / size}
    panels: list[Axes] = list(figure.subplots(len(drawn), 1, sharex=True, squeeze=False, gridspec_kw=grid)[:, 0])
    for panel, (letter, _, draw) in zip(panels, drawn, strict=True):
        _frame(panel)
        draw(panel, report, clock, letter)
        _marks(panel, report, clock)
        panel.tick_params(labelbottom=False)
    panels[-1].tick_params(labelbottom=True)
    panels[-1].set_xlim(0.0, clock.stop)
    panels[-1].set_xlabel(f"time since the start of the recording, {clock.name}", fontsize=FONT, color=DARK)
    return inline_svg(
        figure, "o", "Relative orientation, standard deviation, residual, observability and innovations over time"
    )


def histogram_picture(report: dict[str, Any]) -> str | None:
    """The histogram of the residual's channels beside the normal distribution; None where there is none."""
    residual = report["residual"]
    if residual is None or not residual["robust_std_m_s2"]:
        return None
    std = residual["robust_std_m_s2"]
    edges = np.array(residual["histogram"]["edges_m_s2"], dtype=np.float64)
    counts = np.array(residual["histogram"]["counts"], dtype=np.float64)
    density = counts / (counts.sum() * (edges[1] - edges[0]))
    figure = Figure(figsize=(WIDTH_IN, 2.1), facecolor="none")
    panel: Axes = figure.add_axes((0.085, 0.23, 0.9, 0.64))
    _frame(panel)
    _title(panel, "F  Residual of the link: histogram of its channels")
    panel.stairs(density, edges, fill=True, color=SKY, alpha=0.6, label="found")
    grid = np.linspace(edges[0], edges[-1], 241)
    normal = np.exp(-0.5 * (grid / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
    panel.plot(grid, normal, color=DARK, linewidth=1.1, linestyle=(0, (4, 2)), label="normal distribution of the same middle")
    panel.set_yscale("log")
    panel.set_ylim(0.4 * float(density[density > 0.0].min()), 2.0 * float(max(density.max(), normal.max())))
    panel.set_yticks([])
    panel.minorticks_off()
    panel.set_xlim(edges[0], edges[-1])
    panel.set_ylabel("density (log)", fontsize=FONT, color=DARK)
    panel.set_xlabel("m/s²", fontsize=FONT, color=DARK)
    _legend(panel)
    return inline_svg(figure, "h", "Histogram of the residual of the link")


def _angle(panel: Axes, report: dict[str, Any], clock: Clock, letter: str) -> None:
    curve = report["curve"]
    _title(
        panel, f"{letter}  {'Angle about the hinge axis' if curve['about_axis'] else 'Angle away from the mean orientation'}"
    )
    time, angle, std = (_with_breaks(curve[name], report) for name in ("time_s", "angle_deg", "band_std_deg"))
    time = clock(time)
    low, high = angle - 2.0 * std, angle + 2.0 * std
    if not curve["about_axis"]:
        low = np.maximum(low, 0.0)
    panel.fill_between(time, low, high, color=SKY, alpha=0.5, linewidth=0.0, label="± 2 standard deviations")
    panel.plot(time, angle, color=BLUE, linewidth=0.9, label="angle")
    # A band of half a turn says nothing, and must not flatten the curve.
    known = np.isfinite(angle)
    if known.any():
        bottom, top = float(angle[known].min()), float(angle[known].max())
        room = max(0.08 * (top - bottom), min(2.2 * float(np.nanmax(std)), 0.6 * (top - bottom) + 5.0), 0.5)
        panel.set_ylim(bottom - room if curve["about_axis"] else max(0.0, bottom - room), top + room)
    panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
    _legend(panel)


def _certainty(panel: Axes, report: dict[str, Any], clock: Clock, letter: str) -> None:
    curve = report["curve"]
    _title(panel, f"{letter}  Stated standard deviation")
    time, std = _with_breaks(curve["time_s"], report), _with_breaks(curve["angle_std_deg"], report)
    panel.set_yscale("log")
    values = np.maximum(std, LEAST_DEG)
    panel.plot(clock(time), values, color=DARK, linewidth=1.2)
    known = values[np.isfinite(values)]
    bottom, top = (float(known.min()), float(known.max())) if len(known) else (0.1, 10.0)
    if top > 0.4 * report["vague_deg"]:
        bottom, top = min(bottom, report["vague_deg"]), max(top, report["vague_deg"])
        panel.axhline(report["vague_deg"], color=VERMILLION, linewidth=1.0, linestyle="--", zorder=1)
        _aside(panel, report["vague_deg"], f"vague above {report['vague_deg']:g}°")
    _decades(panel, bottom, top)
    panel.set_ylabel("degrees", fontsize=FONT, color=DARK)


def _residual(panel: Axes, report: dict[str, Any], clock: Clock, letter: str) -> None:
    residual = report["residual"]
    _title(panel, f"{letter}  Residual of the link: how far apart both sensors see the joint's acceleration")
    time = clock(residual["time_s"])
    rms, peak = (np.array(residual[name], dtype=np.float64) for name in ("rms", "peak"))
    panel.fill_between(time, 0.0, peak, color=SKY, alpha=0.5, linewidth=0.0, label="largest")
    panel.plot(time, rms, color=BLUE, linewidth=1.0, label="rms")
    seen = peak[np.isfinite(peak)]
    # The strangest instants may leave the picture.
    panel.set_ylim(0.0, max(1.08 * min(float(seen.max()), 3.0 * float(np.quantile(seen, 0.98))), 1e-6))
    panel.set_ylabel("m/s²", fontsize=FONT, color=DARK)
    _legend(panel)


def _heading(panel: Axes, report: dict[str, Any], clock: Clock, letter: str) -> None:
    heading = report["heading"]
    _title(
        panel, f"{letter}  What shows the heading: horizontal acceleration of the joint, rms over {heading['window_s']:.3g} s"
    )
    values = np.maximum(np.array(heading["horizontal_acc_rms_m_s2"], dtype=np.float64), LEAST_M_S2)
    panel.set_yscale("log")
    alone = np.isfinite(values).sum() < 3
    panel.plot(clock(heading["time_s"]), values, "o-" if alone else "-", color=GREEN, linewidth=1.5, markersize=4)
    known = values[np.isfinite(values)]
    bottom, top = (float(known.min()), float(known.max())) if len(known) else (0.1, 10.0)
    needed = heading["needed_m_s2"]
    if needed is not None:
        bottom, top = min(bottom, needed), max(top, needed)
        panel.axhline(needed, color=VERMILLION, linewidth=1.0, linestyle="--", zorder=1)
        _aside(panel, needed, f"shows it to {heading['needed_for_deg']:g}°")
    _decades(panel, bottom, top)
    panel.set_ylabel("m/s²", fontsize=FONT, color=DARK)


def _innovations(panel: Axes, report: dict[str, Any], clock: Clock, letter: str) -> None:
    health = report["innovations"]
    what = "Residuals of the link" if health["kind"] == "residual" else "Innovations"
    over = f"mean over {health['over_s']:.2g} s"
    _title(panel, f"{letter}  {what}, squared and normalised: as large as they are stated to be? ({over})")
    panel.set_yscale("log")
    values = np.maximum(np.array(health["mean_over_time"], dtype=np.float64), 0.1 * health["nominal"])
    alone = np.isfinite(values).sum() < 3
    panel.plot(clock(health["time_s"]), values, "o-" if alone else "-", color=BLUE, linewidth=1.2, markersize=4)
    panel.axhline(health["nominal"], color=VERMILLION, linewidth=1.0, linestyle="--", zorder=1)
    _aside(panel, health["nominal"], f"as stated: {health['nominal']:g}")
    known = values[np.isfinite(values)]
    _decades(panel, min(float(known.min()), health["nominal"]), max(float(known.max()), health["nominal"]))


def _with_breaks(values: Any, report: dict[str, Any]) -> Array:
    """The values with a NaN inside each gap, so that no line crosses it."""
    array = np.array(values, dtype=np.float64)
    time = np.array(report["curve"]["time_s"], dtype=np.float64)
    starts = np.array([span[0] for span in report["gaps_s"]["spans"]], dtype=np.float64)
    return np.insert(array, np.unique(np.searchsorted(time, starts, side="right")), np.nan) if len(starts) else array


def _marks(panel: Axes, report: dict[str, Any], clock: Clock) -> None:
    """Gaps are grey; stretches in which a filter looked for its start are hatched, their ends lines."""
    for start, stop in report["gaps_s"]["spans"]:
        panel.axvspan(*clock([start, stop]), facecolor=GREY, alpha=0.9, linewidth=0.0, zorder=0)
    for start, stop in report["starts_s"]["spans"]:
        left, right = clock([start, stop])
        panel.axvspan(left, right, facecolor=PURPLE, alpha=0.2, linewidth=0.0, zorder=0)
        if right < 0.999 * clock.stop:
            panel.axvline(right, color=PURPLE, linewidth=1.2, linestyle=(0, (4, 2)), zorder=1)


def _frame(panel: Axes) -> None:
    panel.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    panel.grid(axis="y", color=PALE, alpha=0.25, linewidth=0.6)
    panel.set_axisbelow(True)


def _title(panel: Axes, text: str) -> None:
    panel.set_title(text, loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=4)


def _decades(panel: Axes, bottom: float, top: float) -> None:
    """A logarithmic scale of at least a factor of ten, with numbers to read at 1, 2 and 5."""
    middle = float(np.sqrt(bottom * top))
    bottom, top = min(0.75 * bottom, middle / 3.2), max(1.35 * top, 3.2 * middle)
    many = top / bottom > 300.0
    ticks = [base * 10.0**power for power in range(-6, 7) for base in ((1.0,) if many else (1.0, 2.0, 5.0))]
    panel.set_yticks([tick for tick in ticks if bottom <= tick <= top])
    panel.minorticks_off()
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.set_ylim(bottom, top)


def _aside(panel: Axes, at: float, text: str) -> None:
    panel.text(
        0.997,
        at,
        text,
        fontsize=FONT - 0.5,
        color="#a34700",
        ha="right",
        va="bottom",
        transform=panel.get_yaxis_transform(),
        bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.6},
    )


def _legend(panel: Axes) -> None:
    panel.legend(
        loc="lower right",
        bbox_to_anchor=(1.004, 0.99),
        ncols=3,
        fontsize=FONT - 0.5,
        frameon=False,
        borderpad=0.1,
        handlelength=1.7,
        columnspacing=1.3,
    )
