"""The figures of the report, drawn from its plain data; no pyplot, no state that others see.

Colours are those of Okabe and Ito, told apart by all eyes; where colour carries a meaning, so does a line style, a hatch or a
place. Names from files stay out of the figures.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from imufast.decide import Verdict
from imufast.report.svg import inline_svg
from imufast.report.words import verdict_name

__all__ = ["FONT", "WIDTH_IN", "Clock", "clock_of", "timeline"]

Array = NDArray[np.float64]

BLUE, VERMILLION, GREEN, SKY, PURPLE, GREY, DARK = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#CC79A7", "#DDDDDD", "#333333"
YELLOW = "#F0E442"
VERDICTS: dict[Verdict, tuple[str, str]] = {
    Verdict.NOT_ENOUGH_INFORMATION: (GREY, ""),
    Verdict.HINGE: (GREEN, ""),
    Verdict.APPROXIMATE_HINGE: (SKY, "//"),
    Verdict.NOT_A_HINGE: (VERMILLION, "xx"),
    Verdict.MOUNTING_CHANGED: (PURPLE, ".."),
    Verdict.BALL_JOINT: (YELLOW, "oo"),
}
WIDTH_IN = 9.6
FONT = 9.0
LEAST_DEG = 0.01
"""Where curves of degrees end below, on their logarithmic scale."""
TICKS = 500
"""Places that the marks of selected samples may take."""


class Clock:
    """Time on the axis: from the start on, in a unit that suits the length."""

    def __init__(self, start_s: float, stop_s: float) -> None:
        span = max(stop_s - start_s, 1e-9)
        for name, seconds, longest in (
            ("s", 1.0, 300.0),
            ("min", 60.0, 18_000.0),
            ("h", 3600.0, 345_600.0),
            ("days", 86400.0, math.inf),
        ):
            self.name, self.seconds = name, seconds
            if span <= longest:
                break
        self.start_s, self.stop = start_s, span / self.seconds

    def __call__(self, time_s: object) -> Array:
        """Time since the start in `name`s."""
        values: Array = (np.array(time_s, dtype=np.float64) - self.start_s) / self.seconds
        return values


def clock_of(report: dict[str, Any]) -> Clock:
    """The clock of all figures of a report."""
    start = float(report["start_s"])
    stop = report["stop_s"] if report["stop_s"] is not None else start + 1.0
    return Clock(start, max(float(stop), start + 1e-9))


def timeline(report: dict[str, Any]) -> str:
    """Everything over the time of the recording, one panel below the other."""
    clock = clock_of(report)
    heights = [0.28, 1.25, 0.62, 0.62, 1.9, 1.35]
    figure = Figure(figsize=(WIDTH_IN, 9.6), facecolor="none")
    panels: list[Axes] = list(
        figure.subplots(
            len(heights),
            1,
            sharex=True,
            gridspec_kw={
                "height_ratios": heights,
                "hspace": 0.62,
                "left": 0.085,
                "right": 0.985,
                "top": 0.925,
                "bottom": 0.055,
            },
        )
    )
    titles = (
        "A  Verdict",
        "B  Excitation: rate of the joint about the axis"
        if not report["excitation"] or report["excitation"]["about_axis"]
        else "B  Excitation: angular rate of the faster sensor",
        "C  Time that the joint has moved",
        "D  Selected samples",
        "E  Uncertainty",
        "F  Misfit to a hinge",
    )
    for panel, heading in zip(panels, titles, strict=True):
        panel.set_title(heading, loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=4)
        panel.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
        for side in ("top", "right"):
            panel.spines[side].set_visible(False)
    history = report["history"]
    time = clock(history["time_s"])
    _verdicts(figure, panels[0], history, time, clock)
    _excitation(panels[1], report, clock)
    _moving(panels[2], history, time, clock)
    _selected(panels[3], report, clock)
    _uncertainty(panels[4], report, time, clock)
    _misfit(panels[5], report, time, clock)
    for panel in panels[1:]:
        for at in clock(report["mounting_changed_at_s"]):
            panel.axvline(at, color=PURPLE, linewidth=1.6, linestyle=(0, (4, 2)), zorder=1)
        if report["accepted_at_s"] is not None:
            panel.axvline(float(clock(report["accepted_at_s"])), color=GREEN, linewidth=1.4, zorder=1)
    panels[-1].set_xlim(0.0, clock.stop)
    panels[-1].set_xlabel(f"time since the start of the recording, {clock.name}", fontsize=FONT, color=DARK)
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    return inline_svg(
        figure, "t", "Verdict, excitation, selected samples, uncertainty and misfit over the time of the recording"
    )


def _verdicts(figure: Figure, panel: Axes, history: dict[str, Any], time: Array, clock: Clock) -> None:
    """A band of the verdicts; accepted stretches are underlined."""
    names, accepted = history["verdict"], history["accepted"]
    panel.set_yticks([])
    panel.set_ylim(-0.45, 1.0)
    panel.spines["left"].set_visible(False)
    ends = [*time[1:].tolist(), clock.stop]
    for start, stop in _runs(names):
        color, hatch = VERDICTS[Verdict(names[start])]
        span = 0.0 if start == 0 else float(time[start]), max(float(ends[stop]), float(time[stop]))
        panel.axvspan(*span, 0.31, 1.0, facecolor=color, hatch=hatch, edgecolor="white", linewidth=0.0)
    for start, stop in _runs(accepted):
        if accepted[start]:
            panel.axvspan(float(time[start]), float(ends[stop]), 0.0, 0.2, facecolor=DARK, linewidth=0.0)
    handles = [
        Patch(facecolor=color, hatch=hatch, edgecolor="white", linewidth=0.0, label=verdict_name(verdict))
        for verdict, (color, hatch) in VERDICTS.items()
        if verdict.value in names
    ]
    if any(accepted):
        handles.append(Patch(facecolor=DARK, label="accepted"))
    if handles:
        figure.legend(
            handles=handles,
            loc="upper right",
            bbox_to_anchor=(0.99, 0.995),
            ncols=len(handles),
            frameon=False,
            fontsize=FONT,
            handlelength=1.4,
            columnspacing=1.4,
        )
    else:
        _nothing(panel, "no estimate was made")


def _excitation(panel: Axes, report: dict[str, Any], clock: Clock) -> None:
    curve = report["excitation"]
    panel.set_ylabel("°/s", fontsize=FONT, color=DARK)
    if curve is None:
        _nothing(panel, "the sensors' data were not given to the report")
        return
    time = clock(curve["time_s"])
    rms, peak = (np.degrees(np.array(curve[name], dtype=np.float64)) for name in ("rms_rad_s", "peak_rad_s"))
    panel.fill_between(time, 0.0, peak, color=SKY, alpha=0.45, linewidth=0.0, label="largest")
    panel.plot(time, rms, color=BLUE, linewidth=1.0, label="rms")
    panel.set_ylim(bottom=0.0)
    _legend(panel)


def _moving(panel: Axes, history: dict[str, Any], time: Array, clock: Clock) -> None:
    panel.set_ylabel(clock.name, fontsize=FONT, color=DARK)
    moving = np.array(history["moving_s"], dtype=np.float64) / clock.seconds
    if not len(moving):
        _nothing(panel, "no estimate was made")
        return
    panel.fill_between(time, 0.0, moving, color=GREY, linewidth=0.0)
    panel.plot(time, moving, color=DARK, linewidth=1.0)
    panel.set_ylim(0.0, max(1.0 / clock.seconds, 1.08 * float(moving.max())))
    panel.yaxis.set_major_locator(MaxNLocator(3))


def _selected(panel: Axes, report: dict[str, Any], clock: Clock) -> None:
    panel.set_ylim(-0.55, 1.55)
    panel.set_yticks([1, 0], ["gyr", "acc"])
    panel.tick_params(axis="y", length=0)
    if not report["gyr_samples"]["count"] and not report["acc_samples"]["count"]:
        _nothing(panel, "the times of the samples were not kept")
        return
    for row, (kind, color) in enumerate((("acc_samples", VERMILLION), ("gyr_samples", BLUE))):
        places = np.unique(np.round(clock(report[kind]["time_s"]) / clock.stop * TICKS)) / TICKS * clock.stop
        panel.vlines(places, row - 0.38, row + 0.38, color=color, linewidth=0.9)


def _uncertainty(panel: Axes, report: dict[str, Any], time: Array, clock: Clock) -> None:
    history = report["history"]
    panel.set_yscale("log")
    panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
    top = 1.0
    for i, color in ((1, BLUE), (2, VERMILLION)):
        for name, style, width, label in (
            ("bound95", "-", 1.7, f"bound, sensor {i}"),
            ("published_bound", (0, (1, 1.2)), 1.2, f"μ + 2σ, sensor {i}"),
        ):
            values = np.array(history[f"{name}_{i}_deg"], dtype=np.float64)
            if np.isfinite(values).any():
                panel.plot(time, np.maximum(values, LEAST_DEG), color=color, linestyle=style, linewidth=width, label=label)
                top = max(top, float(np.nanmax(values)))
    change = np.array(history["change_deg"], dtype=np.float64)
    # A step that makes no new estimate changes nothing.
    new = np.isfinite(change) & (change > 0.0) & (change < 180.0)
    if new.any():
        top = max(top, float(change[new].max()))
        label = "change (SEQAD)"
        panel.plot(time[new], np.maximum(change[new], LEAST_DEG), ".", color=DARK, markersize=2.6, label=label, zorder=2)
    limit = report["bound_limit_deg"]
    if limit is not None:
        top = max(top, limit)
        panel.axhline(limit, color=DARK, linewidth=1.1, linestyle="--", zorder=1)
        panel.text(
            0.997,
            limit,
            f"limit {limit:g}°",
            fontsize=FONT - 0.5,
            color=DARK,
            ha="right",
            va="bottom",
            transform=panel.get_yaxis_transform(),
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.6},
        )
    panel.set_ylim(LEAST_DEG, 1.6 * top)
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    at = report["accepted_at_s"]
    if at is not None:
        x = float(clock(at))
        left = x > 0.6 * clock.stop
        panel.annotate(
            "accepted" if not left else "accepted ",
            (x, 1.6 * top),
            xytext=(-3 if left else 3, -3),
            textcoords="offset points",
            fontsize=FONT,
            color="#00694d",
            fontweight="bold",
            ha="right" if left else "left",
            va="top",
            bbox={"facecolor": "white", "alpha": 0.75, "linewidth": 0.0, "pad": 0.6},
        )
    _legend(panel)


def _misfit(panel: Axes, report: dict[str, Any], time: Array, clock: Clock) -> None:
    settings = report["settings"]
    limits = [settings["hinge_misfit"], settings["approximate_misfit"]] if settings else []
    values = np.array(report["history"]["misfit"], dtype=np.float64)
    finite = values[np.isfinite(values)]
    seen = finite[finite > 0.0]
    bottom = max(1e-3, min([0.005, *(0.6 * limit for limit in limits[:1] if limit), *(0.7 * seen)]))
    top = max([1.0, *(2.0 * limit for limit in limits), *(1.3 * finite)])
    panel.set_yscale("log")
    panel.set_ylim(bottom, top)
    if limits:
        _misfit_limits(panel, limits[0], limits[1], bottom, top)
    else:
        panel.minorticks_off()
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    if len(finite):
        panel.plot(time, np.maximum(values, bottom), color=DARK, linewidth=1.6)
    else:
        _nothing(panel, "the joint has not moved enough for a misfit")


def _misfit_limits(panel: Axes, low: float, high: float, bottom: float, top: float) -> None:
    """Bands of what each misfit means."""
    for start, stop, verdict in (
        (bottom, low, Verdict.HINGE),
        (low, high, Verdict.APPROXIMATE_HINGE),
        (high, top, Verdict.NOT_A_HINGE),
    ):
        if stop > start:
            panel.axhspan(start, stop, facecolor=VERDICTS[verdict][0], alpha=0.16, linewidth=0.0, zorder=0)
            panel.text(
                0.995,
                math.sqrt(start * stop),
                verdict_name(verdict),
                fontsize=FONT - 0.5,
                color=DARK,
                ha="right",
                va="center",
                transform=panel.get_yaxis_transform(),
            )
    for limit in (low, high):
        panel.axhline(limit, color=DARK, linewidth=1.0, linestyle="--", zorder=1)
    panel.set_yticks([low, high, 0.01, 1.0] if low > 0.015 else [low, high, 1.0])
    panel.minorticks_off()


def _runs(states: list[Any]) -> list[tuple[int, int]]:
    """First and last index of each stretch of equal states."""
    runs: list[tuple[int, int]] = []
    for i, state in enumerate(states):
        if runs and states[i - 1] == state:
            runs[-1] = runs[-1][0], i
        else:
            runs.append((i, i))
    return runs


def _nothing(panel: Axes, why: str) -> None:
    if panel.get_yscale() == "linear":
        panel.set_yticks([])
        panel.set_ylabel("")
    panel.text(
        0.5, 0.5, why, fontsize=FONT, color="#666666", style="italic", ha="center", va="center", transform=panel.transAxes
    )


def _legend(panel: Axes) -> None:
    """On the line of the panel's title, where no curve runs."""
    handles, _ = panel.get_legend_handles_labels()
    if handles:
        panel.legend(
            loc="lower right",
            bbox_to_anchor=(1.004, 0.99),
            ncols=len(handles),
            fontsize=FONT - 0.5,
            frameon=False,
            borderpad=0.1,
            handlelength=1.7,
            columnspacing=1.3,
        )
