"""From what the core found to what `estimate_lower_body` returns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.anatomy import frames
from imufast.body.frames import angle_std_deg, angles_deg, frame
from imufast.body.layout import SIDES, Layout
from imufast.body.result import BodyJoint, BodyStatus, LowerBody
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.start import STILL, BodyStart
from imufast.imu import Recording
from imufast.quaternion import from_matrix, matrix, multiply

__all__ = ["Reading"]

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
UNSEEN_DEG = 10.0
"""A joint whose relative heading is less certain than this for most of the time is undetermined, degrees."""
OPEN_M = 0.03
"""Likewise a joint centre of which a direction is less certain than this, m."""
UNLIKELY = 5.0
"""A length that is so many of its usual standard deviations off contradicts what was expected."""


class Reading:
    """A fit beside what it was made from; `known`: frames (sensor to (3, 3), segment to sensor) found elsewhere."""

    def __init__(
        self,
        recording: Recording,
        layout: Layout,
        anthropometry: Anthropometry,
        start: BodyStart,
        rows: Rows,
        fit: _core.BodyFit,
        known: dict[int, Array] | None = None,
    ) -> None:
        self.recording, self.layout, self.anthropometry, self.start = recording, layout, anthropometry, start
        self.rows, self.fit, self.turned = rows, fit, matrix(fit.q)
        self.frames = self.all_frames() if known is None else known

    def read(self, settings: LowerBodySettings, history: Array, why: list[str]) -> LowerBody:
        """All of it."""
        layout, fit, turned, found = self.layout, self.fit, self.turned, self.frames
        angles: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        stds: dict[str, dict[str, Array]] = {kind: {} for kind in ("hip", "knee", "ankle")}
        joints = {}
        for name, (upper, lower) in layout.joints.items():
            kind, side = name.split("_")
            if upper in found and lower in found:
                relative = np.swapaxes(turned[:, upper] @ found[upper], 1, 2) @ (turned[:, lower] @ found[lower])
                angles[kind][side] = angles_deg(kind, side, relative)
                stds[kind][side] = self.bands(name)
            joints[name] = self.joint(name)
        undetermined = [name for name, joint in joints.items() if not joint.determined]
        if undetermined:
            why.append(f"the motion leaves open: {', '.join(undetermined)}")
        status = BodyStatus(fit.status)
        if status is BodyStatus.CONVERGED and len(undetermined) == len(joints):
            status = BodyStatus.NOT_OBSERVABLE
        lengths = {name: self.length(*ends) for name, ends in layout.bones().items()}
        for name, (length, _) in lengths.items():
            usual, spread = getattr(self.anthropometry, f"{name.partition('_')[0]}_m")
            if abs(length - usual) > UNLIKELY * spread:
                why.append(
                    f"{name} came out {100 * length:.0f} cm long where {100 * usual:.0f} ± {100 * spread:.0f} cm was expected: "
                    "its joint centres and their standard deviations are not to be trusted"
                )
        knees: dict[str, Array] = {}
        for side in SIDES:
            if f"knee_{side}" in layout.joints:
                j = layout.names.index(f"knee_{side}")
                knees |= {f"thigh_{side}": fit.axes[j, 0], f"shank_{side}": fit.axes[j, 1]}
        return LowerBody(
            time_s=self.recording.time_s[self.rows],
            status=status,
            why=tuple(why),
            q={segment: fit.q[:, k] for k, segment in enumerate(layout.segments)},
            q_segment={
                segment: multiply(fit.q[:, k], np.broadcast_to(from_matrix(found[k]), (len(turned), 4)))
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
            joints=joints,
            knee_axis=knees,
            lengths_m=lengths,
            cost=fit.cost,
            iterations=len(history),
            history=history,
            placement=dict(layout.placed),
            anthropometry=self.anthropometry,
            settings=settings,
        )

    def all_frames(self) -> dict[int, Array]:
        """Sensor to (3, 3), segment to sensor, of all that have a neighbour whose frame is known."""
        found = frames(self.layout, self.fit.centers, self.fit.axes, self.start.up)
        quiet = self.standing()
        for upper, lower in self.layout.joints.values():
            # What has no frame of its own: upright as when standing, to the right as its neighbour then is.
            for known, open_ in ((upper, lower), (lower, upper)):
                if known in found and open_ not in found:
                    right = self.turned[quiet, known] @ found[known][:, 0]
                    across = np.swapaxes(self.turned[quiet, open_], 1, 2) @ right[:, :, None]
                    found[open_] = frame(across[:, :, 0].mean(axis=0), self.start.up[open_])
        return found

    def standing(self) -> Rows:
        """Which moments are quiet; all, where hardly any is."""
        imus = [self.recording[name] for name in self.layout.placed.values()]
        fast = np.max([np.linalg.norm(imu.gyr[self.rows], axis=1) for imu in imus], axis=0)
        quiet = fast < max(STILL, float(np.percentile(fast, 10)))
        return np.flatnonzero(quiet)

    def bands(self, name: str) -> Array:
        """(K, 3) standard deviations of a joint's angles, degrees."""
        layout, fit, turned = self.layout, self.fit, self.turned
        j, (upper, lower), (kind, side) = layout.names.index(name), layout.joints[name], name.split("_")
        if fit.joint_covariance is None or fit.joint_constants is None or fit.constants_covariance is None:
            return np.full((len(turned), 3), np.inf)
        count = len(fit.constants_covariance)

        def moved(step: Array) -> tuple[Array, Array]:
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
            return now.get(upper, self.frames[upper]), now.get(lower, self.frames[lower])

        own = fit.joint_covariance[:, j].reshape(-1, 6, 6)
        beside = fit.joint_constants[:, 6 * j : 6 * j + 6, :count]
        covariance = (own, beside, fit.constants_covariance)
        return angle_std_deg(kind, side, (turned[:, upper], turned[:, lower]), moved, covariance)

    def joint(self, name: str) -> BodyJoint:
        """What was found of a joint, and whether that is to be believed."""
        fit, start = self.fit, self.start.joints[name]
        j, (upper, lower) = self.layout.names.index(name), self.layout.joints[name]
        heading = np.full(len(self.rows), np.inf)
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
        return length, float(max(float(row @ fit.constants_covariance @ row), 0.0)) ** 0.5


def _tangent(axis: Array) -> Array:
    """(3, 2) the core's basis of the plane across a unit vector."""
    farthest = np.zeros(3)
    farthest[int(np.argmin(np.abs(axis)))] = 1.0
    first = np.cross(farthest, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)], axis=1)
