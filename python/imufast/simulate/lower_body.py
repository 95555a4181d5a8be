"""Simulated recordings of seven sensors on pelvis and legs, consistent as rigid bodies, with exact truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast.errors import SettingsError
from imufast.imu import Imu, Recording
from imufast.quaternion import continuous, from_matrix, matrix

from .body_gait import sit_to_stand, walking
from .body_motions import BodyMotion, Program, exercises, named_body_motion
from .body_tissue import LegTissue
from .body_tree import JOINTS, SEGMENTS, SIDES, Anatomy, Tree, random_anatomy
from .checks import FloatArray, number, quaternion, seed_number, vector3
from .jets import Jet
from .motion_base import as_motions
from .sensors import noisy
from .signals import stream
from .so3 import random_direction, rotate_back, turned_by
from .timing import Clock, arrived

__all__ = ["LowerBodySimulation", "simulate_lower_body"]

# Where a sensor usually sits, in segment axes from the segment's origin, m; x outwards on the legs.
PLACES = {
    "pelvis": np.array([0.0, -0.12, 0.10]),
    "thigh": np.array([0.08, 0.02, -0.22]),
    "shank": np.array([0.05, 0.02, -0.14]),
    "foot": np.array([0.0, 0.08, 0.02]),
}
SPREAD = np.array([0.015, 0.015, 0.022])
"""How far it is from there, standard deviation, m."""


@dataclass(frozen=True, eq=False)
class LowerBodySimulation:
    """A simulated recording of a lower body, with its exact truth. Segments are "pelvis", "thigh_right", "shank_right",
    "foot_right", "thigh_left" ..., joints "hip_right", "knee_right", "ankle_right", "hip_left" ...

    Quaternions are (N, 4), Hamilton, scalar first, from the sensor or segment to the global frame, which has z up. Segment
    axes: x to the right, y forward, z towards the body (McGrath & Stirling 2020).

    Attributes:
        time_s: (N,) time stamps, s.
        rate_hz: the rate, where all samples lie on an unbroken regular grid; else None.
        gyr, acc: segment to (N, 3), what its sensor reads, rad/s and m/s².
        gyr_true, acc_true: the same without noise and bias.
        q: segment to the orientation of its sensor; q_segment: of the segment itself.
        sensor_position, sensor_velocity: segment to (N, 3), m and m/s, global.
        joint_position: joint to (N, 3), m, global.
        joint_in_sensor: (segment, joint) to (3,), the joint's centre as seen from the sensor of the straight standing leg, m.
        knee_axis: thighs and shanks to (3,), the knee's axis in sensor frames, pointing to the right.
        mounts: segment to (4,), from the sensor to its segment.
        knee_angles_deg, hip_angles_deg, ankle_angles_deg: side to (N, 3): flexion (ankle: dorsiflexion), adduction, internal
            rotation of the distal segment, ISB (Grood & Suntay 1983), positive on both sides.
        lengths_m: "femur_right", "tibia_right", ..., "hips", m.
        contact: side to (N,), whether that foot stands still.
        gyr_bias, acc_bias: segment to (3,), rad/s and m/s².
        anatomy: the subject.
        motion: (N,) name of the motion at each sample; part: (N,) which of them, from 0 on.
        row: (N,) the row that each sample would have had, had no packet been lost.
    """

    time_s: FloatArray
    rate_hz: float | None
    gyr: dict[str, FloatArray]
    acc: dict[str, FloatArray]
    gyr_true: dict[str, FloatArray]
    acc_true: dict[str, FloatArray]
    q: dict[str, FloatArray]
    q_segment: dict[str, FloatArray]
    sensor_position: dict[str, FloatArray]
    sensor_velocity: dict[str, FloatArray]
    joint_position: dict[str, FloatArray]
    joint_in_sensor: dict[tuple[str, str], FloatArray]
    knee_axis: dict[str, FloatArray]
    mounts: dict[str, FloatArray]
    knee_angles_deg: dict[str, FloatArray]
    hip_angles_deg: dict[str, FloatArray]
    ankle_angles_deg: dict[str, FloatArray]
    lengths_m: dict[str, float]
    contact: dict[str, NDArray[np.bool_]]
    gyr_bias: dict[str, FloatArray]
    acc_bias: dict[str, FloatArray]
    anatomy: Anatomy
    motion: NDArray[np.str_]
    part: NDArray[np.int64]
    row: NDArray[np.int64]

    @cached_property
    def recording(self) -> Recording:
        """All sensors, named as their segments, on one time base."""
        base: dict[str, Any] = {"time_s": self.time_s} if self.rate_hz is None else {"rate_hz": self.rate_hz}
        return Recording({name: Imu(self.gyr[name], self.acc[name], name=name, **base) for name in self.gyr})

    @property
    def placement(self) -> dict[str, str]:
        """Segment to the name of its sensor, as `estimate_lower_body` takes it."""
        return {name: name for name in self.gyr}


def simulate_lower_body(
    motion: str | BodyMotion | Sequence[str | BodyMotion] = "profile",
    *,
    duration_s: float | None = None,
    transition_s: float = 1.0,
    rate_hz: float | None = None,
    time_s: ArrayLike | None = None,
    seed: int = 0,
    anatomy: Anatomy | None = None,
    mounts: Mapping[str, ArrayLike] | None = None,
    mount_deg: float = 180.0,
    places: Mapping[str, ArrayLike] | None = None,
    soft_tissue: LegTissue | None = None,
    gyr_noise: float = 0.003,
    acc_noise: float = 0.03,
    gyr_bias: Mapping[str, ArrayLike] | float = 0.0,
    acc_bias: Mapping[str, ArrayLike] | float = 0.0,
    packet_loss: float = 0.0,
    burst_length: float = 3.0,
    gravity: float = 9.81,
) -> LowerBodySimulation:
    """Simulate seven IMUs on pelvis, thighs, shanks and feet; rates and accelerations are exact at every instant.

    Hips and ankles are balls, knees hinges whose axis stands oblique to the bones (Table 1 of McGrath & Stirling 2020). All
    motion is given as smooth functions of time with exact derivatives. Feet on the ground do not move in walking and
    sit-to-stand; in the profile the ankle of the standing leg does not. Several motions follow each other with gaps in time
    between them, during which the subject moves on unseen. The same seed gives the same bits, and a changed setting leaves the
    random draws of all others alone.

    Args:
        motion: a kind of `BodyMotion` ("profile", "ankles_and_knees", "seated", "walking", "sit_to_stand", "standing"), a
            `BodyMotion`, or a sequence of these; default "profile".
        duration_s: length of each motion given by name, s; default 60. With `time_s` and one motion: as long as that asks for.
        transition_s: unrecorded time between motions, s; default 1. At 0 the pose jumps from one sample to the next.
        rate_hz: sampling rate, Hz; default 100.
        time_s: (N,) strictly increasing sampling times instead of `rate_hz`, s; the motion begins at 0.
        seed: non-negative integer; default 0.
        anatomy: the subject; default drawn, `random_anatomy(seed)`.
        mounts: segment to (4,) quaternion from its sensor to the segment; those not given are drawn.
        mount_deg: how far a drawn mount is turned against the segment at most, degrees: by 0 to that much about any axis;
            default 180.
        places: segment to (3,) place of its sensor in segment axes, from the joint nearer to the pelvis (pelvis: from midway
            between the hips), m; those not given are drawn around the usual ones.
        soft_tissue: how the sensors move against the bones; default None, rigidly mounted.
        gyr_noise, acc_noise: standard deviation of white noise per sample, rad/s and m/s²; defaults 0.003 and 0.03.
        gyr_bias, acc_bias: segment to (3,), or one size in random directions, rad/s and m/s²; default 0.
        packet_loss: fraction of packets that each sensor loses, 0 to below 0.5; default 0. Only rows that all sensors keep
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
    motions = as_motions(motion, duration_s, clock.time_s, BodyMotion, named_body_motion)
    timeline = clock.timeline(motions, transition_s)
    if anatomy is None:
        anatomy = random_anatomy(seed)
    elif not isinstance(anatomy, Anatomy):
        raise SettingsError(f"anatomy must be an Anatomy or None; got {type(anatomy).__name__}")
    if soft_tissue is not None and not isinstance(soft_tissue, LegTissue):
        raise SettingsError(f"soft_tissue must be a LegTissue or None; got {type(soft_tissue).__name__}")
    worn = _Worn(
        anatomy=anatomy,
        mounts=_mounts(mounts, number("mount_deg", mount_deg, least=0.0), seed),
        places=_places(places, seed),
        soft_tissue=soft_tissue,
        seed=seed,
        gravity=number("gravity", gravity, least=0.0),
    )
    biases = {kind: _biases(kind, given, seed) for kind, given in (("gyr_bias", gyr_bias), ("acc_bias", acc_bias))}
    noise = {"gyr": number("gyr_noise", gyr_noise, least=0.0), "acc": number("acc_noise", acc_noise, least=0.0)}
    loss = number("packet_loss", packet_loss, least=0.0, below=0.5)
    burst = number("burst_length", burst_length, least=1.0)

    pieces = [
        worn.truth(_program(m, seed, anatomy)(m.start_s + part.since_start_s), m.start_s + part.since_start_s)
        for m, part in zip(motions, timeline.parts, strict=True)
        if len(part.time_s)
    ]
    truth: dict[str, dict[str, FloatArray]] = {
        name: {key: np.concatenate([piece[name][key] for piece in pieces]) for key in pieces[0][name]} for name in pieces[0]
    }
    # Noise falls on all rows before packets are lost, so that loss takes rows away and changes nothing else.
    for kind in ("gyr", "acc"):
        truth[kind] = {
            segment: noisy(
                truth[f"{kind}_true"][segment],
                biases[f"{kind}_bias"][segment],
                noise[kind],
                stream(seed, f"{kind} noise {segment}"),
            )
            for segment in SEGMENTS
        }
    stamps = timeline.time_s
    here = np.ones(len(stamps), dtype=np.bool_)
    for segment in SEGMENTS:
        here &= arrived(stream(seed, f"packets {segment}"), len(stamps), loss, burst)
    kept = np.flatnonzero(here)
    if len(kept) < 2:
        raise SettingsError("packet_loss leaves fewer than 2 samples")
    fields: dict[str, Any] = {name: {key: value[kept] for key, value in of.items()} for name, of in truth.items()}
    fields["contact"] = {side: still > 0.5 for side, still in fields["contact"].items()}
    fields |= worn.constants() | biases
    return LowerBodySimulation(
        time_s=stamps[kept],
        rate_hz=timeline.rate_hz if timeline.unbroken and len(kept) == len(stamps) else None,
        **fields,
        anatomy=anatomy,
        motion=np.repeat([m.name for m in motions], timeline.counts)[kept],
        part=np.repeat(np.arange(len(motions), dtype=np.int64), timeline.counts)[kept],
        row=kept,
    )


