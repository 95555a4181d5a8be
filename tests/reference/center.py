"""Joint centre of Olsson & Halvorsen 2017 as printed, slow and literal: LS (eqs 9-14), SS (eq. 15), SA (eq. 20).

r points from the joint centre to the sensor, as in the paper; the public API gives its negative.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.optimize
import scipy.sparse
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Moments(NamedTuple):
    """(N, 3) each: rates, angular accelerations, specific forces of both sensors."""

    gyr1: Array
    gyr_dot1: Array
    acc1: Array
    gyr2: Array
    gyr_dot2: Array
    acc2: Array

    def turned(self, rotation1: Array, rotation2: Array) -> Moments:
        """The same, seen from sensors that are mounted otherwise."""
        return Moments(*(a @ r.T for a, r in zip(self, [rotation1] * 3 + [rotation2] * 3, strict=True)))

    def swapped(self) -> Moments:
        return Moments(*self[3:], *self[:3])


def moments_of(gyr1: Array, acc1: Array, gyr2: Array, acc2: Array, step_s: float) -> Moments:
    """Eq. 8 on even samples; the first and the last have no neighbour."""
    inner = slice(1, -1)

    def rate(y: Array) -> Array:
        return np.asarray((y[2:] - y[:-2]) / (2.0 * step_s))

    return Moments(gyr1[inner], rate(gyr1), acc1[inner], gyr2[inner], rate(gyr2), acc2[inner])


def cross_matrix(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def lever_matrix(gyr: Array, gyr_dot: Array) -> Array:
    """K of eq. 5."""
    return cross_matrix(gyr) @ cross_matrix(gyr) + cross_matrix(gyr_dot)


def lever_matrices(gyr: Array, gyr_dot: Array) -> Array:
    return np.stack([lever_matrix(w, d) for w, d in zip(gyr, gyr_dot, strict=True)])


class Problem:
    """Eq. 16 over all moments; biases, where they are unknowns, follow r1 and r2."""

    def __init__(self, moments: Moments) -> None:
        self.K = [lever_matrices(moments.gyr1, moments.gyr_dot1), lever_matrices(moments.gyr2, moments.gyr_dot2)]
        self.acc = [moments.acc1, moments.acc2]

    def at_centre(self, sensor: int, x: Array) -> Array:
        bias = x[6 + 3 * sensor : 9 + 3 * sensor] if len(x) == 12 else np.zeros(3)
        return np.asarray(self.acc[sensor] - bias - self.K[sensor] @ x[3 * sensor : 3 * sensor + 3])  # eq. 19

    def residuals(self, x: Array) -> Array:
        return np.asarray(np.linalg.norm(self.at_centre(0, x), axis=1) - np.linalg.norm(self.at_centre(1, x), axis=1))

    def jacobian(self, x: Array) -> Array:
        """Eqs 17 and 18."""
        columns = []
        for sensor, sign in ((0, -1.0), (1, 1.0)):
            at_centre = self.at_centre(sensor, x)
            direction = at_centre / np.linalg.norm(at_centre, axis=1, keepdims=True)
            columns.append(sign * np.einsum("nij,ni->nj", self.K[sensor], direction))
        return np.hstack(columns)

    def squares(self, start: Array) -> tuple[Array, float]:
        """Eq. 15: the minimum near `start`, and Σ e² there."""
        found = scipy.optimize.least_squares(
            self.residuals, start, jac=self.jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15
        )
        return found.x, float(2.0 * found.cost)

    def absolutes(self, start: Array, trust: float = 0.02) -> tuple[Array, float]:
        """Eq. 20: a minimum near `start` by a sequence of linear programs within a box, and Σ |e| there."""
        x, cost = start, float(np.abs(self.residuals(start)).sum())
        for _ in range(40):
            e, J = self.residuals(x), self.jacobian(x)
            count, unknowns = J.shape
            # min Σ t with −t ≤ e + J d ≤ t and |d| ≤ trust;
            plan = scipy.optimize.linprog(
                np.concatenate([np.zeros(unknowns), np.ones(2 * count)]),
                A_eq=scipy.sparse.hstack([scipy.sparse.csr_matrix(J), -scipy.sparse.eye(count), scipy.sparse.eye(count)]),
                b_eq=-e,
                bounds=[(-trust, trust)] * unknowns + [(0.0, None)] * (2 * count),
                method="highs",
            )
            there = x + plan.x[:unknowns]
            reached = float(np.abs(self.residuals(there)).sum())
            if reached < cost:
                gain, x, cost = cost - reached, there, reached
                if gain < 1e-10 * cost:
                    break
            else:
                trust *= 0.25
                if trust < 1e-9:
                    break
        return x, cost


def rotation_matrices(q: Array) -> Array:
    """(N, 3, 3) of quaternions, scalar first."""
    w, v = q[:, 0], q[:, 1:]
    cross = np.stack([cross_matrix(row) for row in v])
    square = (w * w - np.einsum("ni,ni->n", v, v))[:, None, None]
    return np.asarray(square * np.eye(3) + 2.0 * v[:, :, None] * v[:, None, :] + 2.0 * w[:, None, None] * cross)


def least_squares(moments: Moments, q_1: Array, q_2: Array) -> tuple[Array, float]:
    """Eqs 10-14 in the global frame: r1 and r2, and the cost of eq. 13."""
    R1, R2 = rotation_matrices(q_1), rotation_matrices(q_2)
    K1, K2 = lever_matrices(moments.gyr1, moments.gyr_dot1), lever_matrices(moments.gyr2, moments.gyr_dot2)
    stacked = np.concatenate([R1 @ K1, -R2 @ K2], axis=2).reshape(-1, 6)  # eq. 11
    wanted = (np.einsum("nij,nj->ni", R1, moments.acc1) - np.einsum("nij,nj->ni", R2, moments.acc2)).reshape(-1)  # eq. 12
    r = np.linalg.lstsq(stacked, wanted, rcond=None)[0]
    return r, float(np.sum((stacked @ r - wanted) ** 2))
