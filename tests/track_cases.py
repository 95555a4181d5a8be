"""What tests of relative orientations share: simulated joints, errors, and what holds of every result."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from imufast import BallJointSimulation, Imu, JointCalibration, RelativeOrientation, calibrate_joint, simulate_ball_joint
from numpy.typing import NDArray

Array = NDArray[np.float64]
METHODS = ("complementary", "mekf", "smoother")
FILTERS = ("complementary", "mekf")


def times(a: Array, b: Array) -> Array:
    """Quaternion products."""
    (aw, ax, ay, az), (bw, bx, by, bz) = np.moveaxis(np.asarray(a), -1, 0), np.moveaxis(np.asarray(b), -1, 0)
    rows = (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
    return np.stack(rows, axis=-1)


def back(q: Array) -> Array:
    """The inverse rotations."""
    return np.asarray(np.asarray(q) * np.array([1.0, -1.0, -1.0, -1.0]))


def apart_deg(a: Array, b: Array) -> Array:
    """Angles between rotations, degrees; exact also near 0."""
    between = times(back(a), b)
    return np.asarray(np.degrees(2.0 * np.arctan2(np.linalg.norm(between[..., 1:], axis=-1), np.abs(between[..., 0]))))


def sound(found: RelativeOrientation, imu: Imu) -> None:
    """One unit quaternion a sample, without sign flips, and a standard deviation."""
    single = getattr(found.method, "precision", "double") == "single"
    q, std = found.q_12, found.angle_std_deg
    np.testing.assert_array_equal(found.time_s, imu.time_s)
    assert len(found) == len(imu)
    assert q.shape == (len(imu), 4)
    assert np.isfinite(q).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0.0, atol=1e-6 if single else 1e-8)
    assert (np.einsum("ij,ij->i", q[1:], q[:-1]) >= 0.0).all()
    assert std.shape == (len(imu),)
    assert np.isfinite(std).all()
    assert (std >= 0.0).all()
    if found.covariance is not None:
        assert found.covariance.shape == (len(imu), 3, 3)


def honest(found: RelativeOrientation, truth: Array, most: float = 4.0) -> None:
    """No error beyond so many standard deviations."""
    share = apart_deg(found.q_12, truth) / found.angle_std_deg
    assert share.max() <= most, f"{share.max():.1f} standard deviations at sample {int(share.argmax())}"


@cache
def ball(seed: int = 1, duration_s: float = 20.0) -> BallJointSimulation:
    return simulate_ball_joint(seed=seed, duration_s=duration_s)


@cache
def known(seed: int = 1, duration_s: float = 20.0) -> JointCalibration:
    return calibrate_joint(ball(seed, duration_s).imu1, ball(seed, duration_s).imu2)


def pair(sim: Any, rows: Any = slice(None)) -> tuple[Imu, Imu]:
    """The rows of a simulation, with their times."""
    first, second = (
        Imu(gyr[rows], acc[rows], time_s=sim.time_s[rows], name=name)
        for gyr, acc, name in ((sim.gyr1, sim.acc1, "one"), (sim.gyr2, sim.acc2, "two"))
    )
    return first, second


def with_gap(sim: Any, at_s: float, length_s: float) -> tuple[tuple[Imu, Imu], Array, NDArray[np.bool_]]:
    """A simulation without some seconds, its truth, and which samples come before."""
    rows = (sim.time_s < at_s) | (sim.time_s > at_s + length_s)
    return pair(sim, rows), sim.q_12[rows], sim.time_s[rows] < at_s
