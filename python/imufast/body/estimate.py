"""The lower body from up to seven IMUs: `estimate_lower_body`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from imufast.body.checks import alive, legs_swapped, misplaced, stands_still, too_broken, without_islands
from imufast.body.layout import layout
from imufast.body.reading import Reading
from imufast.body.result import BodyJoint, BodyStatus, LowerBody, together
from imufast.body.samples import at_samples
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.solve import Ask, Progress, solve
from imufast.body.stance import STILL
from imufast.body.start import BodyStart
from imufast.body.timing import out_of_step
from imufast.body.windows import excerpt, through_windows
from imufast.errors import InputError, SettingsError
from imufast.imu import Recording

__all__ = ["estimate_lower_body"]

LEAST_S = 5.0
"""Less cannot show how a body moves, s."""
LEAST_HZ = 10.0
"""Nor can fewer samples a second."""
FEW_HZ = 30.0
"""With fewer than this, what happens between the samples is told."""


def estimate_lower_body(
    recording: Recording,
    placement: Mapping[str, str],
    anthropometry: Anthropometry | None = None,
    *,
    settings: LowerBodySettings | None = None,
    every_sample: bool = True,
    progress: Progress | None = None,
) -> LowerBody:
    """Estimate pelvis and legs from IMUs strapped on anyhow: no magnetometer, no calibration pose (McGrath & Stirling 2020).

    Each joint is first calibrated and tracked by its two sensors alone; from there one maximum a posteriori search over all
    sensors, joints and the body's measures (eqs 4-18).

    Skin and straps turn and shift the sensors of thighs and shanks as knees and hips bend: how the joints' centres move in them
    with the flexion is estimated along with the rest. Stated standard deviations of angles, centres and lengths count what no
    sensor shows, too: how far soft tissue turns and shifts the sensors (`settings.soft_tissue_deg`, `soft_tissue_m`), and how
    upright a pelvis and a foot stand whose frames are taken from standing. Impacts that are faster than the samples follow
    widen the increments they fall into.

    A long recording is cut into overlapping windows (`settings.window_s`), so that memory stays flat: joint centres and axes
    come from its most informative pieces together.

    Args:
        recording: all sensors on one time base.
        placement: segment to sensor name; segments are "pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left" ...
            Missing feet, a missing leg or a missing pelvis make a smaller model; without a pelvis each leg has a heading and a
            place of its own.
        anthropometry: lengths and angles of the subject; default the population's.
        settings: default `LowerBodySettings()`.
        every_sample: whether the result is given at every sample (default), the gyroscopes telling how sensors turn between the
            moments of the search, or at these alone (`settings.key_step_s` apart), which takes less memory.
        progress: called with (iteration, cost, fall that the step promised, damping, stage) after each iteration; the stage is
            "whole", or of a long recording "constants", "window 1 of 30" ...; may raise to stop.

    Returns:
        LowerBody. What the motion leaves open is said joint by joint, not raised; sensors that look swapped are a status, and
        so is a subject who stands still (then every standard deviation is infinite). A stretch in which a sensor is frozen is
        a gap to all; less than half a second between two gaps is left out. A sensor that is behind the others in time, or
        ahead of them, is named.

    Raises:
        InputError: not a recording; a placement that names no segment or sensor, uses a sensor twice, or leaves a segment
            without a neighbour; a dead sensor; two that hold the same data; less than 5 s or 10 Hz.
        UnitError: a sensor whose numbers are not in SI.
        SettingsError: not an Anthropometry or LowerBodySettings.
    """
    placed = layout(recording, placement)
    if anthropometry is not None and not isinstance(anthropometry, Anthropometry):
        raise SettingsError(f"anthropometry must be an Anthropometry or None, got {type(anthropometry).__name__}")
    if settings is not None and not isinstance(settings, LowerBodySettings):
        raise SettingsError(f"settings must be a LowerBodySettings or None, got {type(settings).__name__}")
    measures, how = anthropometry or Anthropometry(), settings or LowerBodySettings()
    _check_length(recording, [])
    recording, why = alive(recording, placed)
    recording, islands = without_islands(recording, placed, how.bridge_s)
    why += islands
    _check_length(recording, why)
    if recording.rate_hz < FEW_HZ:
        why.append(
            f"recording has {recording.rate_hz:.3g} samples a second: impacts and ringing straps are faster, and look like "
            "movement where the sensors have not low-passed before they sampled; then joints are centimetres off. Record at "
            "50 Hz or more"
        )
    still = stands_still(recording, placed)
    pieces = excerpt(recording, list(placed.placed.values()), how)
    swapped = [] if still else misplaced(pieces or recording, placed)
    if not still and too_broken(pieces or recording, placed):
        why.append("gaps leave too few samples in a row to check the placement and the sensors' clocks")
    # One that sits elsewhere fits its neighbours no better by being in step with them.
    late = {} if still or swapped else out_of_step(recording, placed)
    why += [_late(segment, placed.placed[segment], behind_s) for segment, behind_s in late.items()]
    found = together([_part(recording, pieces, Ask(part, measures, how, progress)) for part in placed.parts()])
    if every_sample:
        found = at_samples(found, recording)
    if still:
        return _unseen(found, [*why, f"the subject stands still: no sensor turns faster than {STILL:g} rad/s"])
    # What the motion leaves open faces as the search began.
    hips = {n: joint.in_sensors[0] for n, joint in found.joints.items() if n.startswith("hip") and joint.turn_determined}
    doubt_deg = {name: float(np.median(found.joints[name].heading_std_deg)) for name in hips}
    swapped += legs_swapped(placed, found.q, hips, found.knee_axis, doubt_deg)
    status = BodyStatus.PLACEMENT_CONTRADICTED if swapped else found.status
    return replace(found, status=status, why=(*swapped, *why, *found.why), placement=dict(placed.placed))


def _check_length(recording: Recording, why: list[str]) -> None:
    """Refuse what is too short, or sampled too rarely; `why`: what has been left out of it."""
    lasts_s = recording.time_s[-1] - recording.time_s[0]
    if lasts_s < LEAST_S:
        raise InputError("; ".join([f"recording lasts {lasts_s:.3g} s; give at least {LEAST_S:g} s of motion", *why]))
    if recording.rate_hz < 0.99 * LEAST_HZ:
        raise InputError(f"recording has {recording.rate_hz:.3g} samples a second; give at least {LEAST_HZ:g}")


def _late(segment: str, name: str, behind_s: float) -> str:
    way = "behind" if behind_s > 0.0 else "ahead of"
    return (
        f"imu {name!r} on {segment} is about {1e3 * abs(behind_s):.0f} ms {way} the others: synchronise the sensors, or put "
        "its time stamps right and join them again (imufast.align); till then its joints are off by more than their bands"
    )


def _part(recording: Recording, pieces: Recording | None, ask: Ask) -> LowerBody:
    """Segments that joints connect."""
    if pieces is not None:
        return through_windows(recording, pieces, ask)
    found = solve(recording, ask, BodyStart(recording, ask.layout), "whole")
    return Reading(found, ask).read(found.history, list(found.why))


def _unseen(found: LowerBody, why: list[str]) -> LowerBody:
    """A body of which nothing is known: what was assumed beforehand is no measurement."""
    stds: dict[str, Any] = {
        name: {side: np.full_like(std, np.inf) for side, std in getattr(found, name).items()}
        for name in ("knee_std_deg", "hip_std_deg", "ankle_std_deg")
    }
    joints = {name: _open(joint, why[-1]) for name, joint in found.joints.items()}
    lengths = {name: (length, float("inf")) for name, (length, _) in found.lengths_m.items()}
    stds["pelvis_std_deg"] = np.full_like(found.pelvis_std_deg, np.inf)
    return replace(found, **stds, joints=joints, lengths_m=lengths, status=BodyStatus.NOT_OBSERVABLE, why=tuple(why))


def _open(joint: BodyJoint, why: str) -> BodyJoint:
    unknown: dict[str, Any] = {
        name: np.full_like(getattr(joint, name), np.inf) for name in ("heading_std_deg", "in_sensors_std")
    }
    return replace(joint, **unknown, determined=False, why=(why,))
