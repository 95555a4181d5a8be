"""A self-calibrating filter that starts anywhere: what it reaches, and why it is no method of imufast.

    python benches/self_calibrating.py [--markdown] [--part rig|simulated|people] [--every 20]

The filter is that of `key_filter.py`; joint centre and all biases are unknown to it. A window begins every so many seconds and
lasts 40. It fails where it ever is off by more than 5° while it states less than 2°, or never starts although the motion
shows the orientation. NEES/3 is the squared error over the stated covariance, 1 where that is honest.

Rig: against optics (0.25° of its own are added to what is stated), beside the Kalman filter that knows the joint as
`calibrate_joint` finds it from the whole recording, over the same moments. Simulated: against the truth. People: there is no
truth; the reference is the smoother over the whole 100 s, whose stated covariance is added, beside the smoother over each
window alone. About two and a half minutes of CPU time.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import imufast
import numpy as np
from imufast.quaternion import matrix
from key_filter import Keys, Settings, log, track
from measuring import Array, data_folder, imus, one_core, refuse_debug_build, rms, setting, table
from numpy.typing import NDArray

Signals = tuple[Array, Array, Array, Array]
Rows = list[list[str | None]]
WINDOW_S, KEYS_PER_S = 40.0, 10
WRONG_DEG, SURE_DEG = 5.0, 2.0
REFERENCE_STD = math.radians(0.25)


@dataclass(frozen=True, eq=False)
class Recording:
    """Both sensors, and what is known of the orientation: (N, 3, 3), its covariance (N, 3, 3), where it is valid."""

    signals: Signals
    rate_hz: float
    reference: Array
    covariance: Array
    valid: Array

    def pair(self, begin: int = 0, end: int | None = None) -> tuple[imufast.Imu, imufast.Imu]:
        return imus(self.rate_hz, *(x[begin:end] for x in self.signals))

    def windows(self, every_s: float) -> Iterator[tuple[int, int]]:
        """First sample of each window and the one past its last; none is shorter than 10 s."""
        count = len(self.signals[0])
        for begin in np.arange(0.0, count / self.rate_hz - 10.0, every_s):
            first = round(begin * self.rate_hz)
            yield first, min(count, first + round(WINDOW_S * self.rate_hz))


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors and what is stated (degrees), squared errors over the stated covariance, and seconds since the window began."""

    errors: Array
    stated: Array
    nees: Array
    seconds: Array

    def failed(self) -> bool:
        return bool(((self.errors > WRONG_DEG) & (self.stated < SURE_DEG)).any())


def judge(rec: Recording, begin: int, sample: NDArray[np.int64], r: Array, covariance: Array) -> Judged:
    """Where the reference is valid."""
    kept = rec.valid[begin + sample]
    sample, r, covariance = sample[kept], r[kept], covariance[kept]
    at = begin + sample
    off = np.array([log(found.T @ true) for found, true in zip(r, rec.reference[at], strict=True)]).reshape(-1, 3)
    both = covariance + rec.covariance[at]
    nees = np.einsum("ki,ki->k", off, np.linalg.solve(both, off[..., None])[..., 0])
    stated = np.degrees(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))
    return Judged(np.degrees(np.linalg.norm(off, axis=1)), stated, nees, sample / rec.rate_hz)


def self_calibrating(rec: Recording, begin: int, end: int, settings: Settings) -> Judged | None:
    """None: it never started."""
    gyr1, acc1, gyr2, acc2 = (x[begin:end] for x in rec.signals)
    keys = Keys.of((gyr1, gyr2), (acc1, acc2), rec.rate_hz)
    found = track(keys, settings)
    return None if found.begin is None else judge(rec, begin, keys.sample[found.begin :], found.r, found.covariance)


HEADINGS = (
    "recordings",
    "windows",
    "never started",
    "started after, median, s",
    "latest",
    "RMSE, °",
    "at 10 s",
    "20 s",
    "40 s",
    "largest error",
    "stated, RMS",
    "NEES/3",
    "failed",
)


