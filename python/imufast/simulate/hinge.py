"""Simulated recordings of two segments joined by a hinge, consistent as rigid bodies, with exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of, seed_number
from .motion_base import as_motions
from .motions import Motion, named_motion, program, scenario_motions
from .pair import SensorPair
from .pose import Bodies, Movement, Program, X, Y, Z
from .record import Readout, true_rows
from .simulation import HingeSimulation
from .so3 import Turning
from .soft_tissue import SoftTissue
from .timing import Clock

__all__ = ["simulate_hinge"]

# Joint centre from either sensor in segment axes, m: much as on the published rig, the sensors 12 and 15 cm from the joint.
JOINT_FROM_SENSOR = (np.array([0.118, -0.005, -0.018]), np.array([-0.149, -0.005, -0.020]))


def simulate_hinge(
    motion: int | str | Motion | Sequence[int | str | Motion] | None = None,
    *,
    scenario: Literal[1, 2, 3, 4] | None = None,
    duration_s: float | None = None,
    transition_s: float = 1.0,
    rate_hz: float | None = None,
    time_s: ArrayLike | None = None,
    seed: int = 0,
    mount1: ArrayLike | None = None,
    mount2: ArrayLike | None = None,
    joint_in_sensor1: ArrayLike | None = None,
    joint_in_sensor2: ArrayLike | None = None,
    dof: Literal[1, 2, 3] = 1,
    extra_rad: float = 0.4,
    soft_tissue: SoftTissue | None = None,
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
) -> HingeSimulation:
    """Simulate two IMUs on two segments that a hinge joins; rates and accelerations are exact at every instant.

    All motion is given as smooth functions of time with exact derivatives, so nothing is integrated or differenced: angular
    velocities satisfy eqs 8-14 and specific forces eqs 1-7 of Olsson et al. 2020 to rounding, at any time stamps. Several
    motions follow each other as in the paper's scenarios: each is consistent in itself, and the transition to the next,
    during which the segments move on unseen, is a gap in time. The same seed gives the same bits, and a changed setting
    leaves the random draws of all others alone.

    Args:
        motion: 1 to 14 (section 7.1 of the paper), a kind of `Motion` ("mixed", "stationary", "stiff", "sequential", "planar",
            "free", "walking", "sit_to_stand"), a `Motion`, or a sequence of these; default "mixed".
        scenario: 1 to 4, the paper's sequences of motions, instead of `motion`.
        duration_s: length of each motion given by number or name, s; default 50 (Scenario 1 then has the paper's 700 s).
            With `time_s` and one motion: as long as `time_s` asks for, at least 50.
        transition_s: unrecorded time between motions, s; default 1. At 0 the pose jumps from one sample to the next.
        rate_hz: sampling rate, Hz; default 50.
        time_s: (N,) strictly increasing sampling times instead of `rate_hz`, s; the motion begins at 0, and times within a
            transition yield no sample.
        seed: non-negative integer; default 0.
        mount1, mount2: (4,) quaternion from the sensor to its segment; default random. Segment axes: x along the limb away
            from the body, y the hinge axis, z to the front.
        joint_in_sensor1, joint_in_sensor2: (3,) the joint centre as seen from the sensor, in its frame, m; default a rig's,
            12 and 15 cm away.
        dof: degrees of freedom; 2 and 3 add turns about segment 2's x and then z axis, so that the joint is no hinge.
        extra_rad: rms of each added turn while the joint moves, rad; default 0.4. Without effect on a hinge.
        soft_tissue: how the sensors move against their bones; default None, rigidly mounted.
        gyr_noise, acc_noise: standard deviation of white noise per sample, rad/s and m/s²; defaults 0.005 and 0.05: an Xsens
            MTw at rest shows 0.003 to 0.006 rad/s and 0.01 to 0.05 m/s² at 50 Hz.
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
    clock = Clock.checked(rate_hz, time_s, 50.0)
    motions = _motions(motion, scenario, duration_s, clock.time_s)
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
    freedom = one_of("dof", dof, (1, 2, 3))
    extra_rad = number("extra_rad", extra_rad, least=0.0)
    movements = [_movement(program(m, seed), freedom, extra_rad) for m in motions]
    truth = true_rows(pair, movements, motions, timeline)
    return HingeSimulation(**readout.recorded(seed, timeline, motions, pair, truth), dof=freedom)


def _motions(
    motion: int | str | Motion | Sequence[int | str | Motion] | None,
    scenario: int | None,
    duration_s: float | None,
    clock: FloatArray | None,
) -> tuple[Motion, ...]:
    if scenario is not None:
        if motion is not None:
            raise SettingsError("motion and scenario exclude each other; give one of them")
        return scenario_motions(scenario, 50.0 if duration_s is None else duration_s)
    return as_motions("mixed" if motion is None else motion, duration_s, clock, Motion, named_motion)


def _movement(motion: Program, dof: int, extra_rad: float) -> Movement:
    """Both segments as turning frames; `motions` says what the angles mean."""

    def bodies(time_s: FloatArray) -> Bodies:
        pose = motion(time_s)
        first = Turning.about(Z, pose.heading).then(Turning.about(X, pose.tilt)).then(Turning.about(Y, pose.swing))
        second = first.then(Turning.about(Y, pose.hinge))
        for axis, angle in ((X, pose.second), (Z, pose.third))[: dof - 1]:
            second = second.then(Turning.about(axis, extra_rad * angle))
        return Bodies(
            segments=(first, second),
            position=pose.position,
            swing=(pose.swing, pose.swing + pose.hinge),
            bend=pose.hinge,
            truth={"angle_rad": pose.hinge.rows[0], "angle_rate": pose.hinge.rows[1]},
        )

    return bodies
