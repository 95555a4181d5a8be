"""What a result means, in words that need no knowledge of the method. Used by the report and by the command line."""

from __future__ import annotations

import math

from imufast.calibration import JointCalibration
from imufast.decide import Verdict
from imufast.hinge import HingeCalibration
from imufast.settings import HingeSettings

__all__ = [
    "LIMITS_OF_USE",
    "UNKNOWN_DEG",
    "acceptance",
    "advice",
    "duration",
    "headline",
    "judged_bounds",
    "limit_deg",
    "mounting",
    "verdict_name",
]

UNKNOWN_DEG = 45.0
"""From this bound on a direction is called unknown."""

_NAMES = {
    Verdict.HINGE: "hinge",
    Verdict.APPROXIMATE_HINGE: "approximate hinge",
    Verdict.NOT_A_HINGE: "not a hinge",
    Verdict.NOT_ENOUGH_INFORMATION: "not enough information",
    Verdict.MOUNTING_CHANGED: "mounting changed",
    Verdict.BALL_JOINT: "ball joint",
}

_HEADLINES = {
    (Verdict.HINGE, True): "The joint is a hinge, and its axis is known",
    (Verdict.HINGE, False): "The joint moves like a hinge, but its axis is not yet known well enough",
    (Verdict.APPROXIMATE_HINGE, True): "The joint is nearly a hinge, and its functional axis is known",
    (Verdict.APPROXIMATE_HINGE, False): "The joint moves nearly like a hinge, but its axis is not yet known well enough",
    (Verdict.NOT_A_HINGE, False): "The joint is not a hinge: there is no one axis to be found",
    (Verdict.NOT_ENOUGH_INFORMATION, False): "Not enough motion to tell",
    (Verdict.MOUNTING_CHANGED, False): "A sensor has moved on its segment, and the new mounting is not calibrated yet",
    (Verdict.BALL_JOINT, True): "The joint is no hinge but turns about one point: a ball joint, and its centre is known",
    (Verdict.BALL_JOINT, False): "The joint turns about one point, but its centre is not known well enough",
}

_ADVICE = {
    (Verdict.HINGE, True): "The axes below can be used.",
    (Verdict.HINGE, False): "Do not use the axes yet. Record more motion: bend the joint, and turn the whole limb too.",
    (
        Verdict.APPROXIMATE_HINGE,
        True,
    ): "The axes below can be used as a functional axis. Soft tissue and the joint itself depart "
    "from a perfect hinge; the bound includes this.",
    (Verdict.APPROXIMATE_HINGE, False): "Do not use the axes yet. Record more motion: bend the joint, and turn the whole limb "
    "too; check that the straps are firm.",
    (
        Verdict.NOT_A_HINGE,
        False,
    ): "Do not use an axis from this motion. Either the joint has more than one degree of freedom, or a strap is "
    "loose, or the sensors are not those of one joint, or they are not synchronous.",
    (Verdict.NOT_ENOUGH_INFORMATION, False): "This is no statement about the joint. Record more motion: bend the joint, and "
    "turn the whole limb too.",
    (Verdict.MOUNTING_CHANGED, False): "Do not use axes from before the change for data after it. Check the straps and record "
    "more motion.",
    (Verdict.BALL_JOINT, True): "The centre below can be used, within its standard deviations. There is no hinge axis. Joints "
    "with two axes that meet in one point are called ball joints, too.",
    (Verdict.BALL_JOINT, False): "Do not use the centre yet. Record more motion: turn the joint about several axes.",
}

# A run that was accepted may fail a step or two before the acceptance is revoked.
_DOUBT = (
    "The axis was accepted, but the latest motion casts doubt on it",
    "Record more motion before you rely on the axes.",
)

_COVERS = (
    "A joint with two degrees of freedom that has so far turned about one axis only cannot be told from a hinge by anyone; "
    "later data revoke the acceptance.",
    "The axes hold for the sensors as they were strapped on in this recording. After the sensors have been taken off or have "
    "slipped, calibrate anew.",
)
_SOFT_TISSUE = (
    "The axis is a functional axis: the one that the two sensors turn about. On a person the sensors sit on soft tissue. For "
    "an approximate hinge the bound covers how well this functional axis repeats; it does not cover its distance from an "
    "anatomical axis, such as the transepicondylar axis of the knee."
)
LIMITS_OF_USE = (_SOFT_TISSUE, *_COVERS)
"""What the numbers do not cover."""


