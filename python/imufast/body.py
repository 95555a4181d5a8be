"""The lower body from up to seven IMUs: `estimate_lower_body`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body_frames import angle_std_deg, angles_deg, frame
from imufast.body_settings import Anthropometry, LowerBodySettings
from imufast.body_start import JointStart, joint_start, upright
from imufast.errors import InputError, SettingsError
from imufast.imu import Recording
from imufast.quaternion import from_matrix, matrix, multiply
from imufast.samples import ReadOnly

__all__ = ["SEGMENTS", "BodyJoint", "BodyStatus", "LowerBody", "estimate_lower_body"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

SIDES = ("right", "left")
SEGMENTS = ("pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left", "shank_left", "foot_left")
JOINTS = {
    "hip_right": ("pelvis", "thigh_right"),
    "knee_right": ("thigh_right", "shank_right"),
    "ankle_right": ("shank_right", "foot_right"),
    "hip_left": ("pelvis", "thigh_left"),
    "knee_left": ("thigh_left", "shank_left"),
    "ankle_left": ("shank_left", "foot_left"),
}
GRAVITY = 9.80665
LIMITS_M = {"femur": (0.326, 0.480), "tibia": (0.344, 0.479), "hips": (0.0, 0.409)}
UNSEEN_DEG = 10.0
"""A joint whose relative heading is less certain than this for most of the time is undetermined, degrees."""
OPEN_M = 0.03
"""Likewise a joint centre of which a direction is less certain than this, m."""
UNLIKELY = 5.0
"""A length that is so many of its usual standard deviations off contradicts what was expected."""
GAUGE_STD = 1e-3


class BodyStatus(str, Enum):
    """What became of the search."""

    CONVERGED = "CONVERGED"
    """Found; what the motion left open, `joints` say one by one."""
    STALLED = "STALLED"
    """No step lowered the cost although one was promised; take the numbers with care."""
    MAX_ITERATIONS = "MAX_ITERATIONS"
    """The iterations ran out before the minimum."""
    NOT_OBSERVABLE = "NOT_OBSERVABLE"
    """The motion determines no joint."""
    NUMERICAL_ERROR = "NUMERICAL_ERROR"
    """The numbers overflow; are they in the right unit?"""

    def __str__(self) -> str:
        return self.value


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


@dataclass(frozen=True, eq=False)
class LowerBody:
    """Pelvis and legs over a recording, at K moments about ten times a second. Segments and joints are those of the placement:
    "pelvis", "thigh_right" ..., "hip_right", "knee_left" ...

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
        joints: joint to what was found of it.
        knee_axis: thighs and shanks to (3,), the knee's axis in sensor frames, pointing to the right.
        lengths_m: "femur_right", "tibia_left", "hips" ... to (length, standard deviation), m.
        cost: minus the logarithm of the posterior, up to a constant.
        iterations: linear systems solved.
        history: (T, 5) of these: cost before, after, promised fall, damping, whether taken.
        placement, anthropometry, settings: what it was made with.
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
    joints: dict[str, BodyJoint] = field(repr=False)
    knee_axis: dict[str, Array]
    lengths_m: dict[str, tuple[float, float]]
    cost: float
    iterations: int
    history: Array = field(repr=False)
    placement: dict[str, str] = field(repr=False)
    anthropometry: Anthropometry = field(repr=False)
    settings: LowerBodySettings = field(repr=False)


Progress = Callable[[int, float, float, float], object]


