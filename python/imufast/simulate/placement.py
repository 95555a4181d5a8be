"""Where sensors sit: on the rig of Olsson & Halvorsen 2017, or at random places."""

from __future__ import annotations

from typing import Literal, TypedDict

import numpy as np

from imufast.errors import SettingsError

from .checks import FloatArray, number, seed_number
from .signals import stream
from .so3 import random_direction

__all__ = ["PAPER_R1", "PAPER_R2", "PaperRig", "SensorPositions", "paper_rig", "random_positions"]

PAPER_R1 = np.array([0.334, 0.0, 0.028])
"""r1 of eq. 24, from the joint centre to sensor 1 in its frame, m."""
PAPER_R2 = np.array([-0.325, 0.0, 0.028])
"""r2 of eq. 25, from the joint centre to sensor 2 in its frame, m."""


class PaperRig(TypedDict):
    """Mounts, joint centre and freedom of the paper's rig, under the names that `simulate_ball_joint` takes."""

    mount1: FloatArray
    mount2: FloatArray
    joint_in_sensor1: FloatArray
    joint_in_sensor2: FloatArray
    dof: Literal[1, 2, 3]


class SensorPositions(TypedDict):
    """The joint centre as seen from both sensors, under the names that the simulations take: (3,), m."""

    joint_in_sensor1: FloatArray
    joint_in_sensor2: FloatArray


def paper_rig() -> PaperRig:
    """The rig of Olsson & Halvorsen 2017: lever arms of eqs 24 and 25, sensors aligned with the links, 2 degrees of freedom.

    The x axes of its sensors point from link 2 to link 1, so that either mount is half a turn about z.

    Returns:
        A mapping to hand on: `simulate_ball_joint("S3", **paper_rig())`.
    """
    half_turn = [0.0, 0.0, 0.0, 1.0]
    return PaperRig(
        mount1=np.array(half_turn), mount2=np.array(half_turn), joint_in_sensor1=-PAPER_R1, joint_in_sensor2=-PAPER_R2, dof=2
    )


def random_positions(seed: int = 0, *, least_m: float = 0.08, most_m: float = 0.4) -> SensorPositions:
    """The joint centre in a random direction from each sensor, at a random distance.

    Args:
        seed: non-negative integer; the same seed gives the same places.
        least_m, most_m: bounds of the distance, m; defaults 0.08 and 0.4.

    Returns:
        A mapping to hand on: `simulate_ball_joint(**random_positions(7))`.

    Raises:
        SettingsError: a negative distance or seed, or bounds in the wrong order.
    """
    rng = stream(seed_number(seed), "positions")
    least_m = number("least_m", least_m, least=0.0)
    if number("most_m", most_m, least=0.0) < least_m:
        raise SettingsError(f"most_m must not be less than least_m = {least_m:g}; got {most_m:g}")
    return SensorPositions(
        joint_in_sensor1=rng.uniform(least_m, most_m) * random_direction(rng),
        joint_in_sensor2=rng.uniform(least_m, most_m) * random_direction(rng),
    )
