"""The evaluation of Olsson & Halvorsen 2017 by simulation: their methods, literally, and imufast on the same samples.

    python benches/papers/olsson2017/run.py [--markdown] [--runs 100] [--recordings 50] [--table 1|2|3|4]

Table I is made as in section V-B. For Tables II to IV the rig's segments S1 to S7 are simulated at 100 Hz and used as there,
because the paper's recording is not public; the simulated ones share the runs. One set of numbers serves all tables. What the
paper leaves open is settled by its Tables II and III, and no number by Table IV:

- The sensors' noise is what section V-B calls typical of them. Accelerometer biases of `--acc-bias`, by default what calibrated
  sensors keep from one year to the next. Gyroscope biases as S1 leaves them: none.
- S3 to S7 are twice as brisk as `simulate_ball_joint` has them: with that noise, SA then scatters by 0.3 mm in S6 and S7, as
  the paper's does. (Its rig also paused: fewer of its samples are above the gate.)
- Hands hold the links half way to the sensors. Did they hold the joint, its acceleration would have nothing to do with the
  rotations, and wrong orientations would cost LS no more in S5, which moves in both planes, than in S6 and S7. Table III says
  otherwise.
- Collisions in S6 and S7 alone, "occasionally" (section VI-D; one in 5 s), "impulse like": one sample each, 40 to 160 m/s² in
  any direction. They let SS lose to SA in Table II what the paper's loses, about 1 mm.
- The orientations of LS come from the paper's filter (literal.orientations) as section VI-C runs it: over the whole recording
  from rest in S1 on, where gravity tells the inclination and the magnetometer, never used again, the heading, to 5° (section
  V-B). In Table IV it sees the accelerations with their soft tissue. Its tuning is not in the paper. Here the accelerometers
  have their noise, and the rates 0.1 rad/s: what a sum of rates times period leaves out, which is half a period times the
  angular acceleration, rms over S3 to S7. LS is then worse than the paper's in Table II and better in Table III. Told of the
  gyroscopes' noise alone, 30 times less, it is five times closer in Table II and Table III is out of reach.

So tuned, the filter follows whatever acceleration happens to be near g in size, and soft tissue changes which do: of Table IV's
runs, orientations differ by tens of degrees, which shifts LS as much again as eq. 29's skew part shifts all methods alike, by
some 6.5 mm. That is why LS alone scatters over H. The paper's grows from Table II to Table IV, ours does not; the paper's gate
of 5 % was found on the accelerations of Table II.

The published methods see instants at which a sensor turns faster than 1.2 rad/s, 500 at random where the paper says so, and the
literal ones start where the paper's do, at random; imufast needs no random start. "default" is imufast without settings. In
Table I it gets the same samples; else the whole recording or segment, which is one estimate where the others draw many, so that
its std is that between recordings (in Table IV, over the soft tissue).

The paper's numbers come from one rig of its own, whose joint was measured by hand to ±2 mm; its SA is always 13 and 7 mm from
there. So what compares is the order of the methods. Ours stands with the difference between neighbours and its standard error,
over recordings (in Table I, runs); neighbours closer than two of them are a tie, ≈. In the paper's order a tie is what its
section VI-D takes for one: less than those 2 mm.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import imufast
from imufast import CenterSettings
from imufast.center import fit_joint_center
from imufast.quaternion import from_matrix, matrix
from imufast.simulate import paper_segment
from measuring import one_core, refuse_debug_build, table

from olsson2017 import literal
from olsson2017.literal import Array, Moments

RATE_HZ, LEAST_RATE, PICKED = 100.0, 1.2, 500
ACC_STD, GYR_STD, GYR_DOT_STD = np.sqrt([1e-2, 1e-5, 5e-2])
"""Section V-B."""
FILTER_STDS = 0.1, float(ACC_STD)
"""Of rates and accelerations, as the paper's filter is told."""
TEMPO, GRIP_M = 2.0, 0.167
COLLISIONS = imufast.Collisions(per_s=0.2, least_m_s2=40.0, most_m_s2=160.0, most_samples=1, motions=("S6", "S7"))
ORIENTATION_STD = np.radians(5.0)
GRAVITY = 9.82
TISSUE_STD = 0.018 / np.pi
SAME_COST = 1e-3
PAPER_TIE_MM = 2.0
"""How well the paper's joint was measured."""
R1, R2 = np.array([0.334, 0.0, 0.028]), np.array([-0.325, 0.0, 0.028])
BEFORE = ("S1", "S2")
SEGMENTS = ("S3", "S4", "S5", "S6", "S7")
PUBLISHED = CenterSettings.as_published()
METHODS = ("ls", "ss", "sa")
# Mean error and std of r1, then of r2, mm.
PAPER: dict[str, tuple[tuple[float, float, float, float], ...]] = {
    "I": ((0.22, 0.09, 0.23, 0.10), (0.07, 0.03, 0.07, 0.03), (0.08, 0.03, 0.09, 0.04)),
    "II": ((16.8, 0.0, 11.3, 0.0), (13.8, 0.0, 8.9, 0.0), (13.0, 0.0, 7.1, 0.0)),
    "S3": ((332.7, 19.4, 181.8, 18.3), (17.5, 0.5, 6.6, 0.4), (17.5, 2.3, 6.8, 1.6)),
    "S4": ((806.5, 13.4, 655.5, 11.5), (15.9, 0.4, 5.1, 0.3), (15.0, 1.3, 6.0, 0.7)),
    "S5": ((325.6, 23.4, 129.3, 27.5), (13.8, 0.5, 6.8, 0.5), (13.0, 1.3, 7.3, 1.0)),
    "S6": ((40.0, 6.4, 33.9, 10.5), (24.2, 23.6, 10.7, 8.8), (13.1, 0.2, 7.4, 0.3)),
    "S7": ((20.9, 8.1, 21.1, 7.1), (22.4, 12.7, 9.4, 2.4), (13.0, 0.3, 7.1, 0.3)),
    "IV": ((31.6, 12.2, 22.7, 12.4), (17.6, 5.6, 11.2, 4.2), (15.2, 3.7, 10.4, 4.0)),
}
Rows = list[list[str | None]]
Found = tuple[Rows, Rows, list[str]]
"""Errors, orders, and what else there is to say."""
ORDERS = "table", "best to worst as published, mm", "paper, mm"


