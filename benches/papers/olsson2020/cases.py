"""Simulated recordings of the paper's evaluation, and what both methods make of them: the paper's, literally, and imufast's."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import imufast
import literal
import numpy as np
from imufast.simulate.motions import Motion, paper_motion, scenario_motions
from numpy.typing import NDArray

Array = NDArray[np.float64]
RATE_HZ, WINDOW, ENERGY_THRESHOLD, WEIGHT_RATIO = 50, 21, 1.0, 50.0
INFORMATIVE = (3, 4, 5, 6, 7, 10, 11, 12, 13, 14)
ACC_BIAS, GYR_BIAS = 0.1, np.radians(0.5)
"""Biases that the paper names for its sensors, m/s² and rad/s; the gyroscopes' are then taken away as measured at rest."""
HORIZONTAL_RAD = np.radians(5.0)
"""So far is a "horizontal" axis held from horizontal: exactly there nothing but accelerometer bias would pair the signs."""


@dataclass(frozen=True, eq=False)
class Case:
    """One recording as both methods get it, with the true axes."""

    time_s: Array
    gyr1: Array
    acc1: Array
    gyr2: Array
    acc2: Array
    axis1: Array
    axis2: Array

    def biased(self, seed: int) -> Case:
        """The same with the artificial biases of section 7.5, in random directions."""
        b = imufast.random_biases(seed)
        gyr1, gyr2 = self.gyr1 + b["gyr_bias1"], self.gyr2 + b["gyr_bias2"]
        acc1, acc2 = self.acc1 + b["acc_bias1"], self.acc2 + b["acc_bias2"]
        return Case(self.time_s, gyr1, acc1, gyr2, acc2, self.axis1, self.axis2)

    def imus(self) -> tuple[imufast.Imu, imufast.Imu]:
        return (
            imufast.Imu(self.gyr1, self.acc1, time_s=self.time_s, name="1"),
            imufast.Imu(self.gyr2, self.acc2, time_s=self.time_s, name="2"),
        )

    def errors_deg(self, axis1: Array, axis2: Array) -> Array:
        """(R, 2) AD as in section 7.2: the pair has the sign that suits axis 1; a wrongly paired axis 2 is up to 180° off."""
        first, second = (
            literal.apart_deg(axis, np.broadcast_to(truth, axis.shape))
            for axis, truth in ((np.atleast_2d(axis1), self.axis1), (np.atleast_2d(axis2), self.axis2))
        )
        turned = first > 90.0
        return np.stack([np.where(turned, 180.0 - first, first), np.where(turned, 180.0 - second, second)], axis=1)


def held(motion: Motion) -> Motion:
    """A motion of the paper as a hand holds it."""
    horizontal = motion.kind in ("sequential", "planar") and motion.axis_tilt_rad == 0.0
    return replace(motion, axis_tilt_rad=HORIZONTAL_RAD) if horizontal else motion


@functools.lru_cache(maxsize=64)
def scenario_case(scenario: int, seed: int, transition_s: float, duration_s: float = 50.0) -> Case:
    """A scenario of section 7.1; gyroscope biases as the mean over motion 1 shows them are subtracted."""
    biases = imufast.random_biases(1000 + seed, gyr_rad_s=GYR_BIAS, acc_m_s2=ACC_BIAS)
    motions = [held(motion) for motion in scenario_motions(scenario, duration_s)]
    s = imufast.simulate_hinge(motions, transition_s=transition_s, rate_hz=RATE_HZ, seed=seed, **biases)
    rest = s.motion == "1"
    gyr1, gyr2 = (gyr - gyr[rest].mean(axis=0) for gyr in (s.gyr1, s.gyr2))
    return Case(s.time_s, gyr1, s.acc1, gyr2, s.acc2, s.axis1, s.axis2)


def motion_case(motion: int, seed: int, duration_s: float) -> Case:
    """One motion alone, as in section 7.2."""
    biases = imufast.random_biases(1000 + seed, gyr_rad_s=0.0, acc_m_s2=ACC_BIAS)
    s = imufast.simulate_hinge(held(paper_motion(motion, duration_s)), rate_hz=RATE_HZ, seed=seed, **biases)
    return Case(s.time_s, s.gyr1, s.acc1, s.gyr2, s.acc2, s.axis1, s.axis2)


def six_by_six() -> Array:
    """(36, 6) the initial estimates of section 7.2: each axis along ±x, ±y, ±z."""
    ends = np.vstack([np.eye(3), -np.eye(3)])
    return np.array([np.concatenate([a, b]) for a in ends for b in ends])


@dataclass(frozen=True)
class Run:
    """How one repetition ended: when an estimate was first accepted, in seconds of data (None: never), and its errors then."""

    accepted_at_s: float | None
    errors_deg: tuple[float, float]
    note: str = ""


def literal_runs(
    case: Case, rng: np.random.Generator, repeats: int, max_samples: int, max_error_deg: float, n_mins: Sequence[int]
) -> dict[int, list[Run]]:
    """Section 7.4: the literal algorithm second by second, `repeats` times with other random initial estimates."""
    arrays = case.gyr1, case.acc1, case.gyr2, case.acc2
    selection = literal.Selection(*arrays, max_samples, WINDOW, ENERGY_THRESHOLD)
    rules = {n_min: literal.Algorithm4(repeats, max_error_deg, n_min) for n_min in n_mins}
    never = Run(None, (np.nan, np.nan))
    runs = {n_min: [never] * repeats for n_min in n_mins}
    for second in range(1, len(case.gyr1) // RATE_HZ + 1):
        batch = selection.batch(second * RATE_HZ, WEIGHT_RATIO)
        if len(batch.acc1) < 4:
            continue
        estimates = literal.algorithm_1(batch, rng.normal(size=(repeats, 6)))
        errors = case.errors_deg(estimates.axis1, estimates.axis2)
        for n_min, rule in rules.items():
            for k in np.flatnonzero(rule.step(estimates)):
                if runs[n_min][k].accepted_at_s is None:
                    runs[n_min][k] = Run(float(second), (float(errors[k, 0]), float(errors[k, 1])))
        if all(run.accepted_at_s is not None for n_min in n_mins for run in runs[n_min]):
            break
    return runs


def our_run(case: Case, max_samples: int, max_error_deg: float, n_consistent: int) -> Run:
    """imufast on the same recording, default settings otherwise: one limit for hinges and approximate hinges alike."""
    result = imufast.calibrate_hinge(
        *case.imus(),
        max_samples=max_samples,
        max_error_deg=max_error_deg,
        max_error_approximate_deg=max_error_deg,
        n_consistent=n_consistent,
    )
    first = next((step for step in result.history if step.accepted), None)
    if first is None or first.axis1 is None or first.axis2 is None or first.bound95_deg is None or first.misfit is None:
        last = result.history[-1]
        return Run(None, (np.nan, np.nan), f"{last.verdict}: {'; '.join(last.why)}")
    errors = case.errors_deg(first.axis1, first.axis2)[0]
    note = f"{first.verdict}, bound {first.bound95_deg.max():.2f}°, misfit {first.misfit:.3f}"
    passed = float((case.time_s <= first.time_s).sum()) / RATE_HZ
    return Run(passed, (float(errors[0]), float(errors[1])), note)


def rmsae_deg(errors: Array) -> float:
    """Eq. 71."""
    return float(np.sqrt(np.mean(np.square(errors))))
