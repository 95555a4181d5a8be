"""What the commands write, and where: refused beforehand where it could not be written in the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imufast.angles import JointAngles
from imufast.calibration import JointCalibration
from imufast.cli import show
from imufast.cli.angled import AngleOptions
from imufast.errors import InputError
from imufast.files import check_target
from imufast.imu import Imu
from imufast.io import write_angles, write_orientation
from imufast.report import write_figure, write_json, write_report
from imufast.report.page import check_extra
from imufast.track import RelativeOrientation

__all__ = ["Outputs", "check_outputs", "write", "write_tracked"]


@dataclass(frozen=True)
class Outputs:
    """What is to be written, and where."""

    report: Path | None
    json: Path | None = None
    save: Path | None = None
    out: Path | None = None
    figure: Path | None = None
    animate: Path | None = None


def check_outputs(
    files: Sequence[Path], outputs: Outputs, calibration: Path | None = None, placement: Path | None = None
) -> None:
    """Refuse outputs that could not be written in the end, before the work begins."""
    taken = {file.resolve(): f"the recording {str(file)!r}" for file in files}
    for name, given in (("calibration", calibration), ("placement", placement)):
        if given is not None:
            taken[given.resolve()] = f"the {name} {str(given)!r}"
    for name in ("report", "json", "save", "out", "figure", "animate"):
        path = getattr(outputs, name)
        if path is None:
            continue
        target = check_target(path, f"--{name}")
        if target in taken:
            raise InputError(f"--{name} {str(path)!r} would replace {taken[target]}; give another file")
        taken[target] = f"what --{name} writes"
    if outputs.report is not None:
        check_extra()


def write_tracked(
    rel: RelativeOrientation, angles: JointAngles | None, asked: AngleOptions, outputs: Outputs, written: list[str]
) -> None:
    """What `track` writes beside report and numbers; what was written, and where, is added to `written`."""
    if outputs.out is not None and angles is not None:
        write_angles(angles, outputs.out, names=asked.columns())
        written.append(f"angles: {outputs.out}")
    elif outputs.out is not None and not asked.angles:
        names = asked.columns()
        write_orientation(rel, outputs.out, **({} if names is None else {"names": names}))
        written.append(f"orientations: {outputs.out}")
    if outputs.figure is not None and angles is not None:
        write_figure(angles, outputs.figure)
        written.append(f"figure: {outputs.figure}")
    if outputs.save is not None:
        rel.calibration.save(outputs.save)
        written.append(f"calibration: {outputs.save}")


def write(
    result: JointCalibration | RelativeOrientation,
    pair: tuple[Imu, Imu],
    outputs: Outputs,
    title: str | None,
    warned: Sequence[str],
    written: list[str],
    angles: JointAngles | None = None,
) -> None:
    """Calibration, numbers and report; what was written, and where, is added to `written`.

    Files come before words: whoever reads these may stop after the first line (`| head -1`), and the command ends there.
    """
    if outputs.save is not None and isinstance(result, JointCalibration):
        result.save(outputs.save)
        written.append(f"calibration: {outputs.save}")
    if outputs.json is not None:
        write_json(result, outputs.json, recording=pair, title=title, warnings=warned, angles=angles)
        written.append(f"numbers: {outputs.json}")
    if outputs.report is not None:
        with show.working("Drawing the report"):
            write_report(result, outputs.report, recording=pair, title=title, warnings=warned, angles=angles)
        written.append(f"report: {outputs.report}")
