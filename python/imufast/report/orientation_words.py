"""What a relative orientation means, in words that need no knowledge of the method. Used by the report and the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from imufast.report import joint_words
from imufast.report.words import duration

if TYPE_CHECKING:
    from imufast.calibration import JointCalibration
    from imufast.track import RelativeOrientation

__all__ = [
    "LIMITS_OF_USE",
    "advice",
    "calibration",
    "certainty",
    "degrees",
    "has_verdict",
    "headline",
    "method_name",
    "start",
    "state_name",
    "vague_share",
]

_NAMES = {
    "TRACKED": "tracked",
    "NOT_OBSERVABLE": "not observable",
    "STALLED": "search stalled",
    "MAX_ITERATIONS": "search not finished",
    "NUMERICAL_ERROR": "numerical error",
}
_HEADLINES = {
    "TRACKED": "The relative orientation is known",
    "NOT_OBSERVABLE": "The motion does not show the relative orientation",
    "STALLED": "The search for the orientations stalled",
    "MAX_ITERATIONS": "The search for the orientations was cut short",
    "NUMERICAL_ERROR": "The numbers overflow: are they in the right unit?",
}
_ADVICE = {
    "TRACKED": "The orientations can be used, within their standard deviations.",
    "NOT_OBSERVABLE": "Do not use these orientations. Move the whole limb: the joint must be carried sideways, in changing "
    "directions, as in walking; rest and turning on the spot show the tilt alone.",
    "STALLED": "Take the numbers with care.",
    "MAX_ITERATIONS": "Take the numbers with care; allow more iterations.",
    "NUMERICAL_ERROR": "Check the units of the recording.",
}
_METHODS = {"Smoother": "smoother", "Mekf": "mekf", "Complementary": "complementary"}

LIMITS_OF_USE = (
    "The orientation is that of one sensor against the other, not of the bones. Sensors sit on soft tissue that moves; the "
    "standard deviation does not know by how much skin and strap turn against the bone.",
    "Heading, the turn about the vertical, is shown only while the joint is accelerated sideways; in between the gyroscopes "
    "carry it, and the standard deviation grows.",
    "Sensors that sample at different moments look as if they were turned against each other while they turn: half a sample "
    "at 100 Hz is 1.4° at 5 rad/s. The standard deviation does not know of it.",
    "A calibration holds for the sensors as they were strapped on. After they have slipped or have been taken off, centre and "
    "biases no longer fit.",
)
"""What the numbers do not cover."""


def state_name(rel: RelativeOrientation) -> str:
    """The status in small letters."""
    return _NAMES.get(rel.status.value, rel.status.value.lower())


def headline(rel: RelativeOrientation) -> str:
    """The status as one sentence without a full stop."""
    return _HEADLINES.get(rel.status.value, rel.status.value)


def advice(rel: RelativeOrientation) -> str:
    """What to do with the orientations."""
    said = _ADVICE.get(rel.status.value, "")
    limit = getattr(rel.method, "max_gap_s", None)
    if limit is not None and rel.restarts > int((np.diff(rel.time_s) > limit).sum()):
        said += (
            " The filter started anew where no gap made it: what both sensors felt contradicted its heading. Then soft tissue, "
            "a slipped strap or a calibration that does not fit makes errors that the standard deviation does not know of; the "
            "smoother is less sensitive to them."
        )
    return said


def method_name(rel: RelativeOrientation) -> str:
    """As `track(method=...)` takes it."""
    return _METHODS.get(type(rel.method).__name__, type(rel.method).__name__)


def degrees(value: float) -> str:
    """An angle for people: "0.43°", "12°", "180°"."""
    return "unknown" if not np.isfinite(value) else f"{value:.2g}°" if value < 99.5 else f"{value:.0f}°"


def certainty(rel: RelativeOrientation) -> str:
    """How certain the orientations are, in one sentence."""
    std = rel.angle_std_deg
    if not len(std) or not np.isfinite(std).all():
        return "How certain they are is not known."
    median, most = float(np.median(std)), float(np.quantile(std, 0.95))
    return f"Standard deviation: {degrees(median)} in the median, at most {degrees(most)} for 95 % of the time."


def vague_share(rel: RelativeOrientation) -> float:
    """Share of the samples that are less certain than `VAGUE_DEG`."""
    from imufast.track import VAGUE_DEG

    return float((~(rel.angle_std_deg <= VAGUE_DEG)).mean()) if len(rel) else 1.0


def start(rel: RelativeOrientation) -> str:
    """How it began, and how often anew."""
    if method_name(rel) == "smoother":
        return "No start is needed: the smoother sees the whole recording at once."
    whole = float(rel.time_s[-1] - rel.time_s[0]) if len(rel) else 0.0
    if rel.starting_s >= whole > 0.0:
        said = "The filter found no start in the whole recording"
    elif rel.starting_s == 0.0:
        said = "The start was known at once"
    else:
        said = f"The start was found after {duration(rel.starting_s)}, and the samples before it turned back from there"
    times = "once" if rel.restarts == 1 else f"{rel.restarts} times"
    if not rel.restarts:
        return f"{said}."
    return f"{said}; the filter started anew {times}."


def calibration(known: JointCalibration) -> str:
    """What it was made with, in one sentence without a full stop."""
    verdict = "made by hand"
    if has_verdict(known):
        verdict = f"{joint_words.state_name(known)}, {'accepted' if known.accepted else 'not accepted'}"
    if known.center is None:
        return f"{verdict}; no joint centre"
    away = [f"{1e3 * float(np.linalg.norm(c)):.0f} mm" for c in (known.center.in_sensor1, known.center.in_sensor2)]
    return f"{verdict}; joint centre {away[0]} and {away[1]} from the sensors"


def has_verdict(known: JointCalibration) -> bool:
    """Whether it came from motion."""
    return joint_words.state_name(known) != "made by hand"
