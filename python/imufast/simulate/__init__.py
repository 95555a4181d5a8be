"""Physically consistent recordings of body-worn IMUs with exactly known truth."""

from __future__ import annotations

from .ball_joint import simulate_ball_joint
from .ball_motions import BallMotion, paper_segment
from .body_motions import BodyMotion
from .body_tissue import LegTissue
from .body_tree import Anatomy, random_anatomy
from .disturbances import Collisions, TissueMatrices, random_tissue
from .hinge import simulate_hinge
from .lower_body import LowerBodySimulation, simulate_lower_body
from .motions import Motion, paper_motion, scenario_motions
from .placement import PaperRig, SensorPositions, paper_rig, random_positions
from .sensors import SensorBiases, random_biases
from .simulation import BallJointSimulation, HingeSimulation, PairSimulation
from .soft_tissue import SoftTissue

__all__ = [
    "Anatomy",
    "BallJointSimulation",
    "BallMotion",
    "BodyMotion",
    "Collisions",
    "HingeSimulation",
    "LegTissue",
    "LowerBodySimulation",
    "Motion",
    "PairSimulation",
    "PaperRig",
    "SensorBiases",
    "SensorPositions",
    "SoftTissue",
    "TissueMatrices",
    "paper_motion",
    "paper_rig",
    "paper_segment",
    "random_anatomy",
    "random_biases",
    "random_positions",
    "random_tissue",
    "scenario_motions",
    "simulate_ball_joint",
    "simulate_hinge",
    "simulate_lower_body",
]
