"""Olsson & Halvorsen 2017 (Fusion, "Experimental Evaluation of Joint Position Estimation Using Inertial Sensors") as published:
LS, SS and SA in plain numpy, for comparison only.

Equation numbers are the paper's. r goes from the joint centre to the sensor. What the paper leaves open is decided here:

- SS is Gauss-Newton (eqs 15-19) whose step is halved, at most 30 times, until the cost falls. It ends where the cost falls by
  less than 1e-12 of itself.
- SA needs "other gradient descent-type methods": here BFGS on the subgradients (eqs 21-23) with a line search that halves and
  doubles until both weak Wolfe conditions hold (Lewis & Overton 2013), which is made for kinks. It ends where no step lowers
  the cost any more.
- The orientations of LS come from section VI-C's extended Kalman filter with orientation deviation states: rates integrated,
  gravity seen by the accelerometer wherever its norm is within 5 % of g, as inclination alone, no magnetometer. Where it starts
  and its noise are said by its caller; over the pauses of a simulation its error stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TOLERANCE, ITERATIONS, HALVINGS = 1e-12, 300, 30
GATE, START_STD = 0.05, np.radians(5.0)


@dataclass(frozen=True, eq=False)
class Moments:
    """Rates, angular accelerations and specific forces of both sensors at N instants, (N, 3) each."""

    gyr1: Array
    gyr_dot1: Array
    acc1: Array
    gyr2: Array
    gyr_dot2: Array
    acc2: Array

    def at(self, rows: NDArray[np.int64]) -> Moments:
        return Moments(*(a[rows] for a in self.arrays))

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        return self.gyr1, self.gyr_dot1, self.acc1, self.gyr2, self.gyr_dot2, self.acc2


def skew(v: Array) -> Array:
    """(N, 3, 3) matrices of the cross product with each row."""
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)


def rotations(vectors: Array) -> Array:
    """(N, 3, 3) rotation by each rotation vector (N, 3)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    across = skew(vectors)
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * across + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * across @ across)


def orientations(time_s: Array, gyr: Array, acc: Array, begun: Array, gravity: float, stds: tuple[float, float]) -> Array:
    """(B, N, 3, 3) from sensor to global as the extended Kalman filter has them, for each of B accelerations (B, N, 3) that go
    with the same rates (N, 3). R is off by the deviation η, true R = exp(η) R, and where ‖a‖ is near g, R a − g e_z is
    g [e_z×] η: the heading is not seen. `begun` (N, 3, 3) are true turns from its start, where it is off by 5° (section V-B);
    `stds` of gyr and acc, one sample."""
    gyr_std, acc_std = stds
    period_s = float(np.median(np.diff(time_s)))
    still = np.abs(np.linalg.norm(acc, axis=2) - gravity) < GATE * gravity
    steps_s = np.diff(time_s, prepend=time_s[0])
    turns = rotations(steps_s[:, None] * np.roll(gyr, 1, axis=0))
    down = np.array([0.0, 0.0, gravity])
    h = skew(down[None])[0]
    noise = acc_std**2 * np.eye(3)
    found = np.empty((*acc.shape, 3))
    r = np.repeat(begun[:1], len(acc), axis=0)
    p = np.repeat(START_STD**2 * np.eye(3)[None], len(acc), axis=0)
    for k, step_s in enumerate(steps_s):
        if step_s > 2.5 * period_s:
            r = r @ (begun[k - 1].T @ begun[k])
        else:
            r = r @ turns[k]
            p = p + (step_s * gyr_std) ** 2 * np.eye(3)
        if still[:, k].any():
            off = (r @ acc[:, k, :, None])[:, :, 0] - down
            gain = np.swapaxes(np.linalg.solve(h @ p @ h.T + noise, h @ p), 1, 2) * still[:, k, None, None]
            r = rotations((gain @ off[:, :, None])[:, :, 0]) @ r
            p = p - gain @ h @ p
        found[:, k] = r
    return found


def k_matrix(gyr: Array, gyr_dot: Array) -> Array:
    """K(ω, ω̇) of eqs 3-5: ω×(ω×r) + ω̇×r = K r."""
    across = skew(gyr)
    return across @ across + skew(gyr_dot)


