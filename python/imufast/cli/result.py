"""How a calibration is printed, and the exit code it means."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table
from rich.text import Text

from imufast.cli.show import console, plain, say
from imufast.decide import Verdict
from imufast.hinge import HingeCalibration
from imufast.imu import Imu
from imufast.report import words
from imufast.simulate import HingeSimulation

__all__ = ["beside_truth", "calibration", "demo_intro", "exit_code"]

Array = NDArray[np.float64]

NOT_ENOUGH_INFORMATION, NOT_A_HINGE, MOUNTING_CHANGED = 3, 4, 5


def exit_code(result: HingeCalibration) -> int:
    """0 accepted, 3 not enough information, 4 not a hinge, 5 the mounting changed on the way, accepted anew or not."""
    if result.mounting_changed_at_s or result.verdict is Verdict.MOUNTING_CHANGED:
        return MOUNTING_CHANGED
    if result.accepted:
        return 0
    return NOT_A_HINGE if result.verdict is Verdict.NOT_A_HINGE else NOT_ENOUGH_INFORMATION


def calibration(result: HingeCalibration, imu1: Imu, imu2: Imu) -> None:
    """Verdict in words, axes with bounds, misfit against its limits."""
    start_s = float(imu1.time_s[0])
    style = "bold green" if result.accepted else "bold yellow"
    say(words.headline(result), style)
    say(f"verdict: {result.verdict}, {'accepted' if result.accepted else 'not accepted'}")
    say(words.acceptance(result, start_s))
    for text in (words.mounting(result, start_s), words.advice(result)):
        if text:
            say(text)
    if result.axis1 is not None and result.axis2 is not None and result.bound95_deg is not None:
        say()
        say(f"Axis of {imu1.name} and {imu2.name}{'' if result.accepted else ', not accepted'}", "bold")
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        table.add_column("in the frame of", overflow="fold")
        for heading in ("x", "y", "z", "within\n95 % of cases"):
            table.add_column(heading, justify="right")
        for imu, vector, bound in ((imu1, result.axis1, result.bound95_deg[0]), (imu2, result.axis2, result.bound95_deg[1])):
            within = f"{bound:.2f}°" if bound < words.UNKNOWN_DEG else "unknown"
            table.add_row(Text(plain(imu.name)), *(f"{value:.4f}" for value in vector), within)
        console().print(table)
    settings = result.settings
    limits = f"a hinge up to {settings.hinge_misfit:g}, an approximate hinge up to {settings.approximate_misfit:g}"
    say(f"misfit to a hinge: {'unknown' if result.misfit is None else f'{result.misfit:.3f}'} ({limits})")
    for imu, bias in ((imu1, result.gyr_bias1), (imu2, result.gyr_bias2)):
        if bias is not None:
            x, y, z = np.round(np.degrees(bias), 2) + 0.0
            say(f"gyroscope bias seen at rest, {imu.name}: {x:.2f}, {y:.2f}, {z:.2f} °/s")
    say(f"samples used: {len(result.gyr_time_s)} gyroscope, {len(result.acc_time_s)} accelerometer of {len(imu1)}")


def demo_intro(simulation: HingeSimulation) -> None:
    """What is about to be shown."""
    turn_deg = float(np.degrees(np.ptp(simulation.angle_rad)))
    say("A simulated recording: two sensors, mounted anyhow, on two segments that a hinge joins", "bold")
    say(
        f"It bends by {turn_deg:.0f}° while both segments move about. Gyroscope biases "
        f"{np.degrees(np.linalg.norm(simulation.gyr_bias1)):.1f} °/s, accelerometer biases "
        f"{np.linalg.norm(simulation.acc_bias1):.1f} m/s², noise. The calibration sees only the raw data."
    )


def beside_truth(result: HingeCalibration, simulation: HingeSimulation, took_s: float) -> None:
    """Estimate beside truth, degrees; the common sign of the pair is free."""
    if result.axis1 is None or result.axis2 is None or result.bound95_deg is None:
        return
    turn = 1.0 if result.axis1 @ simulation.axis1 + result.axis2 @ simulation.axis2 > 0.0 else -1.0
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in ("", "truth x", "y", "z", "off by", "bound"):
        table.add_column(heading, justify="right")
    for name, vector, truth, bound in (
        ("sensor1", result.axis1, simulation.axis1, result.bound95_deg[0]),
        ("sensor2", result.axis2, simulation.axis2, result.bound95_deg[1]),
    ):
        off = angle_deg(turn * vector, truth)
        table.add_row(name, *(f"{value:.4f}" for value in turn * truth), f"{off:.2f}°", f"{bound:.2f}°")
    say()
    say("Beside the truth", "bold")
    console().print(table)
    say(f"The calibration took {1e3 * took_s:.0f} ms. Next: imufast info FILE... and imufast calibrate FILE1 FILE2")


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
