"""What a report says of a hinge's calibration: criteria, history, events and samples, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from imufast.decide import MOVING_S, HingeStep
from imufast.hinge import HingeCalibration
from imufast.report import words
from imufast.report.thin import spread_out, thin_steps

__all__ = ["MOST_EVENTS", "hinge_plain"]

MOST_EVENTS = 40


def hinge_plain(
    hinge: HingeCalibration | None, history: Sequence[HingeStep], start_s: float, most: int | None
) -> dict[str, Any]:
    """All that is told of it; without one (a calibration that was loaded or made by hand) all that its history tells."""
    return {
        "accepted_at_s": hinge.accepted_at_s if hinge and hinge.accepted else None,
        "bound_limit_deg": words.limit_deg(hinge.settings, hinge.verdict) if hinge else None,
        "misfit": hinge.misfit if hinge else None,
        "checks": _checks(hinge) if hinge else [],
        "mounting_changed_at_s": hinge.mounting_changed_at_s if hinge else (),
        "events": _events(history, start_s),
        "history": _history(history, most),
        "gyr_samples": _samples(hinge.gyr_time_s if hinge else (), most),
        "acc_samples": _samples(hinge.acc_time_s if hinge else (), most),
        "settings": asdict(hinge.settings) if hinge else None,
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