@dataclass(frozen=True, eq=False)
class Samples:
    """What one estimation run is given: instants, and orientations (sensor to global) for LS."""

    moments: Moments
    rotation1: Array
    rotation2: Array

    def at(self, rows: NDArray[np.int64]) -> Samples:
        return Samples(self.moments.at(rows), self.rotation1[rows], self.rotation2[rows])

    def literally(self, method: str, start: Array) -> tuple[Array, float]:
        """Stacked r1, r2 and the cost."""
        if method == "ls":
            return literal.least_squares(self.moments, self.rotation1, self.rotation2), 0.0
        return (literal.squares if method == "ss" else literal.absolutes)(self.moments, start)

    def ours(self, method: str, settings: CenterSettings | None) -> imufast.CenterEstimate:
        q_12 = from_matrix(np.swapaxes(self.rotation1, 1, 2) @ self.rotation2) if method == "ls" else None
        return fit_joint_center(*self.moments.arrays, method, q_12=q_12, settings=settings)


class Tally:
    """Errors of many runs by who and method, and how the literal methods and imufast as published agree."""

    def __init__(self) -> None:
        self.errors: dict[tuple[str, str], list[list[Array]]] = {}
        self.apart_mm: dict[str, list[float]] = {}
        self.elsewhere: dict[str, list[bool]] = {}
        self.worse: dict[str, list[bool]] = {}
        self.open: dict[str, list[bool]] = {}

    def add(self, who: str, method: str, recording: int, r: Array) -> None:
        """Errors (eq. 28) of stacked r1, r2 in millimetres."""
        error = 1e3 * np.linalg.norm(r.reshape(2, 3) - [R1, R2], axis=1)
        groups = self.errors.setdefault((who, method), [])
        while len(groups) <= recording:
            groups.append([])
        groups[recording].append(error)

    def published(self, samples: Samples, recording: int, rng: np.random.Generator) -> None:
        """All methods as published, both ways, on the same samples."""
        for method in METHODS:
            r, cost = samples.literally(method, rng.standard_normal(6))
            self.add("literal", method, recording, r)
            center = samples.ours(method, PUBLISHED)
            mine = -np.concatenate([center.in_sensor1, center.in_sensor2])
            self.add("as published", method, recording, mine)
            apart = 1e3 * float(np.abs(mine - r).max())
            other = method != "ls" and abs(cost - center.cost) > SAME_COST * center.cost
            self.elsewhere.setdefault(method, []).append(other)
            self.worse.setdefault(method, []).append(other and center.cost > cost)
            if not other:
                self.apart_mm.setdefault(method, []).append(apart)

    def default(self, method: str, recording: int, center: imufast.CenterEstimate) -> None:
        self.add("default", method, recording, -np.concatenate([center.in_sensor1, center.in_sensor2]))
        self.open.setdefault(method, []).append(len(center.undetermined) > 0)

    def rows(self, name: str, paper: Sequence[Sequence[float]]) -> Rows:
        rows: Rows = []
        for who in ("literal", "as published", "default"):
            for method, theirs in zip(METHODS, paper, strict=True):
                groups = [np.array(group) for group in self.errors.get((who, method), []) if group]
                if not groups:
                    continue
                every = np.concatenate(groups)
                # Eq. 27 knows one recording: the std is that within, but for one estimate a recording.
                single = all(len(group) == 1 for group in groups)
                std = every.std(axis=0) if single else np.sqrt(np.mean([group.var(axis=0) for group in groups], axis=0))
                mean, middle = every.mean(axis=0), np.median(every, axis=0)
                cells = [f"{name} {method.upper()} {who}", str(len(every))]
                cells += [written(x) for k in (0, 1) for x in (mean[k], std[k], middle[k])]
                rows.append([*cells, *(f"{x:g}" for x in theirs)])
        return rows

    def order(self, name: str, paper: Sequence[Sequence[float]], *, exact: bool = False) -> list[str | None]:
        """Best to worst as published, and in the paper: by the mean over r1 and r2, with the differences between neighbours.
        The paper's are told apart by 2 mm or, where the truth is `exact`, by twice the standard error of its 100 runs."""
        groups = {method: self.errors["as published", method] for method in METHODS}
        several = len(groups["ls"]) > 1
        ours = {
            method: np.array([np.mean(group) for group in each] if several else np.mean(each[0], axis=1))
            for method, each in groups.items()
        }
        theirs = {method: (r1 + r2) / 2.0 for method, (r1, _, r2, _) in zip(METHODS, paper, strict=True)}
        spread = {method: np.hypot(std1, std2) / 20.0 for method, (_, std1, _, std2) in zip(METHODS, paper, strict=True)}
        found = _ordered(
            {method: float(each.mean()) for method, each in ours.items()},
            lambda a, b: 2.0 * standard_error(ours[b] - ours[a]),
            lambda a, b: f"{written(float((ours[b] - ours[a]).mean()))} ± {written(standard_error(ours[b] - ours[a]))}",
        )
        printed = _ordered(
            theirs,
            lambda a, b: 2.0 * float(np.hypot(spread[a], spread[b])) if exact else PAPER_TIE_MM,
            lambda a, b: written(theirs[b] - theirs[a]),
        )
        return [name, found, printed]

    def agreement(self) -> str:
        """How far imufast as published is from the literal methods."""
        said = []
        for method in METHODS:
            apart, other, worse = (x.get(method, []) for x in (self.apart_mm, self.elsewhere, self.worse))
            text = f"{method.upper()} at most {max(apart):.2g} mm apart" if apart else f"{method.upper()} never alike"
            if method != "ls":
                text += f" where the costs agree to {100 * SAME_COST:g} %, in {len(other) - sum(other)} of {len(other)} runs"
                text += f" ({sum(worse)} times imufast's cost is higher)" if any(other) else ""
            said.append(text)
        text = "imufast as published and the literal methods: " + "; ".join(said) + "."
        left = [f"{method.upper()} in {sum(each)} of {len(each)}" for method, each in self.open.items() if any(each)]
        return text + (f" The default calls a direction undetermined: {', '.join(left)}." if left else "")


