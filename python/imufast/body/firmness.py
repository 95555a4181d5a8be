"""How firmly the sensors of a recording sit: by how far apart they see each joint while it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.layout import Layout
from imufast.body.settings import LowerBodySettings

__all__ = ["firmness"]

Array = NDArray[np.float64]
REPEATS_S = 4.0
"""What soft tissue does at a joint repeats with the movement: residuals count as one every so many seconds, about two strides
or one slow movement there and back."""
LEAST = 0.5
"""No less than this share of what was stated is taken: what goes with the movement in all repetitions alike, residuals hide."""


def firmness(layout: Layout, graph: _core.BodyProblem, fit: _core.BodyFit, settings: LowerBodySettings) -> Array:
    """(J,) share of the stated standard deviation of each joint's centre that this recording asks for, `LEAST` to 1.

    Residuals count with the squares of the rates of the joint's two sensors, for only movement tells where its centre is; their
    root mean square, inflated for that they repeat, is the standard deviation that they show.

    Args:
        layout: joints and sensors.
        graph: what was searched, with the stated standard deviations.
        fit: what was found.
        settings: the same.
    """
    rates = (graph.rates**2).sum(axis=2)
    found = np.ones(len(layout.names))
    for j, (upper, lower) in enumerate(layout.joints.values()):
        weight = rates[:, upper] + rates[:, lower] + 1e-9
        white = np.sqrt(np.average(fit.joint_squares[:, j, 0], weights=weight) / 3.0)
        found[j] = np.clip(white * np.sqrt(REPEATS_S / settings.key_step_s), LEAST, 1.0)
    return found
