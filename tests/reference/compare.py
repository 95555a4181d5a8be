"""What the tests of Algorithm 1 share: estimates from simulations and how far they are off."""

from __future__ import annotations

from typing import Any

import numpy as np
from imufast import HingeAxis, HingeSimulation, estimate_hinge_axis
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Motions of section 7.1 that excite the joint; 1, 2, 8, 9 (at rest, stiff) hold nothing about the axis.
INFORMATIVE = (3, 4, 5, 6, 7, 10, 11, 12, 13, 14)
UNINFORMATIVE = (1, 2, 8, 9)


def angle_deg(a: Array, b: Array) -> float:
    """Angle between two axes, their sign free; exact near 0."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))


def error_deg(axis: HingeAxis, truth: HingeSimulation) -> Array:
    return np.array([angle_deg(axis.axis1, truth.axis1), angle_deg(axis.axis2, truth.axis2)])


def estimate(simulation: HingeSimulation, **settings: Any) -> HingeAxis:
    return estimate_hinge_axis(simulation.imu1, simulation.imu2, **settings)
