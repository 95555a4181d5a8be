"""All that a report says, as plain data: what the JSON twin holds is what the page shows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from enum import Enum
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.angles import JointAngles
from imufast.axis import JointAxis
from imufast.body.result import LowerBody
from imufast.body.settings import Anthropometry
from imufast.calibration import JointCalibration
from imufast.center import CenterEstimate
from imufast.decide import HingeStep
from imufast.errors import InputError
from imufast.hinge import HingeCalibration
from imufast.imu import Imu, Recording
from imufast.pairs import check_pair, pair_signals
from imufast.report import joint_words
from imufast.report.angle_content import angles_plain
from imufast.report.body_content import body_plain
from imufast.report.center_content import acc_bias_plain, center_plain
from imufast.report.hinge_content import hinge_plain
from imufast.report.joint_words import Result
from imufast.report.orientation_content import orientation_plain
from imufast.report.thin import excitation
from imufast.track import RelativeOrientation

__all__ = ["SCHEMAS", "SCHEMA_VERSION", "Pair", "Reported", "installed_version", "report_json"]

Array = NDArray[np.float64]
Pair: TypeAlias = Recording | Sequence[Imu]
Reported: TypeAlias = Result | RelativeOrientation | LowerBody

SCHEMAS = {
    "hinge": "imufast.hinge-report",
    "joint": "imufast.joint-report",
    "orientation": "imufast.orientation-report",
    "body": "imufast.body-report",
}
"""The first two have the same names. In that of a `HingeCalibration`, `center` and all else that is told of a centre is null;
in that of a `JointCalibration` or a `CenterEstimate`, whatever it does not hold: of a centre alone also `verdict` and
`accepted`."""
SCHEMA_VERSION = 1
"""Raised whenever a name changes its meaning or goes away; new names do not raise it."""
MOST_POINTS = 2000
"""Steps, residuals, and times of selected samples of either kind, that a report holds."""
EPOCH_S = 1e6
"""First times beyond this are a clock's, not a recording's: times are then told from the first one on."""


def installed_version() -> str:
    """The version of imufast."""
    # Here, for it takes longer to import than the rest together.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("imufast")
    except PackageNotFoundError:
        return "unknown"


def report_json(
    result: Reported,
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
    angles: JointAngles | None = None,
    max_points: int | None = MOST_POINTS,
) -> dict[str, Any]:
    """All numbers and words of the report as plain JSON: dict, list, str, int, float, bool and None (for what is unknown,
    not finite or, in settings, without limit).

    Names end in their unit: `_s`, `_deg`, `_rad_s`, `_m`. `schema` and `schema_version` say what to expect:
    "imufast.hinge-report" of a HingeCalibration, "imufast.orientation-report" of a RelativeOrientation,
    "imufast.body-report" of a LowerBody, else "imufast.joint-report"; the first and the last have the same names. What a
    result does not hold is None.

    Args:
        result: what `calibrate_joint`, `calibrate_hinge`, `HingeCalibrator`, `estimate_joint_center`, `track` or
            `estimate_lower_body` gave, or a `JointCalibration` that was loaded or made by hand.
        recording: the two sensors it was made from, a pair of Imus or a Recording of two; adds names and excitation, of a
            `RelativeOrientation` residual and observability. Of a `LowerBody` the Recording of all its sensors.
        title: of the report.
        warnings: what else the reader should know, one sentence each.
        angles: of a `RelativeOrientation`: the joint angles that were made of it. Default None.
        max_points: the most steps of the history, times of samples, residuals, and orientations that are kept; longer
            histories are thinned, extremes kept. None: all.

    Raises:
        InputError: an argument of the wrong kind.
    """
    if not isinstance(result, (HingeCalibration, JointCalibration, CenterEstimate, RelativeOrientation, LowerBody)):
        kinds = "a JointCalibration, a HingeCalibration, a CenterEstimate, a RelativeOrientation or a LowerBody"
        raise InputError(f"result must be {kinds}, got {type(result).__name__}")
    if title is not None and not isinstance(title, str):
        raise InputError(f"title must be a text or None, got {type(title).__name__}")
    if isinstance(warnings, str):
        raise InputError("warnings must be several texts, such as a list, not one text")
    if max_points is not None and (isinstance(max_points, bool) or not isinstance(max_points, int) or max_points < 100):
        raise InputError(f"max_points must be a whole number of at least 100 or None (all), got {max_points!r}")
    if angles is not None:
        if not isinstance(angles, JointAngles) or not isinstance(result, RelativeOrientation):
            raise InputError(f"angles must be JointAngles, and go with a RelativeOrientation; got {type(angles).__name__}")
        if not np.array_equal(angles.time_s, result.time_s):
            raise InputError("angles are not of this relative orientation: the times of their samples differ")
    told = [str(warning) for warning in warnings]
    if isinstance(result, LowerBody):
        whole: dict[str, Any] = _clean(_body(result, recording, title, told, max_points))
        return whole
    pair = _pair(recording)
    if isinstance(result, RelativeOrientation):
        of_angles = None if angles is None else "Joint angle" if len(angles.names) == 1 else "Joint angles"
        plain = _orientation(result, pair, title or of_angles, told, max_points)
        plain["angles"] = None if angles is None else angles_plain(angles, max_points)
    else:
        plain = _calibration(result, pair, title, told, max_points)
    cleaned: dict[str, Any] = _clean(plain)
    return cleaned


def _orientation(
    rel: RelativeOrientation, pair: tuple[Imu, Imu] | None, title: str | None, warnings: list[str], most: int | None
) -> dict[str, Any]:
    """All of a relative orientation's report."""
    calibration = _calibration(rel.calibration, None, None, [], MOST_POINTS)
    names = "verdict", "verdict_name", "accepted", "why", "axis1", "axis2", "bound95_deg", "center"
    biases = "gyr_bias1_rad_s", "gyr_bias2_rad_s", "acc_bias1_m_s2", "acc_bias2_m_s2"
    return {
        "schema": SCHEMAS["orientation"],
        "schema_version": SCHEMA_VERSION,
        "imufast_version": installed_version(),
        "title": title or "Relative orientation",
        "sensors": _names(pair),
        "recording": _recording(pair),
        "calibration": {name: calibration[name] for name in (*names, *biases)},
        **orientation_plain(rel, pair, warnings, most),
    }


