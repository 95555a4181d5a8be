"""imufast beside its peers on real recordings: axis, centre and relative orientation of a mechanical joint with optical truth,
and a walking person's knees.

    python benches/two_imu.py [--markdown] [--rounds 7] [--starts 20]

Default settings on both sides, same arrays, same run; no setting is chosen for a file. Recordings: `two_imu_joint` and
`lower_body` in the folder IMUFAST_DATA (else ../shared/data). Errors are the worse of both axes; times are medians of
interleaved runs, from checked sensors (imufast) or arrays (qmt) to the axes. qmt neither judges nor accepts: it is given what
imufast had seen. Errors of joint centres are means of both sensors, for hinges without the axis direction. Orientations are
scored over whole recordings, starts included, against an optical reference whose own noise is about 0.25 degrees.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import imufast
import numpy as np
from measuring import (
    Array,
    QmtHinge,
    data_folder,
    dfjimu_center,
    dfjimu_orientation,
    imus,
    interleaved,
    one_core,
    pair_error_deg,
    qmt_hinge,
    quaternion_errors_deg,
    refuse_debug_build,
    relative,
    rms,
    setting,
    table,
)

ARRAYS = ("gyr1", "acc1", "gyr2", "acc2")
HEADINGS = ("recording", "samples", "imufast, °", "bound, °", "qmt, °", "imufast, ms", "qmt, ms", "times faster")


def measure(path: Path, qmt: QmtHinge | None, rounds: int) -> tuple[int, list[float | None]]:
    """Number of samples, and the numbers of one row."""
    with np.load(path) as recording:
        arrays = [np.ascontiguousarray(recording[name], np.float64) for name in ARRAYS]
        truth = recording["hinge_axis1_reference"], recording["hinge_axis2_reference"]
        pair = imus(float(recording["rate_hz"]), *arrays)
    axis = imufast.estimate_hinge_axis(*pair)
    error = pair_error_deg(axis.axis1, axis.axis2, *truth)
    theirs = None if qmt is None else pair_error_deg(*qmt(*arrays), *truth)
    calls: list[Callable[[], object]] = [lambda: imufast.estimate_hinge_axis(*pair)]
    if qmt is not None:
        calls.append(lambda: qmt(*arrays))
    times = np.array(interleaved(calls, rounds))
    ours_ms, *their_ms = (1e3 * np.median(times, axis=0)).tolist()
    ratio = None if qmt is None else float(np.median(times[:, 1] / times[:, 0]))
    values = [error, float(np.max(axis.bound95_deg)), theirs, ours_ms, their_ms[0] if their_ms else None, ratio]
    return len(arrays[0]), values


def hinge_rows(files: list[Path], rounds: int) -> list[list[str | None]]:
    """One row a recording and one of means."""
    qmt = qmt_hinge()
    rows: list[list[str | None]] = []
    numbers = []
    for path in files:
        samples, values = measure(path, qmt, rounds)
        numbers.append(values)
        rows.append([path.stem, str(samples), *written(values)])
    columns = [[value for value in column if value is not None] for column in zip(*numbers, strict=True)]
    return [*rows, ["mean", None, *written([statistics.fmean(column) if column else None for column in columns])]]


def written(values: list[float | None]) -> list[str | None]:
    """Numbers as they are printed."""
    forms = (".2f", ".2f", ".2f", ".2f", ".0f", ".0f")
    return [None if value is None else format(value, form) for value, form in zip(values, forms, strict=True)]


@dataclass(frozen=True, eq=False)
class Joint:
    """A recording of the mechanical joint; `truth` only where it is a hinge."""

    name: str
    rate_hz: float
    arrays: tuple[Array, ...]
    truth: tuple[Array, Array] | None

    @classmethod
    def read(cls, path: Path) -> Joint:
        with np.load(path) as z:
            truth = (z["hinge_axis1_reference"], z["hinge_axis2_reference"]) if "hinge_axis1_reference" in z.files else None
            arrays = tuple(np.ascontiguousarray(z[name], np.float64) for name in ARRAYS)
            return cls(path.stem, float(z["rate_hz"]), arrays, truth)

    def cut(self, start: int, stop: int | None = None) -> list[Array]:
        return [a[start:stop] for a in self.arrays]

    def starts(self, count: int) -> list[int]:
        """Moments to begin at, evenly spread, the last 40 s before the end."""
        last = max(0, len(self.arrays[0]) - round(40 * self.rate_hz))
        return sorted({int(start) for start in np.linspace(0, last, count)})

    def calibrate(self, start: int, stop: int | None = None) -> imufast.HingeCalibration:
        return imufast.calibrate_hinge(*imus(self.rate_hz, *self.cut(start, stop)))


START_HEADINGS = (
    "recording",
    "accepted, %",
    "after, s",
    "worst, °",
    "median, °",
    "bound, °",
    "within bound, %",
    "qmt worst, °",
    "qmt median, °",
)


def start_rows(joint: Joint, count: int, qmt: QmtHinge | None) -> list[list[str | None]]:
    """calibrate_hinge from many starting moments of a hinge: as accepted first, and at the end of the recording."""
    starts = joint.starts(count)
    results = [joint.calibrate(start) for start in starts]
    rows: list[list[str | None]] = []
    for when in ("when accepted", "at the end"):
        errors, bounds, theirs, after = [], [], [], []
        for start, result in zip(starts, results, strict=True):
            first = next((step for step in result.history if step.accepted), None)
            said = first if when == "when accepted" else (result if result.accepted else None)
            if first is None or said is None or said.axis1 is None or said.axis2 is None or said.bound95_deg is None:
                continue
            assert joint.truth is not None
            errors.append(pair_error_deg(said.axis1, said.axis2, *joint.truth))
            bounds.append(float(np.max(said.bound95_deg)))
            after.append(first.time_s)
            if qmt is not None:
                stop = start + round(first.time_s * joint.rate_hz) if when == "when accepted" else None
                gyr1, acc1, gyr2, acc2 = joint.cut(start, stop)
                theirs.append(pair_error_deg(*qmt(gyr1, acc1, gyr2, acc2), *joint.truth))
        name = f"{joint.name}, {when}"
        share = f"{100.0 * len(errors) / len(starts):.0f}"
        if not errors:
            rows.append([name, share, *[None] * 7])
            continue
        within = 100.0 * np.mean(np.array(errors) <= np.array(bounds))
        ours = [f"{x:.2f}" for x in (max(errors), statistics.median(errors), statistics.median(bounds))]
        beside = [f"{max(theirs):.2f}", f"{statistics.median(theirs):.2f}"] if theirs else [None, None]
        rows.append([name, share, f"{statistics.median(after):.0f}", *ours, f"{within:.0f}", *beside])
    return rows


OTHER_HEADINGS = ("recording", "whole file", "misfit", "accepted from starts, %", "30-second pieces accepted, %", "pieces")


def other_row(joint: Joint, count: int) -> list[str | None]:
    """Verdicts on a joint that is no hinge."""
    whole = joint.calibrate(0)
    from_starts = [whole.accepted, *(joint.calibrate(start).accepted for start in joint.starts(count)[1:])]
    piece = round(30 * joint.rate_hz)
    pieces = [joint.calibrate(at, at + piece).accepted for at in range(0, len(joint.arrays[0]) - piece, piece)]
    verdict = f"{whole.verdict}{', accepted' if whole.accepted else ''}"
    misfit = None if whole.misfit is None else f"{whole.misfit:.2f}"
    shares = [f"{100.0 * np.mean(each):.0f}" if each else None for each in (from_starts, pieces)]
    return [joint.name, verdict, misfit, *shares, str(len(pieces))]


KNEE_HEADINGS = ("knee", "verdicts", "misfits", "apart, °", "bounds, °", "off the limb, °", "qmt apart, °", "qmt off, °")
HALVES = ((0.56, 0.74), (0.77, 0.95))


def knee_row(path: Path, side: str, qmt: QmtHinge | None) -> list[str | None]:
    """A walking person's knee from both halves of the walk, without the turn between them."""
    thigh, shank = f"upper_leg_{side}", f"lower_leg_{side}"
    with np.load(path) as z:
        rate_hz = float(z["rate_hz"])
        names = (f"{thigh}.gyr", f"{thigh}.acc", f"{shank}.gyr", f"{shank}.acc")
        arrays = [np.ascontiguousarray(z[name], np.float64) for name in names]
    cuts = [[a[int(begin * len(a)) : int(end * len(a))] for a in arrays] for begin, end in HALVES]
    results = [imufast.calibrate_hinge(*imus(rate_hz, *cut)) for cut in cuts]
    standing = arrays[1][: round(4 * rate_hz)].mean(axis=0)  # along the thigh

    def judged(pairs: Sequence[tuple[Array, Array]]) -> list[str]:
        """How far the halves are apart, and how near to the limb either thigh axis comes, about which the strap wobbles."""
        apart = pair_error_deg(*pairs[0], *pairs[1])
        along = [abs(float(axis @ standing)) / float(np.linalg.norm(standing)) for axis, _ in pairs]
        return [f"{apart:.1f}", f"{np.degrees(np.arccos(min(1.0, max(along)))):.0f}"]

    ours = [(r.axis1, r.axis2) for r in results if r.axis1 is not None and r.axis2 is not None]
    if len(ours) < 2:
        return [side, ", ".join(str(r.verdict) for r in results), *[None] * 6]
    verdicts = ", ".join(f"{r.verdict}{'' if r.accepted else ' (not accepted)'}" for r in results)
    misfits = ", ".join("–" if r.misfit is None else f"{r.misfit:.2f}" for r in results)
    bound = float(np.sqrt(sum(np.max(r.bound95_deg) ** 2 for r in results if r.bound95_deg is not None)))
    apart, off = judged(ours)
    theirs: list[str] | list[None] = [None, None]
    if qmt is not None:
        theirs = judged([qmt(*cut) for cut in cuts])
    return [side, verdicts, misfits, apart, f"{bound:.1f}", off, *theirs]


