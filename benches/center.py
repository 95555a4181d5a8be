"""How good a joint centre is, how honest its uncertainty, and what it costs: by simulation, and on a walking person.

    python benches/center.py [--markdown] [--part judge|coverage|knees|linear|memory] [--recordings 1000] [--hours 24]

The simulations differ in motion, rate, mounts, lever arms and biases; no setting is chosen for one of them. They are the judge
that no default was tuned on, and the paper's own choice of settings stands beside. About three minutes on two cores; times are
CPU times of one thread.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import resource
import statistics
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast import BallMotion, CenterSettings
from measuring import Array, begin, data_folder, imus
from scipy.stats import chi2

Rows = list[list[str | None]]
METHODS = ("ss", "sa")
PUBLISHED = CenterSettings.as_published()
RATES_HZ = (50.0, 75.0, 100.0, 128.0, 200.0)
GYR_BIAS, ACC_BIASES = np.radians(0.5), (0.1, 0.3)
KINDS = ("random", "random, 2 axes", "hinge", "S3", "S4", "S5", "S6", "S7", "S3 to S7", "rest, then random")
"""What the judge and the coverage are about, each with the same share."""
BEYOND = ("rates are interval means", "collisions", "soft tissue, eq. 29")
"""Random motion that the model does not describe: told apart, not part of the totals."""


@dataclass(frozen=True)
class Estimate:
    """How far one estimate is off.

    Attributes:
        error_mm: mean over both sensors, for a hinge without the axis direction.
        claimed_mm: the same of its standard deviations.
        open_count: how many directions it calls undetermined.
        square: squared error over the stated covariance, in the determined directions.
    """

    error_mm: float
    claimed_mm: float
    open_count: int
    square: float
    status: str


Estimates = dict[tuple[str, str], Estimate]


def simulated(kind: str, seed: int) -> imufast.BallJointSimulation:
    """One recording with everything drawn at random that `kind` leaves open."""
    rng = np.random.default_rng([2017, seed])
    duration_s = float(rng.uniform(30.0, 90.0))
    roam = BallMotion("random", duration_s=duration_s, tempo=float(rng.uniform(0.7, 1.5)), size=float(rng.uniform(0.7, 1.3)))
    freedom: dict[str, Any] = {}
    motion: str | BallMotion | Sequence[str | BallMotion] = roam
    if kind == "rest, then random":
        motion = (BallMotion("stationary", duration_s=10.0), roam)
    elif kind == "S3 to S7":
        motion = ("S3", "S4", "S5", "S6", "S7")
    elif kind.startswith("S"):
        motion = kind
    if kind in ("hinge", "random, 2 axes") or kind.startswith("S"):
        freedom["dof"] = 1 if kind == "hinge" else 2
    if kind == "rates are interval means":
        freedom["gyr_sampling"] = "interval_mean"
    elif kind == "collisions":
        freedom["collisions"] = imufast.Collisions()
    elif kind == "soft tissue, eq. 29":
        freedom |= imufast.random_tissue(seed)
    return imufast.simulate_ball_joint(
        motion,
        rate_hz=float(rng.choice(RATES_HZ)),
        seed=seed,
        gyr_noise=float(rng.uniform(0.002, 0.01)),
        acc_noise=float(rng.uniform(0.02, 0.1)),
        **imufast.random_biases(seed, gyr_rad_s=float(GYR_BIAS), acc_m_s2=float(rng.uniform(*ACC_BIASES))),
        **imufast.random_positions(seed),
        **freedom,
    )


def judged(center: imufast.CenterEstimate, s: imufast.BallJointSimulation) -> Estimate:
    error = np.concatenate([center.in_sensor1 - s.joint_in_sensor1, center.in_sensor2 - s.joint_in_sensor2])
    across = np.eye(6) - center.undetermined.T @ center.undetermined
    covariance = across @ center.covariance @ across
    inverse = np.linalg.pinv(covariance, rcond=1e-12, hermitian=True)
    parts, stds = [], []
    for i, axis in enumerate((s.axis1, s.axis2)):
        free = np.eye(3) - np.outer(axis, axis) if s.is_hinge else np.eye(3)
        here = slice(3 * i, 3 * i + 3)
        parts.append(float(np.linalg.norm(free @ error[here])))
        stds.append(float(np.sqrt(max(0.0, np.trace(free @ covariance[here, here] @ free)))))
    square = float(error @ across @ inverse @ across @ error)
    count = len(center.undetermined)
    return Estimate(1e3 * statistics.fmean(parts), 1e3 * statistics.fmean(stds), count, square, str(center.status))


def run(task: tuple[str, int, bool]) -> tuple[str, Estimates]:
    """One recording through all methods; the published settings only where they are asked for."""
    kind, seed, published = task
    found: Estimates = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", imufast.ImufastWarning)
        s = simulated(kind, seed)
        for method in METHODS:
            found["default", method] = judged(imufast.estimate_joint_center(s.imu1, s.imu2, method), s)
            if published:
                found["published", method] = judged(
                    imufast.estimate_joint_center(s.imu1, s.imu2, method, settings=PUBLISHED), s
                )
    return kind, found


def all_runs(tasks: Sequence[tuple[str, int, bool]], cores: set[int]) -> list[tuple[str, Estimates]]:
    """In as many processes as there are cores; the order is that of the tasks."""
    if len(cores) < 2:
        return [run(task) for task in tasks]
    with get_context("spawn").Pool(min(len(cores), 8), _on_cores, (cores,)) as pool:
        return pool.map(run, tasks, chunksize=10)


def _on_cores(cores: set[int]) -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def quantiles(values: Sequence[float]) -> list[str]:
    return [f"{np.quantile(values, q):.2f}" for q in (0.5, 0.95)] if values else ["–", "–"]


JUDGE_HEADINGS = (
    "mean error of both centres, mm",
    "recordings",
    *(f"{who} {method.upper()}, {q}" for method in METHODS for who in ("published", "default") for q in ("median", "95 %")),
    "default better",
)


def judge(runs: Sequence[tuple[str, Estimates]]) -> Rows:
    """Median and 95 % quantile of the errors, and how often the default is nearer than the published settings, by kind."""
    rows: Rows = []
    whole = [(kind, found) for kind, found in runs if kind in KINDS and ("published", "ss") in found]
    groups = [("all", whole)] + [(name, [x for x in runs if x[0] == name]) for name in (*KINDS, *BEYOND)]
    for name, group in groups:
        both = [found for _, found in group if ("published", "ss") in found]
        if not both:
            continue
        cells: list[str | None] = [name, str(len(both))]
        for method in METHODS:
            for who in ("published", "default"):
                cells += quantiles([found[who, method].error_mm for found in both])
        better = [
            100.0 * np.mean([found["default", m].error_mm < found["published", m].error_mm for found in both]) for m in METHODS
        ]
        rows.append([*cells, " and ".join(f"{share:.0f}" for share in better) + " %"])
    return rows


COVERAGE_HEADINGS = (
    "truth inside the stated region",
    "recordings",
    "50 %",
    "95 %",
    "99 %",
    "median, of expected",
    "95 % quantile, of expected",
    "99 % quantile",
    "error, mm",
    "stated std, mm",
    "undetermined",
)


def coverage(runs: Sequence[tuple[str, Estimates]]) -> Rows:
    """The share of the recordings in which a region that should hold the truth in 50, 95 or 99 % of cases does, and the
    quantiles of the squared error over the covariance, as multiples of what χ² of its degrees of freedom leads to expect."""
    rows: Rows = []
    for method in METHODS:
        groups = [("all", [f for kind, f in runs if kind in KINDS])]
        groups += [(name, [f for kind, f in runs if kind == name]) for name in (*KINDS, *BEYOND)]
        for name, group in groups:
            mine = [found["default", method] for found in group]
            known = [x for x in mine if x.open_count < 6]
            if not known:
                continue
            squares = np.array([x.square for x in known])
            free = np.array([6 - x.open_count for x in known])
            inside = [f"{100.0 * np.mean(squares <= chi2.ppf(p, free)):.1f}" for p in (0.5, 0.95, 0.99)]
            scaled = [f"{np.quantile(squares / chi2.ppf(p, free), p):.2f}" for p in (0.5, 0.95, 0.99)]
            counts = [sum(x.open_count == k for x in mine) for k in range(7)]
            opened = ", ".join(f"{k}: {count}" for k, count in enumerate(counts) if count)
            typical = [f"{statistics.median(x):.2f}" for x in ([e.error_mm for e in known], [e.claimed_mm for e in known])]
            rows.append([f"{method.upper()}: {name}", str(len(mine)), *inside, *scaled, *typical, opened])
    return rows


KNEE_HEADINGS = (
    "knee",
    "settings",
    "thigh apart, mm",
    "stated",
    "shank apart, mm",
    "stated",
    "knee from thigh and shank, mm",
    "biases, m/s²",
    "unexplained",
    "status",
)
WALK_S = ((56.0, 74.0), (77.0, 95.0))


def knees(path: Path) -> Rows:
    """Both halves of the walk, without the turn between them: how far the centres are apart across the axis."""
    choices: list[tuple[str, str, dict[str, Any], bool]] = [
        ("default SA, axis known", "sa", {}, True),
        ("default SA", "sa", {}, False),
        ("default SS", "ss", {}, False),
        ("published SA", "sa", {"settings": PUBLISHED}, False),
        ("published SS", "ss", {"settings": PUBLISHED}, False),
    ]
    rows: Rows = []
    with np.load(path) as z:
        rate_hz = float(z["rate_hz"])
        sides = {
            side: [
                np.ascontiguousarray(z[f"{segment}_leg_{side}.{kind}"], np.float64)
                for segment in ("upper", "lower")
                for kind in ("gyr", "acc")
            ]
            for side in ("left", "right")
        }
    for side, arrays in sides.items():
        halves = [imus(rate_hz, *(a[round(x * rate_hz) : round(y * rate_hz)] for a in arrays)) for x, y in WALK_S]
        axes = [hinge_axis(*pair) for pair in halves]
        for name, method, keywords, known in choices:
            found = [
                imufast.estimate_joint_center(*pair, method, axis=axis if known else None, **keywords)
                for pair, axis in zip(halves, axes, strict=True)
            ]
            cells: list[str | None] = [side, name]
            for k in (0, 1):
                first, second = (each.axis1 if k == 0 else each.axis2 for each in axes)
                mean = first + np.copysign(1.0, first @ second) * second
                axis = mean / np.linalg.norm(mean)
                centers = [c.in_sensor1 if k == 0 else c.in_sensor2 for c in found]
                across = np.eye(3) - np.outer(axis, axis)
                variances = [c.covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for c in found]
                stated = np.sqrt(sum(np.trace(across @ v @ across) for v in variances))
                cells += [f"{1e3 * np.linalg.norm(across @ (centers[1] - centers[0])):.1f}", f"{1e3 * stated:.1f}"]
            reach = [f"{1e3 * np.linalg.norm(x):.0f}" for c in found for x in (c.in_sensor1, c.in_sensor2)]
            biases = [f"{np.linalg.norm(b):.2f}" for c in found for b in (c.acc_bias1, c.acc_bias2)]
            cells += [f"{reach[0]} and {reach[1]}, {reach[2]} and {reach[3]}", " ".join(biases)]
            cells += [", ".join(f"{c.unexplained:.2f}" for c in found), ", ".join(str(c.status) for c in found)]
            rows.append(cells)
    return rows


@dataclass(frozen=True, eq=False)
class Axes:
    axis1: Array
    axis2: Array


def hinge_axis(imu1: imufast.Imu, imu2: imufast.Imu) -> Axes:
    """The functional axis of half a walk."""
    found = imufast.calibrate_hinge(imu1, imu2)
    if found.axis1 is None or found.axis2 is None:
        raise SystemExit("no axis of the knee in half of the walk")
    return Axes(found.axis1, found.axis2)


RATE_HZ = 100.0
LINEAR_HEADINGS = ("samples", "push, ms", "ns a sample", "result SS, ms", "result SA, ms", "instants used")


def hour(seconds: float = 3600.0) -> list[Array]:
    s = imufast.simulate_ball_joint(duration_s=seconds, rate_hz=RATE_HZ, seed=1, gyr_noise=0.0, acc_noise=0.0)
    return [s.gyr1, s.acc1, s.gyr2, s.acc2]


def spent_ms(call: Callable[[], object]) -> float:
    started = time.process_time()
    call()
    return 1e3 * (time.process_time() - started)


def fed(arrays: Sequence[Array], method: str = "sa", block: int = 1000) -> imufast.JointCenterEstimator:
    estimator = imufast.JointCenterEstimator(RATE_HZ, method=method)
    for start in range(0, len(arrays[0]), block):
        gyr1, acc1, gyr2, acc2 = (a[start : start + block] for a in arrays)
        estimator.push(gyr1, acc1, gyr2, acc2)
    return estimator


def linear() -> Rows:
    """What samples cost on the way in, and what an estimate costs, over the length of the recording."""
    whole = noisy(hour(), np.random.default_rng(1))
    rows: Rows = []
    for samples in (15_000, 60_000, 240_000, 360_000):
        part = [a[:samples] for a in whole]
        push = statistics.median(spent_ms(lambda part=part: fed(part)) for _ in range(3))  # type: ignore[misc]
        results = []
        used = 0
        for method in METHODS:
            estimator = fed(part, method)
            used = estimator.result().n_samples
            results.append(statistics.median(spent_ms(estimator.result) for _ in range(3)))
        rows.append([str(samples), f"{push:.1f}", f"{1e6 * push / samples:.0f}", *(f"{x:.1f}" for x in results), str(used)])
    return rows


def noisy(arrays: Sequence[Array], rng: np.random.Generator) -> list[Array]:
    return [a + std * rng.standard_normal(a.shape) for a, std in zip(arrays, (0.005, 0.05, 0.005, 0.05), strict=True)]


MEMORY_HEADINGS = ("a day at 100 Hz in blocks of 10 s", "resident, MB", "push, ns a sample", "error, mm", "stated std, mm")


def memory(hours: int) -> Rows:
    """A stream of many hours: the same ten minutes' motion again and again, with fresh noise each time."""
    s = imufast.simulate_ball_joint(duration_s=600.0, rate_hz=RATE_HZ, seed=1, gyr_noise=0.0, acc_noise=0.0)
    motion = [s.gyr1, s.acc1, s.gyr2, s.acc2]
    rng = np.random.default_rng(2)
    estimator = imufast.JointCenterEstimator(RATE_HZ)
    rows: Rows = [["before", f"{resident_mb():.1f}", None, None, None]]
    marks = {1, 2, 6, 12, 18, hours}
    for done in range(1, hours + 1):
        took_ms = 0.0
        for start in [*range(0, len(motion[0]), 1000)] * 6:
            block = noisy([a[start : start + 1000] for a in motion], rng)
            took_ms += spent_ms(lambda block=block: estimator.push(*block))  # type: ignore[misc]
        if done in marks:
            center = estimator.result()
            found = judged(center, s)
            cost = f"{1e6 * took_ms / (6 * len(motion[0])):.0f}"
            rows.append([f"hour {done}", f"{resident_mb():.1f}", cost, f"{found.error_mm:.2f}", f"{found.claimed_mm:.2f}"])
    return rows


