"""How a relative orientation is printed, and the exit code it means."""

from __future__ import annotations

from imufast.cli.show import say
from imufast.imu import Imu
from imufast.report import orientation_words as told
from imufast.report import words
from imufast.track import VAGUE_DEG, RelativeOrientation, TrackStatus

__all__ = ["exit_code", "orientation"]

NOT_OBSERVABLE, NOT_FINISHED = 3, 4


def exit_code(rel: RelativeOrientation) -> int:
    """0 tracked, 3 not observable, 4 the search did not end as it should."""
    return {TrackStatus.TRACKED: 0, TrackStatus.NOT_OBSERVABLE: NOT_OBSERVABLE}.get(rel.status, NOT_FINISHED)


def orientation(rel: RelativeOrientation, imu1: Imu, imu2: Imu, calibration: str | None) -> None:
    """Status in words, how certain, start and restarts, gaps, and what calibration it rests on.

    Args:
        rel: the orientations.
        imu1, imu2: the sensors.
        calibration: the file that it was loaded from; None: the recording calibrated itself.
    """
    say(told.headline(rel), "bold green" if rel.status is TrackStatus.TRACKED else "bold yellow")
    say(f"status: {rel.status}, method {told.method_name(rel)}, {imu2.name} as seen from {imu1.name}")
    say(told.advice(rel))
    for reason in rel.why:
        say(f"note: {reason}")
    say(told.certainty(rel))
    share = told.vague_share(rel)
    if share:
        percent = format(100.0 * share, ".2g" if share < 0.995 else ".3g")
        say(f"less certain than {VAGUE_DEG:g}°: {percent} % of the samples")
    say(told.start(rel))
    gaps = imu1.gaps
    missing = f"{len(gaps)}, {imu1.lost} samples missing" if len(gaps) else "none"
    say(f"samples: {len(rel)} in {words.duration(imu1.duration_s)} at {imu1.rate_hz:.6g} Hz; gaps: {missing}")
    source = "of this recording itself" if calibration is None else f"from {calibration}"
    say(f"calibration {source}: {told.calibration(rel.calibration)}")
    if not rel.calibration.accepted and told.has_verdict(rel.calibration):
        reasons = "; ".join(rel.calibration.why)
        say(f"it was not accepted{f': {reasons}' if reasons else ''}")
