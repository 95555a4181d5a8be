"""Algorithm 1 of Olsson et al. 2020 (Sensors, doi 10.3390/s20123534), literally: spherical coordinates, one row a sample.

Equation numbers are the paper's. Its slips are mended: eq. 25 takes the second accelerometer, and where a rate is parallel to
its axis, eq. 37 is zero. Eq. 41 is singular at the poles (theta = ±90°); a minimum-norm step there is all that is done about
it, so start elsewhere. Slow on purpose: nothing here shares a line or an idea with the code under test.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Data:
    """Rates (N, 3) and accelerations (M, 3) of both sensors, and the weights of eq. 70.

    With a finite `rate_scale` c, rad/s, each rate residual also counts c / (c + ‖ω1‖ + ‖ω2‖); the paper has none.
    """

    gyr1: Array
    gyr2: Array
    acc1: Array
    acc2: Array
    weight_ratio: float = 50.0
    rate_scale: float = float("inf")

    @property
    def gyr_weight(self) -> Array:
        """(N,) weight of each rate residual."""
        speed = np.linalg.norm(self.gyr1, axis=1) + np.linalg.norm(self.gyr2, axis=1)
        return np.asarray(np.sqrt(self.weight_ratio) / (1.0 + speed / self.rate_scale))

    @property
    def acc_weight(self) -> float:
        return float(1.0 / np.sqrt(self.weight_ratio))


@dataclass(frozen=True)
class Estimate:
    """Where Algorithm 1 ended."""

    x: Array
    cost: float

    @property
    def axis1(self) -> Array:
        return axis(self.x[:2])

    @property
    def axis2(self) -> Array:
        return axis(self.x[2:])


def axis(angles: Array) -> Array:
    """Eq. 21: (theta, phi) to a unit vector."""
    theta, phi = angles
    return np.array([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)])


def axis_slope(angles: Array) -> Array:
    """Eq. 41: (2, 3) derivative of eq. 21."""
    theta, phi = angles
    by_theta = [-np.sin(theta) * np.cos(phi), -np.sin(theta) * np.sin(phi), np.cos(theta)]
    by_phi = [-np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi), 0.0]
    return np.array([by_theta, by_phi])


def angles(vector: Array) -> Array:
    """The inverse of eq. 21."""
    x, y, z = vector / np.linalg.norm(vector)
    return np.array([np.arcsin(np.clip(z, -1.0, 1.0)), np.arctan2(y, x)])


def gyr_residuals(x: Array, data: Data) -> Array:
    """Eq. 24."""
    first = np.linalg.norm(np.cross(data.gyr1, axis(x[:2])), axis=1)
    second = np.linalg.norm(np.cross(data.gyr2, axis(x[2:])), axis=1)
    return np.asarray(data.gyr_weight * (first - second))


def acc_residuals(x: Array, data: Data) -> Array:
    """Eq. 25."""
    return np.asarray(data.acc_weight * (data.acc1 @ axis(x[:2]) - data.acc2 @ axis(x[2:])))


def residuals(x: Array, data: Data) -> Array:
    """Eq. 32."""
    return np.concatenate([gyr_residuals(x, data), acc_residuals(x, data)])


def norm_slope(gyr: Array, j: Array) -> Array:
    """Eq. 37 for all samples (N, 3); zero where the rate is parallel to the axis."""
    perpendicular = np.cross(gyr, j)
    length = np.linalg.norm(perpendicular, axis=1, keepdims=True)
    return np.asarray(np.divide(np.cross(perpendicular, gyr), length, out=np.zeros_like(gyr), where=length > 0.0))


def jacobian(x: Array, data: Data) -> Array:
    """Eqs 31 and 35-41: (N + M, 4)."""
    slope1, slope2 = axis_slope(x[:2]), axis_slope(x[2:])
    of_gyr = data.gyr_weight[:, None] * np.hstack(
        [norm_slope(data.gyr1, axis(x[:2])) @ slope1.T, -norm_slope(data.gyr2, axis(x[2:])) @ slope2.T]
    )
    of_acc = data.acc_weight * np.hstack([data.acc1 @ slope1.T, -data.acc2 @ slope2.T])
    return np.vstack([of_gyr, of_acc])


def cost(x: Array, data: Data) -> float:
    """Eq. 23."""
    e = residuals(x, data)
    return float(e @ e)


def gauss_newton(x: Array, data: Data, tolerance: float, max_iterations: int) -> Estimate:
    """Lines 2-14 of Algorithm 1."""
    here = cost(x, data)
    for _ in range(max_iterations):
        # The minimum-norm solution of line 7.
        step = np.linalg.lstsq(jacobian(x, data), residuals(x, data), rcond=None)[0]
        alpha, there = 1.0, cost(x - step, data)
        while there >= here and alpha > 1e-9:  # backtracking line search
            alpha *= 0.5
            there = cost(x - alpha * step, data)
        if there >= here:
            break
        x, gained, here = x - alpha * step, here - there, there
        if gained < tolerance * here:
            break
    return Estimate(x, here)


def algorithm_1(x: Array, data: Data, tolerance: float = 1e-14, max_iterations: int = 500) -> Estimate:
    """Algorithm 1 from one initial estimate (4,): both sign pairings, the better one (eqs 28 and 29).

    The tolerance is relative to the cost (the paper leaves V_tol open).
    """
    first = gauss_newton(x, data, tolerance, max_iterations)
    other = np.array([first.x[0], first.x[1], -first.x[2], first.x[3] + np.pi])
    second = gauss_newton(other, data, tolerance, max_iterations)
    return first if first.cost <= second.cost else second


def random_start(rng: np.random.Generator) -> Array:
    """An initial estimate (4,) uniform over both spheres."""
    return np.concatenate([angles(rng.standard_normal(3)), angles(rng.standard_normal(3))])


def best_of(data: Data, starts: int, seed: int) -> Estimate:
    """The best of Algorithm 1 from several random starts."""
    rng = np.random.default_rng(seed)
    return min((algorithm_1(random_start(rng), data) for _ in range(starts)), key=lambda estimate: estimate.cost)


def covariance(x: Array, data: Data) -> Array:
    """Eqs 57 and 58: (4, 4) of the spherical coordinates, each residual scaled by its own standard deviation."""
    gyr_std = np.std(gyr_residuals(x, data), ddof=1)
    acc_std = np.std(acc_residuals(x, data), ddof=1)
    rows = len(data.gyr1)
    scaled = np.vstack([jacobian(x, data)[:rows] / gyr_std, jacobian(x, data)[rows:] / acc_std])
    return np.asarray(np.linalg.inv(scaled.T @ scaled))


def angular_deviation_bound(x: Array, p: Array, draws: int, seed: int) -> Array:
    """Eqs 60-65 by Monte Carlo: mean plus two standard deviations of the angle of each axis, (2,), rad."""
    drawn = np.random.default_rng(seed).multivariate_normal(x, p, size=draws)
    spread = []
    for part in (slice(0, 2), slice(2, 4)):
        theta, phi = drawn[:, part].T
        vectors = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], axis=1)
        truth = axis(x[part])
        # Eq. 59 by a form that is exact for small angles.
        angle = np.arctan2(np.linalg.norm(np.cross(vectors, truth), axis=1), vectors @ truth)
        spread.append(angle.mean() + 2.0 * angle.std(ddof=1))
    return np.array(spread)
