"""Joint angles: against optics on hinges, on a walking person's knees beside the vendor's orientation, and in simulation.

python benches/angles.py [--markdown] [--part rig|walk|axes|simulated] [--runs N] [--figures FOLDER]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast.hinge_angle import flexion_axis, hinge_turn
from imufast.quaternion import conjugate, from_matrix, matrix, multiply
from measuring import Array, begin, data_folder, rms

Rows = list[list[str]]
RIG = ("1D_01", "1D_02", "1D_04")
METHODS = ("smoother", "mekf", "complementary")
REFERENCE_STD_DEG = 0.25
"""Of the optical reference: 0.15 to 0.35."""
STAND, WALK, TURN = (0.0, 2.0), (56.5, 98.5), (74.0, 77.5)
"""Of the walking person, s: standing; walking; a sharp turn on the way, left out of what is told of strides."""
HALVES = ((55.0, 77.0), (77.0, 99.0))
"""Of the walk, s."""
STOOD = ((45.5, 48.5), (53.0, 54.8))
"""When the same person stood again, s."""

RIG_HEADINGS = (
    "recording, method",
    "RMSE, °",
    "95 % below, °",
    "largest, °",
    "stated std, °",
    "within 2 std, %",
    "and the reference's 0.25°",
    "off its axis, °",
)


def rig() -> Rows:
    """Hinge angle against that of the optical reference about the optical axis, one constant removed, where it is valid."""
    rows: Rows = []
    for name in RIG:
        z = np.load(data_folder() / "two_imu_joint" / f"{name}.npz")
        imu1, imu2 = (imufast.Imu(z[f"gyr{i}"], z[f"acc{i}"], rate_hz=float(z["rate_hz"])) for i in (1, 2))
        axes = z["hinge_axis1_reference"], z["hinge_axis2_reference"]
        valid = z["reference_valid"].astype(bool)
        # Where the reference is not valid it may be anything: only the valid part is unwrapped.
        truth = np.degrees(hinge_turn(z["q_12_reference"][valid], *axes)[0])
        calibration = imufast.calibrate_joint(imu1, imu2)
        if calibration.axis is None:
            raise SystemExit(f"{name} has no hinge axis")
        axis = calibration.axis.oriented(towards1=axes[0])
        for method in METHODS:
            found = imufast.hinge_angle(imufast.track(imu1, imu2, calibration, method), axis)
            error = found.angles_deg[valid, 0] - truth
            error -= error.mean()
            std = found.std_deg[valid, 0]
            cells = [rms(error), float(np.quantile(np.abs(error), 0.95)), float(np.abs(error).max()), rms(std)]
            covered = [100.0 * float((np.abs(error) <= 2.0 * np.hypot(std, more)).mean()) for more in (0.0, REFERENCE_STD_DEG)]
            shares = [f"{share:.0f}" for share in covered]
            rows.append([f"{name}, {method}", *(f"{x:.2f}" for x in cells), *shares, f"{found.off_axis_deg:.2f}"])
    return rows


WALK_HEADINGS = (
    "knee, angle",
    "strides",
    "period, s",
    "peak in swing, °",
    "from to",
    "lowest, °",
    "trend of the lowest, °/min",
    "of the stride's mean",
    "standing, °",
    "standing again, °",
    "sitting, °",
    "stated std, °",
)


def knees() -> dict[str, tuple[imufast.RelativeOrientation, imufast.JointAxis, Array, tuple[imufast.Imu, imufast.Imu]]]:
    """Of either side: the orientations, the axis, flexion positive, the vendor's orientation, and the sensors."""
    z = np.load(data_folder() / "lower_body" / "full_body_walk.npz")
    found = {}
    for side in ("left", "right"):
        names = f"upper_leg_{side}", f"lower_leg_{side}"
        thigh, shank = (imufast.Imu(z[f"{n}.gyr"], z[f"{n}.acc"], rate_hz=100.0, name=n) for n in names)
        # The axis from the walk, where the knee is used as a hinge; the orientation over all 100 s.
        calibration = imufast.calibrate_joint(thigh.between(55.0, 99.0), shank.between(55.0, 99.0))
        rel = imufast.track(thigh, shank, calibration)
        if calibration.axis is None:
            raise SystemExit(f"the {side} knee has no hinge axis")
        axis = flexion_axis(rel, calibration.axis, zero=STAND, flexion="excursion")
        turned = [
            multiply(z[f"{n}.quat_onboard"], conjugate(vendor_offset(z[f"{n}.quat_onboard"], z[f"{n}.gyr"]))) for n in names
        ]
        vendor = multiply(conjugate(turned[0]), turned[1])
        vendor /= np.linalg.norm(vendor, axis=1, keepdims=True)
        found[side] = rel, axis, vendor, (thigh, shank)
    return found