def row(name: str, judged: list[Judged | None]) -> list[str | None]:
    """All windows of one kind."""
    started = [j for j in judged if j is not None and len(j.errors)]
    never = str(sum(j is None for j in judged))
    if not started:
        return [name, str(len(judged)), never, *[None] * (len(HEADINGS) - 3)]
    first = [float(j.seconds[0]) for j in started]
    errors, stated, nees = (np.concatenate([getattr(j, what) for j in started]) for what in ("errors", "stated", "nees"))
    cells: list[str | None] = [f"{np.median(first):.1f}", f"{max(first):.1f}", f"{rms(errors):.2f}"]
    for at in (10.0, 20.0, WINDOW_S - 0.3):
        near = [j.errors[np.abs(j.seconds - at) < 0.6 / KEYS_PER_S] for j in started]
        there = np.concatenate(near)
        cells.append(f"{rms(there):.2f}" if len(there) else None)
    cells += [f"{errors.max():.1f}", f"{rms(stated):.2f}", f"{nees.mean() / 3.0:.1f}", str(sum(j.failed() for j in started))]
    return [name, str(len(judged)), never, *cells]


def rig(every_s: float) -> Rows:
    """Each recording, all together, and the calibrated Kalman filter over the same moments."""
    rows: Rows = []
    every: list[Judged | None] = []
    known: list[Judged | None] = []
    for path in sorted((data_folder() / "two_imu_joint").glob("*.npz")):
        with np.load(path) as z:
            g1, a1, g2, a2 = (np.ascontiguousarray(z[k], np.float64) for k in ("gyr1", "acc1", "gyr2", "acc2"))
            reference, valid = matrix(z["q_12_reference"]), z["reference_valid"].astype(bool)
            rate_hz = float(z["rate_hz"])
        noise = np.broadcast_to(REFERENCE_STD**2 / 3.0 * np.eye(3), reference.shape)
        rec = Recording((g1, a1, g2, a2), rate_hz, reference, noise, valid)
        calibration = imufast.calibrate_joint(*rec.pair())
        own: list[Judged | None] = []
        for begin, end in rec.windows(every_s):
            found = self_calibrating(rec, begin, end, Settings())
            own.append(found)
            if found is not None and len(found.seconds):
                sample = np.round(found.seconds * rate_hz).astype(np.int64)
                tracked = imufast.track(*rec.pair(begin, end), calibration, "mekf")
                variance = (np.radians(tracked.angle_std_deg[sample]) ** 2 / 3.0)[:, None, None] * np.eye(3)
                known.append(judge(rec, begin, sample, matrix(tracked.q_12[sample]), variance))
        rows.append(row(path.stem, own))
        every += own
    return [*rows, row("all", every), row("all: `Mekf`, calibrated", known)]