def _body(body: LowerBody, recording: object, title: str | None, warnings: list[str], most: int | None) -> dict[str, Any]:
    """All of a lower body's report."""
    sensor = None
    if recording is not None:
        if not isinstance(recording, Recording):
            raise InputError(f"recording must be the Recording of all sensors or None, got {type(recording).__name__}")
        missing = [name for name in body.placement.values() if name not in recording]
        if missing:
            raise InputError(f"recording is not the one it was made from: it has no sensor {missing[0]!r}")
        sensor = recording[next(iter(body.placement.values()))]
    return {
        "schema": SCHEMAS["body"],
        "schema_version": SCHEMA_VERSION,
        "imufast_version": installed_version(),
        "title": title or "Lower body",
        "recording": _recording(None if sensor is None else (sensor, sensor)),
        "own_measures": body.anthropometry != Anthropometry(),
        **body_plain(body, warnings, most),
    }


def _names(pair: tuple[Imu, Imu] | None) -> list[str]:
    return [imu.name for imu in pair] if pair else ["sensor 1", "sensor 2"]


def _calibration(
    result: Result, pair: tuple[Imu, Imu] | None, title: str | None, warnings: list[str], max_points: int | None
) -> dict[str, Any]:
    """All of a calibration's or a centre's report."""
    names = _names(pair)
    joint = result if isinstance(result, JointCalibration) else None
    hinge = joint.hinge if joint else result if isinstance(result, HingeCalibration) else None
    estimate = joint.estimate if joint else result if isinstance(result, CenterEstimate) else None
    history = () if isinstance(result, CenterEstimate) else result.history
    axis = joint.axis if joint else _hinge_axis(hinge)
    start_s, stop_s = _span(history, hinge, estimate, pair)
    alone = isinstance(result, CenterEstimate)
    center = joint.center if joint else result if isinstance(result, CenterEstimate) else None
    plain: dict[str, Any] = {
        "schema": SCHEMAS["hinge" if isinstance(result, HingeCalibration) else "joint"],
        "schema_version": SCHEMA_VERSION,
        "imufast_version": installed_version(),
        "title": title or ("Joint calibration" if joint else "Joint centre" if alone else "Hinge calibration"),
        "sensors": names,
        "verdict": None if isinstance(result, CenterEstimate) else result.verdict,
        "verdict_name": joint_words.state_name(result),
        "headline": joint_words.headline(result),
        "advice": joint_words.advice(result),
        "accepted": None if isinstance(result, CenterEstimate) else result.accepted,
        "acceptance": joint_words.acceptance(result, start_s),
        "why": () if isinstance(result, CenterEstimate) else result.why,
        "axis1": axis.axis1 if axis else None,
        "axis2": axis.axis2 if axis else None,
        "bound95_deg": axis.bound95_deg if axis else None,
        "covariance": axis.covariance if axis else None,
        "mounting": joint_words.mounting(result, start_s),
        "center": center_plain(center, estimate, axis, names, max_points),
        "gyr_bias1_rad_s": _seen(result.gyr_bias1),
        "gyr_bias2_rad_s": _seen(result.gyr_bias2),
        **acc_bias_plain(joint or (result if isinstance(result, CenterEstimate) else None)),
        "noise": asdict(joint.noise) if joint and joint.noise else None,
        "start_s": start_s,
        "stop_s": stop_s,
        "recording": _recording(pair),
        "warnings": warnings,
        "excitation": None,
        "limits_of_use": joint_words.limits_of_use(result),
        **hinge_plain(hinge, history, start_s, max_points),
    }
    if pair:
        axes = (axis.axis1, axis.axis2) if axis else (None, None)
        plain["excitation"] = {"about_axis": axis is not None, **excitation(pair_signals(*pair), *axes)}
    return plain