def vendor_offset(q: Array, gyr: Array, rate_hz: float = 100.0) -> Array:
    """(4,) from the vendor's body frame to the frame of gyr: the turn that best takes the rates of q to gyr (Wahba)."""
    step = multiply(conjugate(q[:-1]), q[1:])
    step *= np.where(step[:, :1] < 0.0, -1.0, 1.0)
    # The first orientations jump while the vendor's filter starts.
    rows = slice(300, None)
    rate, seen = 2.0 * rate_hz * step[rows, 1:], 0.5 * (gyr[1:] + gyr[:-1])[rows]
    u, _, v = np.linalg.svd(seen.T @ rate)
    return from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def angles_of(
    rel: imufast.RelativeOrientation, axis: imufast.JointAxis, pair: Sequence[imufast.Imu], side: str
) -> dict[str, imufast.JointAngles]:
    """The hinge angle from the standing pose, and three angles between frames of that pose and the axis."""
    frames = [
        imufast.segment_frame(side, flexion_axis=axis, sensor=i, joint="knee", standing=imu.between(*STAND))
        for i, imu in enumerate(pair, 1)
    ]
    return {
        "hinge": imufast.hinge_angle(rel, axis, zero=STAND, flexion="axis"),
        "ISB flexion": imufast.joint_angles(rel, frames[0], frames[1]),
    }


def strides(time_s: Array, flexion: Array) -> tuple[Array, Array, Array]:
    """Times and sizes of the peaks in swing, and the lowest flexion between two of them, the turn left out."""
    walking = (time_s >= WALK[0]) & (time_s <= WALK[1])
    t, x = time_s[walking], flexion[walking]
    high = x > 0.6 * np.quantile(x, 0.99)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], high, [False]]).astype(np.int8)))
    # Swings that the window cuts are none.
    swings = [(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True) if start > 0 and stop < len(x)]
    at = np.array([start + int(x[start:stop].argmax()) for start, stop in swings])
    lowest = np.array([[t[a + int(x[a:b].argmin())], x[a:b].min()] for a, b in pairwise(at)])
    straight = (t[at] < TURN[0]) | (t[at] > TURN[1])
    kept = (lowest[:, 0] < TURN[0]) | (lowest[:, 0] > TURN[1])
    return t[at][straight], x[at][straight], lowest[kept]


def mean_between(time_s: Array, values: Array, start_s: float, stop_s: float) -> float:
    return float(values[(time_s >= start_s) & (time_s <= stop_s)].mean())


def trend(time_s: Array, values: Array) -> str:
    """Slope a minute and its standard error, as if strides were independent."""
    t = (time_s - time_s.mean()) / 60.0
    slope = float(t @ values / (t @ t))
    left = values - values.mean() - slope * t
    return f"{slope:+.1f} ± {float(np.sqrt(left @ left / (len(t) - 2) / (t @ t))):.1f}"


