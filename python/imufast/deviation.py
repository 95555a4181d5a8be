"""The angle between an estimated axis and the truth, given the covariance: eqs 60-65 of Olsson et al. 2020."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.errors import InputError
from imufast.settings import check_count

__all__ = ["angular_deviation_deg"]


def angular_deviation_deg(
    axis: ArrayLike, covariance: ArrayLike, *, draws: int | None = None, seed: int = 0
) -> tuple[float, float]:
    """Mean and standard deviation of the angle between an axis and the truth, degrees.

    The error of a unit vector is a two-dimensional Gaussian in its tangent plane, so both moments have a closed form (complete
    elliptic integral of the second kind). The paper draws them instead; `draws` does as the paper.

    Args:
        axis: (3,) unit vector.
        covariance: (3, 3) covariance of the axis in the same coordinates, rad²: a diagonal block of the (6, 6) `covariance` of
            `HingeAxis` or `HingeCalibration`.
        draws: None (default): closed form; a number: Monte Carlo with so many draws on the sphere (eqs 62-65).
        seed: seed of the draws; default 0.

    Returns:
        (μ, σ) in degrees; infinite where the covariance is.

    Raises:
        InputError: wrong shapes, or an axis that is not a unit vector.
        SettingsError: draws or seed out of range.
    """
    j, p = np.asarray(axis, np.float64), np.asarray(covariance, np.float64)
    if j.shape != (3,) or not abs(np.linalg.norm(j) - 1.0) < 1e-6:
        raise InputError(f"axis must be a unit vector of three numbers, got {axis!r}")
    if p.shape != (3, 3) or np.isnan(p).any():
        raise InputError(f"covariance must be a (3, 3) matrix without NaN, got shape {p.shape}")
    if not np.isfinite(p).all():
        return float("inf"), float("inf")
    basis = _tangent_basis(j)
    tangent = basis.T @ p @ basis
    if draws is None:
        mean, std = _core.angular_deviation(tangent.tolist())
        return float(np.degrees(mean)), float(np.degrees(std))
    check_count("draws", draws, 2, 100_000_000)
    check_count("seed", seed, 0, 2**63)
    steps = np.random.default_rng(seed).multivariate_normal(np.zeros(2), tangent, size=draws)
    # A step's length is the angle: walk along the great circle.
    angles = np.degrees(np.linalg.norm(steps, axis=1) % (2.0 * np.pi))
    angles = np.minimum(angles, 360.0 - angles)
    return float(angles.mean()), float(angles.std(ddof=1))


def _tangent_basis(j: NDArray[np.float64]) -> NDArray[np.float64]:
    across = np.cross(np.eye(3)[int(np.abs(j).argmin())], j)
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(j, across)], axis=1)
