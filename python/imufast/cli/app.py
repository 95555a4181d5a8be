"""Commands and options; what they print is in `show` and `result`.

Exit codes: 0 done, 2 wrong input (one line on stderr says which); of `calibrate` also 3 not enough information, 4 not a hinge
(nor, with `--joint auto`, a ball joint), 5 the mounting changed on the way; of `track` also 3 not observable, 4 the search
did not end as it should; with --angles also 3 no hinge axis yet, 4 not a hinge; of `body` also 3 and 4 as of `track`.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import click

from imufast.calibrate import JOINTS, calibrate_joint
from imufast.calibration import JointCalibration
from imufast.cli import angled, show, tracked, truth
from imufast.cli import result as print_result
from imufast.cli.angled import AngleOptions, angle_options
from imufast.cli.body import body
from imufast.cli.outputs import Outputs, check_outputs, write, write_tracked
from imufast.cli.reading import guard, offset_of, read_files, reading_options, told_after
from imufast.errors import ImufastError, InputError
from imufast.imu import Imu, Recording
from imufast.report import words
from imufast.settings import HingeSettings, settings_from
from imufast.simulate import random_biases, simulate_hinge
from imufast.track import METHODS
from imufast.track import track as track_pair

__all__ = ["app"]

DEMO_REPORT = "imufast-demo.html"


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="imufast", prog_name="imufast", message="%(prog)s %(version)s")
def app() -> None:
    """Raw recordings of body-worn inertial sensors in; trusted joint calibration and joint motion out."""


app.add_command(body)


@app.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@reading_options
def info(files: tuple[Path, ...], **reading: Any) -> None:
    """What is in FILES: sensors, samples, rate, losses, warnings; the time offset if there are two sensors.

    Files of one recording are joined; files that cannot be are shown one by one, with the reason.
    """
    with guard():
        try:
            recordings = [read_files(files, **reading)]
        except InputError as reason:
            if len(files) == 1:
                raise
            recordings = [read_files([file], **reading) for file in files]
            show.warning(f"shown one by one, for they cannot be joined: {reason}")
        for recording in recordings:
            show.recording(recording)
            if len(recording) == 2:
                show.offset(offset_of(*recording.values()), *recording)


@app.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--sensors", nargs=2, metavar="NAME1 NAME2", help="The two sensors of the joint, where FILES hold more.")
@click.option(
    "--joint", type=click.Choice(JOINTS), default="auto", help="What the joint is known to be. Default: auto, to be found out."
)
@click.option("--save", "save_path", type=click.Path(path_type=Path), metavar="CAL.json", help="Write the calibration here.")
@click.option("--report", "report_path", type=click.Path(path_type=Path), metavar="OUT.html", help="Write the report here.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), metavar="OUT.json", help="Write its numbers here.")
@click.option("--max-error", "max_error_deg", type=float, metavar="DEG", help="Accept a hinge below this bound. Default: 3.")
@click.option("--n-consistent", type=int, metavar="N", help="...in so many estimates in a row. Default: 10.")
@click.option(
    "--lowpass",
    "lowpass_hz",
    type=float,
    metavar="HZ",
    help="Low-pass before the axis is sought; 0: raw signals. Default: 4, for people, whose straps wobble. The centre has its "
    "own.",
)
@reading_options
def calibrate(
    files: tuple[Path, ...],
    sensors: tuple[str, str] | None,
    joint: str,
    save_path: Path | None,
    report_path: Path | None,
    json_path: Path | None,
    max_error_deg: float | None,
    n_consistent: int | None,
    lowpass_hz: float | None,
    **reading: Any,
) -> None:
    """Is the joint a hinge or a ball joint, and where are axis and centre? FILE1 FILE2, or one file with both sensors.

    Exit codes: 0 accepted, 2 wrong input, 3 not enough information, 4 not a hinge (with --joint auto: nor a ball joint), 5 the
    mounting changed on the way.
    """
    given = {"max_error_deg": max_error_deg, "n_consistent": n_consistent, "lowpass_hz": lowpass_hz}
    chosen = {name: value for name, value in given.items() if value is not None}
    with guard() as warned:
        settings = settings_from(HingeSettings, None, chosen)
        if joint == "ball" and chosen:
            raise InputError(f"{', '.join(chosen)}: set how a hinge's axis is found, which --joint ball leaves out")
        outputs = Outputs(report_path, json_path, save_path)
        check_outputs(files, outputs)
        imu1, imu2 = _choose(read_files(files, **reading), sensors)
        late = show.offset_warning(offset_of(imu1, imu2), imu1.name, imu2.name)
        if late:
            warned.append(late)
            show.warning(late)
        with show.waiting(f"Calibrating on {words.duration(imu1.duration_s)} of motion", files):
            result = calibrate_joint(imu1, imu2, joint, hinge_settings=settings)
        with told_after(lambda: print_result.calibration(result, imu1, imu2)) as written:
            write(result, (imu1, imu2), outputs, None, warned, written)
    raise SystemExit(print_result.exit_code(result))


@app.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--sensors", nargs=2, metavar="NAME1 NAME2", help="The two sensors of the joint, where FILES hold more.")
@click.option(
    "--calibration",
    "calibration_path",
    type=click.Path(path_type=Path),
    metavar="CAL.json",
    help="What `imufast calibrate --save` wrote for these sensors as they sit. Default: the recording calibrates itself.",
)
@click.option(
    "--method",
    type=click.Choice(tuple(METHODS)),
    default="auto",
    help="smoother: the whole recording at once, most accurate; mekf, complementary: causal filters. Default: auto, smoother.",
)
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="Write time, quaternion and std here, .csv, .parquet or .sto; with --angles the angles, .mot (OpenSim), .sto, .csv or "
    ".parquet.",
)
@angle_options
@click.option("--save", "save_path", type=click.Path(path_type=Path), metavar="CAL.json", help="Write the calibration here.")
@click.option("--report", "report_path", type=click.Path(path_type=Path), metavar="OUT.html", help="Write the report here.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), metavar="OUT.json", help="Write its numbers here.")
@reading_options
def track(
    files: tuple[Path, ...],
    sensors: tuple[str, str] | None,
    calibration_path: Path | None,
    method: str,
    out_path: Path | None,
    save_path: Path | None,
    report_path: Path | None,
    json_path: Path | None,
    **others: Any,
) -> None:
    """How is sensor 2 turned against sensor 1 over time, and with --angles: what are the joint's angles? FILE1 (proximal) FILE2
    (distal), or one file with both sensors. Times in options count from the start of the recording, s.

    Exit codes: 0 tracked, 2 wrong input, 3 the motion does not show the orientation (or the axis that --angles needs), 4 the
    search did not end as it should, or the joint is no hinge.
    """
    asked = AngleOptions(**{name: others.pop(name) for name in AngleOptions.__dataclass_fields__})
    with guard() as warned:
        outputs = Outputs(report_path, json_path, save_path, out_path, asked.figure_path)
        check_outputs(files, outputs, calibration_path)
        asked.check(out_path, calibration_path)
        known = None if calibration_path is None else JointCalibration.load(calibration_path)
        imu1, imu2 = _choose(read_files(files, **others), sensors)
        late = show.offset_warning(offset_of(imu1, imu2), imu1.name, imu2.name)
        if late:
            warned.append(late)
            show.warning(late)
        with show.waiting(f"Tracking {words.duration(imu1.duration_s)} of motion", files):
            given = calibrate_joint(imu1, imu2) if known is None else known
            rel = track_pair(imu1, imu2, given, method)
        code, angles = tracked.exit_code(rel), None

        def tell() -> None:
            tracked.orientation(rel, imu1, imu2, None if calibration_path is None else str(calibration_path))
            if asked.angles and rel.calibration.axis is None:
                angled.no_axis(rel)
            if angles is not None:
                angled.found(angles)

        with told_after(tell) as written:
            if asked.angles and rel.calibration.axis is None:
                code = max(code, angled.no_axis_code(rel))
            elif asked.angles:
                angles, rel = angled.find(rel, imu1, imu2, asked)
                code = max(code, angled.exit_code(angles))
            write_tracked(rel, angles, asked, outputs, written)
            write(rel, (imu1, imu2), outputs, None, warned, written, angles)
    raise SystemExit(code)


@app.command()
@click.option(
    "--report",
    "report_path",
    type=click.Path(path_type=Path),
    metavar="OUT.html",
    help=f"Default: {DEMO_REPORT}, in this folder.",
)
def demo(report_path: Path | None) -> None:
    """From raw data to a calibration on a simulated recording, beside its truth, and its report."""
    with guard() as warned:
        outputs, without = Outputs(report_path or Path(DEMO_REPORT)), None
        try:
            check_outputs((), outputs)
        except InputError:
            raise
        except ImufastError as missing:
            # The demo goes without its report where none was asked for and the extra is not installed.
            if report_path:
                raise
            without = str(missing)
        # What the gyroscopes and accelerometers of a good sensor show: half a degree a second, a fiftieth of gravity.
        biases = random_biases(seed=1, gyr_rad_s=math.radians(0.5), acc_m_s2=0.2)
        simulation = simulate_hinge(duration_s=60.0, rate_hz=100.0, seed=1, **biases)
        started = time.perf_counter()
        result = calibrate_joint(simulation.imu1, simulation.imu2)
        took_s = time.perf_counter() - started

        def tell() -> None:
            truth.demo_intro(simulation)
            show.recording(simulation.recording)
            show.offset(offset_of(simulation.imu1, simulation.imu2), *simulation.recording)
            show.say()
            print_result.calibration(result, simulation.imu1, simulation.imu2)
            truth.beside_truth(result, simulation, took_s)
            truth.tracking_beside_truth(track_pair(simulation.imu1, simulation.imu2, result), simulation)
            if without:
                show.say(f"No report: {without}")

        with told_after(tell) as written:
            if not without:
                write(result, simulation.recording.pair(), outputs, "Demo: a simulated hinge", warned, written)


def _choose(recording: Recording, names: tuple[str, str] | None) -> tuple[Imu, Imu]:
    """The two sensors meant."""
    present = ", ".join(recording)
    if names:
        for name in names:
            if name not in recording:
                raise InputError(f"--sensors: there is no {name!r}; there are {present}")
        if names[0] == names[1]:
            raise InputError(f"--sensors: name two different sensors of {present}")
        return recording.pair(*names)
    if len(recording) != 2:
        raise InputError(
            f"a joint has two sensors, but there {'is' if len(recording) == 1 else 'are'} {len(recording)}: {present}; "
            + ("give the other one's file too" if len(recording) == 1 else "choose with --sensors NAME1 NAME2")
        )
    return recording.pair()