def _ordered(means: dict[str, float], tie: Callable[[str, str], float], apart: Callable[[str, str], str]) -> str:
    """ "A < B (by so much) ≈ C (by so much)"."""
    names = sorted(means, key=means.__getitem__)
    text = names[0].upper()
    for a, b in pairwise(names):
        text += f" {'<' if means[b] - means[a] > tie(a, b) else '≈'} {b.upper()} (by {apart(a, b)})"
    return text


def standard_error(values: Array) -> float:
    """Of the mean; infinite of one value."""
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("inf")


def written(value: float) -> str:
    return format(value, ".3f" if value < 1.0 else ".2f" if value < 10.0 else ".1f")


HEADINGS = (
    "table, method",
    "runs",
    "r1 mean, mm",
    "std",
    "median",
    "r2 mean, mm",
    "std",
    "median",
    "paper r1",
    "std",
    "paper r2",
    "std",
)


def ideal(rng: np.random.Generator, count: int) -> Samples:
    """Independent samples of section V-B."""

    def turns(std: float) -> Array:
        return literal.rotations(std * rng.standard_normal((count, 3)))

    def signals(rotation: Array, r: Array) -> tuple[Array, Array, Array]:
        gyr, gyr_dot = 10.0 * rng.standard_normal((2, count, 3))
        acc = (a0 @ rotation)[:, 0] + literal.k_matrix(gyr, gyr_dot) @ r  # a0 turned to the sensor frame, eqs 3 and 4
        noisy = (x + std * rng.standard_normal(x.shape) for x, std in zip((gyr, gyr_dot, acc), stds, strict=True))
        return next(noisy), next(noisy), next(noisy)

    stds = GYR_STD, GYR_DOT_STD, ACC_STD
    direction = rng.standard_normal((count, 3))
    a0 = GRAVITY * (direction / np.linalg.norm(direction, axis=1, keepdims=True))[:, None, :]
    rotation1, rotation2 = (matrix(unit(rng.standard_normal((count, 4)))) for _ in (1, 2))
    moments = Moments(*signals(rotation1, R1), *signals(rotation2, R2))
    return Samples(moments, turns(ORIENTATION_STD) @ rotation1, turns(ORIENTATION_STD) @ rotation2)


def unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v, axis=1, keepdims=True))


def table_1(runs: int) -> Found:
    tally = Tally()
    for run in range(runs):
        rng = np.random.default_rng([2017, 1, run])
        samples = ideal(rng, PICKED)
        tally.published(samples, 0, rng)
        for method in METHODS:
            center = samples.ours(method, None)
            tally.default(method, 0, center)
    return tally.rows("I", PAPER["I"]), [tally.order("I", PAPER["I"], exact=True)], [tally.agreement()]


@dataclass(frozen=True, eq=False)
class Rig:
    """A simulated recording of the rig.

    `begun` are true turns (N, 3, 3) of either sensor from where the filter starts, `gyr_dots` eq. 8 (N, 3), 0 where a neighbour
    is missing; `rows` are above the gate, `plain` is what the sensors read without soft tissue."""

    simulation: imufast.BallJointSimulation
    begun: tuple[Array, Array]
    gyr_dots: tuple[Array, Array]
    rows: NDArray[np.int64]

    @classmethod
    def simulate(cls, seed: int, acc_bias: float) -> Rig:
        s = imufast.simulate_ball_joint(
            [*BEFORE, *(replace(paper_segment(name), tempo=TEMPO, grip_m=GRIP_M) for name in SEGMENTS)],
            rate_hz=RATE_HZ,
            seed=seed,
            gyr_noise=float(GYR_STD),
            acc_noise=float(ACC_STD),
            gravity=GRAVITY,
            collisions=COLLISIONS,
            **imufast.random_biases(seed, gyr_rad_s=0.0, acc_m_s2=acc_bias),
            **imufast.paper_rig(),
        )
        rng = np.random.default_rng([2017, 2, seed])
        off = literal.rotations(ORIENTATION_STD * rng.standard_normal((2, 1)) * np.array([0.0, 0.0, 1.0]))
        # Where both neighbours are one period away.
        k = np.arange(1, len(s.time_s) - 1)
        k = k[s.time_s[k + 1] - s.time_s[k - 1] < 2.5 / RATE_HZ]
        gyr_dots = np.zeros_like(s.gyr1), np.zeros_like(s.gyr2)
        for gyr_dot, gyr in zip(gyr_dots, (s.gyr1, s.gyr2), strict=True):
            gyr_dot[k] = 0.5 * RATE_HZ * (gyr[k + 1] - gyr[k - 1])
        fast = np.maximum(*(np.linalg.norm(gyr[k], axis=1) for gyr in (s.gyr1, s.gyr2))) > LEAST_RATE
        begun = off[0] @ matrix(s.q_1), off[1] @ matrix(s.q_2)
        return cls(s, begun, gyr_dots, k[fast & np.isin(s.motion[k], SEGMENTS)])

    @cached_property
    def plain(self) -> Reading:
        return self.read(np.zeros((1, 2, 3, 3)))[0]

    def read(self, tissue: Array) -> list[Reading]:
        """What the accelerometers read with soft tissue by each of B pairs of H (eq. 29), (B, 2, 3, 3), and what the filter
        makes of it. The angular accelerations are the measured ones, as in the paper."""
        s = self.simulation
        accs, turned = [], []
        for i, (gyr, acc) in enumerate(((s.gyr1, s.acc1), (s.gyr2, s.acc2))):
            accs.append(acc + self.gyr_dots[i] @ np.swapaxes(tissue[:, i], 1, 2))
            turned.append(literal.orientations(s.time_s, gyr, accs[i], self.begun[i], GRAVITY, FILTER_STDS))
        return [Reading(self, acc1, acc2, *both) for acc1, acc2, *both in zip(*accs, *turned, strict=True)]


