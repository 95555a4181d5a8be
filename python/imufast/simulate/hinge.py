"""Simulated recordings of two segments joined by a hinge, consistent as rigid bodies, with exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from imufast.errors import SettingsError

from .checks import FloatArray, number, one_of, quaternion, seed_number, times, vector3
from .motions import Motion, as_motions, program, scenario_motions
from .pose import Pose, Program
from .sensors import noisy, specific_force
from .signals import Signal, stream
from .simulation import HingeSimulation
from .so3 import Turning, conjugate, multiply, random_quaternion, rotate_back
from .soft_tissue import SoftTissue
from .timing import Part, arrived, interval_before, schedule

__all__ = ["simulate_hinge"]

X, Y, Z = np.eye(3)
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
    if time_s is not None and rate_hz is not None:
        raise SettingsError("rate_hz and time_s exclude each other; give one of them")
    rate = number("rate_hz", 50.0 if rate_hz is None else rate_hz, above=0.0)
    clock = None if time_s is None else times("time_s", time_s)
    motions = _motions(motion, scenario, duration_s, clock)
    parts = schedule([m.recorded_s for m in motions], number("transition_s", transition_s, least=0.0), rate, clock)
    if sum(len(part.time_s) for part in parts) < 2:
        raise SettingsError("duration_s, rate_hz or time_s leave fewer than 2 samples")

    mounts = [
        random_quaternion(stream(seed, name)) if mount is None else quaternion(name, mount)
        for name, mount in (("mount1", mount1), ("mount2", mount2))
    ]
    joints = [
        rotate_back(q, standard) if joint is None else vector3(name, joint)
        for name, joint, q, standard in zip(
            ("joint_in_sensor1", "joint_in_sensor2"),
            (joint_in_sensor1, joint_in_sensor2),
            mounts,
            JOINT_FROM_SENSOR,
            strict=True,
        )
    ]
    if soft_tissue is not None and not isinstance(soft_tissue, SoftTissue):
        raise SettingsError(f"soft_tissue must be a SoftTissue or None; got {type(soft_tissue).__name__}")
    biases = {
        name: vector3(name, value)
        for name, value in (
            ("gyr_bias1", gyr_bias1),
            ("gyr_bias2", gyr_bias2),
            ("acc_bias1", acc_bias1),
            ("acc_bias2", acc_bias2),
        )
    }
    noise = {"gyr": number("gyr_noise", gyr_noise, least=0.0), "acc": number("acc_noise", acc_noise, least=0.0)}
    model = _Model(
        dof=one_of("dof", dof, (1, 2, 3)),
        extra_rad=number("extra_rad", extra_rad, least=0.0),
        soft_tissue=soft_tissue,
        phases=(stream(seed, "wobble1").uniform(-np.pi, np.pi), stream(seed, "wobble2").uniform(-np.pi, np.pi)),
        mounts=(mounts[0], mounts[1]),
        joints=(joints[0], joints[1]),
        mean_rate=one_of("gyr_sampling", gyr_sampling, ("instant", "interval_mean")) == "interval_mean",
        clock_offset_s=number("clock_offset_s", clock_offset_s),
        gravity=number("gravity", gravity, least=0.0),
    )
    loss = number("packet_loss", packet_loss, least=0.0, below=0.5)
    burst = number("burst_length", burst_length, least=1.0)

    pieces = [model.part(program(m, seed), part, m.start_s) for m, part in zip(motions, parts, strict=True) if len(part.time_s)]
    truth = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    stamps = np.concatenate([part.time_s for part in parts])
    counts = [len(part.time_s) for part in parts]
    # Noise falls on all rows before packets are lost, so that loss takes rows away and changes nothing else.
    measured = {
        f"{kind}{i}": noisy(truth[f"{kind}{i}_true"], biases[f"{kind}_bias{i}"], noise[kind], stream(seed, f"{kind} noise {i}"))
        for kind in ("gyr", "acc")
        for i in (1, 2)
    }
    kept = np.flatnonzero(
        arrived(stream(seed, "packets1"), len(stamps), loss, burst)
        & arrived(stream(seed, "packets2"), len(stamps), loss, burst)
    )
    if len(kept) < 2:
        raise SettingsError("packet_loss leaves fewer than 2 samples")
    whole_grid = clock is None and len(kept) == len(stamps) and bool((np.diff(np.round(stamps * rate)) == 1.0).all())
    return HingeSimulation(
        time_s=stamps[kept],
        rate_hz=rate if whole_grid else None,
        **{name: values[kept] for name, values in (measured | truth).items()},
        motion=np.repeat([m.name for m in motions], counts)[kept],
        part=np.repeat(np.arange(len(motions), dtype=np.int64), counts)[kept],
        row=kept,
        axis1=rotate_back(mounts[0], Y),
        axis2=rotate_back(mounts[1], Y),
        joint_in_sensor1=joints[0],
        joint_in_sensor2=joints[1],
        **biases,
        clock_offset_s=model.clock_offset_s,
        dof=model.dof,
    )


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
    motion = "mixed" if motion is None else motion
    single = isinstance(motion, (str, Motion)) or not isinstance(motion, Sequence)
    if clock is not None and duration_s is None and single and not isinstance(motion, Motion):
        duration_s = max(50.0, float(np.nextafter(clock[-1], np.inf)))
    return as_motions(motion, duration_s)


@dataclass(frozen=True, eq=False)
class _Model:
    """From a pose to what two sensors would read without noise; pairs are (sensor 1, sensor 2)."""

    dof: int
    extra_rad: float
    soft_tissue: SoftTissue | None
    phases: tuple[float, float]
    mounts: tuple[FloatArray, FloatArray]
    joints: tuple[FloatArray, FloatArray]
    mean_rate: bool
    clock_offset_s: float
    gravity: float

    def part(self, motion: Program, part: Part, start_s: float) -> dict[str, FloatArray]:
        """Truth of one stretch; see `HingeSimulation` for the names."""
        time_s = start_s + part.since_start_s
        pose = motion(time_s)
        bones = self._bones(pose)
        now = [self._sensor(i, bones[i], time_s, pose) for i in (0, 1)]
        rigid = [bones[i].mounted(self.mounts[i]) for i in (0, 1)]
        truth = {
            "q_1": now[0].q,
            "q_2": now[1].q,
            "q_12": multiply(conjugate(now[0].q), now[1].q),
            "q_12_bone": multiply(conjugate(rigid[0].q), rigid[1].q),
            "angle_rad": pose.hinge.rows[0],
            "angle_rate": pose.hinge.rows[1],
            "joint_position": np.stack([p.rows[0] for p in pose.position], axis=-1),
        }
        for i, late in ((0, 0.0), (1, self.clock_offset_s)):
            read_at = time_s + late
            pose_then = pose if late == 0.0 else motion(read_at)
            sensor = now[i] if late == 0.0 else self._sensor(i, self._bones(pose_then)[i], read_at, pose_then)
            joint_acc = np.stack([p.rows[2] for p in pose_then.position], axis=-1)
            truth[f"gyr{i + 1}_true"] = self._mean_rate(motion, i, read_at) if self.mean_rate else sensor.gyr
            truth[f"acc{i + 1}_true"] = specific_force(sensor, joint_acc, -self.joints[i], self.gravity)
            truth[f"gyr_rate{i + 1}_true"] = sensor.gyr_rate
        return truth

    def _bones(self, pose: Pose) -> tuple[Turning, Turning]:
        first = Turning.about(Z, pose.heading).then(Turning.about(X, pose.tilt)).then(Turning.about(Y, pose.swing))
        second = first.then(Turning.about(Y, pose.hinge))
        for axis, angle in ((X, pose.second), (Z, pose.third))[: self.dof - 1]:
            second = second.then(Turning.about(axis, self.extra_rad * angle))
        return first, second

    def _sensor(self, i: int, bone: Turning, time_s: FloatArray, pose: Pose) -> Turning:
        if self.soft_tissue is not None:
            swing: Signal = pose.swing if i == 0 else pose.swing + pose.hinge
            bone = bone.then(self.soft_tissue.shell(i + 1, time_s, swing, pose.hinge, self.phases[i]))
        return bone.mounted(self.mounts[i])

    def _mean_rate(self, motion: Program, i: int, time_s: FloatArray) -> FloatArray:
        """Mean of each component of the rate over the interval before each sample: Gauss-Legendre, exact to rounding here."""
        before = interval_before(time_s)
        total = np.zeros((len(time_s), 3))
        for node, weight in zip(*np.polynomial.legendre.leggauss(6), strict=True):
            at = time_s - before * 0.5 * (1.0 - node)
            pose = motion(at)
            total += 0.5 * weight * self._sensor(i, self._bones(pose)[i], at, pose).gyr
        return total
