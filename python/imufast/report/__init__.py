"""The report of a calibration, a joint centre or tracked orientations: one self-contained HTML file for people, and a JSON twin
for programs.

The page needs the extra `report` (matplotlib, jinja2); the JSON twin needs numpy alone.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import TYPE_CHECKING

from imufast.files import write_text
from imufast.report.content import Pair, report_json

if TYPE_CHECKING:
    from imufast.report.content import Reported

__all__ = ["report_json", "write_json", "write_report"]


def write_report(
    result: Reported,
    path: str | os.PathLike[str],
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
) -> None:
    """Write what a calibration or `track` found as one HTML file that needs nothing else: no network, no scripts.

    The verdict in words, axes with bounds, the joint centre to scale with its uncertainty and what the motion left open of it,
    what acceptance rests on or what stands in its way, figures over the recording's time, settings, and what the numbers do
    not cover. Of orientations: angle and standard deviation over time, gaps and starts, and, with the recording, the residual
    and what shows the heading. What the result does not hold is left out. The file is written whole or not at all.

    Args:
        result: what `calibrate_joint`, `calibrate_hinge`, `HingeCalibrator`, `estimate_joint_center` or `track` gave, or a
            `JointCalibration` that was loaded or made by hand.
        path: the file to write; an existing one is replaced.
        recording: the two sensors it was made from, a pair of Imus or a Recording of two: adds their names and how the joint
            turned; of orientations also residual and observability.
        title: of the report.
        warnings: what else the reader should know, one sentence each.

    Raises:
        InputError: an argument of the wrong kind, another recording than was tracked, or a path that cannot be written.
        ImufastError: the extra `report` is not installed.
    """
    from imufast.report.page import html

    write_text(path, html(report_json(result, recording=recording, title=title, warnings=warnings)))


def write_json(
    result: Reported,
    path: str | os.PathLike[str],
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
    max_points: int | None = 2000,
) -> None:
    """Write `report_json` as a file, whole or not at all. Arguments and exceptions as there and in `write_report`."""
    plain = report_json(result, recording=recording, title=title, warnings=warnings, max_points=max_points)
    write_text(path, json.dumps(plain, allow_nan=False, indent=1) + "\n")