def walk(figures: Path | None) -> tuple[Rows, Rows]:
    """What both knees do, and by how much the vendor's orientation says otherwise."""
    rows: Rows = []
    beside: Rows = []
    for side, (rel, axis, vendor, pair) in knees().items():
        other = replace(rel, q_12=vendor, covariance=None)
        for label, source in (("", rel), ("vendor: ", other)):
            for kind, found in angles_of(source, axis, pair, side).items():
                flexion, time = found["flexion"], found.time_s
                peaks_s, peaks, lowest = strides(time, flexion)
                slope = trend(lowest[:, 0], lowest[:, 1])
                means = np.array([[a, mean_between(time, flexion, a, b)] for a, b in pairwise(peaks_s) if b - a < 2.0])
                level = trend(means[:, 0], means[:, 1])
                steps = np.diff(peaks_s)
                period = float(np.median(steps[steps < 2.0]))
                cells = [f"{len(peaks)}", f"{period:.2f}", f"{np.median(peaks):.1f}", f"{peaks.min():.0f} to {peaks.max():.0f}"]
                again = ", ".join(f"{mean_between(time, flexion, *span):.1f}" for span in STOOD)
                std = "–" if label else f"{float(np.median(found.std_deg[:, 0])):.1f}"
                cells += [f"{np.median(lowest[:, 1]):.1f}", slope, level]
                cells += [
                    f"{mean_between(time, flexion, 0.5, 2.0):.1f}",
                    again,
                    f"{mean_between(time, flexion, 17, 34):.0f}",
                    std,
                ]
                rows.append([f"{side}, {label}{kind}", *cells])
                if figures is not None and not label:
                    imufast.write_figure(found, figures / f"knee_{side}_{kind.split()[0]}.png", title=f"{side} knee, {kind}")
        ours, theirs = (angles_of(source, axis, pair, side) for source in (rel, other))
        for kind in ours:
            rows_walking = (rel.time_s >= WALK[0]) & (rel.time_s <= WALK[1])
            off = (ours[kind]["flexion"] - theirs[kind]["flexion"])[rows_walking]
            follow = float(np.corrcoef(ours[kind]["flexion"][rows_walking], theirs[kind]["flexion"][rows_walking])[0, 1])
            drift = float(np.polyfit(rel.time_s[rows_walking] / 60.0, off, 1)[0])
            apart = [off.mean(), off.std(), np.abs(off - off.mean()).max(), drift]
            beside.append(
                [f"{side}, {kind}", *(f"{x:+.1f}" if k in (0, 3) else f"{x:.1f}" for k, x in enumerate(apart)), f"{follow:.4f}"]
            )
    return rows, beside


VENDOR_HEADINGS = ("knee, angle", "mean, °", "std about it, °", "largest, °", "trend, °/min", "correlation")

AXES_HEADINGS = (
    "knee, sensor",
    "recordings",
    "off the bone's axis, °",
    "worst, °",
    "bound, °",
    "hinge calibration's, °",
    "worst, °",
    "bound, °",
    "both apart, °",
    "recordings or halves apart, °",
    "hinge calibration's, °",
    "off the limb, °",
    "hinge calibration's, °",
)


def axes(runs: int) -> Rows:
    """The axis of `calibrate_joint` beside that of `calibrate_hinge`, where soft tissue moves."""
    rows: Rows = []
    for motion in ("walking", "sit_to_stand"):
        found: list[list[tuple[Array, float, Array, float, Array, Array]]] = [[], []]
        for seed in range(runs):
            s, mounts = simulated_knee(motion, TISSUES["default"], seed, np.random.default_rng([1983, seed]))
            turned = [matrix(q) for q in mounts]
            for i, (numbers, truth) in enumerate(zip(both_axes(s.imu1, s.imu2), (s.axis1, s.axis2), strict=True)):
                joint, joint_bound, hinge, hinge_bound = numbers
                # In the segment's frame, where the mounting does not matter.
                limb = turned[i] @ joint, turned[i] @ hinge
                found[i].append((limb[0], joint_bound, limb[1], hinge_bound, turned[i] @ truth, np.array([1.0, 0.0, 0.0])))
        rows += [axes_row(f"simulated, {motion}, {i}", each) for i, each in enumerate(found, 1)]
    z = np.load(data_folder() / "lower_body" / "full_body_walk.npz")
    for side in ("left", "right"):
        names = f"upper_leg_{side}", f"lower_leg_{side}"
        pair = [imufast.Imu(z[f"{n}.gyr"], z[f"{n}.acc"], rate_hz=100.0, name=n) for n in names]
        found = [[], []]
        for span in HALVES:
            halves = [imu.between(*span) for imu in pair]
            for i, (joint, joint_bound, hinge, hinge_bound) in enumerate(both_axes(halves[0], halves[1])):
                up = pair[i].between(*STAND).acc.mean(axis=0)
                found[i].append((joint, joint_bound, hinge, hinge_bound, np.full(3, np.nan), up / np.linalg.norm(up)))
        rows += [axes_row(f"walking person, {side}, {i}", each) for i, each in enumerate(found, 1)]
    return rows


