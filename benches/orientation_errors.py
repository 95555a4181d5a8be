"""Relative orientation: how honest the stated uncertainty, and what disturbances and slow sampling do.

    python benches/orientation_errors.py [--markdown] [--part consistency|disturbances|rates] [--runs 100]

The simulations are seeded; no setting is chosen for one of them. Errors are total rotation angles, stds those of
`angle_std_deg`, degrees. About two minutes.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import imufast
import numpy as np
from imufast import Complementary, Imu, Mekf, Smoother
from imufast.simulate import PairSimulation
from measuring import Array, begin, imus, quaternion_errors_deg, relative, rms
from orientation import Method, Rows, truly

SETTLED_S = 10.0
METHODS: dict[str, Method] = {"complementary": Complementary(), "mekf": Mekf(), "smoother": Smoother()}
CONSISTENCY_HEADINGS = (
    "method, calibration",
    "runs",
    "RMSE, °",
    "RMS of std, °",
    "mean of error²/std²",
    "median over runs",
    "5 % to 95 % of runs",
    "NEES over 3",
    "target",
)


def consistency(runs: int) -> Rows:
    """Mean normalised squared errors: error² over the trace of the covariance (1 is honest), and, where the covariance itself
    is known, NEES over its three degrees of freedom."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for seed in range(runs):
        rng = np.random.default_rng([2021, 7, seed])
        s = imufast.simulate_ball_joint(
            imufast.BallMotion(
                "random", duration_s=60.0, tempo=float(rng.uniform(0.7, 1.5)), size=float(rng.uniform(0.7, 1.3))
            ),
            rate_hz=float(rng.choice([50.0, 100.0, 200.0])),
            seed=seed,
            **imufast.random_biases(seed, gyr_rad_s=float(np.radians(0.3)), acc_m_s2=0.1),
            **imufast.random_positions(seed),
        )
        for how, calibration in (("true", truly(s)), ("own", imufast.calibrate_joint(s.imu1, s.imu2))):
            for name, method in METHODS.items():
                tracked = imufast.track(s.imu1, s.imu2, calibration, method)
                later = s.time_s >= (0.0 if name == "smoother" else SETTLED_S)
                errors = quaternion_errors_deg(tracked.q_12, s.q_12)[later]
                std = tracked.angle_std_deg[later]
                nees = nees_over_3(tracked, s.q_12)
                found.setdefault(f"{name}, {how}", []).append(
                    (rms(errors), rms(std), float(np.mean((errors / std) ** 2)), nees)
                )
    rows: Rows = []
    for name, values in found.items():
        errors, stds, squares, nees_ = np.array(values).T
        low, high = np.quantile(squares, [0.05, 0.95])
        cells = [
            f"{rms(errors):.3f}",
            f"{rms(stds):.3f}",
            f"{squares.mean():.2f}",
            f"{np.median(squares):.2f}",
            f"{low:.2f} to {high:.2f}",
        ]
        rows.append(
            [
                name,
                str(runs),
                *cells,
                f"{nees_.mean():.2f}" if np.isfinite(nees_).all() else None,
                None if "complementary" in name else "0.7 to 1.4",
            ]
        )
    return rows


def nees_over_3(tracked: imufast.RelativeOrientation, truth: Array) -> float:
    if tracked.covariance is None:
        return float("nan")
    off = relative(truth, tracked.q_12)
    vector = 2.0 * np.copysign(1.0, off[:, :1]) * off[:, 1:]
    return float(np.mean(np.einsum("ni,ni->n", vector, np.linalg.solve(tracked.covariance, vector[:, :, None])[:, :, 0])) / 3.0)


@dataclass(frozen=True)
class Disturbance:
    name: str
    settings: dict[str, Any]
    walk: float = 0.0
    tissue: float = 0.0


DISTURBANCES = (
    Disturbance("none", {}),
    Disturbance("impacts in 5 % of the samples", {"collisions": imufast.Collisions(per_s=5.0, most_samples=1)}),
    Disturbance("soft tissue, 18/π mm/rad", {}, tissue=0.018 / np.pi),
    Disturbance("soft tissue, 54/π mm/rad", {}, tissue=0.054 / np.pi),
    Disturbance("soft tissue, 180/π mm/rad", {}, tissue=0.18 / np.pi),
    Disturbance("20 % of the packets lost in bursts", {"packet_loss": 0.2, "burst_length": 5.0}),
    Disturbance("gyroscope biases walk, 1 deg/s in 2 min", {}, walk=float(np.radians(1.0) / np.sqrt(120.0))),
    Disturbance("clocks half a sample apart", {"clock_offset_s": 0.005}),
)
DISTURBANCE_HEADINGS = (
    "disturbance, method",
    "runs",
    "RMSE, °",
    "worst run, °",
    "largest error, °",
    "RMS of std, °",
    "std over RMSE",
    "not TRACKED",
    "restarts",
    "diverged silently",
)
SILENT_DEG, SILENT_RATIO = 5.0, 3.0


