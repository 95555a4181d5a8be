"""The lower body from up to seven IMUs (McGrath & Stirling 2020)."""

from imufast.body.estimate import estimate_lower_body
from imufast.body.layout import JOINTS, SEGMENTS
from imufast.body.placement import Placement, read_placement
from imufast.body.result import BodyJoint, BodyStatus, BodyWindow, LowerBody
from imufast.body.settings import Anthropometry, LowerBodySettings

__all__ = [
    "JOINTS",
    "SEGMENTS",
    "Anthropometry",
    "BodyJoint",
    "BodyStatus",
    "BodyWindow",
    "LowerBody",
    "LowerBodySettings",
    "Placement",
    "estimate_lower_body",
    "read_placement",
]