def _program(motion: BodyMotion, seed: int, anatomy: Anatomy) -> Program:
    """The motion as functions of the time since it began; all random draws are made here."""

    def rng(channel: str) -> np.random.Generator:
        return stream(seed, "body motion", motion.name, motion.take, channel)

    made = {"walking": walking, "sit_to_stand": sit_to_stand}.get(motion.kind, exercises)
    return made(motion, rng, anatomy)


@dataclass(frozen=True, eq=False)
class _Worn:
    """A subject with sensors on."""

    anatomy: Anatomy
    mounts: dict[str, FloatArray]
    places: dict[str, FloatArray]
    soft_tissue: LegTissue | None
    seed: int
    gravity: float

    def truth(self, tree: Tree, time_s: FloatArray) -> dict[str, dict[str, FloatArray]]:
        """Truth of one stretch under the names of `LowerBodySimulation`."""
        names = ("gyr_true", "acc_true", "q", "q_segment", "sensor_position", "sensor_velocity", "joint_position")
        found: dict[str, dict[str, FloatArray]] = {name: {} for name in names}
        up = np.array([0.0, 0.0, self.gravity])
        for segment in SEGMENTS:
            bone, at = tree.turned[segment], Jet.constant(self.places[segment], len(time_s))
            shell = bone
            if self.soft_tissue is not None and segment in self.soft_tissue.segments:
                turn, shift = self.soft_tissue.moved(segment, self.seed, tree, time_s)
                shell, at = bone @ turn, at + shift
            sensor = shell @ Jet.constant(matrix(self.mounts[segment]), len(time_s))
            position = tree.origin[segment] + bone @ at
            spin = (sensor.transposed() @ sensor.derivative()).value
            found["gyr_true"][segment] = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
            found["acc_true"][segment] = np.einsum("nji,nj->ni", sensor.value, position.rows[2] + up)
            found["q"][segment], found["q_segment"][segment] = (
                continuous(from_matrix(turned.value)) for turned in (sensor, bone)
            )
            found["sensor_position"][segment], found["sensor_velocity"][segment] = position.rows[0], position.rows[1]
        for joint, (_, lower) in JOINTS.items():
            found["joint_position"][joint] = tree.origin[lower].value
        for kind in ("hip", "knee", "ankle"):
            found[f"{kind}_angles_deg"] = {
                side: _angles_deg(side, kind, *(tree.turned[s].value for s in JOINTS[f"{kind}_{side}"])) for side in SIDES
            }
        found["contact"] = {side: self._still(tree, side) for side in SIDES}
        return found

    def _still(self, tree: Tree, side: str) -> FloatArray:
        foot, at = tree.turned[f"foot_{side}"], tree.origin[f"foot_{side}"]
        moving = np.abs(at.rows[1]).max(axis=1) + np.abs(foot.rows[1]).max(axis=(1, 2))
        return np.asarray(moving < 1e-9, dtype=np.float64)

    def constants(self) -> dict[str, Any]:
        """What does not change, likewise."""
        joints = {
            (segment, joint): rotate_back(
                self.mounts[segment], self.anatomy.joint_in_segment(segment, joint) - self.places[segment]
            )
            for joint, segments in JOINTS.items()
            for segment in segments
        }
        axes = {
            segment: rotate_back(self.mounts[segment], self.anatomy.knee_axis(segment))
            for side in SIDES
            for segment in (f"thigh_{side}", f"shank_{side}")
        }
        lengths = {"hips": self.anatomy.hip_distance_m}
        for k, side in enumerate(SIDES):
            lengths |= {f"femur_{side}": self.anatomy.femur_m[k], f"tibia_{side}": self.anatomy.tibia_m[k]}
        return {"joint_in_sensor": joints, "knee_axis": axes, "mounts": self.mounts, "lengths_m": lengths}


