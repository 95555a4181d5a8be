"""imufast: raw recordings of body-worn inertial sensors in; trusted joint calibration and joint motion out.

Units are SI (rad/s, m/s², s, m); names that end in `_deg` are degrees. Quaternions are Hamilton, scalar first.
"""

from __future__ import annotations

from imufast.angles import AngleStatus, AngleStd, JointAngles
from imufast.axis import HingeAxis, HingeMinimum, JointAxis, SolveStatus, estimate_hinge_axis
from imufast.body import BodyJoint, BodyStatus, LowerBody, estimate_lower_body
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.calibrate import calibrate_joint
from imufast.calibration import JointCalibration
from imufast.center import (
    CenterEstimate,
    CenterStatus,
    JointCenter,
    JointCenterEstimator,
    estimate_joint_center,
    fit_joint_center,
)
from imufast.decide import HingeStep, Verdict
from imufast.deviation import angular_deviation_deg
from imufast.errors import FileFormatError, ImufastError, ImufastWarning, InputError, MissingFileError, SettingsError, UnitError
from imufast.filters import Complementary, Mekf, OrientationFilter
from imufast.frames import SegmentFrame, segment_frame
from imufast.hinge import HingeCalibration, HingeCalibrator, calibrate_hinge
from imufast.hinge_angle import hinge_angle, hinge_angle_deg
from imufast.imu import Imu, ReadInfo, Recording
from imufast.io import align, read, write_angles, write_orientation
from imufast.joint_angles import joint_angles, joint_angles_deg
from imufast.noise import SensorNoise
from imufast.report import report_json, write_animation, write_figure, write_json, write_report
from imufast.select import SampleSelection, select_samples
from imufast.settings import AxisSettings, CenterSettings, HingeSettings
from imufast.simulate import (
    Anatomy,
    BallJointSimulation,
    BallMotion,
    BodyMotion,
    Collisions,
    HingeSimulation,
    LegTissue,
    LowerBodySimulation,
    Motion,
    SoftTissue,
    paper_rig,
    random_anatomy,
    random_biases,
    random_positions,
    random_tissue,
    simulate_ball_joint,
    simulate_hinge,
    simulate_lower_body,
)
from imufast.smoother import Smoother
from imufast.sync import TimeOffset, time_offset
from imufast.track import RelativeOrientation, TrackStatus, track, track_many

__all__ = [
    "Anatomy",
    "AngleStatus",
    "AngleStd",
    "Anthropometry",
    "AxisSettings",
    "BallJointSimulation",
    "BallMotion",
    "BodyJoint",
    "BodyMotion",
    "BodyStatus",
    "CenterEstimate",
    "CenterSettings",
    "CenterStatus",
    "Collisions",
    "Complementary",
    "FileFormatError",
    "HingeAxis",
    "HingeCalibration",
    "HingeCalibrator",
    "HingeMinimum",
    "HingeSettings",
    "HingeSimulation",
    "HingeStep",
    "Imu",
    "ImufastError",
    "ImufastWarning",
    "InputError",
    "JointAngles",
    "JointAxis",
    "JointCalibration",
    "JointCenter",
    "JointCenterEstimator",
    "LegTissue",
    "LowerBody",
    "LowerBodySettings",
    "LowerBodySimulation",
    "Mekf",
    "MissingFileError",
    "Motion",
    "OrientationFilter",
    "ReadInfo",
    "Recording",
    "RelativeOrientation",
    "SampleSelection",
    "SegmentFrame",
    "SensorNoise",
    "SettingsError",
    "Smoother",
    "SoftTissue",
    "SolveStatus",
    "TimeOffset",
    "TrackStatus",
    "UnitError",
    "Verdict",
    "align",
    "angular_deviation_deg",
    "calibrate_hinge",
    "calibrate_joint",
    "estimate_hinge_axis",
    "estimate_joint_center",
    "estimate_lower_body",
    "fit_joint_center",
    "hinge_angle",
    "hinge_angle_deg",
    "joint_angles",
    "joint_angles_deg",
    "paper_rig",
    "random_anatomy",
    "random_biases",
    "random_positions",
    "random_tissue",
    "read",
    "report_json",
    "segment_frame",
    "select_samples",
    "simulate_ball_joint",
    "simulate_hinge",
    "simulate_lower_body",
    "time_offset",
    "track",
    "track_many",
    "write_angles",
    "write_animation",
    "write_figure",
    "write_json",
    "write_orientation",
    "write_report",
]