@dataclass(frozen=True, eq=False)
class Reading:
    """Accelerations (N, 3) of a recording, and the orientations (N, 3, 3) that the paper's filter has of them."""

    rig: Rig
    acc1: Array
    acc2: Array
    rotation1: Array
    rotation2: Array

    @cached_property
    def samples(self) -> Samples:
        """Those above the gate."""
        s, rows = self.rig.simulation, self.rig.rows
        first, second = ((gyr, dot) for gyr, dot in zip((s.gyr1, s.gyr2), self.rig.gyr_dots, strict=True))
        every = Moments(*first, self.acc1, *second, self.acc2)
        return Samples(every, self.rotation1, self.rotation2).at(rows)

    def pick(self, segment: str, rng: np.random.Generator) -> Samples:
        """500 samples of a segment at random (all, where fewer are above the gate); of S6 and S7 half from before and half from
        after the turn upside down."""
        s, above = self.rig.simulation, self.rig.rows
        rows = np.flatnonzero(s.motion[above] == segment)
        parts = [rows]
        if segment in ("S6", "S7"):
            inside = s.time_s[s.motion == segment]
            late = s.time_s[above[rows]] > 0.5 * (inside[0] + inside[-1])
            parts = [rows[~late], rows[late]]
        each = PICKED // len(parts)
        return self.samples.at(np.concatenate([rng.choice(part, min(each, len(part)), replace=False) for part in parts]))

    def defaults(self, tally: Tally, recording: int, segments: Sequence[str]) -> None:
        """All methods of imufast without settings, of the whole of these segments."""
        s = self.rig.simulation
        rows = np.isin(s.motion, segments)
        pair = [
            imufast.Imu(gyr[rows], acc[rows], time_s=s.time_s[rows], name=name)
            for gyr, acc, name in ((s.gyr1, self.acc1, "1"), (s.gyr2, self.acc2, "2"))
        ]
        q_12 = from_matrix(np.swapaxes(self.rotation1[rows], 1, 2) @ self.rotation2[rows])
        for method in METHODS:
            center = imufast.estimate_joint_center(pair[0], pair[1], method, q_12=q_12 if method == "ls" else None)
            tally.default(method, recording, center)


