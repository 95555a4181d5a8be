"""What a joint calibration or a joint centre means, in words that need no knowledge of the method; see also `words`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.axis import JointAxis
from imufast.calibration import JointCalibration
from imufast.center import CenterEstimate, CenterStatus
from imufast.decide import Verdict
from imufast.hinge import HingeCalibration
from imufast.report import words

__all__ = [
    "ALONG_AXIS",
    "Result",
    "acceptance",
    "advice",
    "center_summary",
    "headline",
    "limits_of_use",
    "millimetres",
    "mounting",
    "residual_summary",
    "state_name",
    "undetermined_words",
]

Array = NDArray[np.float64]
Result: TypeAlias = HingeCalibration | JointCalibration | CenterEstimate

FOUND = (CenterStatus.CONVERGED, CenterStatus.PARTLY_DETERMINED)
ALONG_AXIS = "its place along the hinge axis; no motion of a hinge tells it"

_STATUS_NAMES = {
    CenterStatus.CONVERGED: "determined",
    CenterStatus.PARTLY_DETERMINED: "partly determined",
    CenterStatus.NOT_IDENTIFIABLE: "not identifiable",
    CenterStatus.STALLED: "search stalled",
    CenterStatus.MAX_ITERATIONS: "search not finished",
    CenterStatus.NUMERICAL_ERROR: "numerical error",
}
_CENTER_HEADLINES = {
    CenterStatus.CONVERGED: "The joint centre is known",
    CenterStatus.PARTLY_DETERMINED: "The joint centre is known, but not in every direction",
    CenterStatus.NOT_IDENTIFIABLE: "The motion does not tell where the joint centre is",
    CenterStatus.STALLED: "The search for the joint centre stalled",
    CenterStatus.MAX_ITERATIONS: "The search for the joint centre was cut short",
    CenterStatus.NUMERICAL_ERROR: "The numbers overflow: are they in the right unit?",
}
_CENTER_ADVICE = {
    CenterStatus.CONVERGED: "The centre below can be used, within its standard deviations.",
    CenterStatus.PARTLY_DETERMINED: "The centre below can be used, but for the directions that are named as open. Where the "
    "joint is no hinge, record more motion: turn it about further axes.",
    CenterStatus.NOT_IDENTIFIABLE: "Do not use a centre from this motion. Turn both segments about several axes, and briskly.",
    CenterStatus.STALLED: "Take the numbers with care.",
    CenterStatus.MAX_ITERATIONS: "Take the numbers with care; allow more iterations.",
    CenterStatus.NUMERICAL_ERROR: "Check the units of the recording.",
}

_BY_HAND = (
    "A calibration made by hand: what is known of the joint, as it was given",
    "Nothing of it was found from motion here; whether to trust it is for its maker to say.",
)
_NO_EVIDENCE = "The evidence is not at hand: this calibration was loaded from a file or made by hand."
_BALL_ADVICE = (
    "This is no statement about the joint. Record more motion: turn it about several axes, and the whole limb too. If it is a "
    "hinge, calibrate it as one."
)

_FUNCTIONAL_CENTER = (
    "The centre is a functional one: the point that moves least against both sensors. On a person these sit on soft tissue, "
    "and what the skin shows can lie centimetres from the centre of the bones; the standard deviations do not know of this, "
    "nor of a joint that rolls and glides, as knees do."
)
_ACCELEROMETER = (
    "The centre is told from the point in each housing at which its accelerometer measures, not from the housing's middle."
)
_MOUNTED = (
    "Everything holds for the sensors as they were strapped on in this recording. After they have been taken off or have "
    "slipped, calibrate anew."
)


def headline(result: Result) -> str:
    """The result as one sentence without a full stop."""
    if isinstance(result, CenterEstimate):
        return _CENTER_HEADLINES[result.status]
    return _BY_HAND[0] if _made_by_hand(result) else words.headline(result)


def advice(result: Result) -> str:
    """What to do with the result."""
    if isinstance(result, CenterEstimate):
        return _CENTER_ADVICE[result.status]
    if _made_by_hand(result):
        return _BY_HAND[1]
    ball_asked = isinstance(result, JointCalibration) and result.hinge is None and result.estimate is not None
    if ball_asked and result.verdict is Verdict.NOT_ENOUGH_INFORMATION:
        return _BALL_ADVICE
    said = words.advice(result)
    if isinstance(result, JointCalibration) and result.accepted and result.axis is not None:
        if result.center is not None:
            open_ = undetermined_words(result.center.undetermined, result.axis, ("sensor 1", "sensor 2"))
            but = "" if not open_ else ", but for its place along the axis" if open_ == [ALONG_AXIS] else ", but not all of it"
            said += f" So can the joint centre, within its standard deviations{but}."
        elif result.estimate is not None:
            said += " The joint centre was not found."
    return said


def state_name(result: Result) -> str:
    """In small letters: the verdict, or what became of a centre alone."""
    if isinstance(result, CenterEstimate):
        return _STATUS_NAMES[result.status]
    return "made by hand" if _made_by_hand(result) else words.verdict_name(result.verdict)


def acceptance(result: Result, start_s: float = 0.0) -> str:
    """Why it is accepted, or what stands in the way; `start_s` is where times count from, s."""
    if isinstance(result, HingeCalibration):
        return words.acceptance(result, start_s)
    if isinstance(result, CenterEstimate):
        return center_summary(result)
    if _made_by_hand(result):
        return "Not accepted by any rule." if not result.accepted else "Accepted by its maker."
    if result.hinge is not None and result.verdict is result.hinge.verdict and result.accepted:
        return words.acceptance(result.hinge, start_s)
    if result.accepted and result.estimate is not None and result.center is not None:
        std = " and ".join(millimetres(value) for value in result.center.determined_std)
        return f"Accepted: the motion determines the centre in all directions (standard deviation {std})."
    said = "Accepted." if result.accepted else f"Not accepted: {'; '.join(result.why) or 'no reason is on record'}."
    return said if result.estimate is not None or result.hinge is not None else f"{said} {_NO_EVIDENCE}"


def mounting(result: Result, start_s: float = 0.0) -> str:
    """When the mounting changed, in words; empty when it did not."""
    hinge = result if isinstance(result, HingeCalibration) else result.hinge if isinstance(result, JointCalibration) else None
    said = "" if hinge is None else words.mounting(hinge, start_s)
    if said and isinstance(result, JointCalibration) and result.center is not None:
        said += " The joint centre is that of the time since."
    return said


def limits_of_use(result: Result) -> tuple[str, ...]:
    """What the numbers do not cover."""
    if isinstance(result, HingeCalibration):
        return words.LIMITS_OF_USE
    has_center = isinstance(result, CenterEstimate) or result.center is not None
    of_center = (_FUNCTIONAL_CENTER, _ACCELEROMETER) if has_center else ()
    of_axis = words.LIMITS_OF_USE[:2] if isinstance(result, JointCalibration) and result.axis is not None else ()
    return (*of_axis, *of_center, _MOUNTED)


def center_summary(estimate: CenterEstimate) -> str:
    """What became of the search for the centre, in one sentence."""
    count = len(estimate.undetermined)
    if estimate.status is CenterStatus.CONVERGED:
        return "The motion determines the joint centre in all directions."
    if estimate.status is CenterStatus.PARTLY_DETERMINED:
        return f"The motion leaves {count} of the 6 directions of the joint centre open."
    if estimate.status is CenterStatus.NOT_IDENTIFIABLE:
        if count >= 3:
            return f"The motion leaves {count} of the 6 directions of the joint centre open: it says next to nothing of it."
        return "No joint centre explains the motion: the two sensors may not share a joint."
    return f"{_CENTER_HEADLINES[estimate.status].rstrip('?')}."


def residual_summary(residual_std: float, unexplained: float) -> str:
    """How well the centre explains what both sensors feel."""
    percent = 100.0 * unexplained
    share = f"{percent:.0f}" if percent >= 10.0 else f"{percent:.2g}"
    return f"{residual_std:.2g} m/s² at the joint centre, {share} % of what is left without lever arms"


def millimetres(value_m: float) -> str:
    """A length for people, such as "0.55 mm" or "21 mm"."""
    return f"{1e3 * value_m:.2g} mm" if value_m < 0.1 else f"{1e3 * value_m:.0f} mm"


def undetermined_words(undetermined: Array, axis: JointAxis | None, names: Sequence[str]) -> list[str]:
    """Each direction that the motion left open, for people.

    Args:
        undetermined: (k, 6) of the stacked centres.
        axis: the hinge axis where it is known.
        names: of both sensors.
    """
    whole = [name for i, name in enumerate(names) if (undetermined[:, 3 * i : 3 * i + 3] ** 2).sum() > 2.6]
    if len(undetermined) >= 3:
        said = [f"the whole centre as seen from {name}" for name in whole]
        left = len(undetermined) - 3 * len(whole)
        more = "further " if whole else ""
        return said + ([f"{left} {more}of the 6 directions of both centres"] if left > 0 else [])
    return [_one_direction(direction, axis, names) for direction in undetermined]


def _one_direction(direction: Array, axis: JointAxis | None, names: Sequence[str]) -> str:
    first, second = direction[:3], direction[3:]
    if axis is not None:
        along = np.concatenate([axis.axis1, axis.axis2]) / np.sqrt(2.0)
        if abs(float(direction @ along)) > 0.97:
            return ALONG_AXIS
    sizes = float(np.linalg.norm(first)), float(np.linalg.norm(second))
    if min(sizes) > 0.35:
        # A sign for both, so that the first leads.
        said = f"both centres together, {names[0]} {_along(first)} while {names[1]} {_along(second)}"
        return said + (", as along the axis of a hinge" if abs(sizes[0] - sizes[1]) < 0.1 else "")
    return f"{names[0]}, {_along(first)}" if sizes[0] > sizes[1] else f"{names[1]}, {_along(second)}"


def _along(vector: Array) -> str:
    unit = vector / np.linalg.norm(vector)
    k = int(np.abs(unit).argmax())
    if abs(unit[k]) > 0.9:
        return f"{'' if abs(unit[k]) > 0.995 else 'mostly '}along {'xyz'[k]}"
    x, y, z = np.round(unit * np.sign(unit[k]), 2) + 0.0
    return f"along ({x:g}, {y:g}, {z:g})".replace("-", "−")


def _made_by_hand(result: HingeCalibration | JointCalibration) -> bool:
    """Nothing about it came from motion, as far as can be seen."""
    if isinstance(result, HingeCalibration) or result.hinge is not None or result.estimate is not None:
        return False
    return result.verdict is Verdict.NOT_ENOUGH_INFORMATION and not result.history and not result.why