CENTER_HEADINGS = (
    "recording",
    "samples",
    "SA, mm",
    "SS",
    "SA as published",
    "SS as published",
    "dfjimu",
    "stated std, mm",
    "bias error, m/s²",
    "undetermined",
    "SA, ms",
    "dfjimu, ms",
)


def center_rows(paths: Sequence[Path], rounds: int) -> list[list[str | None]]:
    """Errors of the joint centre a recording, and their means and worst."""
    peer, published = dfjimu_center(), imufast.CenterSettings.as_published()
    forms = (".2f", ".2f", ".2f", ".2f", ".2f", ".2f", ".3f", ".0f", ".2f", ".2f")
    numbers: list[list[float | None]] = []
    for path in paths:
        with np.load(path) as z:
            rec = {name: z[name] for name in z.files}
        rate_hz, arrays = float(rec["rate_hz"]), [np.ascontiguousarray(rec[name], np.float64) for name in ARRAYS]
        pair = imus(rate_hz, *arrays)
        ours = imufast.estimate_joint_center(*pair, "sa")
        found = [ours, imufast.estimate_joint_center(*pair, "ss")]
        found += [imufast.estimate_joint_center(*pair, method, settings=published) for method in ("sa", "ss")]
        errors: list[float | None] = [center_error_mm(rec, c.in_sensor1, c.in_sensor2) for c in found]
        calls: list[Callable[[], object]] = [lambda pair=pair: imufast.estimate_joint_center(*pair)]  # type: ignore[misc]
        errors.append(None)
        if peer is not None:
            gyr1, acc1, gyr2, acc2 = arrays
            errors[-1] = center_error_mm(rec, *peer(gyr1, acc1, gyr2, acc2, rate_hz))
            calls.append(lambda a=gyr1, b=acc1, c=gyr2, d=acc2, f=rate_hz: peer(a, b, c, d, f))  # type: ignore[misc]
        times: list[float | None] = [*(1e3 * np.median(np.array(interleaved(calls, rounds)), axis=0)).tolist(), None]
        bias = max(across(rec, i, b - rec[f"acc_bias{i}_optical"]) for i, b in ((1, ours.acc_bias1), (2, ours.acc_bias2)))
        stated = 1e3 * float(np.mean(ours.determined_std))
        numbers.append([*errors, stated, bias, float(len(ours.undetermined)), *times[:2]])
    rows: list[list[str | None]] = []
    for path, values in zip(paths, numbers, strict=True):
        cells = [None if v is None else format(v, form) for v, form in zip(values, forms, strict=True)]
        with np.load(path) as z:
            rows.append([path.stem, str(len(z["gyr1"])), *cells])
    columns = [[v for v in column if v is not None] for column in zip(*numbers, strict=True)]
    for name, how in (("mean", statistics.fmean), ("worst", max)):
        summary = [format(how(c), form) if c else None for c, form in zip(columns, forms, strict=True)]
        summary[7:] = [None, *(summary[8:] if name == "mean" else [None, None])]  # a mean of counts says nothing
        rows.append([name, None, *summary])
    return rows


