"""imufast: raw recordings of body-worn inertial sensors in; trusted joint calibration and joint motion out.

Units are SI (rad/s, m/s², s, m); names that end in `_deg` are degrees. Quaternions are Hamilton, scalar first.
"""

from __future__ import annotations

from imufast.axis import HingeAxis, HingeMinimum, SolveStatus, estimate_hinge_axis
from imufast.errors import FileFormatError, ImufastError, ImufastWarning, InputError, SettingsError, UnitError
from imufast.imu import Imu, Recording
from imufast.settings import HingeSettings

__all__ = [
    "FileFormatError",
    "HingeAxis",
    "HingeMinimum",
    "HingeSettings",
    "Imu",
    "ImufastError",
    "ImufastWarning",
    "InputError",
    "Recording",
    "SettingsError",
    "SolveStatus",
    "UnitError",
    "estimate_hinge_axis",
]