def simulated() -> Rows:
    """Ball joints with all biases, two windows of each of two seeds."""
    kinds: tuple[tuple[str, dict[str, Any], float, float], ...] = (
        ("both segments roam", {}, 0.0, 0.0),
        ("a hinge", {"dof": 1}, 0.0, 0.0),
        ("gyroscope biases walk, 1 deg/s in 2 min", {}, 0.0, math.radians(1.0) / math.sqrt(120.0)),
        ("clocks half a sample apart", {"clock_offset_s": 0.005}, 0.0, 0.0),
        ("soft tissue, 18/π mm/rad", {}, 0.018 / math.pi, 0.0),
        ("soft tissue, 180/π mm/rad", {}, 0.18 / math.pi, 0.0),
        ("impacts in 5 % of the samples", {"collisions": imufast.Collisions(per_s=5.0, most_samples=1)}, 0.0, 0.0),
        ("hanging in a hand", {"motion": "held"}, 0.0, 0.0),
        ("lying", {"motion": "stationary"}, 0.0, 0.0),
    )
    rows: Rows = []
    for name, settings, tissue, walk in kinds:
        judged: list[Judged | None] = []
        for seed in (1, 2):
            biases = imufast.random_biases(seed, gyr_rad_s=math.radians(0.5), acc_m_s2=0.15)
            tissues = imufast.random_tissue(seed, std_m_rad=tissue)
            s = imufast.simulate_ball_joint(duration_s=60.0, rate_hz=100.0, seed=1000 + seed, **biases, **tissues, **settings)
            rng = np.random.default_rng([8, seed])
            wander = walk / math.sqrt(100.0) * np.cumsum(rng.standard_normal((2, *s.gyr1.shape)), axis=1)
            signals = (s.gyr1 + wander[0], s.acc1, s.gyr2 + wander[1], s.acc2)
            truth = matrix(s.q_12)
            rec = Recording(signals, 100.0, truth, np.zeros_like(truth), np.ones(len(truth), bool))
            judged += [self_calibrating(rec, begin, end, Settings()) for begin, end in list(rec.windows(20.0))[:2]]
        rows.append(row(name, judged))
    return rows


LIMBS = {
    "left knee": ("upper_leg_left", "lower_leg_left"),
    "right knee": ("upper_leg_right", "lower_leg_right"),
    "left ankle": ("lower_leg_left", "foot_left"),
}
UNPAIRED = ("upper_leg_left", "lower_leg_right")
FEW = Settings(start_std=math.radians(5.0), independent_links=16.0)


def people() -> Rows:
    """Knees and an ankle against the smoother over all; two sensors of no joint, which should never start."""
    path = data_folder() / "lower_body" / "full_body_walk.npz"
    if not path.exists():
        return []
    with np.load(path) as z:
        data = {name: np.ascontiguousarray(z[name], np.float64) for name in z.files if name.endswith(("gyr", "acc"))}
    rows: Rows = []
    for name, limbs in {**LIMBS, "no joint": UNPAIRED}.items():
        g1, a1, g2, a2 = (data[f"{limb}.{kind}"] for limb in limbs for kind in ("gyr", "acc"))
        whole = imufast.track(*imus(100.0, g1, a1, g2, a2))
        assert whole.covariance is not None
        rec = Recording((g1, a1, g2, a2), 100.0, matrix(whole.q_12), whole.covariance, np.ones(len(g1), bool))
        windows = list(rec.windows(25.0))
        rows.append(row(name, [self_calibrating(rec, *w, Settings()) for w in windows]))
        if limbs != UNPAIRED:
            rows.append(row(f"{name}: at most 16 independent links", [self_calibrating(rec, *w, FEW) for w in windows]))
            rows.append(row(f"{name}: smoother over the window", [smoothed(rec, *w) for w in windows]))
    return rows


def smoothed(rec: Recording, begin: int, end: int) -> Judged:
    """What the smoother says at every tenth of a second of a window."""
    tracked = imufast.track(*rec.pair(begin, end))
    assert tracked.covariance is not None
    sample = np.arange(0, end - begin, round(rec.rate_hz / KEYS_PER_S), dtype=np.int64)
    return judge(rec, begin, sample, matrix(tracked.q_12[sample]), tracked.covariance[sample])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs")
    parser.add_argument("--part", choices=("rig", "simulated", "people"), help="one part only")
    parser.add_argument("--every", type=float, default=20.0, help="seconds between windows on the rig; default 20")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    warnings.simplefilter("ignore", imufast.ImufastWarning)
    print(setting(), end="\n\n")
    parts: dict[str, Callable[[], Rows]] = {
        "rig": lambda: rig(max(1.0, chosen.every)),
        "simulated": simulated,
        "people": people,
    }
    for name, run in parts.items():
        if chosen.part in (None, name):
            print(f"{name}\n\n{table(HEADINGS, run(), markdown=chosen.markdown)}\n", flush=True)


if __name__ == "__main__":
    main()