def _named(name: str, given: object) -> Mapping[str, Any]:
    """A mapping from segments, checked."""
    if not isinstance(given, Mapping):
        raise SettingsError(f"{name} must map segments to values; got {type(given).__name__}")
    unknown = [key for key in given if key not in SEGMENTS]
    if unknown:
        raise SettingsError(f"{name} names no segment: {unknown[0]!r}; segments are {', '.join(SEGMENTS)}")
    return given


def _mounts(given: Mapping[str, ArrayLike] | None, most_deg: float, seed: int) -> dict[str, FloatArray]:
    known = _named("mounts", {} if given is None else given)
    mounts = {}
    for segment in SEGMENTS:
        rng = stream(seed, f"mount {segment}")
        drawn = turned_by(random_direction(rng), np.radians(most_deg) * rng.random())
        mounts[segment] = quaternion(f"mounts[{segment!r}]", known[segment]) if segment in known else drawn
    return mounts


def _places(given: Mapping[str, ArrayLike] | None, seed: int) -> dict[str, FloatArray]:
    known = _named("places", {} if given is None else given)
    places = {}
    for segment in SEGMENTS:
        usual = PLACES[segment.split("_")[0]] * ([-1.0, 1.0, 1.0] if segment.endswith("left") else [1.0, 1.0, 1.0])
        drawn = usual + SPREAD * np.clip(stream(seed, f"place {segment}").standard_normal(3), -2.0, 2.0)
        places[segment] = vector3(f"places[{segment!r}]", known[segment]) if segment in known else drawn
    return places


def _biases(kind: str, given: Mapping[str, ArrayLike] | float, seed: int) -> dict[str, FloatArray]:
    if isinstance(given, Mapping):
        known = _named(kind, given)
        return {s: vector3(f"{kind}[{s!r}]", known[s]) if s in known else np.zeros(3) for s in SEGMENTS}
    size = number(kind, given, least=0.0)
    return {segment: size * random_direction(stream(seed, f"{kind} {segment}")) for segment in SEGMENTS}


def _angles_deg(side: str, kind: str, upper: FloatArray, lower: FloatArray) -> FloatArray:
    """(N, 3) flexion, adduction and internal rotation: turns about x (right), y (forward) and z (up) one after the other."""
    r = np.einsum("nji,njk->nik", upper, lower)
    about_x = np.arctan2(-r[:, 1, 2], r[:, 2, 2])
    about_y = np.arcsin(np.clip(r[:, 0, 2], -1.0, 1.0))
    about_z = np.arctan2(-r[:, 0, 1], r[:, 0, 0])
    mirror = 1.0 if side == "right" else -1.0
    bend = -1.0 if kind == "knee" else 1.0
    return np.asarray(np.degrees(np.stack([bend * about_x, mirror * about_y, mirror * about_z], axis=-1)))
