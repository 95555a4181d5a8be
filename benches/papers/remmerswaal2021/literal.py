"""Remmerswaal et al. 2021 (ECC, "Fast relative sensor orientation estimation in the presence of real-world disturbances") as
published: Algorithm 1 and the Kalman filter of Weygers & Kok 2020 with and without rejection, in plain numpy, for comparison
only.

Equation numbers are the paper's. Many recordings go side by side: arrays are (B, N, 3), quaternions (B, 4), Hamilton, scalar
first, sensor to global. r goes from the joint centre to the sensor. Where text and equations disagree or say nothing:

- The lower block of S(q) in eq. 7 is `q0 I + [qv×]`, as eq. 5a has it; what eq. 5b gives is normalised.
- Algorithm 1 takes the gradient at the orientation "of t-1" with the acceleration of t. It is read such that this orientation
  is the one predicted for t, from which the rate of t leads on to the next instant: rates hold over the step that begins at
  their sample. (Read otherwise, with rates that hold over the step before, accelerations meet orientations 0.1 s old, and at
  10 Hz the errors are 5 to 7 degrees where the paper prints 0.71.) The Kalman filters mean rates the same way.
- An instant whose five-point stencil would reach beyond the recording has no correction.
- The Kalman filters turn the error with the sensor, F = exp(-T[ω×]), and reject at the 95 % quantile of χ² with three degrees
  of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GATE = 7.81


@dataclass(frozen=True, eq=False)
class Recordings:
    """B recordings of N samples: rates, specific forces (B, N, 3) of both sensors, and the step T, s."""

    gyr1: Array
    acc1: Array
    gyr2: Array
    acc2: Array
    step_s: float
    r1: Array
    r2: Array

    def joint_accelerations(self) -> tuple[Array, Array]:
        """Eq. 3 for both sensors, with angular accelerations by the five-point stencil; NaN where that lacks neighbours."""
        found = []
        for gyr, acc, r in ((self.gyr1, self.acc1, self.r1), (self.gyr2, self.acc2, self.r2)):
            dot = np.full_like(gyr, np.nan)
            dot[:, 2:-2] = (gyr[:, :-4] - 8.0 * gyr[:, 1:-3] + 8.0 * gyr[:, 3:-1] - gyr[:, 4:]) / (12.0 * self.step_s)
            found.append(acc - np.cross(gyr, np.cross(gyr, r)) - np.cross(dot, r))
        return found[0], found[1]


def product(p: Array, q: Array) -> Array:
    """p ⊙ q."""
    (a, b, c, d), (w, x, y, z) = p.T, q.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    return np.asarray(q * np.array([1.0, -1.0, -1.0, -1.0]))


def exponential(v: Array) -> Array:
    """Eq. 6."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle), np.sinc(angle / np.pi) * v], axis=-1)


def matrix(q: Array) -> Array:
    """R(q), (B, 3, 3)."""
    w, x, y, z = q.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def skew(v: Array) -> Array:
    """[v×], (B, 3, 3)."""
    x, y, z = v.T
    zero = np.zeros_like(x)
    return np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), 2, 0)


def s_matrix(q: Array) -> Array:
    """Eq. 7, (B, 4, 3)."""
    lower = q[:, :1, None] * np.eye(3) + skew(q[:, 1:])
    return np.concatenate([-q[:, None, 1:], lower], axis=1)


def complementary(recordings: Recordings, beta: float, start1: Array, start2: Array) -> Array:
    """Algorithm 1 with β in rad/s: q_12 (B, N, 4), of which row k is what sample k leads to, at the next instant."""
    step_s = recordings.step_s
    acc1, acc2 = recordings.joint_accelerations()
    q1, q2 = start1, start2
    found = []
    for k in range(acc1.shape[1]):
        rates = [recordings.gyr1[:, k], recordings.gyr2[:, k]]
        if np.isfinite(acc1[:, k]).all():
            # Step 1: eq. 13.
            rotation1, rotation2 = matrix(q1), matrix(q2)
            left = np.concatenate([-rotation1 @ skew(acc1[:, k]), rotation2 @ skew(acc2[:, k])], axis=2)
            off = rotation1 @ acc1[:, k, :, None] - rotation2 @ acc2[:, k, :, None]
            gradient = (left.transpose(0, 2, 1) @ off)[:, :, 0]
            # Step 2: eqs 8 and 12.
            correction = beta * gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
            rates = [rates[0] - correction[:, :3], rates[1] - correction[:, 3:]]
        # Step 3: eq. 5b; step 4: eq. 9.
        turned = [q + 0.5 * step_s * (s_matrix(q) @ rate[:, :, None])[:, :, 0] for q, rate in zip((q1, q2), rates, strict=True)]
        q1, q2 = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in turned)
        found.append(product(conjugate(q1), q2))
    return np.stack(found, axis=1)


def kalman(
    recordings: Recordings, gyr_std: float, link_std: float, start1: Array, start2: Array, start_std: float, *, reject: bool
) -> Array:
    """The multiplicative extended Kalman filter on eq. 4: q_12 (B, N, 4) at the samples.

    Args:
        recordings: what the sensors read.
        gyr_std: σ of each gyroscope channel, rad/s.
        link_std: σ of each component of e_link, m/s².
        start1, start2: (B, 4) orientations at the first sample.
        start_std: standard deviation of each of the six angles at the start, rad.
        reject: whether innovations beyond `GATE` are left out.
    """
    step_s = recordings.step_s
    acc1, acc2 = recordings.joint_accelerations()
    q1, q2 = start1, start2
    count = len(q1)
    p = np.broadcast_to(start_std**2 * np.eye(6), (count, 6, 6)).copy()
    process = (step_s * gyr_std) ** 2 * np.eye(6)
    transition = np.zeros((count, 6, 6))
    found = [product(conjugate(q1), q2)]
    for k in range(1, acc1.shape[1]):
        turns = [0.5 * step_s * gyr[:, k - 1] for gyr in (recordings.gyr1, recordings.gyr2)]
        steps = [exponential(turn) for turn in turns]
        q1, q2 = product(q1, steps[0]), product(q2, steps[1])
        transition[:, :3, :3], transition[:, 3:, 3:] = (matrix(conjugate(each)) for each in steps)
        p = transition @ p @ transition.transpose(0, 2, 1) + process
        if np.isfinite(acc1[:, k]).all():
            rotation1, rotation2 = matrix(q1), matrix(q2)
            innovation = rotation2 @ acc2[:, k, :, None] - rotation1 @ acc1[:, k, :, None]
            h = np.concatenate([-rotation1 @ skew(acc1[:, k]), rotation2 @ skew(acc2[:, k])], axis=2)
            p_h = p @ h.transpose(0, 2, 1)
            inverse = np.linalg.inv(h @ p_h + link_std**2 * np.eye(3))
            gain = p_h @ inverse
            if reject:
                square = (innovation.transpose(0, 2, 1) @ inverse @ innovation)[:, 0, 0]
                gain = np.where(square[:, None, None] > GATE, 0.0, gain)
            eta = (gain @ innovation)[:, :, 0]
            q1, q2 = product(q1, exponential(0.5 * eta[:, :3])), product(q2, exponential(0.5 * eta[:, 3:]))
            p = p - gain @ p_h.transpose(0, 2, 1)
            p = 0.5 * (p + p.transpose(0, 2, 1))
        q1, q2 = (q / np.linalg.norm(q, axis=1, keepdims=True) for q in (q1, q2))
        found.append(product(conjugate(q1), q2))
    return np.stack(found, axis=1)