def both_axes(imu1: imufast.Imu, imu2: imufast.Imu) -> list[tuple[Array, float, Array, float]]:
    """Of either sensor: the axis of the joint and its bound, that of the hinge's calibration and its bound."""
    joint = imufast.calibrate_joint(imu1, imu2)
    axis, hinge = joint.axis, joint.hinge
    if axis is None or hinge is None or hinge.axis1 is None or hinge.axis2 is None or hinge.bound95_deg is None:
        raise SystemExit("a knee has no axis")
    pairs = ((axis.axis1, hinge.axis1), (axis.axis2, hinge.axis2))
    return [(a, float(axis.bound95_deg[i]), b, float(hinge.bound95_deg[i])) for i, (a, b) in enumerate(pairs)]


def axes_row(name: str, each: Sequence[tuple[Array, float, Array, float, Array, Array]]) -> list[str]:
    joint, joint_bound, hinge, hinge_bound, truth, limb = (np.array(x) for x in zip(*each, strict=True))
    known = not np.isnan(truth).any()
    off = [lines_apart_deg(x, truth) if known else np.full(1, np.nan) for x in (joint, hinge)]
    numbers = [off[0].mean(), off[0].max(), joint_bound.mean(), off[1].mean(), off[1].max(), hinge_bound.mean()]
    numbers += [lines_apart_deg(joint, hinge).mean()]
    # The largest angle between two of them.
    numbers += [max(lines_apart_deg(x, x[[k]]).max() for k in range(len(x))) for x in (joint, hinge)]
    numbers += [lines_apart_deg(x, limb).mean() for x in (joint, hinge)]
    return [name, str(len(each)), *("–" if np.isnan(x) else f"{x:.1f}" for x in numbers)]


def lines_apart_deg(a: Array, b: Array) -> Array:
    """(N,) angles between lines along unit vectors (N, 3), degrees."""
    return np.asarray(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.abs((a * b).sum(axis=1)))))


SIMULATED_HEADINGS = (
    "motion, soft tissue, angle",
    "runs",
    "RMSE, °",
    "worst run, °",
    "stated std, °",
    "within 2 std, %",
    "worst run, %",
)
TISSUES = {
    "none": None,
    "default": imufast.SoftTissue(),
    "default and tilt": imufast.SoftTissue(tilt_rad=0.05),
}
FRAME_STD_DEG = 3.0


def simulated(runs: int) -> Rows:
    """Knees at 100 Hz for a minute, calibrated by themselves; the truth is that of the bones. Long axes are given with errors
    of 3° of standard deviation, which is stated; the hinge angle from its mean on."""
    rows: Rows = []
    for motion in ("walking", "sit_to_stand"):
        for tissue_name, tissue in TISSUES.items():
            found: dict[str, list[tuple[float, float, float]]] = {}
            lost = 0
            for seed in range(runs):
                got = one_simulation(motion, tissue, seed)
                lost += not got
                for name, numbers in got.items():
                    found.setdefault(name, []).append(numbers)
            for name, values in found.items():
                error, std, covered = np.array(values).T
                cells = [
                    f"{rms(error):.2f}",
                    f"{error.max():.2f}",
                    f"{rms(std):.2f}",
                    f"{covered.mean():.1f}",
                    f"{covered.min():.0f}",
                ]
                rows.append([f"{motion}, {tissue_name}: {name}", str(runs - lost), *cells])
    return rows