def resident_mb() -> float:
    """Memory that the process holds now; where the system does not say, the most that it ever held."""
    with contextlib.suppress(OSError):
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def simulations(recordings: int, cores: set[int]) -> list[tuple[str, Estimates]]:
    """The first 300 with the published settings, too, and 60 of each kind beyond the model."""
    kinds = [KINDS[k % len(KINDS)] for k in range(recordings)]
    tasks = [(kind, seed, seed < 300) for seed, kind in enumerate(kinds)]
    extra = min(60, max(1, recordings // 15))
    tasks += [(kind, recordings + extra * i + k, True) for i, kind in enumerate(BEYOND) for k in range(extra)]
    return all_runs(tasks, cores)


def main() -> None:
    parts = ("judge", "coverage", "knees", "linear", "memory")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs/measured.md")
    parser.add_argument("--part", choices=parts, help="one part only")
    parser.add_argument("--recordings", type=int, default=1000, help="how many are simulated; default 1000")
    parser.add_argument("--hours", type=int, default=24, help="length of the stream; default 24")
    chosen = parser.parse_args()
    cores = set(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else {0}
    show = begin(markdown=chosen.markdown)

    def wanted(*names: str) -> bool:
        return chosen.part in (None, *names)

    if wanted("judge", "coverage"):
        runs = simulations(max(len(KINDS), chosen.recordings), cores)
        if wanted("judge"):
            show("Simulated joints, default settings beside the published ones.", JUDGE_HEADINGS, judge(runs))
        if wanted("coverage"):
            title = "Does the stated covariance hold the truth? Default settings, determined directions. Regions of 95 % should"
            text = f"{title}\nhold 90 to 99 %. The quantiles are multiples of what is expected: more than 1 is too sure."
            show(text, COVERAGE_HEADINGS, coverage(runs))
    if wanted("knees"):
        path = data_folder() / "lower_body" / "full_body_walk.npz"
        if not path.exists():
            raise SystemExit(f"the recording of a walking person is missing: {path}")
        title = "A walking person's knees from both halves of the walk, without the direction of the axis. The first half's"
        show(f"{title}\ncentres, then the second's; biases of thigh and shank.", KNEE_HEADINGS, knees(path))
    if wanted("linear"):
        show("Cost over the length of the recording.", LINEAR_HEADINGS, linear())
    if wanted("memory"):
        show("Memory and cost of a stream without end.", MEMORY_HEADINGS, memory(max(1, chosen.hours)))


if __name__ == "__main__":
    main()