def disturbances(runs: int) -> Rows:
    """Joints at 100 Hz for two minutes, calibrated before (by the same motion without the disturbance, but with its soft
    tissue) or by the disturbed recording itself. A run has diverged silently where it is TRACKED, off by more than 5 degrees
    RMS, and that is more than 3 times what it states."""
    rows: Rows = []
    for d in DISTURBANCES:
        found: dict[str, list[tuple[float, float, float, float, float, float]]] = {}
        for seed in range(runs):
            tissue = imufast.random_tissue(seed, std_m_rad=d.tissue)
            biases = imufast.random_biases(seed, gyr_rad_s=float(np.radians(0.3)), acc_m_s2=0.1)
            calm, s = (
                imufast.simulate_ball_joint(duration_s=120.0, rate_hz=100.0, seed=1000 + seed, **biases, **tissue, **settings)
                for settings in ({}, d.settings)
            )
            pair = walking(s, d.walk, seed)
            calibrations = [("before", imufast.calibrate_joint(calm.imu1, calm.imu2))]
            if d.settings or d.walk:
                calibrations.append(("by itself", imufast.calibrate_joint(*pair)))
            for how, calibration in calibrations:
                for name, method in METHODS.items():
                    tracked = imufast.track(*pair, calibration, method)
                    found.setdefault(f"{name}, {how}", []).append(judged(tracked, s))
        for name, values in found.items():
            error, std, most, lost, restarts, silent = np.array(values).T
            cells = [f"{rms(error):.2f}", f"{error.max():.2f}", f"{most.max():.1f}", f"{rms(std):.2f}"]
            cells += [f"{rms(std) / rms(error):.2f}", *(f"{x.sum():.0f}" for x in (lost, restarts, silent))]
            rows.append([f"{d.name}: {name}", str(runs), *cells])
    return rows


def judged(tracked: imufast.RelativeOrientation, s: PairSimulation) -> tuple[float, float, float, float, float, float]:
    """RMSE, RMS of the stated std, largest error, degrees; whether it is not TRACKED, restarts, silent divergence."""
    later = s.time_s >= SETTLED_S
    errors = quaternion_errors_deg(tracked.q_12, s.q_12)[later]
    error, std = rms(errors), rms(tracked.angle_std_deg[later])
    lost = tracked.status is not imufast.TrackStatus.TRACKED
    silent = not lost and error > SILENT_DEG and error > SILENT_RATIO * std
    return error, std, float(errors.max()), lost, tracked.restarts, silent


def walking(s: imufast.BallJointSimulation, walk: float, seed: int) -> tuple[Imu, Imu]:
    """Both sensors; their gyroscope biases walk by `walk` rad/s in √s."""
    if not walk:
        return s.imu1, s.imu2
    rng = np.random.default_rng([2021, 8, seed])
    steps = walk * np.sqrt(np.diff(s.time_s, prepend=s.time_s[0]))[:, None]
    first, second = (gyr + np.cumsum(steps * rng.standard_normal(gyr.shape), axis=0) for gyr in (s.gyr1, s.gyr2))
    return imus(100.0, first, s.acc1, second, s.acc2)


RATES_HZ = (10.0, 15.0, 20.0, 25.0, 30.0, 50.0, 100.0, 200.0)
RATE_HEADINGS = ("rate, method", "runs", "RMSE, °", "largest error, °", "RMS of std, °", "largest error over std")


def rates(runs: int) -> Rows:
    """The same half minutes of a ball joint sampled slowly and fast, calibrated by themselves."""
    rows: Rows = []
    for rate_hz in RATES_HZ:
        for name, method in METHODS.items():
            errors, stds = [], []
            for seed in range(1, runs + 1):
                s = imufast.simulate_ball_joint(seed=seed, duration_s=30.0, rate_hz=rate_hz)
                tracked = imufast.track(s.imu1, s.imu2, imufast.calibrate_joint(s.imu1, s.imu2), method)
                errors.append(quaternion_errors_deg(tracked.q_12, s.q_12))
                stds.append(tracked.angle_std_deg)
            error, std = np.concatenate(errors), np.concatenate(stds)
            cells = [f"{rms(error):.2f}", f"{error.max():.1f}", f"{rms(std):.2f}", f"{(error / std).max():.1f}"]
            rows.append([f"{rate_hz:g} Hz: {name}", str(runs), *cells])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs/measured.md")
    parser.add_argument("--part", choices=("consistency", "disturbances", "rates"), help="one part only")
    parser.add_argument("--runs", type=int, default=100, help="simulations of the consistency; default 100")
    chosen = parser.parse_args()
    show = begin(markdown=chosen.markdown)

    runs = max(1, chosen.runs)
    few = max(1, runs // 12)
    if chosen.part in (None, "consistency"):
        show("Is the stated uncertainty honest? Simulated ball joints, a minute each.", CONSISTENCY_HEADINGS, consistency(runs))
    if chosen.part in (None, "disturbances"):
        title = "Disturbances, simulated; impacts of 10 to 60 m/s², soft tissue as H ω̇ with elements of the stated std."
        show(title, DISTURBANCE_HEADINGS, disturbances(few))
    if chosen.part in (None, "rates"):
        show("The same simulated joint sampled at different rates.", RATE_HEADINGS, rates(few))


if __name__ == "__main__":
    main()