def estimate_lower_body(
    recording: Recording,
    placement: Mapping[str, str],
    anthropometry: Anthropometry | None = None,
    *,
    settings: LowerBodySettings | None = None,
    progress: Progress | None = None,
) -> LowerBody:
    """Estimate pelvis and legs from IMUs strapped on anyhow: no magnetometer, no calibration pose (McGrath & Stirling 2020).

    Each joint is first calibrated and tracked by its two sensors alone; from there one maximum a posteriori search over all
    sensors, joints and the body's measures (eqs 4-18).

    Not finished: on a real walking person the search has not converged yet, and stated standard deviations are too small where
    soft tissue moves (`why` and `joints` name contradictions); swapped or dead sensors are not found out.

    Args:
        recording: all sensors on one time base.
        placement: segment to sensor name; segments are "pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left" ...
            Missing feet, a missing leg or a missing pelvis with a single leg make a smaller model.
        anthropometry: lengths and angles of the subject; default the population's.
        settings: default `LowerBodySettings()`.
        progress: called with (iteration, cost, fall that the step promised, damping) after each iteration; may raise to stop.

    Returns:
        LowerBody. What the motion leaves open is said joint by joint, not raised.

    Raises:
        InputError: not a recording; a placement that names no segment or sensor, uses a sensor twice, or leaves segments
            unconnected; less than 5 s.
        SettingsError: not an Anthropometry or LowerBodySettings.
    """
    sensors = _placed(recording, placement)
    if anthropometry is not None and not isinstance(anthropometry, Anthropometry):
        raise SettingsError(f"anthropometry must be an Anthropometry or None, got {type(anthropometry).__name__}")
    if settings is not None and not isinstance(settings, LowerBodySettings):
        raise SettingsError(f"settings must be a LowerBodySettings or None, got {type(settings).__name__}")
    if recording.time_s[-1] - recording.time_s[0] < 5.0:
        raise InputError(f"recording lasts {recording.time_s[-1] - recording.time_s[0]:.3g} s; give at least 5 s of motion")
    body = _Body(recording, sensors, anthropometry or Anthropometry(), settings or LowerBodySettings())
    return body.estimate(progress)


def _placed(recording: object, placement: object) -> dict[str, str]:
    """Segment to sensor name in the order of `SEGMENTS`, checked."""
    if not isinstance(recording, Recording):
        raise InputError(f"recording must be a Recording, got {type(recording).__name__}; imufast.read(...) makes one")
    if not isinstance(placement, Mapping):
        raise InputError(f"placement must map segments to sensor names, got {type(placement).__name__}")
    for segment, name in placement.items():
        if segment not in SEGMENTS:
            raise InputError(f"placement names no segment: {segment!r}; segments are {', '.join(SEGMENTS)}")
        if name not in recording:
            raise InputError(f"placement[{segment!r}] names no sensor: {name!r}; there are {', '.join(map(repr, recording))}")
    placed = {segment: placement[segment] for segment in SEGMENTS if segment in placement}
    names = list(placed.values())
    for name in names:
        if names.count(name) > 1:
            twice = [segment for segment in placed if placed[segment] == name]
            raise InputError(f"placement uses sensor {name!r} for {' and '.join(twice)}; each segment needs its own")
    lower = {b for a, b in JOINTS.values() if a in placed and b in placed}
    roots = [segment for segment in placed if segment not in lower]
    if len(placed) < 2:
        raise InputError("placement must have two segments that share a joint at least")
    if len(roots) > 1:
        raise InputError(
            f"placement leaves {' and '.join(roots)} unconnected: segments between them have no sensor; "
            "estimate each part alone"
        )
    return placed