def least_squares(m: Moments, rotation1: Array, rotation2: Array) -> Array:
    """Eqs 9-14 with R1, R2 (N, 3, 3) that take vectors of either sensor to the global frame; stacked r1, r2."""
    left = np.concatenate(
        [rotation1 @ k_matrix(m.gyr1, m.gyr_dot1), -rotation2 @ k_matrix(m.gyr2, m.gyr_dot2)], axis=2
    ).reshape(-1, 6)
    right = (rotation1 @ m.acc1[:, :, None] - rotation2 @ m.acc2[:, :, None]).reshape(-1)
    return np.asarray(np.linalg.pinv(left) @ right)


class Residuals:
    """e(k, r) of eq. 16 and its derivatives (eqs 17 and 18)."""

    def __init__(self, m: Moments) -> None:
        self.k1 = k_matrix(m.gyr1, m.gyr_dot1).reshape(-1, 3)
        self.k2 = k_matrix(m.gyr2, m.gyr_dot2).reshape(-1, 3)
        self.acc1, self.acc2 = m.acc1, m.acc2

    def values(self, r: Array) -> tuple[Array, Array, Array]:
        """e (N,), and the unit vectors e_i/‖e_i‖ of eq. 19 (N, 3)."""
        e1 = self.acc1 - (self.k1 @ r[:3]).reshape(-1, 3)
        e2 = self.acc2 - (self.k2 @ r[3:]).reshape(-1, 3)
        length1, length2 = (np.sqrt(np.einsum("ij,ij->i", e, e)) for e in (e1, e2))
        return length1 - length2, e1 / length1[:, None], e2 / length2[:, None]

    def jacobian(self, unit1: Array, unit2: Array) -> Array:
        of1 = -np.einsum("ni,nij->nj", unit1, self.k1.reshape(-1, 3, 3))
        of2 = np.einsum("ni,nij->nj", unit2, self.k2.reshape(-1, 3, 3))
        return np.hstack([of1, of2])

    def absolute(self, r: Array) -> tuple[float, Array]:
        """Eq. 20 and a subgradient (eqs 21-23)."""
        e, unit1, unit2 = self.values(r)
        sign = np.sign(e)[:, None]
        of1 = -(sign * unit1).reshape(-1) @ self.k1
        of2 = (sign * unit2).reshape(-1) @ self.k2
        return float(np.abs(e).sum()), np.concatenate([of1, of2])


def squares(m: Moments, start: Array) -> tuple[Array, float]:
    """SS from a start: stacked r1, r2 and the cost (eq. 15)."""
    residuals, r = Residuals(m), start
    e, unit1, unit2 = residuals.values(r)
    cost = float(e @ e)
    for _ in range(ITERATIONS):
        step = -np.linalg.lstsq(residuals.jacobian(unit1, unit2), e, rcond=None)[0]
        for _ in range(HALVINGS):
            e, unit1, unit2 = residuals.values(r + step)
            if float(e @ e) < cost:
                break
            step = 0.5 * step
        else:
            break
        fell, cost, r = cost - float(e @ e), float(e @ e), r + step
        if fell <= TOLERANCE * cost:
            break
    return r, cost


def absolutes(m: Moments, start: Array) -> tuple[Array, float]:
    """SA from a start: stacked r1, r2 and the cost (eq. 20)."""
    residuals, r = Residuals(m), start
    cost, gradient = residuals.absolute(r)
    inverse = np.eye(6) / max(1e-300, float(np.linalg.norm(gradient)))
    for _ in range(ITERATIONS):
        direction = -inverse @ gradient
        slope = float(gradient @ direction)
        low, high, size = 0.0, np.inf, 1.0
        found = None
        for _ in range(HALVINGS):
            new_cost, new_gradient = residuals.absolute(r + size * direction)
            if new_cost > cost + 1e-4 * size * slope:
                high = size
            else:
                found = size, new_cost, new_gradient
                if float(new_gradient @ direction) >= 0.9 * slope:
                    break
                low = size
            size = 0.5 * (low + high) if np.isfinite(high) else 2.0 * low
        if found is None or slope >= 0.0:
            break
        size, new_cost, new_gradient = found
        step, change = size * direction, new_gradient - gradient
        curvature = float(step @ change)
        if curvature > 0.0:
            turn = np.eye(6) - np.outer(step, change) / curvature
            inverse = turn @ inverse @ turn.T + np.outer(step, step) / curvature
        fell, cost, r, gradient = cost - new_cost, new_cost, r + step, new_gradient
        if fell <= TOLERANCE * cost:
            break
    return r, cost