def table_2(rigs: Sequence[Rig], runs: int) -> Found:
    tally = Tally()
    for index, rig in enumerate(rigs):
        rng = np.random.default_rng([2017, 3, index])
        for _ in range(max(1, runs // len(rigs))):
            tally.published(rig.plain.samples, index, rng)
        rig.plain.defaults(tally, index, SEGMENTS)
    counts = [len(rig.rows) for rig in rigs]
    notes = [f"Samples above the gate: {min(counts)} to {max(counts)} (paper: 6280).", tally.agreement()]
    return tally.rows("II", PAPER["II"]), [tally.order("II", PAPER["II"])], notes


def table_3(rigs: Sequence[Rig], runs: int) -> Found:
    rows: Rows = []
    orders: Rows = []
    notes = []
    for segment in SEGMENTS:
        tally = Tally()
        for index, rig in enumerate(rigs):
            rng = np.random.default_rng([2017, 4, index, SEGMENTS.index(segment)])
            for _ in range(max(1, runs // len(rigs))):
                tally.published(rig.plain.pick(segment, rng), index, rng)
            rig.plain.defaults(tally, index, (segment,))
        rows += tally.rows(f"III {segment}", PAPER[segment])
        orders.append(tally.order(f"III {segment}", PAPER[segment]))
        notes.append(f"{segment}: {tally.agreement()}")
    return rows, orders, notes


def table_4(rigs: Sequence[Rig], runs: int) -> Found:
    """H of eq. 29 anew for every run."""
    tally = Tally()
    for index, rig in enumerate(rigs):
        rng = np.random.default_rng([2017, 5, index])
        tissue = TISSUE_STD * rng.standard_normal((max(1, runs // len(rigs)), 2, 3, 3))
        for reading in rig.read(tissue):
            tally.published(reading.samples, index, rng)
            reading.defaults(tally, index, SEGMENTS)
    return tally.rows("IV", PAPER["IV"]), [tally.order("IV", PAPER["IV"])], [tally.agreement()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print tables for a document")
    parser.add_argument("--runs", type=int, default=100, help="runs of each table (or segment); default 100, the paper's")
    parser.add_argument("--recordings", type=int, default=50, help="simulated recordings that share the runs; default 50")
    parser.add_argument("--acc-bias", type=float, default=0.03, help="size of each accelerometer bias, m/s²; default 0.03")
    parser.add_argument("--table", type=int, choices=(1, 2, 3, 4), help="one table only")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    warnings.simplefilter("ignore", imufast.ImufastWarning)
    runs = max(1, chosen.runs)
    needed = chosen.table != 1
    rigs = [Rig.simulate(seed, chosen.acc_bias) for seed in range(max(1, chosen.recordings))] if needed else []
    tables: dict[int, tuple[str, Callable[[], Found]]] = {
        1: ("Table I: ideal excitation, 500 independent samples.", lambda: table_1(runs)),
        2: ("Table II: S3 to S7, all samples above the gate.", lambda: table_2(rigs, runs)),
        3: ("Table III: 500 random samples of one segment.", lambda: table_3(rigs, runs)),
        4: ("Table IV: S3 to S7 with simulated soft tissue.", lambda: table_4(rigs, runs)),
    }
    for number, (title, make) in tables.items():
        if chosen.table in (None, number):
            started = time.perf_counter()
            rows, orders, notes = make()
            took = f"({time.perf_counter() - started:.0f} s)"
            print(f"{title}\n\n{table(HEADINGS, rows, markdown=chosen.markdown)}\n")
            print(table(ORDERS, orders, markdown=chosen.markdown), *notes, took, sep="\n\n", end="\n\n", flush=True)


if __name__ == "__main__":
    main()