def verdict_name(verdict: Verdict) -> str:
    """The verdict in small letters, such as "approximate hinge"."""
    return _NAMES[verdict]


def headline(result: HingeCalibration | JointCalibration) -> str:
    """The verdict as one sentence without a full stop."""
    return _HEADLINES.get((result.verdict, result.accepted), _DOUBT[0])


def advice(result: HingeCalibration | JointCalibration) -> str:
    """What to do with the result."""
    return _ADVICE.get((result.verdict, result.accepted), _DOUBT[1])


def duration(seconds: float) -> str:
    """A length of time for people: "0.5 s", "12 s", "3 min 20 s", "2 h 5 min", "3 d 4 h"."""
    if not math.isfinite(seconds):
        return "–"
    if seconds < 0.0:
        return "−" + duration(-seconds)
    if seconds < 120.0:
        return f"{seconds:.1f}".removesuffix(".0") + " s"
    for large, small, size, below in (("min", "s", 1, 7200.0), ("h", "min", 60, 172_800.0), ("d", "h", 3600, math.inf)):
        if seconds < below:
            whole, rest = divmod(round(seconds / size), 24 if large == "d" else 60)
            return f"{whole} {large}" + (f" {rest} {small}" if rest else "")
    return "–"


def limit_deg(settings: HingeSettings, verdict: Verdict) -> float:
    """The limit that the bound must keep, degrees."""
    approximate = verdict is Verdict.APPROXIMATE_HINGE and settings.acceptance == "calibrated"
    return settings.max_error_approximate_deg if approximate else settings.max_error_deg


def acceptance(result: HingeCalibration, start_s: float = 0.0) -> str:
    """Since when it is accepted and why, or what stands in the way; `start_s` is where times count from, s."""
    settings = result.settings
    bounds = judged_bounds(result)
    if not result.accepted or result.accepted_at_s is None:
        reasons = "; ".join(result.why) or "no reason is on record"
        return f"Not accepted: {reasons}."
    said = f"Accepted since {duration(result.accepted_at_s - start_s)} after the start"
    if bounds is not None:
        name = "bounds" if settings.acceptance == "calibrated" else "local uncertainties (μ + 2σ)"
        said += f": both {name} ({bounds[0]:.2g}° and {bounds[1]:.2g}°) are below {limit_deg(settings, result.verdict):g}°"
    if settings.acceptance == "calibrated" and result.misfit is not None:
        hinge = result.verdict is Verdict.HINGE
        limit = settings.hinge_misfit if hinge else settings.approximate_misfit
        said += f", the misfit ({result.misfit:.3f}) {'is below' if hinge else 'is at most'} {limit:g}"
    said += f", and that in {settings.n_consistent} estimates in a row that agree."
    if result.why:
        said += f" At present, though: {'; '.join(result.why)}."
    return said


def judged_bounds(result: HingeCalibration) -> tuple[float, float] | None:
    """The two bounds that acceptance looked at last, degrees."""
    bounds = result.bound95_deg
    if result.settings.acceptance == "published":
        bounds = result.history[-1].published_bound_deg if result.history else None
    return None if bounds is None else (float(bounds[0]), float(bounds[1]))


def mounting(result: HingeCalibration, start_s: float = 0.0) -> str:
    """When the mounting changed, in words; empty when it did not."""
    times = result.mounting_changed_at_s
    if not times:
        return ""
    count = "" if len(times) == 1 else f" {len(times)} times, last"
    said = f"The mounting of a sensor was seen to have changed{count} at {duration(times[-1] - start_s)} after the start"
    if result.accepted:
        return f"{said}; the new mounting has been calibrated and accepted, and the axes hold from there on only."
    return f"{said}; what was known before does not hold for the data after it."
