"""A lower body as a moving stick figure: `.gif`, `.mp4` by ffmpeg, and `.rrd` for the rerun viewer."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from imufast.body.result import LowerBody
from imufast.body.skeleton import skeleton
from imufast.errors import ImufastError, InputError
from imufast.files import check_target, replacing
from imufast.imu import GAP_STEPS
from imufast.report.body_content import liveliest
from imufast.report.rerun_file import check_rerun, write_rerun

__all__ = ["ANIMATION_FORMATS", "check_animation_target", "write_animation"]

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

ANIMATION_FORMATS = (".gif", ".mp4", ".rrd")
RATES_HZ = {".gif": 10.0, ".mp4": 25.0, ".rrd": 50.0}
LONGEST_S = 60.0
"""Shown where no span is told."""
WIDTH_PX, HEIGHT_PX = 720, 440
MOST_COLOURS, APART = 64, 8
NO_FFMPEG = "an .mp4 needs ffmpeg: install it, or pip install 'imufast[animate]'; a .gif needs neither"


def write_animation(
    body: LowerBody,
    path: str | os.PathLike[str],
    *,
    title: str | None = None,
    span_s: tuple[float, float] | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> None:
    """Draw the subject as a stick figure over time, in real time, from the right and from behind, as a `.gif` or `.mp4` file,
    or, to turn about, with all angles as an `.rrd` file for the rerun viewer; whole or not at all. Between the estimate's
    moments places are drawn on smooth curves; stretches without samples are left out.

    Args:
        body: what `estimate_lower_body` gave.
        path: the file to write; an existing one is replaced.
        title: above the figure, or what the viewer calls it. Default None: none.
        span_s: first and last time, s since the start. Default None: all, of more than a minute the liveliest minute.
        progress: called with (frames drawn, frames in all); may raise to stop. Default None.

    Raises:
        InputError: not a LowerBody, another end of the name, a span outside the recording, or a path that cannot be written.
        ImufastError: the extra `report` is not installed; of an `.mp4` there is no ffmpeg, or it fails; or of an `.rrd` the
            extra `rerun` is not installed.
    """
    if not isinstance(body, LowerBody):
        raise InputError(f"body must be a LowerBody, what estimate_lower_body gave, got {type(body).__name__}")
    if title is not None and not isinstance(title, str):
        raise InputError(f"title must be a text or None, got {type(title).__name__}")
    suffix = check_animation_target(path)
    times = _times(body, span_s, RATES_HZ[suffix])
    if suffix == ".rrd":
        drawn = skeleton(body)
        places = {name: _smooth(body.time_s, place, times) for name, place in drawn.points.items()}
        with replacing(path) as file:
            write_rerun(body, drawn, places, times, file.name, title, progress)
        return
    frames = _frames(body, times, title, progress)
    with replacing(path) as file:
        if suffix == ".gif":
            _gif(frames, file, RATES_HZ[suffix])
        else:
            _mp4(frames, file, RATES_HZ[suffix])


def check_animation_target(path: str | os.PathLike[str], name: str = "path") -> str:
    """The format that the name of the file asks for, one of `ANIMATION_FORMATS`.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `report` is not installed, of an `.mp4` there is no ffmpeg, or of an `.rrd` no rerun-sdk.
    """
    from imufast.report.page import check_extra

    check_target(path, name)
    suffix = Path(path).suffix.lower()
    if suffix not in ANIMATION_FORMATS:
        raise InputError(f"{name} {str(path)!r} must end in .gif, .mp4 or .rrd: that says what to draw")
    check_extra("an animation")
    if suffix == ".mp4":
        _ffmpeg()
    if suffix == ".rrd":
        check_rerun()
    return suffix


def _times(body: LowerBody, span_s: tuple[float, float] | None, rate_hz: float) -> Array:
    """When frames are drawn, s: an even clock, without what lies in gaps."""
    start, stop = float(body.time_s[0]), float(body.time_s[-1])
    if span_s is None:
        first, last = start, stop
        if stop - start > LONGEST_S:
            first = min(max(float(body.time_s[liveliest(body, LONGEST_S)]) - 0.5 * LONGEST_S, start), stop - LONGEST_S)
            last = first + LONGEST_S
    else:
        try:
            first, last = (start + float(value) for value in span_s)
        except (TypeError, ValueError):
            raise InputError(f"span_s must be two times, s since the start, got {span_s!r}") from None
        if not start - 1e-6 <= first < last <= stop + 1e-6:
            raise InputError(f"span_s must be two times from 0 to {stop - start:.6g}, the later last, got {span_s!r}")
    wanted = first + np.arange(int((last - first) * rate_hz + 1e-6) + 1) / rate_hz
    wanted = np.clip(wanted, start, stop)
    steps = np.diff(body.time_s)
    after = np.clip(np.searchsorted(body.time_s, wanted, side="right"), 1, max(len(body.time_s) - 1, 1)) - 1
    missing = steps[after] > GAP_STEPS * np.median(steps) if len(steps) else np.zeros(len(wanted), dtype=bool)
    whole = wanted[~missing]
    if not len(whole):
        raise InputError("span_s lies in a gap of the recording: there is nothing to draw")
    return np.asarray(whole)


def _frames(body: LowerBody, times: Array, title: str | None, progress: Callable[[int, int], object] | None) -> Iterator[Image]:
    """(HEIGHT_PX, WIDTH_PX, 3) pictures. What does not move is drawn once."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from imufast.report.body_figure import SIDE_COLOURS, chains, draw_sticks
    from imufast.report.figures import DARK, FONT

    drawn = skeleton(body)
    points = {name: _smooth(body.time_s, place, times) for name, place in drawn.points.items()}
    lines = chains({"bones": drawn.bones, "assumed": drawn.assumed})
    figure = Figure(figsize=(WIDTH_PX / 100.0, HEIGHT_PX / 100.0), dpi=100, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    every = np.stack(list(points.values()))
    spans = [(float(every[:, :, axis].min()) - 0.05, float(every[:, :, axis].max()) + 0.05) for axis in (1, 0)]
    wide = sum(high - low for low, high in spans)
    top = max(float(every[:, :, 2].max()) + 0.05, 0.3)
    # One scale, inches a metre, for both views.
    height = HEIGHT_PX / 100.0
    width = WIDTH_PX / 100.0
    scale = min((width - 0.9) / wide, (height - 1.05) / top)
    room = (width - wide * scale) / 3.0
    panels, left = [], room
    for (name, axis), (low, high) in zip((("from the right", 1), ("from behind", 0)), spans, strict=True):
        panel = figure.add_axes((left / width, 0.62 / height, (high - low) * scale / width, top * scale / height))
        left += (high - low) * scale + room
        panel.set_axis_off()
        panel.set_xlim(low, high)
        panel.set_ylim(0.0, top)
        panel.plot([low, high], [0.0, 0.0], color=DARK, linewidth=1.0, zorder=1, clip_on=False)
        panel.text(0.5 * (low + high), -0.1 / scale, name, ha="center", va="top", fontsize=FONT, color=DARK)
        panels.append((panel, axis))
    at = 0.97
    for side, colour in SIDE_COLOURS.items():
        figure.text(at, 0.97, side, ha="right", va="top", fontsize=FONT + 1.0, color=colour, fontweight="bold")
        at -= 0.075
    if title is not None:
        figure.text(0.02, 0.97, title.replace("$", r"\$"), va="top", fontsize=FONT + 2.0, color=DARK)
    # matplotlib states no types here.
    agg: Any = canvas
    agg.draw()
    behind = agg.copy_from_bbox(figure.bbox)
    pose = {name: place[0] for name, place in points.items()}
    artists = [(panel, axis, draw_sticks(panel, pose, lines, axis)) for panel, axis in panels]
    said = figure.text(0.02, 0.03, "", fontsize=FONT + 1.0, color=DARK)
    flexions = {side: np.interp(times, body.time_s, angles[:, 0]) for side, angles in body.knee_angles_deg.items()}
    for k, moment in enumerate(times):
        agg.restore_region(behind)
        for panel, axis, strokes in artists:
            for stroke, (names, _) in zip(strokes, lines, strict=True):
                stroke.set_data([points[name][k, axis] for name in names], [points[name][k, 2] for name in names])
            for stroke in sorted(strokes, key=lambda stroke: stroke.get_zorder()):
                panel.draw_artist(stroke)
        knees = ", ".join(f"{side} {value[k]:.0f}°" for side, value in flexions.items()).replace("-", "−")
        said.set_text(f"{moment - body.time_s[0]:.1f} s" + (f"    knee flexion: {knees}" if knees else ""))
        figure.draw_artist(said)
        yield np.asarray(agg.buffer_rgba())[:, :, :3].copy()
        if progress is not None:
            progress(k + 1, len(times))


def _smooth(time_s: Array, place: Array, times: Array) -> Array:
    """(len(times), 3) on cubics through the moments, with central slopes; straight across nothing else than one step."""
    if len(time_s) < 2:
        return np.repeat(place[:1], len(times), axis=0)
    steps = np.diff(time_s)
    slopes = np.diff(place, axis=0) / steps[:, None]
    # A slope does not look across a gap.
    near = steps <= GAP_STEPS * np.median(steps)
    before, after = np.concatenate([[False], near]), np.concatenate([near, [False]])
    total = np.zeros_like(place)
    total[1:][near] += slopes[near]
    total[:-1][near] += slopes[near]
    tangent = total / np.maximum(before.astype(np.float64) + after, 1.0)[:, None]
    k = np.clip(np.searchsorted(time_s, times, side="right") - 1, 0, len(steps) - 1)
    h = steps[k][:, None]
    u = ((times - time_s[k]) / steps[k])[:, None]
    start, stop = place[k], place[k + 1]
    return np.asarray(
        (1.0 + 2.0 * u) * (1.0 - u) ** 2 * start
        + u * (1.0 - u) ** 2 * h * tangent[k]
        + u**2 * (3.0 - 2.0 * u) * stop
        + u**2 * (u - 1.0) * h * tangent[k + 1]
    )


def _gif(frames: Iterator[Image], file: BinaryIO, rate_hz: float) -> None:
    """By pillow, which comes with matplotlib."""
    from PIL import Image as Pillow

    # Not an adaptive palette, for it would tint the white.
    start = Pillow.fromarray(next(frames))
    found: list[Any] = start.getcolors(WIDTH_PX * HEIGHT_PX) or []
    colours: list[tuple[int, int, int]] = []
    for _, colour in sorted(found, key=lambda counted: -counted[0]):
        # Of colours that pillow's lookup would mix up, the more frequent one.
        if all(max(abs(a - b) for a, b in zip(colour, other, strict=True)) > APART for other in colours):
            colours.append(colour)
    palette = Pillow.new("P", (1, 1))
    palette.putpalette([channel for colour in colours[:MOST_COLOURS] for channel in colour])
    first = start.quantize(palette=palette, dither=Pillow.Dither.NONE)
    rest = (Pillow.fromarray(frame).quantize(palette=palette, dither=Pillow.Dither.NONE) for frame in frames)
    first.save(file, format="GIF", save_all=True, append_images=rest, duration=round(1e3 / rate_hz), loop=0)


def _mp4(frames: Iterator[Image], file: BinaryIO, rate_hz: float) -> None:
    """By ffmpeg, which takes raw pictures through a pipe."""
    given = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH_PX}x{HEIGHT_PX}", "-r", f"{rate_hz:g}", "-i", "-"]
    wanted = ["-an", "-c:v", "libx264", "-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4"]
    command = [_ffmpeg(), "-y", "-loglevel", "error", *given, *wanted, file.name]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:  # noqa: S603
        if process.stdin is None or process.stderr is None:  # both are pipes
            raise ImufastError("ffmpeg could not be started")
        try:
            for frame in frames:
                process.stdin.write(frame.tobytes())
            process.stdin.close()
        except BrokenPipeError:
            pass  # it says below why it stopped
        except BaseException:
            process.kill()
            raise
        said = process.stderr.read().decode(errors="replace").strip().splitlines()
    if process.returncode != 0:
        raise ImufastError(f"ffmpeg could not write the .mp4: {said[-1] if said else f'it gave {process.returncode}'}")


def _ffmpeg() -> str:
    """The program: the system's, else that of imageio-ffmpeg.

    Raises:
        ImufastError: there is none.
    """
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise ImufastError(NO_FFMPEG) from None
