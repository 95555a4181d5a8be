"""The report of a calibration, a joint centre, tracked orientations, joint angles and a lower body: one self-contained
HTML file for people, and a JSON twin for programs; and the figure of joint angles, and the animation of a body, on their own.

The page needs the extra `report` (matplotlib, jinja2); the JSON twin needs numpy alone.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from imufast.angles import JointAngles
from imufast.errors import InputError
from imufast.files import check_target, write_text
from imufast.report.animation import write_animation
from imufast.report.content import Pair, report_json

if TYPE_CHECKING:
    from imufast.report.content import Reported

__all__ = [
    "FIGURE_FORMATS",
    "check_figure_target",
    "report_json",
    "write_animation",
    "write_figure",
    "write_json",
    "write_report",
]

FIGURE_FORMATS = (".png", ".svg")
"""The ends of the names of figures that can be written."""


def write_report(
    result: Reported,
    path: str | os.PathLike[str],
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
    angles: JointAngles | None = None,
) -> None:
    """Write what a calibration or `track` found as one HTML file that needs nothing else: no network, no scripts.

    The verdict in words, axes with bounds, the joint centre to scale with its uncertainty and what the motion left open of it,
    what acceptance rests on or what stands in its way, figures over the recording's time, settings, and what the numbers do
    not cover. Of orientations: angle and standard deviation over time, gaps and starts, and, with the recording, the residual
    and what shows the heading. What the result does not hold is left out. The file is written whole or not at all.

    Args:
        result: what `calibrate_joint`, `calibrate_hinge`, `HingeCalibrator`, `estimate_joint_center`, `track` or
            `estimate_lower_body` gave, or a `JointCalibration` that was loaded or made by hand.
        path: the file to write; an existing one is replaced.
        recording: the two sensors it was made from, a pair of Imus or a Recording of two: adds their names and how the joint
            turned; of orientations also residual and observability. Of a `LowerBody` the Recording of all its sensors.
        title: of the report.
        warnings: what else the reader should know, one sentence each.
        angles: of a `RelativeOrientation`: the joint angles that `hinge_angle` or `joint_angles` made of it, to be shown first.

    Raises:
        InputError: an argument of the wrong kind, another recording than was tracked, or a path that cannot be written.
        ImufastError: the extra `report` is not installed.
    """
    from imufast.report.page import html

    write_text(path, html(report_json(result, recording=recording, title=title, warnings=warnings, angles=angles)))


def write_json(
    result: Reported,
    path: str | os.PathLike[str],
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
    angles: JointAngles | None = None,
    max_points: int | None = 2000,
) -> None:
    """Write `report_json` as a file, whole or not at all. Arguments and exceptions as there and in `write_report`."""
    plain = report_json(result, recording=recording, title=title, warnings=warnings, angles=angles, max_points=max_points)
    write_text(path, json.dumps(plain, allow_nan=False, indent=1) + "\n")


def write_figure(angles: JointAngles, path: str | os.PathLike[str], *, title: str | None = None) -> None:
    """Draw joint angles with bands of ± 2 standard deviations as a `.png` or `.svg` file, whole or not at all.

    Args:
        angles: what `hinge_angle` or `joint_angles` gave.
        path: the file to write; an existing one is replaced.
        title: above the figure. Default None: none.

    Raises:
        InputError: not joint angles, another end of the name, or a path that cannot be written.
        ImufastError: the extra `report` is not installed.
    """
    if not isinstance(angles, JointAngles):
        raise InputError(f"angles must be JointAngles, what hinge_angle or joint_angles gave, got {type(angles).__name__}")
    if title is not None and not isinstance(title, str):
        raise InputError(f"title must be a text or None, got {type(title).__name__}")
    suffix = check_figure_target(path)
    from imufast.report.angle_figure import save_figure

    save_figure(angles, path, suffix, title)


def check_figure_target(path: str | os.PathLike[str], name: str = "path") -> str:
    """The format that the name of the file asks for, one of `FIGURE_FORMATS`.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `report` is not installed.
    """
    from imufast.report.page import check_extra

    check_target(path, name)
    suffix = Path(path).suffix.lower()
    if suffix not in FIGURE_FORMATS:
        raise InputError(f"{name} {str(path)!r} must end in .png or .svg: that says what to draw")
    check_extra()
    return suffix
