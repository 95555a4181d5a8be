"""What `estimate_lower_body` finds."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.samples import ReadOnly

__all__ = ["BodyJoint", "BodyStatus", "BodyWindow", "LowerBody", "together", "worst"]

Array = NDArray[np.float64]


class BodyStatus(str, Enum):
    """What became of the search."""

    CONVERGED = "CONVERGED"
    """Found; what the motion left open, `joints` say one by one."""
    STALLED = "STALLED"
    """No step lowered the cost although one was promised; take the numbers with care."""
    MAX_ITERATIONS = "MAX_ITERATIONS"
    """The iterations ran out before the minimum."""
    NOT_OBSERVABLE = "NOT_OBSERVABLE"
    """The motion determines none of the joints."""
    NUMERICAL_ERROR = "NUMERICAL_ERROR"
    """The numbers overflow; are they in the right unit?"""
    PLACEMENT_CONTRADICTED = "PLACEMENT_CONTRADICTED"
    """The sensors are not where the placement says: `why` names them. The numbers are of no use."""

    def __str__(self) -> str:
        return self.value


UNSEEN_DEG = 10.0
"""A joint whose relative heading is less certain than this for most of the time is undetermined, degrees."""


@dataclass(frozen=True, eq=False)
class BodyJoint(ReadOnly):
    """One joint as found.

    Attributes:
        in_sensors: (2, 3) its centre as seen from the sensor nearer to the pelvis and from the other, m.
        in_sensors_std: (2,) standard deviation of either in its least certain direction, m.
        heading_std_deg: (K,) of the heading between both sensors, degrees; infinite where nothing is known.
        heading_drift_deg: how far that heading has moved, over the recording, from what the joint's two sensors alone say,
            degrees, rms.
        determined: whether the motion determines heading and centre.
        why: if not, what it leaves open.
    """

    in_sensors: Array
    in_sensors_std: Array
    heading_std_deg: Array = field(repr=False)
    heading_drift_deg: float
    determined: bool
    why: tuple[str, ...]

    @property
    def turn_determined(self) -> bool:
        """Whether the motion shows how both segments are turned against each other, wherever the centre is."""
        return float(np.median(self.heading_std_deg)) <= UNSEEN_DEG


@dataclass(frozen=True)
class BodyWindow:
    """One window of a long recording.

    Attributes:
        start_s, stop_s: first and last moment that the result has from it, s.
        status: what became of its search.
        why: what the reader should know of it.
        iterations: linear systems solved.
    """

    start_s: float
    stop_s: float
    status: BodyStatus
    why: tuple[str, ...]
    iterations: int


@dataclass(frozen=True, eq=False)
class LowerBody:
    """Pelvis and legs over a recording, at K moments: its samples, or about ten a second. Segments and joints are those of
    the placement: "pelvis", "thigh_right" ..., "hip_right", "knee_left" ...

    Quaternions (K, 4) w x y z take sensor or segment vectors to the world (z up; heading and place of the whole are arbitrary).
    Segment axes: x to the right, y forward, z towards the body.

    Attributes:
        time_s: (K,) s.
        status: what became of the search.
        why: what the reader should know, one sentence each.
        q: segment to the orientation of its sensor.
        q_segment: segment to its own; a foot's and, without both hips, a pelvis's is upright when the subject stands.
        position: segment to (K, 3), place of its sensor, m. The whole drifts; differences between segments do not.
        knee_angles_deg, hip_angles_deg, ankle_angles_deg: side to (K, 3): flexion (ankle: dorsiflexion), adduction, internal
            rotation of the distal segment (ISB, Grood & Suntay 1983), positive on both sides, degrees.
        knee_std_deg, hip_std_deg, ankle_std_deg: likewise, one standard deviation.
        pelvis_angles_deg: (K, 2) tilt (positive: its front up) and list (positive: its right side down) of the pelvis against
            the upright, whatever its heading, degrees; (K, 0) without a pelvis sensor.
        pelvis_std_deg: likewise, one standard deviation.
        joints: joint to what was found of it.
        knee_axis: thighs and shanks to (3,), the knee's axis in sensor frames, pointing to the right.
        lengths_m: "femur_right", "tibia_left", "hips" ... to (length, standard deviation), m.
        cost: minus the logarithm of the posterior, up to a constant.
        iterations: linear systems solved.
        residuals: kind of term ("dynamics", "joint_center", "hinge" ...) to segment, joint or bone to the root mean square
            of its residual over its standard deviation; much more than 1 contradicts what was assumed.
        history: (T, 5) of these: cost before, after, promised fall, damping, whether taken.
        placement, anthropometry, settings: what it was made with.
        windows: of a long recording, one after the other; empty where it was solved whole. `cost` is then their sum, and the
            constants (centres, axes, lengths) are those of its informative pieces.
    """

    time_s: Array = field(repr=False)
    status: BodyStatus
    why: tuple[str, ...]
    q: dict[str, Array] = field(repr=False)
    q_segment: dict[str, Array] = field(repr=False)
    position: dict[str, Array] = field(repr=False)
    knee_angles_deg: dict[str, Array] = field(repr=False)
    hip_angles_deg: dict[str, Array] = field(repr=False)
    ankle_angles_deg: dict[str, Array] = field(repr=False)
    knee_std_deg: dict[str, Array] = field(repr=False)
    hip_std_deg: dict[str, Array] = field(repr=False)
    ankle_std_deg: dict[str, Array] = field(repr=False)
    pelvis_angles_deg: Array = field(repr=False)
    pelvis_std_deg: Array = field(repr=False)
    joints: dict[str, BodyJoint] = field(repr=False)
    knee_axis: dict[str, Array]
    lengths_m: dict[str, tuple[float, float]]
    cost: float
    iterations: int
    residuals: dict[str, dict[str, float]] = field(repr=False)
    history: Array = field(repr=False)
    placement: dict[str, str] = field(repr=False)
    anthropometry: Anthropometry = field(repr=False)
    settings: LowerBodySettings = field(repr=False)
    windows: tuple[BodyWindow, ...] = field(default=(), repr=False)


def worst(*all_of: BodyStatus) -> BodyStatus:
    """The status of what has several parts: a search that failed in one has failed; what is not observable in one may be in
    others."""
    ranks = (
        BodyStatus.PLACEMENT_CONTRADICTED,
        BodyStatus.NUMERICAL_ERROR,
        BodyStatus.STALLED,
        BodyStatus.MAX_ITERATIONS,
        BodyStatus.CONVERGED,
        BodyStatus.NOT_OBSERVABLE,
    )
    return min(all_of, key=ranks.index)


def together(parts: list[LowerBody]) -> LowerBody:
    """One result of parts that no joint connects, each with a heading and a place of its own."""
    first = parts[0]
    merged: dict[str, Any] = {}
    for item in fields(LowerBody):
        values = [getattr(part, item.name) for part in parts]
        if isinstance(values[0], dict):
            merged[item.name] = {key: value for part in values for key, value in part.items()}
    merged["residuals"] = {
        kind: {name: value for part in parts for name, value in part.residuals.get(kind, {}).items()}
        for kind in dict.fromkeys(kind for part in parts for kind in part.residuals)
    }
    windows = tuple(
        BodyWindow(
            same[0].start_s,
            same[0].stop_s,
            worst(*(window.status for window in same)),
            tuple(dict.fromkeys(why for window in same for why in window.why)),
            sum(window.iterations for window in same),
        )
        for same in zip(*(part.windows for part in parts), strict=True)
    )
    return replace(
        first,
        **merged,
        status=worst(*(part.status for part in parts)),
        why=tuple(dict.fromkeys(why for part in parts for why in part.why)),
        cost=sum(part.cost for part in parts),
        iterations=sum(part.iterations for part in parts),
        history=np.concatenate([part.history for part in parts]),
        windows=windows,
    )
