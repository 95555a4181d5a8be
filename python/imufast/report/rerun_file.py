"""A lower body as a file for the rerun viewer: a stick figure to turn about in space, and the angles over the same time."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.body.layout import SIDES
from imufast.body.result import LowerBody
from imufast.body.skeleton import Skeleton
from imufast.errors import ImufastError
from imufast.joint_angles import NAMES

__all__ = ["check_rerun", "write_rerun"]

Array = NDArray[np.float64]


def check_rerun() -> None:
    """Refuse with advice if rerun-sdk is missing.

    Raises:
        ImufastError: it is.
    """
    try:
        import rerun  # noqa: F401
    except ImportError:
        raise ImufastError("an .rrd needs rerun-sdk: pip install 'imufast[rerun]'; a .gif does not") from None


def write_rerun(
    body: LowerBody,
    drawn: Skeleton,
    points: Mapping[str, Array],
    times: Array,
    path: str | os.PathLike[str],
    title: str | None,
    progress: Callable[[int, int], object] | None,
) -> None:
    """Write places and angles at `times`.

    Entities: "body/right", "body/left", "body/pelvis" with the bones as lines, m, x to the subject's right, y ahead, z up; and
    "angles/knee_right/flexion" ... with one number each, degrees. Timeline "time", s since the start.

    Args:
        body: whose angles.
        drawn: its bones.
        points: name to (T, 3) places of their ends, m.
        times: (T,) s.
        path: the file to write.
        title: what the viewer calls the recording; None: nothing.
        progress: called with (moments written, moments in all); may raise to stop.

    Raises:
        ImufastError: rerun-sdk is not installed.
    """
    check_rerun()
    import rerun

    from imufast.report.body_figure import SIDE_COLOURS
    from imufast.report.figures import DARK

    stream: Any = rerun.RecordingStream("imufast")
    stream.save(path)
    if title is not None:
        stream.send_recording_name(title)
    stream.log("body", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    since = times - body.time_s[0]
    parts = {side: [ends for name, ends in drawn.bones.items() if name.endswith(f"_{side}")] for side in SIDES}
    colours = {part: int(SIDE_COLOURS.get(part, DARK)[1:] + "ff", 16) for part in (*SIDES, "pelvis")}
    parts["pelvis"] = [ends for name, ends in drawn.bones.items() if not name.endswith(SIDES)]
    for k, moment in enumerate(since):
        stream.set_time("time", duration=float(moment))
        for part, bones in parts.items():
            lines = [[points[start][k], points[stop][k]] for start, stop in bones]
            if lines:
                stream.log(f"body/{part}", rerun.LineStrips3D(lines, colors=[colours[part]], radii=0.008))
        if progress is not None:
            progress(k + 1, len(since))
    index = rerun.TimeColumn("time", duration=since)
    for joint, names in NAMES.items():
        for side, angles in getattr(body, f"{joint}_angles_deg").items():
            for axis, name in enumerate(names):
                shown = np.interp(times, body.time_s, angles[:, axis])
                stream.send_columns(f"angles/{joint}_{side}/{name}", [index], rerun.Scalars.columns(scalars=shown))
    stream.flush()
    stream.disconnect()
