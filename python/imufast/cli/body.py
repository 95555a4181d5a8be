"""`imufast body`: the lower body from sensors on its segments."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from imufast.body import BodyStatus, LowerBody, estimate_lower_body
from imufast.body.layout import SIDES
from imufast.body.placement import read_placement
from imufast.cli import show
from imufast.cli.outputs import Outputs, check_outputs
from imufast.cli.reading import guard, read_files, reading_options, told_after
from imufast.errors import InputError
from imufast.imu import Recording
from imufast.io import write_angles
from imufast.io.angle_files import check_angle_target
from imufast.io.body_files import check_body_names
from imufast.report import body_words, words, write_json, write_report
from imufast.report.animation import check_animation_target, write_animation
from imufast.settings import check_number

__all__ = ["body"]

NOT_OBSERVABLE, NOT_FINISHED = 3, 4


@click.command()
@click.argument("files", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "--placement",
    "placement_path",
    required=True,
    type=click.Path(path_type=Path),
    metavar="PLACEMENT.toml",
    help="Which sensor is on which segment: pelvis, thigh_right, shank_right, foot_right, thigh_left ...",
)
@click.option(
    "--height", "height_m", type=float, metavar="M", help="Of the subject, m. Default: as the placement says, else open."
)
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path),
    metavar="OUT",
    help="Write all angles here: .mot (OpenSim), .sto, .csv or .parquet.",
)
@click.option(
    "--names",
    metavar="NAME=OTHER,...",
    help="Other names for columns of --out; a minus turns the sign: knee_angle_r=-knee_angle_r for models such as gait2392.",
)
@click.option("--report", "report_path", type=click.Path(path_type=Path), metavar="OUT.html", help="Write the report here.")
@click.option("--json", "json_path", type=click.Path(path_type=Path), metavar="OUT.json", help="Write its numbers here.")
@click.option(
    "--animate",
    "animate_path",
    type=click.Path(path_type=Path),
    metavar="OUT.gif|.mp4",
    help="Draw the subject as a moving stick figure here.",
)
@click.option(
    "--span",
    metavar="START:STOP",
    help="What --animate shows, s since the start. Default: all, of more than a minute the liveliest minute.",
)
@reading_options
def body(
    files: tuple[Path, ...],
    placement_path: Path,
    height_m: float | None,
    out_path: Path | None,
    names: str | None,
    report_path: Path | None,
    json_path: Path | None,
    animate_path: Path | None,
    span: str | None,
    **reading: Any,
) -> None:
    """How pelvis and legs move: knee, hip and ankle angles of both sides, from sensors strapped on anyhow. FILES hold the
    sensors; without FILES the placement's own are read.

    Exit codes: 0 found (what the motion leaves open is named), 2 wrong input, 3 the motion determines none of the joints, 4 the
    search did not end as it should, or the sensors are not where the placement says.
    """
    with guard() as warned:
        placement = read_placement(placement_path)
        height = None if height_m is None else check_number("--height", height_m, 0.8, 2.5)
        anthropometry = placement.anthropometry(height)
        files = files or tuple(placement.files)
        if not files:
            raise InputError(f"no FILES: give the recording's, or name them in {placement_path.name} with file = ...")
        outputs = Outputs(report_path, json_path, out=out_path, animate=animate_path)
        check_outputs(files, outputs, placement=placement_path)
        if out_path is not None:
            check_angle_target(out_path, "--out")
        if animate_path is not None:
            check_animation_target(animate_path, "--animate")
        columns, shown = _names(names, out_path), _span(span, animate_path)
        recording = read_files(files, **reading)
        sensors = placement.sensors(recording)
        lasts_s = float(recording.time_s[-1] - recording.time_s[0])
        if shown is not None and shown[1] > lasts_s + 1e-6:
            raise InputError(f"--span must lie within the recording, 0:{lasts_s:.6g}, got {span!r}")
        duration = words.duration(lasts_s)
        with show.working(f"Lower body on {duration} of motion: each joint alone") as tell:
            found = estimate_lower_body(
                recording,
                sensors,
                anthropometry,
                progress=lambda number, cost, promised, *_: tell(
                    f"Lower body on {duration} of motion: iteration {number}, cost {cost:.6g}, promised fall {promised:.3g}"
                ),
            )
        with told_after(lambda: _print(found)) as written:
            _write(found, recording, outputs, columns, shown, warned, written)
    raise SystemExit(_exit_code(found))


def _exit_code(found: LowerBody) -> int:
    """0 found, 3 no joint determined, 4 the search did not end as it should, or the placement is contradicted."""
    if found.status not in (BodyStatus.CONVERGED, BodyStatus.NOT_OBSERVABLE):
        return NOT_FINISHED
    return 0 if any(joint.determined for joint in found.joints.values()) else NOT_OBSERVABLE


def _names(given: str | None, out: Path | None) -> dict[str, str] | None:
    if given is None:
        return None
    if out is None:
        raise InputError("--names are for the columns of --out: give it too")
    pairs = [part.partition("=") for part in given.split(",")]
    for name, equals, other in pairs:
        if not equals or not name.strip() or not other.strip():
            raise InputError(f"--names must look like knee_angle_r=-knee_angle_r,knee_angle_l=-knee_angle_l, got {given!r}")
    return check_body_names({name.strip(): other.strip() for name, _, other in pairs}, "--names")


def _span(given: str | None, animate: Path | None) -> tuple[float, float] | None:
    if given is None:
        return None
    if animate is None:
        raise InputError("--span is what --animate shows: give it too")
    first, colon, last = given.partition(":")
    try:
        pair = float(first), float(last)
    except ValueError:
        pair = 0.0, -1.0
    if not colon or not 0.0 <= pair[0] < pair[1] < 1e12:
        raise InputError(f"--span must look like 0:20, in s since the start of the recording, got {given!r}")
    return pair


def _print(found: LowerBody) -> None:
    """Status in words, what is known of each joint, lengths."""
    known = all(joint.determined for joint in found.joints.values())
    show.say(body_words.headline(found), "bold green" if found.status is BodyStatus.CONVERGED and known else "bold yellow")
    show.say(f"status: {found.status}, {found.iterations} iterations, {len(found.joints)} joints, {len(found.time_s)} moments")
    show.say(body_words.advice(found))
    for reason in found.why:
        show.say(f"note: {reason}")
    show.say(body_words.certainty(found))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("joint", "flexion\n°", "std\n°", "heading\n± °", "centre\n± mm"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    table.add_column("what the motion shows", overflow="fold")
    for name, joint in found.joints.items():
        kind, _, side = name.partition("_")
        angles, std = getattr(found, f"{kind}_angles_deg").get(side), getattr(found, f"{kind}_std_deg").get(side)
        row = [body_words.name_words(name)]
        row += (
            ["–", "–"]
            if angles is None
            else [f"{angles[:, 0].min():.0f} to {angles[:, 0].max():.0f}", _told(_median(std), ".2g")]
        )
        row += [_told(_median(joint.heading_std_deg[:, None]), ".2g"), _told(1e3 * float(joint.in_sensors_std.max()), ".3g")]
        row += ["known" if joint.determined else f"open: {'; '.join(joint.why)}"]
        table.add_row(*(Text(show.plain(cell.replace("-", "−") if k < 5 else cell)) for k, cell in enumerate(row)))
    show.console().print(table)
    for name, (length, std) in found.lengths_m.items():
        mean, spread = getattr(found.anthropometry, f"{name.partition('_')[0]}_m")
        label = body_words.name_words(name) if name.endswith(SIDES) else "between the hips"
        said = f"{100 * length:.1f} ± {_told(100 * std, '.1f')} cm; expected {100 * mean:.1f} ± {100 * spread:.1f}"
        show.say(f"{label}: {said}")
    for text in body_words.residual_words(found):
        show.say(f"fits badly: {text}")


def _told(value: float, form: str) -> str:
    """A number for people; a question mark where nothing is known."""
    return format(value, form) if math.isfinite(value) else "?"


def _median(std: Any) -> float:
    values = sorted(float(value) for value in std[:, 0])
    return values[len(values) // 2]


def _write(
    found: LowerBody,
    recording: Recording,
    outputs: Outputs,
    columns: dict[str, str] | None,
    span: tuple[float, float] | None,
    warned: list[str],
    written: list[str],
) -> None:
    """Angles, numbers, report and animation; `written` gets a line on each."""
    if outputs.out is not None:
        write_angles(found, outputs.out, names=columns)
        written.append(f"angles: {outputs.out}")
    if outputs.json is not None:
        write_json(found, outputs.json, recording=recording, warnings=warned)
        written.append(f"numbers: {outputs.json}")
    if outputs.report is not None:
        with show.working("Drawing the report"):
            write_report(found, outputs.report, recording=recording, warnings=warned)
        written.append(f"report: {outputs.report}")
    if outputs.animate is not None:
        with show.working("Drawing the animation") as tell:
            write_animation(
                found,
                outputs.animate,
                span_s=span,
                progress=lambda done, all_: tell(f"Drawing the animation: {done} of {all_} pictures"),
            )
        written.append(f"animation: {outputs.animate}")
