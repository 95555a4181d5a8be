"""The evaluation of Remmerswaal et al. 2021 by simulation (Table I): their filters, literally, and imufast on the same samples.

    python benches/papers/remmerswaal2021/run.py [--markdown] [--runs 100] [--smoother-runs 10] [--sampling held|instant]

As in section IV: 800 s at 10 Hz, both sensors turn by ±sin(πt/100T) rad/s about one axis after the other, the joint's
acceleration is uniform within ±10 m/s² and new in each sample, r1 = -r2 = (1, 0, 0) m, noise of 1 deg/s and 0.0981 m/s²;
disturbances begin after 100 s; every filter starts at the identity. What the paper leaves open is decided here:

- t is in seconds (a period of 20 s): only then are its largest disturbances by soft tissue what the paper prints (8.7e-3 m/s²),
  and only if H is drawn anew for each sample and sensor. Each period is about another axis: x, y, z, and again.
- "held": a rate holds over the step that begins at its sample; see `literal.py` for why. No sensor does so, and imufast has no
  setting for it: there everybody is given the same rates of steps and the same accelerations of the joint (eq. 3), and the
  filters of imufast are told that rates hold (`midpoint=False`); the smoother cannot be told and is half a sample late.
- "instant": the sensors turn by the exact sinusoid, rates are read at instants, and imufast starts from what the sensors read.
  The literal filters, which take rates for held ones, are half a sample late.
- The true orientations begin at the identity, too. The Kalman filters start with 1 degree a sensor.
- Each sensor has its own 5 % of outliers, size uniform within 50 to 100 σ, direction uniform on the sphere.
- The noise of eq. 4 is that of the two accelerometers, √2·σ, as the paper assumes; what differentiated rates leave on a
  lever of 1 m is larger.
- θ is the mean over the whole 800 s, its std that between runs.

All know noise and lever arms. The smoother gets fewer runs, for it is many times slower. The paper's numbers are from its own
draws and stand beside for orientation.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import imufast
from imufast import Complementary, JointCalibration, JointCenter, Mekf, SensorNoise, Smoother
from measuring import imus, one_core, refuse_debug_build, table

from remmerswaal2021 import literal
from remmerswaal2021.literal import Array, Recordings

STEP_S, SAMPLES, SETTLED = 0.1, 8000, 1000
GYR_STD, ACC_STD = np.pi / 180.0, 9.81 / 100.0
R1, R2 = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])
BETA, START_STD = float(np.sqrt(3.0) * GYR_STD), float(np.radians(1.0))
LINK_STD = float(np.sqrt(2.0) * ACC_STD)
CONDITIONS = ("no disturbance", "5 % outliers", "lowest soft tissue", "middle", "highest")
TISSUE = (0.0, 0.0, 0.018 / np.pi, 1.8 / np.pi, 18.0 / np.pi)
FILTERS = ("Algorithm 1", "Kalman", "Kalman, rejecting")
# Table I: mean and std of θ, degrees, of the three filters.
PAPER = (
    ((0.71, 0.008), (0.59, 0.007), (0.62, 0.008)),
    ((0.75, 0.010), (3.11, 0.109), (0.65, 0.040)),
    ((0.71, 0.008), (0.59, 0.007), (0.64, 0.081)),
    ((0.82, 0.011), (0.73, 0.009), (0.89, 0.084)),
    ((1.52, 0.056), (3.62, 0.059), (1.99, 0.260)),
)
Rows = list[list[str | None]]


@dataclass(frozen=True, eq=False)
class Motion:
    """The true motion at N instants: orientations (N, 4), sensor to global, and rates and their derivatives (N, 3) of sensor 1;
    those of sensor 2 are the opposite. `next_q_12` (N, 4) is q_12 one step later."""

    q1: Array
    q2: Array
    next_q_12: Array
    gyr: Array
    gyr_dot: Array

    @property
    def q_12(self) -> Array:
        return literal.product(literal.conjugate(self.q1), self.q2)

    @classmethod
    def make(cls, sampling: str) -> Motion:
        k = np.arange(SAMPLES)
        axis = np.eye(3)[(k // 200) % 3]  # a period is 200 T
        pace = np.pi / (100.0 * STEP_S)
        gyr = np.sin(pace * k * STEP_S)[:, None] * axis
        gyr_dot = pace * np.cos(pace * k * STEP_S)[:, None] * axis
        # From each sample to the next: a rate that holds, or the whole way of the sinusoid.
        way = STEP_S * gyr
        if sampling == "instant":
            way = ((np.cos(pace * k * STEP_S) - np.cos(pace * (k + 1) * STEP_S)) / pace)[:, None] * axis
        q1, q2 = [np.array([[1.0, 0.0, 0.0, 0.0]])], [np.array([[1.0, 0.0, 0.0, 0.0]])]
        for step in literal.exponential(0.5 * way)[:, None]:
            q1.append(literal.product(q1[-1], step))
            q2.append(literal.product(q2[-1], literal.conjugate(step)))
        all1, all2 = np.concatenate(q1), np.concatenate(q2)
        return cls(all1[:-1], all2[:-1], literal.product(literal.conjugate(all1[1:]), all2[1:]), gyr, gyr_dot)


def simulate(motion: Motion, seeds: Sequence[int]) -> Recordings:
    """The five conditions of each seed, (5·runs, N, 3), condition by condition within a run; the noise is the same in all."""
    parts: list[list[Array]] = [[], [], [], []]
    for seed in seeds:
        rng = np.random.default_rng([2021, seed])
        joint = rng.uniform(-10.0, 10.0, (SAMPLES, 3))
        for sensor, (sign, q, r) in enumerate(((1.0, motion.q1, R1), (-1.0, motion.q2, R2))):
            true, dot = sign * motion.gyr, sign * motion.gyr_dot
            seen = np.einsum("nji,nj->ni", literal.matrix(q), joint)
            acc = seen + np.cross(true, np.cross(true, r)) + np.cross(dot, r)
            gyr = true + GYR_STD * rng.standard_normal(true.shape)
            acc = acc + ACC_STD * rng.standard_normal(acc.shape)
            direction = rng.standard_normal(acc.shape)
            size = ACC_STD * rng.uniform(50.0, 100.0, SAMPLES) * (rng.random(SAMPLES) < 0.05)
            outliers = size[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
            tissue = np.einsum("nij,nj->ni", rng.standard_normal((SAMPLES, 3, 3)), dot)  # eq. 14
            late = (np.arange(SAMPLES) >= SETTLED)[:, None]
            parts[2 * sensor] += [gyr] * len(CONDITIONS)
            parts[2 * sensor + 1] += [
                acc + late * (outliers * (name == "5 % outliers") + std * tissue)
                for name, std in zip(CONDITIONS, TISSUE, strict=True)
            ]
    gyr1, acc1, gyr2, acc2 = (np.stack(part) for part in parts)
    return Recordings(gyr1, acc1, gyr2, acc2, STEP_S, R1, R2)


def angles_deg(q_12: Array, truth: Array) -> Array:
    """Angular distance, degrees: (B, N), of (B, N, 4) from (N, 4) or (B, N, 4)."""
    inner = (q_12 * truth).sum(axis=-1)
    # Half the chord is exact for small angles, too.
    chord = np.linalg.norm(q_12 - np.copysign(1.0, inner)[..., None] * truth, axis=-1)
    return np.asarray(np.degrees(4.0 * np.arcsin(np.minimum(1.0, 0.5 * chord))))


Method = Complementary | Mekf | Smoother


def known(r1: Array, r2: Array) -> JointCalibration:
    """All that the filters know beforehand; the sensors have no bias."""
    noise = SensorNoise(GYR_STD, GYR_STD, ACC_STD, ACC_STD, 1.0 / STEP_S)
    center = JointCenter(-r1, -r2, np.zeros((6, 6)), np.zeros((0, 6)))
    return JointCalibration(center=center, gyr_bias_std=1e-4, noise=noise)


@dataclass(frozen=True, eq=False)
class Given:
    """What imufast is given: recordings, and whether they are what the sensors read."""

    recordings: Recordings
    sampling: str

    def track(self, rows: Sequence[int], method: Method) -> tuple[Array, Array]:
        """q_12 (B, N, 4) and the stated std in degrees (B, N) of some of the recordings."""
        r = self.recordings
        gyr1, acc1, gyr2, acc2, calibration = r.gyr1, r.acc1, r.gyr2, r.acc2, known(R1, R2)
        if self.sampling == "held":
            acc1, acc2 = (np.nan_to_num(acc) for acc in r.joint_accelerations())
            calibration = known(np.zeros(3), np.zeros(3))
            if not (isinstance(method, Complementary) and method.literal):
                # For imufast a rate holds over the step that ends at its sample; Algorithm 1 needs no such shift.
                gyr1, gyr2 = (gyr[:, [0, *range(gyr.shape[1] - 1)]] for gyr in (gyr1, gyr2))
        found, stds = [], []
        for row in rows:
            pair = imus(1.0 / STEP_S, gyr1[row], acc1[row], gyr2[row], acc2[row])
            start = None if isinstance(method, Smoother) else (1.0, 0.0, 0.0, 0.0)
            std_deg = float(np.degrees(np.sqrt(6.0) * START_STD))
            tracked = imufast.track(pair[0], pair[1], calibration, method, start=start, start_std_deg=std_deg)
            found.append(tracked.q_12)
            stds.append(tracked.angle_std_deg)
        return np.stack(found), np.stack(stds)


class Tally:
    """Errors by method and condition."""

    def __init__(self) -> None:
        self.errors: dict[str, list[Array]] = {}
        self.stds: dict[str, list[Array]] = {}

    def add(self, name: str, errors: Array, stds: Array | None = None) -> None:
        """(5·runs, N) errors, condition by condition within a run."""
        split = errors.reshape(-1, len(CONDITIONS), errors.shape[1])
        self.errors.setdefault(name, []).append(np.stack([split.mean(axis=2), np.sqrt((split**2).mean(axis=2))], axis=2))
        if stds is not None:
            stated = stds.reshape(-1, len(CONDITIONS), stds.shape[1])
            self.stds.setdefault(name, []).append(np.sqrt((stated**2).mean(axis=2)))

    def of(self, name: str, condition: int) -> tuple[float, float, float, int]:
        """Mean θ, its std, RMSE, degrees, and the number of runs."""
        values = np.concatenate(self.errors[name])[:, condition]
        rmse = float(np.sqrt((values[:, 1] ** 2).mean()))
        return float(values[:, 0].mean()), float(values[:, 0].std()), rmse, len(values)

    def difference(self, name: str, other: str, condition: int) -> tuple[float, float]:
        """Mean and standard error of the difference of mean θ, run by run, degrees."""
        mine = np.concatenate(self.errors[name])[:, condition, 0]
        apart = mine - np.concatenate(self.errors[other])[: len(mine), condition, 0]
        return float(apart.mean()), float(apart.std(ddof=1) / np.sqrt(len(apart))) if len(apart) > 1 else float("inf")

    def claimed(self, name: str, condition: int) -> float | None:
        """Stated over actual RMSE."""
        if name not in self.stds:
            return None
        stated = np.sqrt((np.concatenate(self.stds[name])[:, condition] ** 2).mean())
        return float(stated / self.of(name, condition)[2])


HEADINGS = ("condition, method", "runs", "mean θ, °", "std", "RMSE, °", "stated over RMSE", "paper θ, °", "std")


def rows_of(tally: Tally) -> Rows:
    rows: Rows = []
    for condition, title in enumerate(CONDITIONS):
        for name in tally.errors:
            mean, std, rmse, runs = tally.of(name, condition)
            claimed = tally.claimed(name, condition)
            paper: list[str | None] = [None, None]
            if name.startswith("literal "):
                value, spread = PAPER[condition][FILTERS.index(name.removeprefix("literal "))]
                paper = [f"{value:.2f}", f"{spread:.3f}"]
            stated = None if claimed is None else f"{claimed:.2f}"
            rows.append([f"{title}: {name}", str(runs), f"{mean:.3f}", f"{std:.3f}", f"{rmse:.3f}", stated, *paper])
    return rows


PUBLISHED: dict[str, Method] = {
    "Algorithm 1": Complementary.as_published(GYR_STD),
    "Kalman": Mekf.as_published("none"),
    "Kalman, rejecting": Mekf.as_published("reject"),
}
BLOCK = 50
"""So many runs at a time."""


def compare(sampling: str, runs: int, smoother_runs: int) -> tuple[Tally, list[str]]:
    """All methods on all conditions, and how near the published filters of imufast are to the literal ones."""
    motion, tally = Motion.make(sampling), Tally()
    midpoint = sampling == "instant"
    defaults: dict[str, Method] = {
        "default complementary": Complementary(midpoint=midpoint),
        "default mekf": Mekf(midpoint=midpoint),
    }
    apart: dict[str, list[Array]] = {}
    for first in range(0, runs, BLOCK):
        seeds = range(first, min(first + BLOCK, runs))
        recordings = simulate(motion, seeds)
        given, every = Given(recordings, sampling), range(len(seeds) * len(CONDITIONS))
        start = np.tile([1.0, 0.0, 0.0, 0.0], (len(every), 1))
        literals = {FILTERS[0]: literal.complementary(recordings, BETA, start, start)}
        for reject in (False, True):
            found = literal.kalman(recordings, GYR_STD, LINK_STD, start, start, START_STD, reject=reject)
            literals[FILTERS[1 + reject]] = found
        truths = {name: motion.next_q_12 if name == FILTERS[0] else motion.q_12 for name in FILTERS}
        for name, q_12 in literals.items():
            tally.add(f"literal {name}", angles_deg(q_12, truths[name]))
        for name, method in PUBLISHED.items():
            if sampling == "held":
                q_12, stds = given.track(every, method)
                tally.add(f"as published {name}", angles_deg(q_12, truths[name]), stds)
                # The delay of differentiation leaves imufast without a correction at either end.
                apart.setdefault(name, []).append(angles_deg(q_12, literals[name]))
        for title, choice in defaults.items():
            q_12, stds = given.track(every, choice)
            tally.add(title, angles_deg(q_12, motion.q_12), stds)
        few = range(max(0, min(smoother_runs - first, len(seeds))) * len(CONDITIONS))
        if few:
            q_12, stds = given.track(few, Smoother())
            tally.add("default smoother", angles_deg(q_12, motion.q_12), stds)
    return tally, [agreement(name, np.concatenate(values)) for name, values in apart.items()]


def agreement(name: str, apart: Array) -> str:
    """How far the two forms of a published filter are from each other, by condition."""
    rms = np.sqrt((apart.reshape(-1, len(CONDITIONS), apart.shape[1]) ** 2).mean(axis=(0, 2)))
    return f"{name}, as published and literal: " + ", ".join(f"{x:.2g}" for x in rms) + "° apart (RMS, condition by condition)."


def verdicts(tally: Tally) -> list[str]:
    """What of the paper's findings comes out, and where imufast is better."""
    mean = {name: [tally.of(name, k)[0] for k in range(len(CONDITIONS))] for name in tally.errors}
    lines = []
    for k, title in enumerate(CONDITIONS):
        found = sorted(FILTERS, key=lambda name: mean[f"literal {name}"][k])
        printed = sorted(FILTERS, key=lambda name: PAPER[k][FILTERS.index(name)][0])
        same = "as in the paper" if found == printed else f"paper: {' < '.join(printed)}"
        lines.append(f"{title}: {' < '.join(found)} ({same})")
    said = ["Best to worst, literal: " + "; ".join(lines) + "."]
    effects = []
    for name, column in ((f"literal {f}", i) for i, f in enumerate(FILTERS)):
        ratios = ", ".join(
            f"{mean[name][k] / mean[name][0]:.2f} ({PAPER[k][column][0] / PAPER[0][column][0]:.2f})" for k in (1, 3, 4)
        )
        effects.append(f"{name.removeprefix('literal ')} {ratios}")
    said.append(
        "Growth of θ by outliers, middle and highest soft tissue, beside the paper's (in brackets): " + "; ".join(effects) + "."
    )
    for name in (n for n in mean if n.startswith("default")):
        rivals = FILTERS[:1] if "complementary" in name else FILTERS
        whom = "Algorithm 1" if "complementary" in name else "the best literal filter"
        rows = []
        for k, title in enumerate(CONDITIONS):
            rival = min((f"literal {f}" for f in rivals), key=lambda rival: mean[rival][k])
            off, error = tally.difference(name, rival, k)
            verdict = "a tie" if abs(off) < 2.0 * error else "better" if off < 0.0 else "worse"
            rows.append(f"{title} {off:+.3f} ± {error:.3f} ({verdict})")
        said.append(f"{name} less {whom}, °, mean and standard error of the differences run by run: {', '.join(rows)}.")
    return said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print tables for a document")
    parser.add_argument("--runs", type=int, default=100, help="runs of each condition; default 100, the paper's")
    parser.add_argument("--smoother-runs", type=int, default=10, help="of them also smoothed; default 10")
    parser.add_argument("--sampling", choices=("held", "instant"), help="one meaning of a rate sample only; default both")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    warnings.simplefilter("ignore", imufast.ImufastWarning)
    runs = max(1, chosen.runs)
    for sampling, title, count in (
        ("held", "Table I, a rate holds over the step that begins at its sample.", runs),
        ("instant", "The same, the rates read at instants of the exact sinusoid.", max(1, runs // 5)),
    ):
        if chosen.sampling in (None, sampling):
            began = time.perf_counter()
            tally, notes = compare(sampling, count, min(chosen.smoother_runs, count))
            print(f"{title}\n\n{table(HEADINGS, rows_of(tally), markdown=chosen.markdown)}\n")
            print(*notes, *verdicts(tally), f"({time.perf_counter() - began:.0f} s)", sep="\n\n", end="\n\n", flush=True)


if __name__ == "__main__":
    main()
