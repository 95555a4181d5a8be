"""The relative orientation of two sensors on one joint, drift-free without a magnetometer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.calibrate import calibrate_joint
from imufast.calibration import JointCalibration
from imufast.center import JointCenter
from imufast.errors import InputError, SettingsError
from imufast.filters import Complementary, Mekf, plan
from imufast.imu import Imu
from imufast.pairs import check_pair
from imufast.quaternion import continuous
from imufast.samples import ReadOnly
from imufast.smoother import Smoother, parts_ratio, relative_bias_std, run_smoother

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["RelativeOrientation", "TrackStatus", "track", "track_many"]

Array = NDArray[np.float64]
Method = Complementary | Mekf | Smoother

METHODS: dict[str, type[Complementary] | type[Mekf] | type[Smoother]] = {
    "auto": Smoother,
    "complementary": Complementary,
    "mekf": Mekf,
    "smoother": Smoother,
}
VAGUE_DEG = 20.0
"""An orientation less certain than this for most of the time was not observable, degrees."""
UNKNOWN_DEG = 104.0
"""Standard deviation of an angle of which nothing is known, degrees: uniform in ±180."""
LEAST_WINDOWS = 5
"""Fifteen unknowns, an orientation, two lever arms and two accelerometer biases, take five comparisons of three channels."""
CONTRADICTED_S = 20.0
"""A filter that follows for less than this from one start to the next, gaps aside, s, follows nothing."""


class TrackStatus(str, Enum):
    """What became of a relative orientation."""

    TRACKED = "TRACKED"
    """Found, as well as `angle_std_deg` says."""
    NOT_OBSERVABLE = "NOT_OBSERVABLE"
    """The motion does not show the orientation: mostly its heading, which takes accelerations of the joint in changing
    directions; `angle_std_deg` is large accordingly."""
    STALLED = "STALLED"
    """The smoother found no way down although one was promised; take the numbers with care."""
    MAX_ITERATIONS = "MAX_ITERATIONS"
    """The smoother's iterations ran out."""
    NUMERICAL_ERROR = "NUMERICAL_ERROR"
    """The numbers overflow; are they in the right unit?"""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class RelativeOrientation(ReadOnly):
    """The orientation of sensor 2 as seen from sensor 1 over time.

    Attributes:
        time_s: (N,) times of the samples, s.
        q_12: (N, 4) unit quaternions w x y z that take vectors of sensor frame 2 to sensor frame 1, without sign flips.
        angle_std_deg: (N,) standard deviation: root of the trace of the 3x3 error covariance, degrees.
        status: what became of it.
        covariance: (N, 3, 3) of the error in sensor frame 2, rad² (a rotation vector on the right of q_12); smoother only.
        calibration: what it was made with; with the smoother centre and biases as found with the orientations.
        method: its settings.
        restarts: how often a filter started anew: after long gaps, or because the heading was contradicted.
        starting_s: how long a filter waited for its start, s; 0 for the smoother.
        starts_s: the stretches (from, to) in which a filter looked for its start, the first one and those of restarts, s; its
            orientations there are turned back from where it was found. Empty for the smoother.
        why: what the reader should know, one sentence each.
        link_std: scale of the residuals of the link constraint, m/s²; smoother only.
        drift_std: what the errors of both gyroscopes add up to, rad/√s; smoother only.
        link_time_s: (K,) when the link was compared, s; smoother only.
        link_squares: (K,) the square of its residual over `link_std`, three channels together; smoother only. Where the model
            holds they are three times F(3, tail) distributed.
        parts_ratio: how many times as far, squared, parts of the recording are apart in centre and biases as noise explains, at
            least 1; what these leave uncertain of `covariance` is widened by it; smoother only.
        link_trust: what a link counts for as information, 0 to 1: less where neighbouring residuals are alike or many are
            large; smoother only.
        iterations: of the smoother.
    """

    time_s: Array = field(repr=False)
    q_12: Array = field(repr=False)
    angle_std_deg: Array = field(repr=False)
    status: TrackStatus
    calibration: JointCalibration = field(repr=False)
    method: Method
    covariance: Array | None = field(default=None, repr=False)
    restarts: int = 0
    starting_s: float = 0.0
    starts_s: tuple[tuple[float, float], ...] = ()
    why: tuple[str, ...] = ()
    link_std: float | None = None
    drift_std: float | None = None
    link_time_s: Array | None = field(default=None, repr=False)
    link_squares: Array | None = field(default=None, repr=False)
    link_trust: float | None = None
    parts_ratio: float | None = None
    iterations: int = 0

    def __len__(self) -> int:
        return len(self.time_s)

    def as_scipy(self) -> Rotation:
        """The same as N scipy rotations, which take vectors of sensor frame 2 to sensor frame 1. Needs scipy."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_quat(self.q_12[:, [1, 2, 3, 0]])


def track(
    imu1: Imu,
    imu2: Imu,
    calibration: JointCalibration | None = None,
    method: str | Method = "auto",
    *,
    start: ArrayLike | None = None,
    start_std_deg: float = 2.0,
) -> RelativeOrientation:
    """Follow the relative orientation of two sensors on the segments of one joint: from the gyroscopes, and from the
    acceleration of the joint centre, which both sensors see (eqs 1-4 of Remmerswaal et al. 2021).

    Args:
        imu1, imu2: the sensors, same time base; irregular time and gaps are honoured.
        calibration: of the joint (`calibrate_joint`). Default None: the recording calibrates itself; the smoother finds centre
            and biases together with the orientations.
        method: "smoother" (default "auto"; the whole recording at once, most accurate), "mekf" or "complementary" (causal: no
            estimate uses later samples, but for the start), or their settings: `Smoother(...)`, `Mekf(...)`,
            `Complementary(...)`.
        start: (4,) orientation at the first sample, where it is known; filters only. Default None: a closed form finds it.
        start_std_deg: how well, degrees. Default 2.

    Returns:
        RelativeOrientation, one unit quaternion a sample. Motion that does not show it is a status and a large
        `angle_std_deg`, not an exception.

    Raises:
        InputError: not two Imus of one time base, the same data twice, not a calibration, or a start that is no quaternion.
        SettingsError: an unknown method.
    """
    settings = _settings(method)
    check_pair(imu1, imu2)
    _check_calibration(calibration)
    if isinstance(settings, Smoother):
        if start is not None:
            raise InputError("start is for the filters; the smoother needs none")
        return _smooth(imu1, imu2, calibration, settings)
    known = calibrate_joint(imu1, imu2) if calibration is None else calibration
    asked = plan(settings, known, imu1.rate_hz, start, start_std_deg, ("start", "start_std_deg"))
    q, std_deg = np.empty((len(imu1), 4)), np.empty(len(imu1))
    ended = _core.track_filter(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, imu1._time_s, asked, q, std_deg, VAGUE_DEG)
    return _filtered(imu1, q, std_deg, ended, known, settings)


def track_many(
    pairs: Sequence[tuple[Imu, Imu]], calibrations: Sequence[JointCalibration], method: str | Method = "mekf"
) -> list[RelativeOrientation]:
    """`track` with a filter for many recordings or joints, side by side in the lanes of the processor: the same bits as one by
    one, in less time. Their results share one piece of memory, which is freed with the last of them.

    Args:
        pairs: the two sensors of each joint; side by side as long as they are sampled evenly.
        calibrations: one each.
        method: "mekf" (default), "complementary" or their settings; "smoother" runs one by one.

    Raises:
        InputError, SettingsError: as `track`; lists of different lengths.
    """
    settings = _settings(method)
    try:
        pairs, calibrations = [(imu1, imu2) for imu1, imu2 in pairs], list(calibrations)
    except (TypeError, ValueError):
        raise InputError("pairs must be a list of (imu1, imu2), and calibrations one of JointCalibration") from None
    if len(pairs) != len(calibrations):
        raise InputError(f"pairs has {len(pairs)} entries but calibrations {len(calibrations)}")
    for (imu1, imu2), calibration in zip(pairs, calibrations, strict=True):
        check_pair(imu1, imu2)
        if calibration is None:
            raise InputError("calibrations must hold a JointCalibration for each pair; calibrate with calibrate_joint")
        _check_calibration(calibration)
    if isinstance(settings, Smoother):
        return [
            _smooth(imu1, imu2, calibration, settings) for (imu1, imu2), calibration in zip(pairs, calibrations, strict=True)
        ]
    plans = [plan(settings, calibration, imu1.rate_hz) for (imu1, _), calibration in zip(pairs, calibrations, strict=True)]
    edges = [0, *accumulate(len(imu1) for imu1, _ in pairs)]
    q, std_deg = np.empty((edges[-1], 4)), np.empty(edges[-1])
    signals = [(a.gyr, a.acc, b.gyr, b.acc, a._time_s) for a, b in pairs]
    all_ended = _core.track_filter_batch(signals, plans, q, std_deg, VAGUE_DEG)
    return [
        _filtered(imu1, q[since:to], std_deg[since:to], ended, calibration, settings)
        for (imu1, _), calibration, (since, to), ended in zip(pairs, calibrations, pairwise(edges), all_ended, strict=True)
    ]


def _settings(method: object) -> Method:
    if isinstance(method, (Complementary, Mekf, Smoother)):
        return method
    if not isinstance(method, str) or method not in METHODS:
        raise SettingsError(
            f"method must be one of {', '.join(map(repr, METHODS))}, or Complementary(...), Mekf(...), Smoother(...); "
            f"got {method!r}"
        )
    return METHODS[method]()


def _check_calibration(calibration: object) -> None:
    if calibration is not None and not isinstance(calibration, JointCalibration):
        raise InputError(f"calibration must be a JointCalibration or None, got {type(calibration).__name__}")


def _filtered(
    imu: Imu,
    q: Array,
    std_deg: Array,
    ended: tuple[int, list[tuple[int, int]], int],
    calibration: JointCalibration,
    settings: Complementary | Mekf,
) -> RelativeOrientation:
    """What a filter found, in arrays of our own; `ended`: how often it started anew, the rows in which it looked for a start,
    and how many of its estimates are vague."""
    restarts, starts, vague = ended
    q.setflags(write=False)
    std_deg.setflags(write=False)
    time_s, count = imu.time_s, len(imu)
    # From the first sample of each start to the first after it.
    starts_s = tuple((float(time_s[since]), float(time_s[min(to, count - 1)])) for since, to in starts)
    gaps = int((np.diff(time_s) > settings.max_gap_s).sum()) if restarts else 0
    contradicted = max(restarts - gaps, 0)
    why = []
    lost = True
    if calibration.center is None:
        why.append("the joint centre is not known: its acceleration was taken to be that of the sensors")
        std_deg = np.maximum(std_deg, UNKNOWN_DEG)
    elif contradicted and contradicted * CONTRADICTED_S > imu.duration_s - sum(to - since for since, to in starts_s):
        why.append("the two sensors contradict each other again and again: soft tissue, impacts or a wrong calibration")
        std_deg = np.maximum(std_deg, UNKNOWN_DEG)
    elif starts == [(0, count)] or 2 * vague > count:
        why.append("nothing shows the heading: the joint hardly accelerates sideways, or gaps are too many")
    else:
        lost = False
    if restarts:
        why.append(f"the filter started anew {restarts} time{'s' * (restarts > 1)}")
    return RelativeOrientation(
        time_s=time_s,
        q_12=q,
        angle_std_deg=std_deg,
        status=TrackStatus.NOT_OBSERVABLE if lost else TrackStatus.TRACKED,
        calibration=calibration,
        method=settings,
        restarts=restarts,
        starting_s=starts_s[0][1] - starts_s[0][0] if starts and starts[0][0] == 0 else 0.0,
        starts_s=starts_s,
        why=tuple(why),
    )


def _smooth(imu1: Imu, imu2: Imu, calibration: JointCalibration | None, settings: Smoother) -> RelativeOrientation:
    fit = run_smoother(imu1, imu2, calibration, settings)
    status = TrackStatus.TRACKED if fit.status == "CONVERGED" else TrackStatus(fit.status)
    alone = calibration is None or calibration.center is None
    ended = status not in (TrackStatus.NUMERICAL_ERROR, TrackStatus.NOT_OBSERVABLE)
    ratio = parts_ratio(imu1, imu2, settings) if ended else None
    covariance = fit.covariance
    if ratio is not None and bool(np.isfinite(covariance).all()):
        covariance = fit.covariance_known + ratio * (covariance - fit.covariance_known)
    covariance = covariance[:, [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
    short = alone and _covered(fit, settings) < LEAST_WINDOWS
    if short:
        # So few comparisons are fitted whatever the orientation is, and their residuals say nothing of it.
        covariance = covariance + np.eye(3) * math.radians(UNKNOWN_DEG) ** 2
    variance = np.trace(covariance, axis1=1, axis2=2)
    # Beyond half a turn an angle says no more.
    std_deg = np.minimum(np.degrees(np.sqrt(np.maximum(variance, 0.0))), 180.0)
    if status is not TrackStatus.NUMERICAL_ERROR and (
        short or (status is TrackStatus.TRACKED and float(np.median(std_deg)) > VAGUE_DEG)
    ):
        status = TrackStatus.NOT_OBSERVABLE
    why = () if status is TrackStatus.TRACKED else (WHY.get(status, str(status)),)
    if short and status is TrackStatus.NOT_OBSERVABLE:
        why = (
            f"too short: without a calibration joint centre and biases take {LEAST_WINDOWS} windows of {settings.window_s:g} s",
        )
    return RelativeOrientation(
        time_s=imu1.time_s,
        q_12=continuous(fit.q_12),
        angle_std_deg=std_deg,
        status=status,
        calibration=_refined(calibration, fit, ratio or 1.0),
        method=settings,
        covariance=covariance,
        why=why,
        link_std=fit.link_std,
        drift_std=fit.drift_std,
        link_time_s=imu1.time_s[fit.link_samples],
        link_squares=fit.link_squares,
        link_trust=fit.trust,
        parts_ratio=ratio,
        iterations=fit.iterations,
    )


def _covered(fit: _core.SmootherFit, settings: Smoother) -> float:
    """How many windows side by side the comparisons of the link cover."""
    more = max(len(fit.link_samples) - 1, 0) * min(settings.key_step_s / settings.window_s, 1.0)
    return more + (1.0 if len(fit.link_samples) else 0.0)


WHY = {
    TrackStatus.NOT_OBSERVABLE: "the motion does not show the relative orientation in all directions",
    TrackStatus.STALLED: "no step lowered the cost although one was promised",
    TrackStatus.MAX_ITERATIONS: "the iterations ran out before the minimum",
    TrackStatus.NUMERICAL_ERROR: "the numbers overflow; are they in the right unit?",
}


def _refined(calibration: JointCalibration | None, fit: _core.SmootherFit, ratio: float) -> JointCalibration:
    """The calibration with centre and biases as the smoother found them; their variances count `ratio` times."""
    known = calibration or JointCalibration()
    x, covariance = fit.constants, ratio * fit.constants_covariance
    if not (np.isfinite(x).all() and np.isfinite(covariance).all()):
        return known
    undetermined = np.zeros((0, 6)) if known.center is None else known.center.undetermined
    gyr_std = math.sqrt(max(float(np.trace(covariance[12:, 12:])) / 6.0, 0.0))
    changes: dict[str, Any] = {
        "center": JointCenter(-x[0:3], -x[3:6], covariance[:6, :6], undetermined),
        "acc_bias1": x[6:9],
        "acc_bias2": x[9:12],
        "acc_bias_covariance": covariance[6:12, 6:12],
        "gyr_bias1": x[12:15],
        "gyr_bias2": x[15:18],
        "gyr_bias_std": gyr_std,
        "relative_gyr_bias_std": relative_bias_std(fit.q_12, covariance[12:, 12:]),
    }
    return replace(known, **changes)
