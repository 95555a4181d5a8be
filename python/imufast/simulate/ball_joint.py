"""Simulated recordings of two segments joined by a spherical joint, consistent as rigid bodies, with exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from imufast.errors import SettingsError

from .ball_motions import BallMotion, ball_program, named_ball_motion
from .checks import FloatArray, matrix33, one_of, seed_number
from .disturbances import Collisions
from .motion_base import as_motions
from .pair import SensorPair
from .placement import PAPER_R1, PAPER_R2
from .pose import BallPose, BallProgram, Bodies, Movement, Position, X, Y, Z
from .record import Readout, true_rows
from .simulation import BallJointSimulation
from .so3 import Turning
from .soft_tissue import SoftTissue
from .timing import Clock

__all__ = ["simulate_ball_joint"]

# Joint centre from either sensor in segment axes, m: the lever arms of the 2017 rig, whose sensors' x axes point backwards.
BACKWARDS = np.array([-1.0, -1.0, 1.0])
JOINT_FROM_SENSOR = (-BACKWARDS * PAPER_R1, -BACKWARDS * PAPER_R2)


def simulate_ball_joint(
    motion: str | BallMotion | Sequence[str | BallMotion] = "random",
    *,
    duration_s: float | None = None,
    transition_s: float = 1.0,
    rate_hz: float | None = None,
    time_s: ArrayLike | None = None,
    seed: int = 0,
    mount1: ArrayLike | None = None,
    mount2: ArrayLike | None = None,
    joint_in_sensor1: ArrayLike | None = None,
    joint_in_sensor2: ArrayLike | None = None,
    dof: Literal[1, 2, 3] = 3,
    soft_tissue: SoftTissue | None = None,
    tissue_matrix1: ArrayLike | None = None,
    tissue_matrix2: ArrayLike | None = None,
    collisions: Collisions | None = None,
    gyr_noise: float = 0.005,
    acc_noise: float = 0.05,
    gyr_bias1: ArrayLike = (0.0, 0.0, 0.0),
    gyr_bias2: ArrayLike = (0.0, 0.0, 0.0),
    acc_bias1: ArrayLike = (0.0, 0.0, 0.0),
    acc_bias2: ArrayLike = (0.0, 0.0, 0.0),
    gyr_sampling: Literal["instant", "interval_mean"] = "instant",
    clock_offset_s: float = 0.0,
    packet_loss: float = 0.0,
    burst_length: float = 3.0,
    gravity: float = 9.81,
) -> BallJointSimulation:
    """Simulate two IMUs on two segments that a spherical joint connects; rates and accelerations are exact at every instant.

    All motion is given as smooth functions of time with exact derivatives, so nothing is integrated or differenced: without
    disturbances the readings satisfy eqs 1-4 of Olsson & Halvorsen 2017 to rounding, at any time stamps. Several motions
    follow each other, each consistent in itself; the transition to the next, during which the segments move on unseen, is a
    gap in time. The same seed gives the same bits, and a changed setting leaves the random draws of all others alone.

    The experiment of the paper is `simulate_ball_joint(("S3", "S4", "S5", "S6", "S7"), **paper_rig())`.

    Args:
        motion: "S1" to "S8" (section IV of the paper), a kind of `BallMotion` ("random", "stationary", "held", "bend_y",
            "bend_z", "alternate", "clockwise", "counterclockwise"), a `BallMotion`, or a sequence of these; default "random".
        duration_s: length of each motion given by name, s; default the paper's 11 to 27 s for "S1" to "S8", else 50. With
            `time_s` and one motion: as long as `time_s` asks for, at least that.
        transition_s: unrecorded time between motions, s; default 1. At 0 the pose jumps from one sample to the next.
        rate_hz: sampling rate, Hz; default 100, the paper's.
        time_s: (N,) strictly increasing sampling times instead of `rate_hz`, s; the motion begins at 0, and times within a
            transition yield no sample.
        seed: non-negative integer; default 0.
        mount1, mount2: (4,) quaternion from the sensor to its segment; default random. Segment axes: x along the link from
            segment 1 towards segment 2, y and z across it.
        joint_in_sensor1, joint_in_sensor2: (3,) the joint centre as seen from the sensor, in its frame, m (-r of the paper);
            default the paper's lever arms, 0.335 and 0.326 m. See `paper_rig` and `random_positions`.
        dof: degrees of freedom; default 3. The joint turns about y, then z, then x; with 1 or 2 the turns about x, or z and
            x, are locked, so that with 1 it is a hinge and what "bend_z" means to do does not happen.
        soft_tissue: how the sensors turn against their bones; default None, rigidly mounted. It turns them about the joint
            centre, which stays where it is as seen from them: `q_12_bone` feels it, an estimate of the centre does not.
        tissue_matrix1, tissue_matrix2: (3, 3) H of eq. 29, m/rad: H times the angular acceleration, in the sensor frame, adds
            to what the accelerometer reads; default none. See `random_tissue`.
        collisions: impulses that the accelerometers feel; default None.
        gyr_noise, acc_noise: standard deviation of white noise per sample, rad/s and m/s²; defaults 0.005 and 0.05. The paper
            calls 0.003 and 0.1 typical (section V-B).
        gyr_bias1, gyr_bias2, acc_bias1, acc_bias2: (3,) constant biases, rad/s and m/s²; default none. See `random_biases`.
        gyr_sampling: "instant", the rate at the time stamp (default); "interval_mean", its mean over the interval that ends
            there, as strapdown sensors report it.
        clock_offset_s: sensor 2 samples this much later than its time stamps say, s; default 0.
        packet_loss: fraction of packets that each sensor loses, 0 to below 0.5; default 0. Only rows that both sensors keep
            remain; the others are gaps in time.
        burst_length: mean number of packets lost in a row, at least 1; default 3. Without effect where none is lost.
        gravity: m/s²; default 9.81.

    Returns:
        The recording with its truth.

    Raises:
        SettingsError: a setting out of range or in contradiction to another; the message names it.
    """
    seed = seed_number(seed)
    clock = Clock.checked(rate_hz, time_s, 100.0)
    motions = as_motions(motion, duration_s, clock.time_s, BallMotion, named_ball_motion)
    timeline = clock.timeline(motions, transition_s)
    pair = SensorPair.checked(
        seed,
        JOINT_FROM_SENSOR,
        mount1=mount1,
        mount2=mount2,
        joint_in_sensor1=joint_in_sensor1,
        joint_in_sensor2=joint_in_sensor2,
        soft_tissue=soft_tissue,
        gyr_sampling=gyr_sampling,
        clock_offset_s=clock_offset_s,
        gravity=gravity,
    )
    readout = Readout.checked(
        gyr_noise=gyr_noise,
        acc_noise=acc_noise,
        gyr_bias1=gyr_bias1,
        gyr_bias2=gyr_bias2,
        acc_bias1=acc_bias1,
        acc_bias2=acc_bias2,
        packet_loss=packet_loss,
        burst_length=burst_length,
    )
    matrices = [
        np.zeros((3, 3)) if matrix is None else matrix33(name, matrix)
        for name, matrix in (("tissue_matrix1", tissue_matrix1), ("tissue_matrix2", tissue_matrix2))
    ]
    if collisions is not None and not isinstance(collisions, Collisions):
        raise SettingsError(f"collisions must be a Collisions or None; got {type(collisions).__name__}")
    freedom = one_of("dof", dof, (1, 2, 3))

    movements = [_movement(ball_program(m, seed), freedom, pair.gravity) for m in motions]
    truth = true_rows(pair, movements, motions, timeline)
    for i, matrix in enumerate(matrices, start=1):
        truth[f"tissue_acc{i}"] = truth[f"gyr_rate{i}_true"] @ matrix.T  # eq. 29
    nothing = np.zeros((len(timeline.time_s), 3))
    blows = (nothing, nothing) if collisions is None else collisions.impulses(seed, timeline, [m.name for m in motions])
    truth |= {"collision1": blows[0], "collision2": blows[1]}
    disturbed = {f"acc{i}": _felt(truth, i) for i in (1, 2)}
    return BallJointSimulation(
        **readout.recorded(seed, timeline, motions, pair, truth, disturbed),
        dof=freedom,
        tissue_matrix1=matrices[0],
        tissue_matrix2=matrices[1],
    )


def _felt(truth: dict[str, FloatArray], i: int) -> FloatArray:
    """What the accelerometer of sensor i (1 or 2) would read without noise and bias, m/s²."""
    return truth[f"acc{i}_true"] + truth[f"tissue_acc{i}"] + truth[f"collision{i}"]


def _movement(motion: BallProgram, dof: int, gravity: float) -> Movement:
    """Both segments as turning frames; `ball_motions` says what the angles mean."""
    up = np.array([0.0, 0.0, gravity])

    def bodies(time_s: FloatArray) -> Bodies:
        pose = motion(time_s)
        free = list(zip((Y, Z, X), pose.turns, strict=True))[:dof]
        first = Turning.about(Z, pose.heading).then(Turning.about(X, pose.tilt)).then(Turning.about(Y, pose.swing))
        for axis, angle in reversed(free):
            first = first.then(Turning.about(axis, -(pose.share1 * angle)))
        second = first
        for axis, angle in free:
            second = second.then(Turning.about(axis, angle))
        bend = pose.turns[0]
        swing1 = pose.swing - pose.share1 * bend
        position = _joint_position(pose, first, second)
        angles = np.zeros((len(time_s), 3))
        for column, (_, angle) in enumerate(free):
            angles[:, column] = angle.rows[0]
        return Bodies(
            segments=(first, second),
            position=position,
            swing=(swing1, swing1 + bend),
            bend=bend,
            truth={
                "joint_angles_rad": angles,
                "joint_acc": np.stack([p.rows[2] for p in position], axis=-1) + up,
            },
        )

    return bodies


def _joint_position(pose: BallPose, first: Turning, second: Turning) -> Position:
    """The joint centre, x along link 1 from its grip and against x along link 2 from the other."""
    if pose.grip_m == 0.0:
        return pose.position
    ways = zip(pose.position, first.carried(X), second.carried(X), strict=True)
    x, y, z = (p + pose.grip_m * ((1.0 - pose.share1) * along1 - pose.share1 * along2) for p, along1, along2 in ways)
    return x, y, z
