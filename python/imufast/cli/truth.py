"""What the demo shows: a simulated recording, and the calibration beside its truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich import box
from rich.table import Table

from imufast.calibration import JointCalibration
from imufast.cli.show import console, say
from imufast.simulate import HingeSimulation
from imufast.track import RelativeOrientation

__all__ = ["beside_truth", "demo_intro", "tracking_beside_truth"]

Array = NDArray[np.float64]


def demo_intro(simulation: HingeSimulation) -> None:
    """What is about to be shown."""
    turn_deg = float(np.degrees(np.ptp(simulation.angle_rad)))
    say("A simulated recording: two sensors, mounted anyhow, on two segments that a hinge joins", "bold")
    say(
        f"It bends by {turn_deg:.0f}° while both segments move about. Gyroscope biases "
        f"{np.degrees(np.linalg.norm(simulation.gyr_bias1)):.1f} °/s, accelerometer biases "
        f"{np.linalg.norm(simulation.acc_bias1):.1f} m/s², noise. The calibration sees only the raw data."
    )


def beside_truth(result: JointCalibration, simulation: HingeSimulation, took_s: float) -> None:
    """Estimate beside truth: the axis, whose common sign is free, degrees; the centre, whose place along it is open, mm."""
    say()
    say("Beside the truth", "bold")
    if result.axis is not None:
        axis = result.axis
        turn = 1.0 if axis.axis1 @ simulation.axis1 + axis.axis2 @ simulation.axis2 > 0.0 else -1.0
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for heading in ("", "true axis x", "y", "z", "off by", "bound"):
            table.add_column(heading, justify="right")
        for name, vector, truth, bound in (
            ("sensor1", axis.axis1, simulation.axis1, axis.bound95_deg[0]),
            ("sensor2", axis.axis2, simulation.axis2, axis.bound95_deg[1]),
        ):
            off = angle_deg(turn * vector, truth)
            table.add_row(name, *(f"{value:.4f}" for value in turn * truth), f"{off:.2f}°", f"{bound:.2f}°")
        console().print(table)
    if result.center is not None:
        center = result.center
        given = np.concatenate([center.in_sensor1, center.in_sensor2])
        truth = np.concatenate([simulation.joint_in_sensor1, simulation.joint_in_sensor2])
        # The truth, moved along what the motion does not tell to where the estimate lies.
        truth += center.undetermined.T @ (center.undetermined @ (given - truth))
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for heading in ("", "true centre x", "y", "z", "off by", "std"):
            table.add_column(heading, justify="right")
        for i, name in enumerate(("sensor1", "sensor2")):
            block = slice(3 * i, 3 * i + 3)
            off = float(np.linalg.norm(given[block] - truth[block]))
            values = np.round(1e3 * truth[block], 1) + 0.0
            std = float(center.determined_std[i])
            table.add_row(name, *(f"{value:.1f}" for value in values), f"{1e3 * off:.2f} mm", f"{1e3 * std:.2f} mm")
        console().print(table)
        say("The true centre is moved along the axis to where the estimate lies: any point of the axis is a centre of a hinge.")
    say(f"The calibration took {1e3 * took_s:.0f} ms.")


def tracking_beside_truth(rel: RelativeOrientation, simulation: HingeSimulation) -> None:
    """The relative orientation beside its truth, and what to do next."""
    # The sine of half the angle between two rotations, exact also for small ones.
    along = np.einsum("ij,ij->i", rel.q_12, simulation.q_12)
    across = np.linalg.norm(rel.q_12 - along[:, None] * simulation.q_12, axis=1)
    off = np.degrees(2.0 * np.arctan2(across, np.abs(along)))
    stated = float(np.sqrt((rel.angle_std_deg**2).mean()))
    say(
        f"Relative orientation, tracked over the whole recording: off by {float(np.sqrt((off**2).mean())):.2f}° rms, "
        f"{off.max():.2f}° at worst; stated {stated:.2f}°."
    )
    say("Next: imufast info FILE..., imufast calibrate FILE1 FILE2, and imufast track FILE1 FILE2")


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))