def across(rec: dict[str, Array], sensor: int, error: Array) -> float:
    """Length of an error in a sensor's frame; for a hinge without its part along the axis."""
    if f"hinge_axis{sensor}_reference" in rec:
        axis = rec[f"hinge_axis{sensor}_reference"]
        error = error - (error @ axis) * axis
    return float(np.linalg.norm(error))


def center_error_mm(rec: dict[str, Array], center1: Array, center2: Array) -> float:
    """Mean over both sensors."""
    pairs = ((1, center1), (2, center2))
    return 1e3 * statistics.fmean(across(rec, i, center - rec[f"joint_in_sensor{i}_optical"]) for i, center in pairs)


ORIENTATION_HEADINGS = (
    "recording",
    "smoother, °",
    "mekf",
    "complementary",
    "self-calibrating smoother",
    "dfjimu MAP",
    "dfjimu MEKF",
    *(f"{name}, stated over actual" for name in ("smoother", "mekf", "complementary")),
    "without the first 10 s: mekf, °",
    "complementary",
    "dfjimu MEKF",
)
ORIENTATION_METHODS = ("smoother", "mekf", "complementary")
REFERENCE_STD_DEG, SETTLED_S = 0.25, 10.0


def orientation_rows(paths: Sequence[Path]) -> list[list[str | None]]:
    """Errors of the relative orientation a recording, and how they compare with what is stated; means and worst. Every method
    but the self-calibrating one takes `calibrate_joint` of the same recording, dfjimu its own lever arms."""
    lever_arms, peer = dfjimu_center(), dfjimu_orientation()
    rows: list[list[str | None]] = []
    numbers: list[list[float | None]] = []
    for path in paths:
        with np.load(path) as z:
            rec = {name: z[name] for name in z.files}
        rate_hz, arrays = float(rec["rate_hz"]), [np.ascontiguousarray(rec[name], np.float64) for name in ARRAYS]
        valid = rec["reference_valid"].astype(bool)
        late = valid & (np.arange(len(valid)) >= SETTLED_S * rate_hz)
        pair = imus(rate_hz, *arrays)
        calibration = imufast.calibrate_joint(*pair)
        tracked = [imufast.track(*pair, calibration, method) for method in ORIENTATION_METHODS]
        off = [quaternion_errors_deg(t.q_12, rec["q_12_reference"]) for t in tracked]
        values: list[float | None] = [rms(errors[valid]) for errors in off]
        values.append(rms(quaternion_errors_deg(imufast.track(*pair).q_12, rec["q_12_reference"])[valid]))
        their_late: float | None = None
        if lever_arms is not None and peer is not None:
            gyr1, acc1, gyr2, acc2 = arrays
            centers = lever_arms(gyr1, acc1, gyr2, acc2, rate_hz)
            smoothed, filtered = (
                quaternion_errors_deg(relative(*run(arrays, rate_hz, *centers)), rec["q_12_reference"])
                for run in (peer.map, peer.mekf)
            )
            values += [rms(smoothed[valid]), rms(filtered[valid])]
            their_late = rms(filtered[late])
        else:
            values += [None, None]
        for t, errors in zip(tracked, off, strict=True):
            stated = np.sqrt(np.mean(t.angle_std_deg[valid] ** 2) + REFERENCE_STD_DEG**2)
            values.append(float(stated / rms(errors[valid])))
        values += [rms(off[1][late]), rms(off[2][late]), their_late]
        numbers.append(values)
        rows.append([path.stem, *(None if v is None else f"{v:.2f}" for v in values)])
    columns = [[v for v in column if v is not None] for column in zip(*numbers, strict=True)]
    for name, how in (("mean", statistics.fmean), ("worst", max)):
        summary = [f"{how(column):.2f}" if column else None for column in columns]
        if name == "worst":  # of a ratio that should be 1 the least is worst: too sure
            summary[6:9] = [f"{min(column):.2f}" for column in columns[6:9]]
        rows.append([name, *summary])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the table for docs/measured.md")
    parser.add_argument("--rounds", type=int, default=7, help="interleaved rounds of timed runs; default 7")
    parser.add_argument("--starts", type=int, default=20, help="moments of each recording to begin at; default 20")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    folder = data_folder()
    paths = sorted((folder / "two_imu_joint").glob("*.npz"))
    joints = [Joint.read(path) for path in paths]
    hinges = [joint for joint in joints if joint.truth is not None]
    if not hinges:
        raise SystemExit(f"no recordings of a hinge with reference axes in {folder / 'two_imu_joint'}")
    qmt, starts, gap = qmt_hinge(), max(1, chosen.starts), "\n\n"
    print(setting(), end=gap)
    print(
        "Hinge axis from all samples, the worse of both axes: error against optics (itself good to about 0.2°), and time.",
        end=gap,
    )
    files = [path for path, joint in zip(paths, joints, strict=True) if joint.truth is not None]
    print(table(HEADINGS, hinge_rows(files, max(1, chosen.rounds)), markdown=chosen.markdown), end=gap)
    print(
        f"`calibrate_hinge` on hinges from {starts} starting moments each, 40 s to the end of the recording at least.", end=gap
    )
    rows = [row for joint in hinges for row in start_rows(joint, starts, qmt)]
    print(table(START_HEADINGS, rows, markdown=chosen.markdown), end=gap)
    others = [joint for joint in joints if joint.truth is None]
    if others:
        print("`calibrate_hinge` on joints with 2 and 3 degrees of freedom, which it should not accept.", end=gap)
        print(table(OTHER_HEADINGS, [other_row(joint, starts) for joint in others], markdown=chosen.markdown), end=gap)
    print("Joint centre from all samples: error against optics, for hinges (1D) without the axis direction.", end=gap)
    print(table(CENTER_HEADINGS, center_rows(paths, max(1, chosen.rounds)), markdown=chosen.markdown), end=gap)
    print(
        "Relative orientation over whole recordings: error against optics, RMS, and what is stated over it (1 is honest).",
        end=gap,
    )
    print(table(ORIENTATION_HEADINGS, orientation_rows(paths), markdown=chosen.markdown), end=gap)
    walk = folder / "lower_body" / "full_body_walk.npz"
    if walk.exists():
        print(
            "`calibrate_hinge` on a walking person: two halves of the walk, how far their axes are apart (root sum of", end=" "
        )
        print("squares of both bounds beside), and how far the thigh's axis keeps off the limb, about which the strap turns.\n")
        rows = [knee_row(walk, side, qmt) for side in ("left", "right")]
        print(table(KNEE_HEADINGS, rows, markdown=chosen.markdown))


if __name__ == "__main__":
    main()
