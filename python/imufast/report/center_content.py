"""What a report says of a joint centre and of accelerometer biases, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.axis import JointAxis
from imufast.calibration import JointCalibration
from imufast.center import CenterEstimate, JointCenter
from imufast.report.joint_words import center_summary, residual_summary, undetermined_words
from imufast.report.thin import spread_out

__all__ = ["acc_bias_plain", "center_plain"]

Array = NDArray[np.float64]


def center_plain(
    center: JointCenter | None, estimate: CenterEstimate | None, axis: JointAxis | None, names: Sequence[str], most: int | None
) -> dict[str, Any] | None:
    """The centre and what it rests on; None where nobody has looked for one.

    Args:
        center: the centre, if it is to be told.
        estimate: the search for it, if there was one.
        axis: the hinge axis where it is known.
        names: of both sensors.
        most: residuals that are kept; None: all.
    """
    if center is None and estimate is None:
        return None
    known = center is not None and bool(np.any(center.covariance))
    open_ = (center or estimate).undetermined  # type: ignore[union-attr]
    return {
        "in_sensor1_m": None if center is None else center.in_sensor1,
        "in_sensor2_m": None if center is None else center.in_sensor2,
        "distance_m": None if center is None else [float(np.linalg.norm(c)) for c in (center.in_sensor1, center.in_sensor2)],
        "determined_std_m": center.determined_std if center is not None and known else None,
        "covariance_m2": center.covariance if center is not None and known else None,
        "undetermined": open_,
        "undetermined_words": undetermined_words(open_, axis, names),
        "status": estimate and estimate.status,
        "summary": estimate and center_summary(estimate),
        "method": estimate and estimate.method,
        "residual_std_m_s2": estimate and estimate.residual_std,
        "unexplained": estimate and estimate.unexplained,
        "residual_words": estimate and residual_summary(estimate.residual_std, estimate.unexplained),
        "cost": estimate and estimate.cost,
        "n_samples": estimate and estimate.n_samples,
        "iterations": estimate and estimate.iterations,
        "residuals": _residuals(estimate, most),
        "settings": estimate and asdict(estimate.settings),
    }


def acc_bias_plain(result: JointCalibration | CenterEstimate | None) -> dict[str, Any]:
    """The accelerometer biases; None where they were not unknowns."""
    bias: list[Array | None] = [None, None]
    std: list[Array | None] = [None, None]
    undetermined = None
    found = isinstance(result, JointCalibration) and (result.estimate is None or result.center is not None)
    if result is not None and (found or isinstance(result, CenterEstimate)):
        variance = np.diag(result.acc_bias_covariance)
        for i, vector in enumerate((result.acc_bias1, result.acc_bias2)):
            if np.any(vector) or np.any(result.acc_bias_covariance):
                bias[i], std[i] = vector, np.sqrt(np.maximum(variance[3 * i : 3 * i + 3], 0.0))
        estimate = result.estimate if isinstance(result, JointCalibration) else result
        undetermined = None if estimate is None or bias[0] is None else estimate.acc_bias_undetermined
    return {
        "acc_bias1_m_s2": bias[0],
        "acc_bias2_m_s2": bias[1],
        "acc_bias1_std_m_s2": std[0],
        "acc_bias2_std_m_s2": std[1],
        "acc_bias_undetermined": undetermined,
    }


def _residuals(estimate: CenterEstimate | None, most: int | None) -> dict[str, Any] | None:
    if estimate is None or not len(estimate.residuals):
        return None
    count = len(estimate.residuals)
    kept = list(range(count)) if most is None else spread_out(range(count), most)
    return {"count": count, "time_s": estimate.residual_time_s[kept], "residual_m_s2": estimate.residuals[kept]}