class _Body:
    """A placement on its way to an estimate."""

    def __init__(
        self, recording: Recording, placed: dict[str, str], anthropometry: Anthropometry, settings: LowerBodySettings
    ) -> None:
        self.recording, self.placed = recording, placed
        self.anthropometry, self.settings = anthropometry, settings
        self.segments = list(placed)
        self.imus = [recording[name] for name in placed.values()]
        index = {segment: k for k, segment in enumerate(self.segments)}
        self.joints = {name: (index[a], index[b]) for name, (a, b) in JOINTS.items() if a in index and b in index}
        self.names = list(self.joints)
        self.starts = {
            name: joint_start(self.imus[a], self.imus[b], name.startswith("knee")) for name, (a, b) in self.joints.items()
        }

    # ---------------------------------------------------------------- model

    def seen(self, joint: str, segment: str) -> tuple[int, int] | None:
        """Joint and side, as the core counts them; None where the joint or the segment is not in the model."""
        if joint not in self.joints:
            return None
        return self.names.index(joint), JOINTS[joint].index(segment)

    def bones(self) -> dict[str, tuple[tuple[int, int], tuple[int, int]]]:
        """Bone to both its ends, nearer to the pelvis (of the hips: the right one) first."""
        found = {}
        for side in SIDES:
            for bone, segment, upper, lower in (("femur", "thigh", "hip", "knee"), ("tibia", "shank", "knee", "ankle")):
                ends = [self.seen(f"{joint}_{side}", f"{segment}_{side}") for joint in (upper, lower)]
                if ends[0] is not None and ends[1] is not None:
                    found[f"{bone}_{side}"] = (ends[0], ends[1])
        hips = [self.seen(f"hip_{side}", "pelvis") for side in SIDES]
        if hips[0] is not None and hips[1] is not None:
            found["hips"] = (hips[0], hips[1])
        return found

    def problem(self, biases: Array) -> _core.BodyProblem:
        s, a = self.settings, self.anthropometry
        center_std = {"hip": s.hip_std_m, "knee": s.knee_std_m, "ankle": s.ankle_std_m}
        axes_std = None if s.axes_std_deg is None else float(np.radians(s.axes_std_deg))
        joints = []
        for name, (upper, lower) in self.joints.items():
            kind = name.split("_")[0]
            hinge = kind == "knee"
            joints.append((upper, lower, [center_std[kind]] * 3, s.hinge_std if hinge else None, axes_std if hinge else None))
        bones, angles, order = [], [], []
        lengths = {"femur": a.femur_m, "tibia": a.tibia_m, "hips": a.hips_m}
        for name, (upper_end, lower_end) in self.bones().items():
            kind, _, side = name.partition("_")
            bones.append((upper_end, lower_end, lengths[kind], LIMITS_M[kind] if a.limits else None))
            order.append(name)
            if side:
                mean, std = a.femur_axis_deg if kind == "femur" else a.tibia_axis_deg
                mean = mean if side == "right" else 180.0 - mean
                knee = (self.names.index(f"knee_{side}"), 0 if kind == "femur" else 1)
                angles.append((knee, len(bones) - 1, float(np.radians(mean)), float(np.radians(std))))
        differences = [
            (order.index(f"{bone}_right"), order.index(f"{bone}_left"), std)
            for bone, std in (("femur", a.femur_difference_m), ("tibia", a.tibia_difference_m))
            if f"{bone}_right" in order and f"{bone}_left" in order
        ]
        rate_hz = self.recording.rate_hz
        noise = [s.gyr_noise, s.acc_noise, 1e-4, s.gyr_walk, s.acc_walk, s.gyr_noise * np.sqrt(rate_hz)]
        noise += [s.gyr_bias_std, s.acc_bias_std, s.center_std_m, GAUGE_STD, s.tail]
        key_samples = max(round(s.key_step_s * rate_hz), 1)
        return _core.BodyProblem(
            np.ascontiguousarray(self.recording.time_s),
            np.stack([imu.gyr for imu in self.imus]),
            np.stack([imu.acc for imu in self.imus]),
            rate_hz,
            False,
            (key_samples, max(key_samples // 5, 1), s.bridge_s),
            biases,
            joints,
            bones,
            angles,
            differences,
            noise,
            GRAVITY,
        )

    # ---------------------------------------------------------------- start

    def biases(self) -> Array:
        """(S, 2, 3) gyroscope and accelerometer biases: the mean of what the joints of a sensor say."""
        total, count = np.zeros((len(self.imus), 2, 3)), np.zeros((len(self.imus), 1, 1))
        for name, pair in self.joints.items():
            for side, sensor in enumerate(pair):
                total[sensor] += self.starts[name].biases[side]
                count[sensor] += 1.0
        return total / np.maximum(count, 1.0)

    def orientations(self, biases: Array) -> Array:
        """(N, S, 4) of all sensors, from the root down."""
        q = np.empty((len(self.recording.time_s), len(self.imus), 4))
        q[:, 0] = upright(self.imus[0], biases[0, 0])
        for name, (upper, lower) in self.joints.items():
            q[:, lower] = multiply(q[:, upper], self.starts[name].rel.q_12)
        return q

    def up(self, q: Array) -> Array:
        """(S, 3) what is upwards in each sensor while the subject stands still, or on average."""
        quiet = np.max([np.linalg.norm(imu.gyr, axis=1) for imu in self.imus], axis=0) < 0.3
        rows = quiet if quiet.sum() >= self.recording.rate_hz else np.ones(len(quiet), dtype=bool)
        up = matrix(q[rows])[:, :, 2, :].mean(axis=0)
        return np.asarray(up / np.linalg.norm(up, axis=1, keepdims=True))

    # ---------------------------------------------------------------- search

    def estimate(self, progress: Progress | None) -> LowerBody:
        biases = self.biases()
        problem = self.problem(np.ascontiguousarray(biases))
        rows = problem.samples.astype(np.intp)
        all_q = self.orientations(biases)
        up = self.up(all_q)
        q = np.ascontiguousarray(all_q[rows])
        centers, axes = self.constants_start(up)
        axes = self.signed(q, centers, axes, up)
        position = self.positions(q, centers)
        time_s = self.recording.time_s[rows]
        velocity = np.gradient(position, time_s, axis=0) if len(time_s) > 1 else np.zeros_like(position)
        start: dict[str, Array] = {
            "q": q,
            "velocity": velocity,
            "position": position,
            "gyr_bias": np.tile(biases[:, 0], (len(rows), 1, 1)),
            "acc_bias": np.tile(biases[:, 1], (len(rows), 1, 1)),
            "centers": centers,
            "axes": axes,
        }
        fit = self.search(problem, start, progress)
        why: list[str] = []
        again = self.signed(fit.q, fit.centers, fit.axes, up)
        history = [fit.trials]
        if not np.array_equal(again, fit.axes):
            # An axis that pointed to the left has pushed the knee's centre aside: search once more.
            start |= {name: getattr(fit, name) for name in start} | {"axes": again}
            fit = self.search(problem, start, progress)
            history.append(fit.trials)
            why.append("a knee's axis was turned round and the search repeated")
        return self.result(problem, fit, np.concatenate(history), up, why)

    def search(self, problem: _core.BodyProblem, start: dict[str, Array], progress: Progress | None) -> _core.BodyFit:
        q, velocity, position, gyr_bias, acc_bias, centers, axes = (
            np.ascontiguousarray(start[name], dtype=np.float64) for name in START
        )
        descent = (self.settings.max_iterations, self.settings.tolerance, 1e-3)
        return problem.minimise(q, velocity, position, gyr_bias, acc_bias, centers, axes, descent, True, progress)

    def constants_start(self, up: Array) -> tuple[Array, Array]:
        """Joint centres and axes; a bone of an impossible length is replaced by the usual one along the upright."""
        centers = np.stack([self.starts[name].centers for name in self.names])
        axes = np.stack([self.starts[name].axes for name in self.names])
        a = self.anthropometry
        for name, (high, low) in self.bones().items():
            kind, _, side = name.partition("_")
            if not side:
                continue
            mean = (a.femur_m if kind == "femur" else a.tibia_m)[0]
            length = float(np.linalg.norm(centers[high] - centers[low]))
            if not 0.6 * mean < length < 1.5 * mean:
                sensor = self.joints[self.names[high[0]]][high[1]]
                middle = 0.5 * (centers[high] + centers[low]) if length > 1e-3 else np.zeros(3)
                centers[high], centers[low] = middle + 0.5 * mean * up[sensor], middle - 0.5 * mean * up[sensor]
        return centers, axes

    def positions(self, q: Array, centers: Array) -> Array:
        """(K, S, 3) places of the sensors, the root at rest."""
        turned = matrix(q)
        place = np.zeros((len(q), len(self.imus), 3))
        for j, (upper, lower) in enumerate(self.joints.values()):
            place[:, lower] = place[:, upper] + turned[:, upper] @ centers[j, 0] - turned[:, lower] @ centers[j, 1]
        return place

    def signed(self, q: Array, centers: Array, axes: Array, up: Array) -> Array:
        """The axes, both of a knee to the right: section 3.9, but by the extremes of flexion instead of its median, which
        standing decides."""
        axes = axes.copy()
        turned = matrix(q)
        for side in SIDES:
            name = f"knee_{side}"
            if name not in self.joints:
                continue
            j, (upper, lower) = self.names.index(name), self.joints[name]
            one, other = turned[:, upper] @ axes[j, 0], turned[:, lower] @ axes[j, 1]
            if float(np.median(np.einsum("ki,ki->k", one, other))) < 0.0:
                axes[j, 1] = -axes[j, 1]
            frames = self.frames(centers, axes, up)
            relative = np.swapaxes(turned[:, upper] @ frames[upper], 1, 2) @ (turned[:, lower] @ frames[lower])
            flexion = angles_deg("knee", side, relative)[:, 0]
            if float(np.percentile(flexion, 1) + np.percentile(flexion, 99)) < 0.0:
                axes[j] = -axes[j]
        return axes

    # ---------------------------------------------------------------- frames and angles

    def frames(self, centers: Array, axes: Array, up: Array) -> dict[int, Array]:
        """Sensor to (3, 3), segment to sensor; feet excepted."""
        bones, found = self.bones(), {}
        for k, segment in enumerate(self.segments):
            kind, _, side = segment.partition("_")
            if kind == "pelvis":
                if "hips" in bones:
                    right = centers[bones["hips"][0]] - centers[bones["hips"][1]]
                    # Of the upright what stands across the line between the hips.
                    across = right / np.linalg.norm(right)
                    found[k] = frame(across, up[k] - across * (across @ up[k]))
            elif kind in ("thigh", "shank") and f"knee_{side}" in self.joints:
                bone = bones.get(f"{'femur' if kind == 'thigh' else 'tibia'}_{side}")
                along = up[k] if bone is None else centers[bone[0]] - centers[bone[1]]
                j = self.names.index(f"knee_{side}")
                found[k] = frame(axes[j, 0 if kind == "thigh" else 1], along)
        return found

    def result(self, problem: _core.BodyProblem, fit: _core.BodyFit, history: Array, up: Array, why: list[str]) -> LowerBody:
        turned = matrix(fit.q)
        rows = problem.samples.astype(np.intp)
        frames = self.frames(fit.centers, fit.axes, up)
        quiet = self.standing(rows)
        for upper, lower in self.joints.values():
            # What has no frame of its own: upright as when standing, to the right as its neighbour then is.
            for known, open_ in ((upper, lower), (lower, upper)):
                if known in frames and open_ not in frames:
                    across = np.swapaxes(turned[quiet, open_], 1, 2) @ (turned[quiet, known] @ frames[known][:, 0])[:, :, None]
                    frames[open_] = frame(across[:, :, 0].mean(axis=0), up[open_])
        angles: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        stds: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        joints = {}
        for j, (name, (upper, lower)) in enumerate(self.joints.items()):
            kind, side = name.split("_")
            if upper in frames and lower in frames:
                relative = np.swapaxes(turned[:, upper] @ frames[upper], 1, 2) @ (turned[:, lower] @ frames[lower])
                angles[kind][side] = angles_deg(kind, side, relative)
                stds[kind][side] = self.bands(fit, j, kind, side, turned, frames, up)
            joints[name] = self.joint(fit, j, name, rows)
        undetermined = [name for name, joint in joints.items() if not joint.determined]
        if undetermined:
            why.append(f"the motion leaves open: {', '.join(undetermined)}")
        status = BodyStatus(fit.status)
        if status is BodyStatus.CONVERGED and len(undetermined) == len(joints):
            status = BodyStatus.NOT_OBSERVABLE
        bones = self.bones()
        lengths = {name: self.length(fit, *ends) for name, ends in bones.items()}
        for name, (length, _) in lengths.items():
            usual, spread = getattr(self.anthropometry, f"{name.partition('_')[0]}_m")
            if abs(length - usual) > UNLIKELY * spread:
                why.append(
                    f"{name} came out {100 * length:.0f} cm long where {100 * usual:.0f} ± {100 * spread:.0f} cm was expected: "
                    "its joint centres and their standard deviations are not to be trusted"
                )
        knees: dict[str, Array] = {}
        for side in SIDES:
            if f"knee_{side}" in self.joints:
                j = self.names.index(f"knee_{side}")
                knees |= {f"thigh_{side}": fit.axes[j, 0], f"shank_{side}": fit.axes[j, 1]}
        return LowerBody(
            time_s=self.recording.time_s[rows],
            status=status,
            why=tuple(why),
            q={segment: fit.q[:, k] for k, segment in enumerate(self.segments)},
            q_segment={
                segment: multiply(fit.q[:, k], np.broadcast_to(from_matrix(frames[k]), (len(rows), 4)))
                for k, segment in enumerate(self.segments)
                if k in frames
            },
            position={segment: fit.position[:, k] for k, segment in enumerate(self.segments)},
            knee_angles_deg=angles["knee"],
            hip_angles_deg=angles["hip"],
            ankle_angles_deg=angles["ankle"],
            knee_std_deg=stds["knee"],
            hip_std_deg=stds["hip"],
            ankle_std_deg=stds["ankle"],
            joints=joints,
            knee_axis=knees,
            lengths_m=lengths,
            cost=fit.cost,
            iterations=len(history),
            history=history,
            placement=dict(self.placed),
            anthropometry=self.anthropometry,
            settings=self.settings,
        )

    def standing(self, rows: Rows) -> Rows:
        """Which moments are quiet; all, where hardly any is."""
        fast = np.max([np.linalg.norm(imu.gyr[rows], axis=1) for imu in self.imus], axis=0)
        quiet = fast < max(0.3, float(np.percentile(fast, 10)))
        return np.flatnonzero(quiet)

    def bands(
        self, fit: _core.BodyFit, j: int, kind: str, side: str, turned: Array, frames: dict[int, Array], up: Array
    ) -> Array:
        """(K, 3) standard deviations of a joint's angles, degrees."""
        upper, lower = self.joints[self.names[j]]
        if fit.joint_covariance is None or fit.joint_constants is None or fit.constants_covariance is None:
            return np.full((len(turned), 3), np.inf)
        count = len(fit.constants_covariance)

        def moved(step: Array) -> tuple[Array, Array]:
            centers = fit.centers + step[: fit.centers.size].reshape(fit.centers.shape)
            axes = fit.axes.copy()
            at = fit.centers.size
            for n, name in enumerate(self.names):
                if name.startswith("knee"):
                    for end in (0, 1):
                        axis = axes[n, end] + _tangent(axes[n, end]) @ step[at : at + 2]
                        axes[n, end] = axis / np.linalg.norm(axis)
                        at += 2
            now = self.frames(centers, axes, up)
            return now.get(upper, frames[upper]), now.get(lower, frames[lower])

        own = fit.joint_covariance[:, j].reshape(-1, 6, 6)
        beside = fit.joint_constants[:, 6 * j : 6 * j + 6, :count]
        covariance = (own, beside, fit.constants_covariance)
        return angle_std_deg(kind, side, (turned[:, upper], turned[:, lower]), moved, covariance)

    def joint(self, fit: _core.BodyFit, j: int, name: str, rows: Rows) -> BodyJoint:
        upper, lower = self.joints[name]
        start: JointStart = self.starts[name]
        heading = np.full(len(rows), np.inf)
        center_std = np.full(2, np.inf)
        if fit.joint_covariance is not None and fit.constants_covariance is not None:
            own = fit.joint_covariance[:, j].reshape(-1, 6, 6)
            # Heading: the turn about the upright, of one sensor against the other.
            variance = own[:, 2, 2] + own[:, 5, 5] - 2.0 * own[:, 2, 5]
            heading = np.degrees(np.sqrt(np.maximum(variance, 0.0)))
            for side in (0, 1):
                block = fit.constants_covariance[
                    6 * j + 3 * side : 6 * j + 3 * side + 3, 6 * j + 3 * side : 6 * j + 3 * side + 3
                ]
                center_std[side] = float(np.sqrt(max(np.linalg.eigvalsh(block)[-1], 0.0)))
        relative = np.swapaxes(matrix(fit.q[:, upper]), 1, 2) @ matrix(fit.q[:, lower])
        alone = matrix(start.rel.q_12[rows])
        world = matrix(fit.q[:, upper])
        off = world @ (relative @ np.swapaxes(alone, 1, 2)) @ np.swapaxes(world, 1, 2)
        drift = np.degrees(np.arctan2(off[:, 1, 0] - off[:, 0, 1], off[:, 0, 0] + off[:, 1, 1]))
        drift_deg = float(np.sqrt(np.mean(drift**2)))
        why = []
        if float(np.median(heading)) > UNSEEN_DEG:
            why.append(f"heading certain to {float(np.median(heading)):.0f} degrees only")
        if not start.seen and not name.startswith("knee"):
            why.append("its two sensors alone do not show how they are turned against each other")
        if start.seen and drift_deg > UNSEEN_DEG:
            why.append(f"heading {drift_deg:.0f} degrees off what its two sensors alone say")
        if float(center_std.max()) > OPEN_M:
            why.append(f"centre certain to {1e3 * float(center_std.max()):.0f} mm only")
        return BodyJoint(
            in_sensors=fit.centers[j],
            in_sensors_std=center_std,
            heading_std_deg=heading,
            heading_drift_deg=drift_deg,
            determined=not why,
            why=tuple(why),
        )

    def length(self, fit: _core.BodyFit, high: tuple[int, int], low: tuple[int, int]) -> tuple[float, float]:
        bone = fit.centers[high] - fit.centers[low]
        length = float(np.linalg.norm(bone))
        if fit.constants_covariance is None or length == 0.0:
            return length, float("inf")
        row = np.zeros(len(fit.constants_covariance))
        for (joint, side), sign in ((high, 1.0), (low, -1.0)):
            row[6 * joint + 3 * side : 6 * joint + 3 * side + 3] += sign * bone / length
        return length, float(max(float(row @ fit.constants_covariance @ row), 0.0)) ** 0.5


START = ("q", "velocity", "position", "gyr_bias", "acc_bias", "centers", "axes")


def _tangent(axis: Array) -> Array:
    """(3, 2) the core's basis of the plane across a unit vector."""
    farthest = np.zeros(3)
    farthest[int(np.argmin(np.abs(axis)))] = 1.0
    first = np.cross(farthest, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)
