"""The factor graph of a body, from its layout and settings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.layout import Layout
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.tissue import Skin
from imufast.imu import Recording

__all__ = ["LIMITS_M", "center_std_m", "problem", "rest_information", "usual_postures"]

Array = NDArray[np.float64]
GRAVITY = 9.80665
LIMITS_M = {"femur": (0.326, 0.480), "tibia": (0.344, 0.479), "hips": (0.0, 0.409)}
GAUGE_STD = 1e-3
LEAST = 1e-6
"""Standard deviation of what is taken to be zero."""
POSTURE_DEG = 20.0
"""How far hips and ankles rest turned off their usual posture: about half of what a hip turns inwards and outwards at most, 45
degrees (American Academy of Orthopaedic Surgeons 1965)."""
APART_S = 0.1
"""Residuals of a joint this far apart count as independent, s: soft tissue moves no faster than the leg."""


def center_std_m(kind: str, settings: LowerBodySettings) -> float:
    """Of a "hip", "knee" or "ankle" as it counts at each moment: what they say in a second does not depend on their number."""
    return float(getattr(settings, f"{kind}_std_m") * _more(settings))


def rest_information(still: NDArray[np.bool_], span_s: float, settings: LowerBodySettings) -> Array:
    """(K, 1, 1) 1/(m/s)², that the first sensor is as fast at the next moment, `span_s` s later, where the body is `still`.

    Else a subject who sits could drift about at metres per second, and headings would be read from those accelerations.
    """
    step = settings.rest_acc_std * span_s * _more(settings)
    return np.asarray(still / step**2).reshape(-1, 1, 1)


def usual_postures(
    layout: Layout, postures: Mapping[str, tuple[Array, NDArray[np.intp]]], rows: NDArray[np.intp]
) -> tuple[Array, Array]:
    """(J, 2, 3) directions in both sensors of each joint that usually agree; (K, J, 1) the information that they do, 1/rad².

    There is some of hips and ankles in stretches between breaks in which nothing else shows how they are turned: that of
    `POSTURE_DEG` for the whole of each.
    """
    axes = np.tile([1.0, 0.0, 0.0], (len(layout.names), 2, 1))
    information = np.zeros((len(rows), len(layout.names), 1))
    for name, (pair, stretches) in postures.items():
        j = layout.names.index(name)
        axes[j], open_ = pair, stretches[rows]
        counts = np.bincount(open_)[open_]
        information[:, j, 0] = (open_ > 0) / (np.radians(POSTURE_DEG) ** 2 * counts)
    return axes, information


def _more(settings: LowerBodySettings) -> float:
    return float(np.sqrt(APART_S / settings.key_step_s))


def problem(
    recording: Recording,
    layout: Layout,
    anthropometry: Anthropometry,
    settings: LowerBodySettings,
    biases: Array,
    moved: list[Skin],
    shares: Array | None = None,
) -> _core.BodyProblem:
    """Sensors, joints, measures and skins as the core wants them; `biases` (S, 2, 3) of gyroscopes (rad/s) and
    accelerometers, `shares` (J,) of the stated standard deviations of joint centres that are taken, default all of them."""
    s, a = settings, anthropometry
    hinge_std = s.hinge_std * _more(s)
    axes_std = None if s.axes_std_deg is None else float(np.radians(s.axes_std_deg) * _more(s))
    joints = []
    for n, (name, (upper, lower)) in enumerate(layout.joints.items()):
        kind = name.split("_")[0]
        hinge = kind == "knee"
        center_std = center_std_m(kind, s) * (1.0 if shares is None else float(shares[n]))
        joints.append((upper, lower, [center_std] * 3, hinge_std if hinge else None, axes_std if hinge else None))
    bones, angles, order = [], [], []
    lengths = {"femur": a.femur_m, "tibia": a.tibia_m, "hips": a.hips_m}
    for name, (upper_end, lower_end) in layout.bones().items():
        kind, _, side = name.partition("_")
        bones.append((upper_end, lower_end, lengths[kind], LIMITS_M[kind] if a.limits else None))
        order.append(name)
        if side:
            mean, std = a.femur_axis_deg if kind == "femur" else a.tibia_axis_deg
            mean = mean if side == "right" else 180.0 - mean
            knee = (layout.names.index(f"knee_{side}"), 0 if kind == "femur" else 1)
            angles.append((knee, len(bones) - 1, float(np.radians(mean)), float(np.radians(std))))
    differences = [
        (order.index(f"{bone}_right"), order.index(f"{bone}_left"), std)
        for bone, std in (("femur", a.femur_difference_m), ("tibia", a.tibia_difference_m))
        if f"{bone}_right" in order and f"{bone}_left" in order
    ]
    imus = [recording[name] for name in layout.placed.values()]
    rate_hz = recording.rate_hz
    noise = [s.gyr_noise, s.acc_noise, 1e-4, s.gyr_walk, s.acc_walk, s.gyr_noise * np.sqrt(rate_hz)]
    noise += [s.gyr_bias_std, s.acc_bias_std, s.center_std_m, GAUGE_STD, s.tail]
    key_samples = max(round(s.key_step_s * rate_hz), 1)
    return _core.BodyProblem(
        np.ascontiguousarray(recording.time_s),
        np.stack([imu.gyr for imu in imus]),
        np.stack([imu.acc for imu in imus]),
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
        [(skin.sensor, max(float(np.radians(s.soft_tissue_deg)), LEAST), max(s.soft_tissue_m, LEAST)) for skin in moved],
    )
