"""How a calibration is printed, and the exit code it means."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table
from rich.text import Text

from imufast.calibration import JointCalibration
from imufast.cli.show import console, plain, say
from imufast.decide import Verdict
from imufast.imu import Imu
from imufast.report import joint_words, words

__all__ = ["calibration", "exit_code"]

Array = NDArray[np.float64]

NOT_ENOUGH_INFORMATION, NOT_A_HINGE, MOUNTING_CHANGED = 3, 4, 5


def exit_code(result: JointCalibration) -> int:
    """0 accepted, 3 not enough information, 4 neither a hinge nor (unless a hinge was asked for) a ball joint, 5 the mounting
    changed on the way, accepted anew or not."""
    changed = result.hinge is not None and bool(result.hinge.mounting_changed_at_s)
    if changed or result.verdict is Verdict.MOUNTING_CHANGED:
        return MOUNTING_CHANGED
    if result.accepted:
        return 0
    return NOT_A_HINGE if result.verdict is Verdict.NOT_A_HINGE else NOT_ENOUGH_INFORMATION


def calibration(result: JointCalibration, imu1: Imu, imu2: Imu) -> None:
    """Verdict in words, axes with bounds, the joint centre and what is open of it, misfit, biases."""
    start_s = float(imu1.time_s[0])
    style = "bold green" if result.accepted else "bold yellow"
    say(joint_words.headline(result), style)
    say(f"verdict: {result.verdict}, {'accepted' if result.accepted else 'not accepted'}")
    say(joint_words.acceptance(result, start_s))
    for text in (joint_words.mounting(result, start_s), joint_words.advice(result)):
        if text:
            say(text)
    _axes(result, imu1, imu2)
    _center(result, imu1, imu2)
    hinge = result.hinge
    if hinge is not None:
        settings = hinge.settings
        limits = f"a hinge up to {settings.hinge_misfit:g}, an approximate hinge up to {settings.approximate_misfit:g}"
        say(f"misfit to a hinge: {'unknown' if hinge.misfit is None else f'{hinge.misfit:.3f}'} ({limits})")
    for imu, bias in ((imu1, result.gyr_bias1), (imu2, result.gyr_bias2)):
        if bias.any():
            x, y, z = np.round(np.degrees(bias), 2) + 0.0
            say(f"gyroscope bias seen at rest, {imu.name}: {x:.2f}, {y:.2f}, {z:.2f} °/s")
    if result.center is not None:
        std = np.sqrt(np.maximum(np.diag(result.acc_bias_covariance), 0.0)).reshape(2, 3)
        for imu, bias, each in ((imu1, result.acc_bias1, std[0]), (imu2, result.acc_bias2, std[1])):
            if bias.any():
                told = ", ".join(f"{value + 0.0:.3f} ± {one:.3f}" for value, one in zip(np.round(bias, 3), each, strict=True))
                say(f"accelerometer bias, {imu.name}: {told} m/s²")
    used = [] if hinge is None else [f"{len(hinge.gyr_time_s)} gyroscope, {len(hinge.acc_time_s)} accelerometer for the axis"]
    used += [] if result.estimate is None else [f"{result.estimate.n_samples} for the centre"]
    say(f"samples used: {', '.join(used)}, of {len(imu1)}")


def _axes(result: JointCalibration, imu1: Imu, imu2: Imu) -> None:
    axis = result.axis
    if axis is None:
        return
    say()
    say(f"Axis of {imu1.name} and {imu2.name}{'' if result.accepted else ', not accepted'}", "bold")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("in the frame of", overflow="fold")
    for heading in ("x", "y", "z", "within\n95 % of cases"):
        table.add_column(heading, justify="right")
    for imu, vector, bound in ((imu1, axis.axis1, axis.bound95_deg[0]), (imu2, axis.axis2, axis.bound95_deg[1])):
        within = f"{bound:.2f}°" if bound < words.UNKNOWN_DEG else "unknown"
        table.add_row(Text(plain(imu.name)), *(f"{value:.4f}" for value in vector), within)
    console().print(table)


def _center(result: JointCalibration, imu1: Imu, imu2: Imu) -> None:
    center, estimate = result.center, result.estimate
    names = imu1.name, imu2.name
    say()
    if center is None:
        if estimate is not None:
            say(f"Joint centre of {imu1.name} and {imu2.name}: not found", "bold")
            say(joint_words.center_summary(estimate))
        return
    say(f"Joint centre of {imu1.name} and {imu2.name}{'' if result.accepted else ', not accepted'}", "bold")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("as seen from", overflow="fold")
    for heading in ("x\nmm", "y\nmm", "z\nmm", "away\nmm", "std\nmm"):
        table.add_column(heading, justify="right")
    for imu, vector, std in zip((imu1, imu2), (center.in_sensor1, center.in_sensor2), center.determined_std, strict=True):
        values = np.round(1e3 * vector, 1) + 0.0
        away, std = 1e3 * float(np.linalg.norm(vector)), 1e3 * float(std)
        table.add_row(Text(plain(imu.name)), *(f"{v:.1f}" for v in values), f"{away:.1f}", f"{std:.2f}")
    console().print(table)
    for said in joint_words.undetermined_words(center.undetermined, result.axis, names):
        say(f"not told by the motion, and left out of std: {said}")
    if estimate is not None:
        say(f"residual: {joint_words.residual_summary(estimate.residual_std, estimate.unexplained)}")
