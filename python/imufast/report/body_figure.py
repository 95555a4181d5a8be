"""The figures of a lower body's report, drawn from its plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from imufast.report.axes_figure import PALE
from imufast.report.figures import BLUE, DARK, FONT, GREEN, GREY, PURPLE, VERMILLION, WIDTH_IN, Clock
from imufast.report.svg import inline_svg

__all__ = [
    "SIDE_COLOURS",
    "chains",
    "close_picture",
    "draw_sticks",
    "flexion_picture",
    "heading_picture",
    "history_picture",
    "lengths_picture",
    "stick_picture",
]

Array = NDArray[np.float64]

SIDE_COLOURS = {"right": BLUE, "left": VERMILLION}
LINES = {"right": "-", "left": (0, (3.2, 1.1))}
MARKS = {"hip": "-", "knee": (0, (5, 1.2)), "ankle": (0, (1.2, 1.2))}
LEAST_HEADING_DEG = 0.1


def flexion_picture(report: dict[str, Any], clock: Clock) -> str:
    """Flexion of hips, knees and ankles over the whole recording, both sides in one panel."""
    kinds = [kind for kind in ("hip", "knee", "ankle") if any(a["kind"] == kind for a in report["angles"])]
    height = 1.55 * len(kinds) + 0.75
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="none")
    grid = {"hspace": 0.36, "left": 0.065, "right": 0.985, "top": 1.0 - 0.32 / height, "bottom": 0.5 / height}
    panels = list(figure.subplots(len(kinds), 1, sharex=True, squeeze=False, gridspec_kw=grid)[:, 0])
    for panel, kind in zip(panels, kinds, strict=True):
        _style(panel, f"{kind.capitalize()} {'dorsiflexion' if kind == 'ankle' else 'flexion'}")
        both = [angles for angles in report["angles"] if angles["kind"] == kind]
        for angles in both:
            time = _broken(angles["time_s"], angles["time_s"], report)
            values, std = (_broken(angles[name][0], angles["time_s"], report) for name in ("angles_deg", "std_deg"))
            _curve(panel, clock(time), values, std, angles["side"])
        _limits(panel, [(a["angles_deg"][0], a["std_deg"][0]) for a in both])
        _gaps(panel, report, clock)
        panel.axvspan(*clock(report["close_s"]), facecolor=PALE, alpha=0.13, linewidth=0.0, zorder=0)
        panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
        panel.tick_params(labelbottom=panel is panels[-1])
    _legend(panels[0])
    panels[-1].set_xlim(0.0, clock.stop)
    panels[-1].set_xlabel(f"time since the start of the recording, {clock.name}", fontsize=FONT, color=DARK)
    return inline_svg(figure, "f", "Flexion of hips, knees and ankles over time, both sides, with bands")


def close_picture(report: dict[str, Any], clock: Clock) -> str:
    """All angles from near: a row a joint, a column an angle."""
    close = report["close"]
    kinds = [kind for kind in ("hip", "knee", "ankle") if any(a["kind"] == kind for a in close["angles"])]
    titles = {angles["kind"]: angles["titles"] for angles in report["angles"]}
    height = 1.6 * len(kinds) + 0.95
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="none")
    grid = {"hspace": 0.42, "wspace": 0.2, "left": 0.065, "right": 0.985, "top": 1.0 - 0.5 / height, "bottom": 0.5 / height}
    rows = figure.subplots(len(kinds), 3, sharex=True, squeeze=False, gridspec_kw=grid)
    for row, kind in zip(rows, kinds, strict=True):
        for k, panel in enumerate(row):
            _style(panel, f"{kind.capitalize()}: {titles[kind][k].lower()}")
            both = [angles for angles in close["angles"] if angles["kind"] == kind]
            for angles in both:
                time = _broken(close["time_s"], close["time_s"], report)
                values, std = (_broken(angles[name][k], close["time_s"], report) for name in ("angles_deg", "std_deg"))
                _curve(panel, clock(time), values, std, angles["side"])
            _limits(panel, [(a["angles_deg"][k], a["std_deg"][k]) for a in both], least=10.0)
            panel.set_xlim(*clock(report["close_s"]))
            if k == 0:
                panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
    for panel in rows[-1]:
        panel.set_xlabel(f"time, {clock.name}", fontsize=FONT, color=DARK)
    _legend(rows[0][2], above=1.12)
    return inline_svg(figure, "n", "All angles of hips, knees and ankles in eight seconds, both sides, with bands")


def stick_picture(report: dict[str, Any], clock: Clock) -> str:
    """The subject at a few moments, from the right and from behind."""
    figures = report["figures"]
    points = {name: np.array(place) for name, place in figures["points_m"].items()}
    every = np.stack(list(points.values()))
    top = float(every[:, :, 2].max()) + 0.03
    # From the right: ahead is to the right of the picture; from behind: the subject's right is.
    views = (("Seen from the right", 1), ("Seen from behind", 0))
    widest = max(float(np.ptp(every[:, :, axis], axis=0).max()) for _, axis in views)
    pitch = max(widest + 0.12, 0.55 * top)
    middles = {axis: 0.5 * (every[:, :, axis].max(axis=0) + every[:, :, axis].min(axis=0)) for _, axis in views}
    count, lines = len(figures["time_s"]), chains(figures)
    # One scale for all, inches a metre.
    scale = min(WIDTH_IN * 0.97 / (count * pitch), 2.6 / top)
    head, foot = 0.3, 0.32
    height = 2.0 * (top * scale + head) + foot
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="none")
    for row, (title, axis) in enumerate(views):
        bottom = foot + (1 - row) * (top * scale + head)
        panel = figure.add_axes((0.015, bottom / height, 0.97, top * scale / height))
        panel.set_axis_off()
        panel.set_title(title, loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=5)
        across = WIDTH_IN * 0.97 / scale
        panel.set_xlim(-0.5 * across, 0.5 * across)
        panel.set_ylim(0.0, top)
        panel.axhline(0.0, color=PALE, linewidth=1.2, zorder=1, clip_on=False)
        for k in range(count):
            at = (k - 0.5 * (count - 1)) * across / count - middles[axis][k]
            draw_sticks(panel, {name: place[k] for name, place in points.items()}, lines, axis, at)
            if row == 1:
                moment = f"{float(clock(figures['time_s'][k])):.4g} {clock.name}"
                panel.text(at + middles[axis][k], -0.05, moment, ha="center", va="top", fontsize=FONT - 0.5, color=DARK)
        if row == 0:
            for side, colour in SIDE_COLOURS.items():
                panel.plot([], [], color=colour, linewidth=2.2, label=side)
            _legend(panel)
    return inline_svg(figure, "s", "Stick figures of pelvis and legs at a few moments, from the right and from behind")


def chains(drawn: Mapping[str, Any]) -> list[tuple[list[str], str]]:
    """Lines of one stroke: names of points, and "right", "left", "torso" or, of what is assumed, "right:" and "left:"."""
    bones, assumed = {tuple(ends) for ends in drawn["bones"].values()}, set(drawn["assumed"])
    found: list[tuple[list[str], str]] = []
    for side in SIDE_COLOURS:
        names = [f"{joint}_{side}" for joint in ("hip", "knee", "ankle", "toe")]
        for ends in pairwise(names):
            kind = side + ":" * bool(assumed & set(ends))
            if ends not in bones:
                continue
            if found and found[-1][1] == kind and found[-1][0][-1] == ends[0]:
                found[-1][0].append(ends[1])
            else:
                found.append((list(ends), kind))
    torso = [name for name in ("hip_left", "lumbar", "hip_right") if any(name in ends for ends in bones if "lumbar" in ends)]
    return [*found, ([*torso, *torso[:1]], "torso")] if torso else found


def draw_sticks(
    panel: Axes, points: Mapping[str, Array], lines: Sequence[tuple[list[str], str]], axis: int, at: float = 0.0
) -> list[Line2D]:
    """One stick figure, a line a chain: places (3,) by name, `chains`, which axis goes to the right, and where."""
    made: list[Line2D] = []
    for names, kind in lines:
        side = kind.rstrip(":")
        across, up = [at + points[name][axis] for name in names], [points[name][2] for name in names]
        made += panel.plot(
            across,
            up,
            color=SIDE_COLOURS.get(side, DARK),
            linestyle=":" if kind.endswith(":") else "-",
            linewidth=1.4 if kind == "torso" else 2.4,
            solid_capstyle="round",
            solid_joinstyle="round",
            marker="o",
            markersize=4.4,
            # Joints alone have a dot.
            markevery=[k for k, name in enumerate(names) if kind != "torso" and not name.startswith("toe")],
            # From the right the right leg is in front.
            zorder=3 if side == "right" else 2,
            clip_on=False,
        )
    return made


def lengths_picture(report: dict[str, Any]) -> str:
    """How far lengths come out from what is expected."""
    lengths = report["lengths"]
    height = 0.3 * len(lengths) + 0.6
    figure = Figure(figsize=(WIDTH_IN, height), facecolor="none")
    panel = figure.add_axes((0.14, 0.47 / height, 0.835, 1.0 - 0.52 / height))
    _style(panel, "")
    panel.grid(axis="y", visible=False)
    panel.axvline(0.0, color=DARK, linewidth=0.8, zorder=2)
    for k, length in enumerate(lengths):
        spread = 100.0 * length["expected_std_m"]
        panel.barh(-k, 4.0 * spread, left=-2.0 * spread, height=0.6, color=GREY, zorder=1)
        colour = SIDE_COLOURS.get(length["name"].split()[0], GREEN)
        value, std = 100.0 * (length["length_m"] - length["expected_m"]), 100.0 * (length["std_m"] or 0.0)
        panel.errorbar(value, -k, xerr=2.0 * std, color=colour, fmt="o", markersize=4.5, capsize=3.0, linewidth=1.4, zorder=3)
    panel.set_yticks([-k for k in range(len(lengths))], [length["name"] for length in lengths], fontsize=FONT)
    panel.set_ylim(-len(lengths) + 0.4, 0.6)
    panel.set_xlabel("found, less what is expected, cm", fontsize=FONT, color=DARK)
    return inline_svg(figure, "l", "Lengths as found with bands, less what is expected")


def heading_picture(report: dict[str, Any], clock: Clock) -> str:
    """How certain the heading of each joint is, over time."""
    figure = Figure(figsize=(WIDTH_IN, 2.6), facecolor="none")
    panel = figure.add_axes((0.065, 0.17, 0.92, 0.68))
    _style(panel, "Heading: standard deviation")
    for name, joint in report["joints"].items():
        kind, _, side = name.partition("_")
        time = _broken(joint["time_s"], joint["time_s"], report)
        std = np.maximum(_broken(joint["heading_std_deg"], joint["time_s"], report), LEAST_HEADING_DEG)
        panel.plot(clock(time), std, color=SIDE_COLOURS[side], linestyle=MARKS[kind], linewidth=1.1, label=joint["name"])
    panel.set_yscale("log")
    panel.set_ylim(LEAST_HEADING_DEG, max(panel.get_ylim()[1], 1.5 * report["unseen_deg"]))
    panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.yaxis.set_minor_formatter(NullFormatter())
    panel.axhline(report["unseen_deg"], color=DARK, linewidth=0.8, linestyle="--")
    _gaps(panel, report, clock)
    panel.set_xlim(0.0, clock.stop)
    panel.set_xlabel(f"time since the start of the recording, {clock.name}", fontsize=FONT, color=DARK)
    panel.set_ylabel("degrees", fontsize=FONT, color=DARK)
    _legend(panel, columns=6)
    return inline_svg(figure, "h", "Standard deviation of each joint's heading over time")


def history_picture(report: dict[str, Any]) -> str:
    """Cost above the last one, promised fall and damping, system by system."""
    history = report["history"]
    number = np.arange(1, len(history["cost"]) + 1)
    numbers = {name: np.array(history[name], dtype=np.float64) for name in ("cost", "tried", "promised", "damping")}
    taken = np.array(history["taken"], dtype=bool)
    best = float(np.nanmin(np.concatenate([numbers["cost"], numbers["tried"]])))
    figure = Figure(figsize=(WIDTH_IN, 2.5), facecolor="none")
    panel = figure.add_axes((0.075, 0.18, 0.86, 0.68))
    _style(panel, "")
    # What is reached is drawn at the tolerance: a logarithm knows no zero.
    least = max(float(report["settings"]["tolerance"]), 1e-6)
    after = np.maximum(numbers["tried"] - best, least)
    panel.plot(number, np.maximum(numbers["cost"] - best, least), color=DARK, linewidth=1.2, label="cost above the lowest")
    panel.plot(number[taken], after[taken], "o", color=GREEN, markersize=4.0, label="step taken")
    panel.plot(number[~taken], after[~taken], "x", color=VERMILLION, markersize=5.0, label="step refused")
    panel.plot(number, np.maximum(numbers["promised"], least), color=BLUE, linewidth=1.0, linestyle="--", label="promised fall")
    panel.set_yscale("log")
    other = panel.twinx()
    other.plot(number, numbers["damping"], color=PURPLE, linewidth=1.0, linestyle=":", label="damping (right)")
    other.set_yscale("log")
    other.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
    for side in ("top", "left", "bottom"):
        other.spines[side].set_visible(False)
    panel.set_xlim(0.5, len(number) + 0.5)
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.set_xlabel("linear system", fontsize=FONT, color=DARK)
    panel.set_ylabel("log-likelihood", fontsize=FONT, color=DARK)
    panel.plot([], [], color=PURPLE, linewidth=1.0, linestyle=":", label="damping (right)")
    _legend(panel, columns=5)
    return inline_svg(figure, "i", "Cost, promised fall and damping over the search")


def _style(panel: Axes, title: str) -> None:
    panel.tick_params(labelsize=FONT - 0.5, colors=DARK, length=3)
    for side in ("top", "right"):
        panel.spines[side].set_visible(False)
    panel.grid(axis="y", color=PALE, alpha=0.25, linewidth=0.6)
    panel.set_axisbelow(True)
    panel.set_title(title, loc="left", fontsize=FONT + 0.5, fontweight="bold", color=DARK, pad=4)


def _curve(panel: Axes, time: Array, values: Array, std: Array, side: str) -> None:
    colour = SIDE_COLOURS[side]
    panel.fill_between(time, values - 2.0 * std, values + 2.0 * std, color=colour, alpha=0.2, linewidth=0.0)
    panel.plot(time, values, color=colour, linestyle=LINES[side], linewidth=1.0, label=side)


def _limits(panel: Axes, curves: list[tuple[Any, Any]], least: float = 1.0) -> None:
    """Room for the curves; a band of half a turn says nothing, and must not flatten them."""
    values = np.concatenate([np.array(value, dtype=np.float64) for value, _ in curves])
    stds = np.concatenate([np.array(std, dtype=np.float64) for _, std in curves])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    widest = float(np.nanmax(stds)) if np.isfinite(stds).any() else 0.0
    room = max(0.06 * (high - low), min(2.2 * widest, 0.6 * (high - low) + 5.0), 0.5 * (least - high + low), 0.5)
    panel.set_ylim(low - room, high + room)
    panel.axhline(0.0, color=DARK, linewidth=0.6, zorder=1)


def _legend(panel: Axes, columns: int = 2, above: float = 0.985) -> None:
    panel.legend(
        loc="lower right",
        bbox_to_anchor=(1.004, above),
        ncols=columns,
        fontsize=FONT - 0.5,
        frameon=False,
        borderpad=0.1,
        handlelength=2.2,
        columnspacing=1.2,
    )


def _gaps(panel: Axes, report: dict[str, Any], clock: Clock) -> None:
    for start, stop in report["gaps_s"]["spans"]:
        panel.axvspan(*clock([start, stop]), facecolor=GREY, alpha=0.9, linewidth=0.0, zorder=0)


def _broken(values: Any, time_s: Any, report: dict[str, Any]) -> Array:
    """The values with a NaN inside each gap, so that no line crosses it."""
    array, time = np.array(values, dtype=np.float64), np.array(time_s, dtype=np.float64)
    starts = np.array([span[0] for span in report["gaps_s"]["spans"]], dtype=np.float64)
    return np.insert(array, np.unique(np.searchsorted(time, starts, side="right")), np.nan) if len(starts) else array
