"""The options of `imufast track` that ask for joint angles, what they mean, and how the angles are printed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import click

from imufast.angles import AngleStatus, JointAngles
from imufast.axis import JointAxis
from imufast.cli.show import say
from imufast.decide import Verdict
from imufast.errors import InputError
from imufast.frames import JOINTS, SIDES, segment_frame
from imufast.hinge_angle import flexion_axis, hinge_angle
from imufast.imu import Imu
from imufast.io.angle_files import check_angle_target
from imufast.io.orientation_files import check_orientation_target
from imufast.io.table_files import check_names
from imufast.joint_angles import CONVENTIONS, SIGNS, joint_angles
from imufast.report import angle_content as words
from imufast.report import check_figure_target, joint_words
from imufast.track import RelativeOrientation

__all__ = ["AngleOptions", "angle_options", "exit_code", "find", "found", "no_axis", "no_axis_code"]

Command = TypeVar("Command", bound=Callable[..., Any])
NOT_ENOUGH, NOT_FINISHED = 3, 4
OF_ANGLES = ("flexion", "axis_towards", "zero", "zero_deg", "side", "joint", "standing", "convention", "signs", "figure_path")
"""Options that need --angles."""


def angle_options(command: Command) -> Command:
    """The options that say which joint angles are asked for."""
    for option in reversed(
        (
            click.option("--angles", is_flag=True, help="Joint angles: one about the hinge axis, or three with --standing."),
            click.option(
                "--flexion",
                metavar="WHICH",
                help="Which way is positive: START:STOP, over which the joint flexes on the whole; 'excursion', the larger one "
                "from zero, as of knees; 'axis', as the axis of --calibration points. Default: not told.",
            ),
            click.option(
                "--axis-towards",
                metavar="X,Y,Z",
                help="...or the direction in the first sensor's frame about which flexion turns by the right hand.",
            ),
            click.option(
                "--zero",
                metavar="WHERE",
                help="START:STOP of a pose whose angle is zero, or 'mean' of the recording (default).",
            ),
            click.option("--zero-deg", type=float, metavar="DEG", help="The angle there. Default: 0."),
            click.option("--side", type=click.Choice(SIDES), help="Of the body; for three angles."),
            click.option("--joint", type=click.Choice(tuple(JOINTS)), help="For three angles."),
            click.option(
                "--standing",
                metavar="START:STOP",
                help="When both segments were held upright: three angles then, flexion, adduction, rotation.",
            ),
            click.option("--convention", type=click.Choice(CONVENTIONS), help="Of three angles. Default: ISB."),
            click.option("--signs", type=click.Choice(SIGNS), help="Of three angles. Default: clinical."),
            click.option(
                "--names",
                metavar="A,B,C",
                help="What the columns of --out are called, such as knee_angle_r; a minus before a name turns its sign.",
            ),
            click.option(
                "--figure",
                "figure_path",
                type=click.Path(path_type=Path),
                metavar="OUT.png|.svg",
                help="Draw the angles with their bands here.",
            ),
        )
    ):
        command = option(command)
    return command


@dataclass(frozen=True)
class AngleOptions:
    """What was asked for; times in s since the start of the recording."""

    angles: bool = False
    flexion: str | None = None
    axis_towards: str | None = None
    zero: str | None = None
    zero_deg: float | None = None
    side: str | None = None
    joint: str | None = None
    standing: str | None = None
    convention: str | None = None
    signs: str | None = None
    names: str | None = None
    figure_path: Path | None = None

    def check(self, out: Path | None, calibration: Path | None) -> None:
        """Refuse what cannot be meant, before the work begins.

        Raises:
            InputError: options that contradict each other or lack another one.
        """
        given = [f"--{name.removesuffix('_path').replace('_', '-')}" for name in OF_ANGLES if getattr(self, name) is not None]
        if given and not self.angles:
            raise InputError(
                f"{', '.join(given)}: {'these ask' if len(given) > 1 else 'this asks'} for joint angles; add --angles"
            )
        if self.names is not None and out is None:
            raise InputError("--names are for the columns of --out: give it too")
        if self.names is not None:
            check_names("--names", self.columns(), 2 if not self.angles else 3 if self.standing else 1)
        if out is not None:
            if self.angles:
                check_angle_target(out, "--out")
            elif out.suffix.lower() == ".mot":
                raise InputError(f"--out {str(out)!r}: a .mot file holds joint angles; add --angles")
            else:
                check_orientation_target(out, "--out")
        if self.figure_path is not None:
            check_figure_target(self.figure_path, "--figure")
        if self.flexion is not None and self.axis_towards is not None:
            raise InputError("--flexion and --axis-towards both say which way is positive: give one of them")
        if self.flexion == "axis" and calibration is None:
            raise InputError("--flexion axis needs --calibration: its axis was turned so, this recording's own has not been")
        for name in ("flexion", "zero", "standing"):
            text = getattr(self, name)
            if text is not None and text not in {"flexion": ("axis", "excursion"), "zero": ("mean",)}.get(name, ()):
                _interval(f"--{name}", text, 0.0)
        if self.axis_towards is not None:
            _direction(self.axis_towards)
        self._check_three()

    def _check_three(self) -> None:
        three = [name for name in ("side", "joint", "convention", "signs") if getattr(self, name) is not None]
        if self.standing is None:
            if three:
                raise InputError(
                    f"--{three[0]} is for three angles, which need the segments' long axes: add --standing START:STOP, a time "
                    "in which both were held upright"
                )
            return
        missing = [f"--{name}" for name in ("joint",) if getattr(self, name) is None]
        if self.side is None and self.convention != "McGrath" and self.signs != "consistent":
            missing.append("--side")
        if self.flexion is None and self.axis_towards is None:
            missing.append("--flexion or --axis-towards")
        if missing:
            raise InputError(f"three angles need {', '.join(missing)} too: nothing in the recording tells it")
        if self.zero is not None or self.zero_deg is not None:
            raise InputError("--zero is of the hinge angle alone; three angles are zero where the segments' axes are parallel")

    def columns(self) -> list[str] | None:
        """What the columns of --out are called."""
        return None if self.names is None else [name.strip() for name in self.names.split(",")]


def find(rel: RelativeOrientation, imu1: Imu, imu2: Imu, asked: AngleOptions) -> tuple[JointAngles, RelativeOrientation]:
    """The angles, and the orientations with the axis of their calibration turned so that flexion is positive."""
    axis = rel.calibration.axis
    if axis is None:
        raise InputError("the calibration has no hinge axis")
    start = float(rel.time_s[0])
    pose = asked.standing or asked.zero
    zero = "mean" if pose in (None, "mean") else _interval("--zero", str(pose), start)
    if asked.axis_towards is not None:
        axis = axis.oriented(towards1=_direction(asked.axis_towards))
    elif asked.flexion is not None:
        which = asked.flexion if asked.flexion in ("axis", "excursion") else _interval("--flexion", asked.flexion, start)
        axis = flexion_axis(rel, axis, zero=zero, flexion=which)
    told = asked.axis_towards is not None or asked.flexion is not None
    if asked.standing is None:
        angles = hinge_angle(rel, axis, zero=zero, zero_deg=asked.zero_deg or 0.0, flexion="axis" if told else None)
    else:
        angles = _three(rel, axis, (imu1, imu2), asked, start)
    if not rel.calibration.accepted and joint_words.state_name(rel.calibration) != "made by hand":
        angles = replace(angles, why=(*angles.why, "the hinge axis was not accepted by its calibration"))
    return angles, replace(rel, calibration=replace(rel.calibration, axis=axis))


def _three(rel: RelativeOrientation, axis: JointAxis, pair: tuple[Imu, Imu], asked: AngleOptions, start: float) -> JointAngles:
    """Flexion, adduction and rotation between frames of the hinge axis and a standing pose."""
    first, last = _interval("--standing", str(asked.standing), start)
    biases = rel.calibration.acc_bias1, rel.calibration.acc_bias2
    frames = []
    for sensor, (imu, bias) in enumerate(zip(pair, biases, strict=True), 1):
        # Up to the last sample, which `between` would leave out.
        upright = imu.between(first, last + 0.5 / imu.rate_hz)
        upright = Imu(upright.gyr, upright.acc - bias, time_s=upright.time_s, name=imu.name)
        frames.append(segment_frame(asked.side, flexion_axis=axis, sensor=sensor, joint=asked.joint, standing=upright))
    return joint_angles(rel, frames[0], frames[1], asked.convention or "ISB", signs=asked.signs or "clinical")


def found(angles: JointAngles) -> None:
    """Status, range, zero, signs and certainty, in words."""
    say(words.angle_headline(angles), "bold green" if angles.status is AngleStatus.FOUND else "bold yellow")
    for name in angles.names:
        values = angles[name]
        low, high = (f"{float(value):.1f}".replace("-", "−") for value in (values.min(), values.max()))
        say(f"{words.name_words(name)}: {low}° to {high}°")
    say(words.band_words(angles))
    say(words.known_words(angles))
    for reason in angles.why:
        say(f"note: {reason}")


def no_axis(rel: RelativeOrientation) -> None:
    """Say that there are no angles."""
    say("No joint angles: the calibration has no hinge axis", "bold yellow")
    say(f"its verdict: {joint_words.state_name(rel.calibration)}. Nothing that needs angles was written.")


def no_axis_code(rel: RelativeOrientation) -> int:
    """3 there is no hinge axis yet, 4 the joint is no hinge."""
    known = rel.calibration.verdict
    return NOT_ENOUGH if known in (Verdict.NOT_ENOUGH_INFORMATION, Verdict.MOUNTING_CHANGED) else NOT_FINISHED


def exit_code(angles: JointAngles) -> int:
    """0 found (gimbal lock included, which is flagged), 3 not observable, 4 no hinge or not finished."""
    if angles.status in (AngleStatus.FOUND, AngleStatus.GIMBAL_LOCK):
        return 0
    return NOT_ENOUGH if angles.status is AngleStatus.NOT_OBSERVABLE else NOT_FINISHED


def _interval(name: str, text: str, start: float) -> tuple[float, float]:
    """START:STOP in s since the start, on the recording's clock."""
    first, colon, last = text.partition(":")
    try:
        pair = float(first), float(last)
    except ValueError:
        pair = 0.0, -1.0
    if not colon or not 0.0 <= pair[0] <= pair[1] < 1e12:
        raise InputError(f"{name} must look like 0:2, in s since the start of the recording, got {text!r}")
    return pair[0] + start, pair[1] + start


def _direction(text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3:
        raise InputError(f"--axis-towards must be three numbers such as 0,1,0, got {text!r}")
    return values
