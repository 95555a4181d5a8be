"""From what the core found to what `estimate_lower_body` returns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast.body.anatomy import frames
from imufast.body.bands import MCGRATH, angles_deg, between, pelvis_deg, pelvis_std_deg, spread_deg, std_deg
from imufast.body.layout import SIDES
from imufast.body.problem import center_std_m
from imufast.body.residuals import residuals
from imufast.body.result import UNSEEN_DEG, BodyJoint, BodyStatus, LowerBody
from imufast.body.solve import Ask, Solved
from imufast.body.stance import STEEP_DEG, Rests
from imufast.frames import STANDING_STD_DEG, spanned, turns_by
from imufast.quaternion import from_matrix, matrix, multiply
from imufast.track import UNKNOWN_DEG

__all__ = ["Reading"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
OPEN_M = 0.03
"""Likewise a joint centre of which a direction is less certain than this, m."""
OPEN_S = 1.0
"""A heading that is open for so long is named, s."""
APART = 3.0
"""Sensors that see their joint apart by so many times what was expected, rms, contradict each other."""
UPRIGHT_DEG = STANDING_STD_DEG
"""A pelvis or foot whose frame is upright when its bearer stands, as most are to within this, degrees..."""
LEANING_DEG = 10.0
"""...or, where nobody stood still, on average over all of the motion."""
BENT_DEG = 25.0
"""A thigh or shank without both its joint centres then: who walks has his knees bent by 25 on average, who sits by more. And
the pelvis of who only sits, which tilts back, and his feet, which may hang."""
BENT_RAD = 0.5
"""A leg is bent by so much more or less than on average, where its frames are found, rad: so far skin turns its sensors."""
UNLIKELY = 5.0
"""A length that is so many of its usual standard deviations off contradicts what was expected."""


class Reading:
    """A fit beside what it was made from; `known`: frames (sensor to (3, 3), segment to sensor) found elsewhere."""

    def __init__(self, solved: Solved, ask: Ask, known: dict[int, Array] | None = None) -> None:
        layout, fit, settings = ask.layout, solved.fit, ask.settings
        self.recording, self.start, self.rows, self.fit = solved.recording, solved.start, solved.rows, fit
        self.layout, self.anthropometry, self.turned, start = layout, ask.anthropometry, matrix(fit.q), solved.start
        self.settings, self.shares = settings, solved.shares
        self.measured = set(frames(layout, fit.centers, fit.axes, start.up))
        self.frames = self.all_frames() if known is None else known
        self.turns = self.turns_of_frames()
        bones = [name.replace("femur", "thigh").replace("tibia", "shank") for name in layout.bones()]
        self.boneless = [s for s in layout.segments if s.startswith(("thigh", "shank")) and s not in bones]
        self.leans = self.all_leans()
        self.stood = start.stood and max(self.leans.values(), default=0.0) <= UNSEEN_DEG
        self.loose = self.all_loose()

    def read(self, history: Array, why: list[str]) -> LowerBody:
        """All of it."""
        layout, fit, turned, found = self.layout, self.fit, self.turned, self.frames
        angles: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        stds: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        joints = {}
        for name, (upper, lower) in layout.joints.items():
            kind, side = name.split("_")
            if upper in found and lower in found:
                relative = between(self.of(upper), self.of(lower))
                angles[kind][side] = angles_deg(kind, side, relative)
                stds[kind][side] = self.bands(name)
            joints[name] = self.joint(name)
        if unsure := [s for s, lean in self.leans.items() if lean > UNSEEN_DEG]:
            lean = max(self.leans[s] for s in unsure)
            points = f"{' and '.join(unsure)} may lean by {lean:.0f} degrees more or less"
            why.append(f"whether the subject stands or sits is open: {points}")
        elif not self.start.stood:
            zero = [s for s in layout.segments if s in self.boneless or s.startswith(("pelvis", "foot"))]
            if zero:
                does = "only sits" if self.start.sat else "never stands still"
                why.append(f"the subject {does}: the zero of {', '.join(zero)} is an average posture")
        undetermined = [name for name, joint in joints.items() if not joint.determined]
        if undetermined:
            why.append(f"the motion leaves open: {', '.join(undetermined)}")
        for name, joint in joints.items():
            if joint.turn_determined and (spans := self.open_spans(joint.heading_std_deg)):
                why.append(f"{name}: how its segments are turned against each other is open {spans}")
        status = BodyStatus(fit.status)
        if status is not BodyStatus.NUMERICAL_ERROR and not any(joint.determined for joint in joints.values()):
            status = BodyStatus.NOT_OBSERVABLE
        lengths = {name: self.length(*ends) for name, ends in layout.bones().items()}
        for name, (length, _) in lengths.items():
            usual, spread = getattr(self.anthropometry, f"{name.partition('_')[0]}_m")
            if abs(length - usual) > UNLIKELY * spread:
                why.append(
                    f"{name} came out {100 * length:.0f} cm long where {100 * usual:.0f} ± {100 * spread:.1f} cm was expected: "
                    "its joint centres and their standard deviations are not to be trusted"
                )
        knees: dict[str, Array] = {}
        for side in SIDES:
            if f"knee_{side}" in layout.joints:
                j = layout.names.index(f"knee_{side}")
                knees |= {f"thigh_{side}": fit.axes[j, 0], f"shank_{side}": fit.axes[j, 1]}
        tilt, tilt_std = self.pelvis()
        return LowerBody(
            time_s=self.recording.time_s[self.rows],
            status=status,
            why=tuple(why),
            q={segment: fit.q[:, k] for k, segment in enumerate(layout.segments)},
            q_segment={
                segment: multiply(fit.q[:, k], np.broadcast_to(from_matrix(found[k] @ MCGRATH), (len(turned), 4)))
                for k, segment in enumerate(layout.segments)
                if k in found
            },
            position={segment: fit.position[:, k] for k, segment in enumerate(layout.segments)},
            knee_angles_deg=angles["knee"],
            hip_angles_deg=angles["hip"],
            ankle_angles_deg=angles["ankle"],
            knee_std_deg=stds["knee"],
            hip_std_deg=stds["hip"],
            ankle_std_deg=stds["ankle"],
            pelvis_angles_deg=tilt,
            pelvis_std_deg=tilt_std,
            joints=joints,
            knee_axis=knees,
            lengths_m=lengths,
            cost=fit.cost,
            iterations=len(history),
            residuals=residuals(layout, self.recording.time_s[self.rows], fit, self.anthropometry, self.settings, lengths),
            history=history,
            placement=dict(layout.placed),
            anthropometry=self.anthropometry,
            settings=self.settings,
        )

    def open_spans(self, heading_deg: Array) -> str:
        """In words, when a heading is open for `OPEN_S` at least; empty where it never is."""
        time_s = self.recording.time_s[self.rows]
        edges = np.flatnonzero(np.diff(np.concatenate([[False], heading_deg > UNSEEN_DEG, [False]])))
        spans = [(time_s[a], time_s[b - 1]) for a, b in zip(edges[::2], edges[1::2], strict=True)]
        told = [f"from {start:.0f} to {stop:.0f} s" for start, stop in spans if stop - start >= OPEN_S]
        return ", ".join([*told[:3], f"and {len(told) - 3} times more"] if len(told) > 3 else told)

    def all_frames(self) -> dict[int, Array]:
        """Sensor to (3, 3), segment to sensor, of all that have a neighbour whose frame is known."""
        found = frames(self.layout, self.fit.centers, self.fit.axes, self.start.up)
        self.measured = set(found)
        standing = self.standing()
        for name, (upper, lower) in self.layout.joints.items():
            # What has no frame of its own: upright as when standing, to the right as its neighbour then is, above all where the
            # heading of one against the other is certain; where it never is while standing, on average over the motion.
            heading = self.heading_deg(name)
            rows = standing if (heading[standing] < UNSEEN_DEG).any() else np.arange(len(heading))
            weight = 1.0 / (1.0 + np.minimum(heading[rows], UNKNOWN_DEG) ** 2)
            for known, open_ in ((upper, lower), (lower, upper)):
                if known in found and open_ not in found:
                    right = self.turned[rows, known] @ found[known][:, 2]
                    across = np.swapaxes(self.turned[rows, open_], 1, 2) @ right[:, :, None]
                    found[open_] = spanned("proximal", self.start.up[open_], "right", weight @ across[:, :, 0]).T
        return found

    def all_leans(self) -> dict[str, float]:
        """Thigh to the standard deviation of how far it leans ahead, of those both of whose ends are known, degrees."""
        covariance, found = self.fit.constants_covariance, {}
        for k, segment in enumerate(self.layout.segments):
            if segment.startswith("thigh") and f"femur_{segment.removeprefix('thigh_')}" in self.layout.bones():
                variance = np.inf if covariance is None else float(self.turns[k][2] @ covariance @ self.turns[k][2])
                found[segment] = float(np.degrees(np.sqrt(max(variance, 0.0))))
        return found

    def all_loose(self) -> dict[int, Array]:
        """Sensor to (3,): variance about X, Y and Z of its segment of how that may be turned against its frame, rad²."""
        settled = (BENT_RAD * self.settings.soft_tissue_deg) ** 2 * np.ones(3)
        found = [settled.copy() for _ in self.layout.segments]
        for name, (upper, lower) in self.layout.joints.items():
            if name.startswith("knee"):
                # How far both sensors see the axis apart is soft tissue, too, or what no hinge does; on which of them it moves
                # nothing shows, and neither what it does about the axis: as much as in the quieter direction across it.
                j = self.layout.names.index(name)
                apart = self.turned[:, upper] @ self.fit.axes[j, 0] - self.turned[:, lower] @ self.fit.axes[j, 1]
                front, up, _ = ((apart[:, None] @ self.turned[:, upper])[:, 0] @ self.frames[upper]).T
                about_front, about_up = np.degrees(1.0) ** 2 * np.array([np.mean(up**2), np.mean(front**2)])
                for k in (upper, lower):
                    found[k] += np.array([about_front, about_up, min(about_front, about_up)])
        lean = UPRIGHT_DEG if self.stood else BENT_DEG if self.start.sat else LEANING_DEG
        for k, segment in enumerate(self.layout.segments):
            if segment == "pelvis" and k in self.measured:
                found[k][2] += lean**2  # the hips show the rest
            elif k not in self.measured:
                found[k] += lean**2
            elif segment in self.boneless:
                # The knee's axis shows how it is turned about its length.
                found[k][[0, 2]] += (lean if self.stood else BENT_DEG) ** 2
            elif self.leans.get(segment, 0.0) > UNSEEN_DEG:
                # It lies or stands, and which way the knee bends is open: linear bands say of it what the start says.
                found[k] += STEEP_DEG**2
        return {k: np.radians(1.0) ** 2 * variance for k, variance in enumerate(found)}

    def standing(self) -> Rows:
        """Which moments the subject stands in; the quietest tenth, where it never does."""
        rests = Rests(self.recording, self.layout)
        stands = rests.samples(rests.standing(self.fit.centers, self.fit.axes, self.start.up))[self.rows]
        imus = [self.recording[name] for name in self.layout.placed.values()]
        fast = np.max([np.linalg.norm(imu.gyr[self.rows], axis=1) for imu in imus], axis=0)
        return np.flatnonzero(stands if stands.any() else fast <= np.percentile(fast, 10))

    def of(self, sensor: int) -> tuple[Array, Array]:
        """(K, 3, 3) sensor to world and (3, 3) segment to sensor."""
        return self.turned[:, sensor], self.frames[sensor]

    def turns_of_frames(self) -> dict[int, Array]:
        """Sensor to (3, C): the small rotation of its segment's frame, in its own axes, by the body's constants."""
        layout, fit = self.layout, self.fit
        if fit.constants_covariance is None:
            return {}

        def rows(step: Array) -> Array:
            centers = fit.centers + step[: fit.centers.size].reshape(fit.centers.shape)
            axes = fit.axes.copy()
            at = fit.centers.size
            for n, joint in enumerate(layout.names):
                if joint.startswith("knee"):
                    for end in (0, 1):
                        axis = axes[n, end] + _tangent(axes[n, end]) @ step[at : at + 2]
                        axes[n, end] = axis / np.linalg.norm(axis)
                        at += 2
            now = frames(layout, centers, axes, self.start.up)
            return np.array([now.get(k, frame).T for k, frame in self.frames.items()]).reshape(-1, 3, 3)

        count = len(fit.constants_covariance)
        turns = turns_by(rows, rows(np.zeros(count)), count)
        return dict(zip(self.frames, turns, strict=True))

    def bands(self, name: str) -> Array:
        """(K, 3) standard deviations of a joint's angles, degrees."""
        layout, fit = self.layout, self.fit
        j, (upper, lower), (kind, side) = layout.names.index(name), layout.joints[name], name.split("_")
        if fit.joint_covariance is None or fit.joint_constants is None or fit.constants_covariance is None:
            return np.full((len(self.turned), 3), np.inf)
        own = fit.joint_covariance[:, j].reshape(-1, 6, 6)
        beside = fit.joint_constants[:, 6 * j : 6 * j + 6]
        covariance = (own, beside, fit.constants_covariance + self.shifted())
        turns, loose = ((of[upper], of[lower]) for of in (self.turns, self.loose))
        found = std_deg(kind, side, self.of(upper), self.of(lower), turns, covariance, loose)
        # The search is local, and so is what it says of a heading that is open: that may be anywhere.
        open_ = self.heading_deg(name) > UNSEEN_DEG
        (high, above), (low, below) = self.of(upper), self.of(lower)
        spread = spread_deg(kind, side, (high[open_], above), (low[open_], below))
        found[open_] = np.minimum(np.hypot(found[open_], spread), 180.0)
        return found

    def heading_deg(self, name: str) -> Array:
        """(K,) standard deviation of the turn about the upright of a joint's one sensor against the other, degrees."""
        if self.fit.joint_covariance is None:
            return np.full(len(self.rows), np.inf)
        own = self.fit.joint_covariance[:, self.layout.names.index(name)].reshape(-1, 6, 6)
        variance = own[:, 2, 2] + own[:, 5, 5] - 2.0 * own[:, 2, 5]
        # Below zero is what rounding makes of something that nothing determines.
        heading: Array = np.degrees(np.sqrt(np.where(variance < 0.0, np.inf, variance)))
        return heading

    def shifted(self) -> Array:
        """(C, C) what soft tissue adds to the covariance of the constants: to joint centres, m²."""
        variance = np.zeros(0 if self.fit.constants_covariance is None else len(self.fit.constants_covariance))
        variance[: self.fit.centers.size] = (BENT_RAD * self.settings.soft_tissue_m) ** 2
        return np.diag(variance)

    def pelvis(self) -> tuple[Array, Array]:
        """(K, 2) tilt and list, and their standard deviations, degrees; (K, 0) where there is none."""
        hips = [name for name in self.layout.joints if name.startswith("hip")]
        if not hips or 0 not in self.frames:
            return np.zeros((len(self.rows), 0)), np.zeros((len(self.rows), 0))
        fit, angles = self.fit, pelvis_deg(self.of(0))
        if fit.joint_covariance is None or fit.joint_constants is None or fit.constants_covariance is None:
            return angles, np.full(angles.shape, np.inf)
        j = self.layout.names.index(hips[0])
        own = fit.joint_covariance[:, j].reshape(-1, 6, 6)[:, :3, :3]
        covariance = (own, fit.joint_constants[:, 6 * j : 6 * j + 3], fit.constants_covariance + self.shifted())
        return angles, pelvis_std_deg(self.of(0), self.turns[0], covariance)

    def joint(self, name: str) -> BodyJoint:
        """What was found of a joint, and whether that is to be believed."""
        fit, start = self.fit, self.start.joints[name]
        j, (upper, lower) = self.layout.names.index(name), self.layout.joints[name]
        heading = self.heading_deg(name)
        center_std, shown = np.full(2, np.inf), np.inf
        if fit.constants_covariance is not None:
            for side in (0, 1):
                block = fit.constants_covariance[
                    6 * j + 3 * side : 6 * j + 3 * side + 3, 6 * j + 3 * side : 6 * j + 3 * side + 3
                ]
                center_std[side] = float(np.sqrt(max(np.linalg.eigvalsh(block)[-1], 0.0)))
            # What the motion leaves open is one thing, what no motion shows another.
            shown = float(center_std.max())
            center_std = np.hypot(center_std, BENT_RAD * self.settings.soft_tissue_m)
        world = self.turned[:, upper]
        relative = np.swapaxes(world, 1, 2) @ self.turned[:, lower]
        alone = matrix(start.rel.q_12[self.rows])
        off = world @ (relative @ np.swapaxes(alone, 1, 2)) @ np.swapaxes(world, 1, 2)
        drift = np.degrees(np.arctan2(off[:, 1, 0] - off[:, 0, 1], off[:, 0, 0] + off[:, 1, 1]))
        drift_deg = float(np.sqrt(np.mean(drift**2)))
        why = []
        if float(np.median(heading)) > UNSEEN_DEG:
            why.append(f"heading certain to {float(np.median(heading)):.0f} degrees only")
        if not start.seen and not name.startswith("knee"):
            why.append("its two sensors alone do not show how they are turned against each other")
        if start.seen and drift_deg > UNSEEN_DEG and self.plausible_alone(name):
            why.append(f"heading {drift_deg:.0f} degrees off what its two sensors alone say")
        if shown > OPEN_M:
            why.append(f"centre certain to {1e3 * shown:.0f} mm only")
        stated_m = center_std_m(name.partition("_")[0], self.settings)
        apart = float(self.shares[j] * np.sqrt(fit.joint_squares[:, j, 0].mean() / 3.0))
        if apart > APART:
            why.append(f"its two sensors see it {100.0 * apart * stated_m:.0f} cm apart: they contradict each other")
        return BodyJoint(
            in_sensors=fit.centers[j],
            in_sensors_std=center_std,
            heading_std_deg=heading,
            heading_drift_deg=drift_deg,
            determined=not why,
            why=tuple(why),
        )

    def plausible_alone(self, name: str) -> bool:
        """Whether the centres that pairs of sensors find alone make bones of usual lengths at a joint: where they do not, its
        heading, which rests on them, contradicts nothing."""
        for bone, ends in self.layout.bones().items():
            if name in (self.layout.names[joint] for joint, _ in ends):
                high, low = (self.start.joints[self.layout.names[joint]].centers[side] for joint, side in ends)
                usual, spread = getattr(self.anthropometry, f"{bone.partition('_')[0]}_m")
                if abs(float(np.linalg.norm(high - low)) - usual) > UNLIKELY * spread:
                    return False
        return True

    def length(self, high: tuple[int, int], low: tuple[int, int]) -> tuple[float, float]:
        """A bone's length and its standard deviation, m."""
        fit = self.fit
        bone = fit.centers[high] - fit.centers[low]
        length = float(np.linalg.norm(bone))
        if fit.constants_covariance is None or length == 0.0:
            return length, float("inf")
        row = np.zeros(len(fit.constants_covariance))
        for (joint, side), sign in ((high, 1.0), (low, -1.0)):
            row[6 * joint + 3 * side : 6 * joint + 3 * side + 3] += sign * bone / length
        return length, float(max(float(row @ (fit.constants_covariance + self.shifted()) @ row), 0.0)) ** 0.5


def _tangent(axis: Array) -> Array:
    """(3, 2) the core's basis of the plane across a unit vector."""
    farthest = np.zeros(3)
    farthest[int(np.argmin(np.abs(axis)))] = 1.0
    first = np.cross(farthest, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)
