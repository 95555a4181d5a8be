"""Physically consistent recordings of body-worn IMUs with exactly known truth."""

from __future__ import annotations

from .hinge import simulate_hinge
from .motions import Motion, paper_motion, scenario_motions
from .sensors import SensorBiases, random_biases
from .simulation import HingeSimulation
from .soft_tissue import SoftTissue

__all__ = [
    "HingeSimulation",
    "Motion",
    "SensorBiases",
    "SoftTissue",
    "paper_motion",
    "random_biases",
    "scenario_motions",
    "simulate_hinge",
]