def one_simulation(motion: str, tissue: imufast.SoftTissue | None, seed: int) -> dict[str, tuple[float, float, float]]:
    """RMSE, rms of the stated standard deviation, degrees, and how often the truth is within two of it, %; of each angle."""
    rng = np.random.default_rng([1983, seed])
    s, mounts = simulated_knee(motion, tissue, seed, rng)
    calibration = imufast.calibrate_joint(s.imu1, s.imu2)
    if calibration.axis is None:
        return {}
    axis = calibration.axis.oriented(towards1=s.axis1)
    rel = imufast.track(s.imu1, s.imu2, calibration)
    hinge = imufast.hinge_angle(rel, axis, flexion="axis")
    turn = np.degrees(s.angle_rad)
    found = {"hinge angle": judged(hinge["flexion"] - (turn - turn.mean()), hinge.std_deg[:, 0])}
    true = [bone_frame(q) for q in mounts]
    frames = [
        imufast.segment_frame(
            "right",
            flexion_axis=axis,
            sensor=i,
            joint="knee",
            proximal=frame.proximal + np.radians(FRAME_STD_DEG) * rng.standard_normal(3),
            std_deg=FRAME_STD_DEG,
        )
        for i, frame in enumerate(true, 1)
    ]
    truth = imufast.joint_angles(replace(rel, q_12=s.q_12_bone), true[0], true[1])
    three = imufast.joint_angles(rel, frames[0], frames[1])
    for k, name in enumerate(three.names):
        found[name] = judged(three.angles_deg[:, k] - truth.angles_deg[:, k], three.std_deg[:, k])
    return found


def simulated_knee(
    motion: str, tissue: imufast.SoftTissue | None, seed: int, rng: np.random.Generator
) -> tuple[imufast.HingeSimulation, tuple[Array, Array]]:
    """A minute at 100 Hz, and the mountings of its sensors."""
    mounts = [q / np.linalg.norm(q) for q in rng.standard_normal((2, 4))]
    biases: dict[str, Any] = dict(imufast.random_biases(seed, gyr_rad_s=float(np.radians(0.3)), acc_m_s2=0.1))
    s = imufast.simulate_hinge(
        motion, duration_s=60.0, rate_hz=100.0, seed=seed, soft_tissue=tissue, mount1=mounts[0], mount2=mounts[1], **biases
    )
    return s, (mounts[0], mounts[1])


def bone_frame(mount: Array) -> imufast.SegmentFrame:
    """The true frame, seen from a sensor so mounted. The simulator's segments: x down the limb, y the hinge axis, which is to
    the left of a knee, z to the front."""
    x, y, z = matrix(conjugate(mount)).T
    return imufast.SegmentFrame(z, -x, -y, "right", "knee")


def judged(error: Array, std: Array) -> tuple[float, float, float]:
    return rms(error), rms(std), 100.0 * float((np.abs(error) <= 2.0 * std).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs/measured.md")
    parser.add_argument("--part", choices=("rig", "walk", "axes", "simulated"), help="one part only")
    parser.add_argument("--runs", type=int, default=20, help="simulations of each kind; default 20")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw the walking knees there")
    chosen = parser.parse_args()
    show = begin(markdown=chosen.markdown)

    if chosen.part in (None, "rig"):
        title = "Angle of mechanical hinges against optics (itself good to 0.15 to 0.35°), one constant removed."
        show(title, RIG_HEADINGS, rig())
    if chosen.part in (None, "walk"):
        ours, beside = walk(chosen.figures)
        show(
            "Knees of a walking person: flexion, zero while standing at 0 to 2 s (hinge) or where the axes are parallel (ISB).",
            WALK_HEADINGS,
            ours,
        )
        show("The same walk: ours less the vendor's, about our axis.", VENDOR_HEADINGS, beside)
    if chosen.part in (None, "axes"):
        title = "Axes of knees: of the joint, about which it turns most, beside that of the hinge's calibration."
        show(title, AXES_HEADINGS, axes(max(1, chosen.runs)))
    if chosen.part in (None, "simulated"):
        title = "Simulated knees against the bones: soft tissue of 5° about and 4° across the limb, tilt of 3° about the axis."
        show(title, SIMULATED_HEADINGS, simulated(max(1, chosen.runs)))


if __name__ == "__main__":
    main()