def _hinge_axis(hinge: HingeCalibration | None) -> JointAxis | None:
    """The best estimate so far, also where it is not accepted."""
    if hinge is None or hinge.axis1 is None or hinge.axis2 is None:
        return None
    unknown = np.full(2, np.nan) if hinge.bound95_deg is None else hinge.bound95_deg
    covariance = np.full((6, 6), np.nan) if hinge.covariance is None else hinge.covariance
    return JointAxis(hinge.axis1, hinge.axis2, covariance, unknown)


def _seen(gyr_bias: Array | None) -> Array | None:
    """A `JointCalibration` holds zeros where rest has shown no bias."""
    return gyr_bias if gyr_bias is not None and np.any(gyr_bias) else None


def _pair(recording: Pair | None) -> tuple[Imu, Imu] | None:
    if recording is None:
        return None
    if isinstance(recording, Recording):
        return recording.pair()
    if isinstance(recording, (Imu, str)) or not isinstance(recording, Sequence) or len(recording) != 2:
        raise InputError(f"recording must be the pair of Imus, a Recording of two or None, got {type(recording).__name__}")
    imu1, imu2 = recording
    check_pair(imu1, imu2)
    return imu1, imu2


def _span(
    history: Sequence[HingeStep], hinge: HingeCalibration | None, estimate: CenterEstimate | None, pair: tuple[Imu, Imu] | None
) -> tuple[float, float | None]:
    """Where times count from, and the last time, s."""
    residual_s = [] if estimate is None or not len(estimate.residual_time_s) else estimate.residual_time_s[[0, -1]].tolist()
    last = [step.time_s for step in history[-1:]] + residual_s[1:]
    if pair:
        return float(pair[0].time_s[0]), max(float(pair[0].time_s[-1]), *last) if last else float(pair[0].time_s[-1])
    if not last:
        return 0.0, None
    step_s = hinge.settings.step_s if hinge else 0.0
    first = min([step.time_s - step_s for step in history[:1]] + residual_s[:1])
    if hinge and hinge.accepted_at_s is not None:
        first = min(first, hinge.accepted_at_s)
    return (first if first > EPOCH_S else 0.0), max(last)


def _recording(pair: tuple[Imu, Imu] | None) -> dict[str, Any] | None:
    if not pair:
        return None
    imu = pair[0]
    return {
        "samples": len(imu),
        "rate_hz": imu.rate_hz,
        "duration_s": imu.duration_s,
        "lost": imu.lost,
        "gaps": len(imu.gaps),
    }


def _clean(value: Any) -> Any:
    """Plain JSON, with None for what is not finite."""
    if isinstance(value, Enum):
        return value.value
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, np.ndarray):
        return _clean(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _clean(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(inner) for inner in value]
    if isinstance(value, (int, np.integer)):
        return int(value)
    number = float(value)
    return number if math.isfinite(number) else None
