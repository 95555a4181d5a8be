"""What a lower body means, in words that need no knowledge of the method."""

from __future__ import annotations

import numpy as np

from imufast.body.result import BodyJoint, BodyStatus, LowerBody
from imufast.report.orientation_words import degrees

__all__ = [
    "ANGLES",
    "LIMITS_OF_USE",
    "RESIDUALS",
    "advice",
    "certainty",
    "headline",
    "joint_words",
    "name_words",
    "residual_words",
    "status_name",
]

ANGLES = {
    "hip": ("Flexion", "Adduction", "Internal rotation"),
    "knee": ("Flexion", "Adduction", "Internal rotation"),
    "ankle": ("Dorsiflexion", "Inversion", "Internal rotation"),
}
RESIDUALS = {
    "dynamics": "gyroscope and accelerometer against the motion",
    "gyr_bias_walk": "gyroscope bias, from moment to moment",
    "acc_bias_walk": "accelerometer bias, from moment to moment",
    "joint_center": "joint centre, as both sensors see it",
    "hinge": "knee as a hinge",
    "knee_axes": "knee axis in thigh against that in shank",
    "segment_length": "length against the usual one",
    "axis_angle": "angle of knee axis and bone against the usual one",
    "length_difference": "right against left",
}
CONTRADICTED = 2.5
"""A residual of so many standard deviations is pointed out."""
_HEADLINES: dict[str, str] = {
    BodyStatus.CONVERGED: "Pelvis and legs are known",
    BodyStatus.STALLED: "The search stalled before its end",
    BodyStatus.MAX_ITERATIONS: "The search ran out of iterations",
    BodyStatus.NOT_OBSERVABLE: "The motion shows at no joint how its segments are turned",
    BodyStatus.NUMERICAL_ERROR: "The numbers overflow: are they in the right unit?",
    "PLACEMENT_CONTRADICTED": "The sensors are not where the placement says",
}
MORE_MOTION = "Record more motion: walk, stand up, bend and turn each hip, for half a minute or more."
_ADVICE: dict[str, str] = {
    BodyStatus.CONVERGED: "The angles below can be used, within their bands.",
    BodyStatus.STALLED: "Take the numbers with care: they are the best that was found, not the minimum, and their bands do not "
    "know of it.",
    BodyStatus.MAX_ITERATIONS: "Take the numbers with care: they are the best that was found, not the minimum, and their bands "
    "do not know of it.",
    BodyStatus.NOT_OBSERVABLE: f"Do not use these angles. {MORE_MOTION}",
    BodyStatus.NUMERICAL_ERROR: "Check the units of the recording.",
    "PLACEMENT_CONTRADICTED": "The numbers are of no use: correct the placement as the notes say, and run it again.",
}
LIMITS_OF_USE = (
    "Sensors sit on skin. Joint centres and axes are functional ones, those that skin and straps show; bones may lie "
    "centimetres and several degrees off, and the bands know of soft tissue only what the motion contradicts.",
    "Lengths and angles that are usual for people enter as knowledge: where the motion says little, what comes out is what is "
    "usual, and its standard deviation says so.",
    "A foot's zero, and the tilt of the pelvis, are those of quiet standing; a subject who stands on bent knees or with toes "
    "turned out moves them.",
    "Where in the room the subject is, and which way the whole faces, no sensor here shows.",
)


def headline(body: LowerBody) -> str:
    """The status as one sentence without a full stop."""
    said = _HEADLINES[body.status]
    if "pelvis" not in body.q:
        said = said.replace(
            "Pelvis and legs", "The legs" if len({name.partition("_")[2] for name in body.q}) > 1 else "The leg"
        )
        said = said.replace("The leg are", "The leg is")
    open_ = [name for name, joint in body.joints.items() if not joint.determined]
    if body.status is BodyStatus.CONVERGED and len(open_) == len(body.joints):
        return "The motion leaves every joint open"
    if body.status is BodyStatus.CONVERGED and open_:
        return f"{said}, but for what the motion leaves open"
    return said


def advice(body: LowerBody) -> str:
    """What to do with the result."""
    open_ = [name for name, joint in body.joints.items() if not joint.determined]
    if body.status is BodyStatus.CONVERGED and len(open_) == len(body.joints):
        return "Take these angles with great care, if at all: this motion settles no joint. " + MORE_MOTION
    if body.status is not BodyStatus.CONVERGED or not open_:
        doubt = body.status is BodyStatus.CONVERGED and residual_words(body)
        return _ADVICE[body.status] + (" Something contradicts what was assumed: see how well it fits." if doubt else "")
    return (
        f"The angles below can be used, within their bands, but not those of {', '.join(map(name_words, open_))}: turn these "
        "joints about more than one axis, and briskly, while the whole body moves."
    )


def status_name(body: LowerBody) -> str:
    """In small letters."""
    return body.status.value.lower().replace("_", " ")


def name_words(name: str) -> str:
    """ "left hip" for "hip_left"; "hips" stays."""
    kind, _, side = name.partition("_")
    return f"{side} {kind}" if side in ("left", "right") else name


def certainty(body: LowerBody) -> str:
    """How certain the flexion angles are, in one sentence."""
    said = []
    for kind in ("hip", "knee", "ankle"):
        stds = [float(np.median(std[:, 0])) for std in getattr(body, f"{kind}_std_deg").values()]
        if stds:
            low, high = degrees(min(stds)), degrees(max(stds))
            said.append(f"{kind} {low}" if low == high else f"{kind} {low} to {high}")
    return f"Standard deviation of flexion, in the median: {', '.join(said)}." if said else "No joint angle could be told."


def joint_words(joint: BodyJoint) -> str:
    """What the motion tells of a joint, in one sentence."""
    if joint.determined:
        return "The motion shows how its segments are turned against each other, and its centre."
    text = "; ".join(joint.why)
    return f"{text[:1].upper()}{text[1:]}."


def residual_words(body: LowerBody) -> list[str]:
    """What contradicts the assumptions most, one sentence each."""
    said = []
    for kind, values in body.residuals.items():
        beyond = [name for name, value in values.items() if abs(value) > CONTRADICTED]
        if beyond:
            worst = max(abs(values[name]) for name in beyond)
            names = ", ".join(map(name_words, beyond))
            said.append(f"{RESIDUALS.get(kind, kind)}: {names}, up to {worst:.3g} standard deviations")
    return said
