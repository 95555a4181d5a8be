"""All that a report says, as plain data: what the JSON twin holds is what the page shows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from enum import Enum
from typing import Any, TypeAlias

import numpy as np

from imufast.decide import MOVING_S, HingeStep
from imufast.errors import InputError
from imufast.hinge import HingeCalibration
from imufast.imu import Imu, Recording
from imufast.pairs import check_pair, pair_signals
from imufast.report import words
from imufast.report.thin import excitation, spread_out, thin_steps

__all__ = ["SCHEMA", "SCHEMA_VERSION", "Pair", "installed_version", "report_json"]

Pair: TypeAlias = Recording | Sequence[Imu]

SCHEMA = "imufast.hinge-report"
SCHEMA_VERSION = 1
"""Raised whenever a name changes its meaning or goes away; new names do not raise it."""
MOST_POINTS = 2000
"""Steps, and times of selected samples of either kind, that a report holds."""
MOST_EVENTS = 40
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
    result: HingeCalibration,
    *,
    recording: Pair | None = None,
    title: str | None = None,
    warnings: Iterable[str] = (),
    max_points: int | None = MOST_POINTS,
) -> dict[str, Any]:
    """All numbers and words of the report as plain JSON: dict, list, str, int, float, bool and None (for what is unknown,
    not finite or, in settings, without limit).

    Names end in their unit: `_s`, `_deg`, `_rad_s`. `schema` and `schema_version` say what to expect.

    Args:
        result: what `calibrate_hinge` or `HingeCalibrator` gave.
        recording: the two sensors it was made from, a pair of Imus or a Recording of two; adds names and excitation.
        title: of the report.
        warnings: what else the reader should know, one sentence each.
        max_points: the most steps of the history, and times of samples, that are kept; longer ones are thinned, extremes
            kept. None: all.

    Raises:
        InputError: an argument of the wrong kind.
    """
    if not isinstance(result, HingeCalibration):
        raise InputError(f"result must be a HingeCalibration, got {type(result).__name__}")
    if title is not None and not isinstance(title, str):
        raise InputError(f"title must be a text or None, got {type(title).__name__}")
    if isinstance(warnings, str):
        raise InputError("warnings must be several texts, such as a list, not one text")
    if max_points is not None and (isinstance(max_points, bool) or not isinstance(max_points, int) or max_points < 100):
        raise InputError(f"max_points must be a whole number of at least 100 or None (all), got {max_points!r}")
    pair = _pair(recording)
    start_s, stop_s = _span(result, pair)
    plain: dict[str, Any] = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "imufast_version": installed_version(),
        "title": title or "Hinge calibration",
        "sensors": [imu.name for imu in pair] if pair else ["sensor 1", "sensor 2"],
        "verdict": result.verdict,
        "verdict_name": words.verdict_name(result.verdict),
        "headline": words.headline(result),
        "advice": words.advice(result),
        "accepted": result.accepted,
        "accepted_at_s": result.accepted_at_s if result.accepted else None,
        "acceptance": words.acceptance(result, start_s),
        "why": result.why,
        "axis1": result.axis1,
        "axis2": result.axis2,
        "bound95_deg": result.bound95_deg,
        "bound_limit_deg": words.limit_deg(result.settings, result.verdict),
        "misfit": result.misfit,
        "covariance": result.covariance,
        "checks": _checks(result),
        "mounting": words.mounting(result, start_s),
        "mounting_changed_at_s": result.mounting_changed_at_s,
        "gyr_bias1_rad_s": result.gyr_bias1,
        "gyr_bias2_rad_s": result.gyr_bias2,
        "start_s": start_s,
        "stop_s": stop_s,
        "recording": _recording(pair),
        "warnings": [str(warning) for warning in warnings],
        "events": _events(result.history, start_s),
        "history": _history(result.history, max_points),
        "gyr_samples": _samples(result.gyr_time_s, max_points),
        "acc_samples": _samples(result.acc_time_s, max_points),
        "excitation": None,
        "settings": asdict(result.settings),
        "limits_of_use": words.LIMITS_OF_USE,
    }
    if pair:
        about_axis = result.axis1 is not None and result.axis2 is not None
        plain["excitation"] = {"about_axis": about_axis, **excitation(pair_signals(*pair), result.axis1, result.axis2)}
    cleaned: dict[str, Any] = _clean(plain)
    return cleaned


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


def _span(result: HingeCalibration, pair: tuple[Imu, Imu] | None) -> tuple[float, float | None]:
    """Where times count from, and the last time, s."""
    history = result.history
    if pair:
        start, stop = float(pair[0].time_s[0]), float(pair[0].time_s[-1])
        return start, max([stop, *(step.time_s for step in history[-1:])])
    if not history:
        return 0.0, None
    first = min([history[0].time_s - result.settings.step_s, *(t for t in (result.accepted_at_s,) if t is not None)])
    return (first if first > EPOCH_S else 0.0), history[-1].time_s


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


def _checks(result: HingeCalibration) -> list[dict[str, Any]]:
    """What acceptance looks at, each with its value, its limit and whether it is met (None: it is not asked for)."""
    settings, last = result.settings, result.history[-1] if result.history else None
    calibrated = settings.acceptance == "calibrated"
    bounds = words.judged_bounds(result)
    bound = max(bounds) if bounds else None
    limit = words.limit_deg(settings, result.verdict)
    change = last.change_deg if last else None
    moving = last.moving_s if last else 0.0
    misfit_limit = settings.approximate_misfit if calibrated else None
    met = None if not calibrated or result.misfit is None else result.misfit <= settings.approximate_misfit
    return [
        {
            "name": "the joint has moved for",
            "value": moving,
            "unit": "s",
            "relation": "≥",
            "limit": MOVING_S if calibrated else None,
        }
        | {"met": moving >= MOVING_S if calibrated else None},
        {"name": "misfit to a hinge", "value": result.misfit, "unit": "", "relation": "≤", "limit": misfit_limit, "met": met},
        {
            "name": "larger of the two bounds" if calibrated else "larger local uncertainty μ + 2σ",
            "value": bound,
            "unit": "°",
            "relation": "<",
            "limit": limit,
            "met": None if bound is None else bound < limit,
        },
        {
            "name": "change of the axes at the last step",
            "value": change,
            "unit": "°",
            "relation": "<",
            "limit": limit,
            "met": None if change is None else change < limit,
        },
    ]


def _events(history: Sequence[HingeStep], start_s: float) -> list[dict[str, Any]]:
    """Where verdict or acceptance turn; the first and the last of them if they are many."""
    events, before = [], None
    for step in history:
        state = step.verdict, step.accepted
        if state != before:
            text = words.verdict_name(step.verdict) + (", accepted" if step.accepted else "")
            if before and before[1] and not step.accepted:
                text += ", acceptance revoked"
            reason = "" if step.accepted else "; ".join(step.why)
            events.append(
                {"time_s": step.time_s, "since_start": words.duration(step.time_s - start_s), "text": text, "why": reason}
            )
        before = state
    if len(events) > MOST_EVENTS:
        half = MOST_EVENTS // 2
        left_out = f"{len(events) - 2 * half} more changes, left out here"
        events[half:-half] = [{"time_s": None, "since_start": "…", "text": left_out, "why": ""}]
    return events


def _history(history: Sequence[HingeStep], most: int | None) -> dict[str, Any]:
    """The steps by columns."""
    steps = thin_steps(history, most)
    columns: dict[str, Any] = {
        name: [getattr(step, name) for step in steps]
        for name in ("time_s", "verdict", "accepted", "change_deg", "misfit", "relative_rate", "moving_s", "n_gyr", "n_acc")
    }
    columns["relative_rate_rad_s"] = columns.pop("relative_rate")
    for name in ("bound95_deg", "published_bound_deg"):
        pairs = [getattr(step, name) for step in steps]
        for i in (0, 1):
            columns[f"{name.removesuffix('_deg')}_{i + 1}_deg"] = [None if pair is None else float(pair[i]) for pair in pairs]
    return {"steps": len(history), "kept": len(steps), **columns}


def _samples(time_s: Any, most: int | None) -> dict[str, Any]:
    times = sorted(float(time) for time in time_s)
    kept = times if most is None or len(times) <= most else [times[i] for i in spread_out(range(len(times)), most)]
    return {"count": len(times), "time_s": kept}


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
