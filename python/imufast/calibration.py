"""Everything that is known of a joint and its two sensors, in one object: axis, centre, biases, noise, verdict."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.axis import JointAxis
from imufast.center import CenterEstimate, JointCenter
from imufast.decide import HingeStep, Verdict
from imufast.errors import InputError, SettingsError
from imufast.files import write_text
from imufast.hinge import HingeCalibration
from imufast.noise import SensorNoise
from imufast.samples import ReadOnly
from imufast.settings import check_number

__all__ = ["JointCalibration"]

Array = NDArray[np.float64]

SCHEMA = "imufast.joint-calibration"
SCHEMA_VERSION = 1
"""Raised whenever a name changes its meaning or goes away; new names do not raise it."""


def _zeros3() -> Array:
    return np.zeros(3)


@dataclass(frozen=True, eq=False)
class JointCalibration(ReadOnly):
    """A joint and the two sensors on its segments, as far as they are known. Made by `calibrate_joint`, or by hand: every part
    may be given, none must.

    Attributes:
        verdict: HINGE, APPROXIMATE_HINGE, BALL_JOINT, NOT_A_HINGE, NOT_ENOUGH_INFORMATION or MOUNTING_CHANGED.
        accepted: whether to trust it: a hinge by its own rules (see `HingeCalibration`), a ball joint by its centre.
        axis: the hinge axis in both sensor frames; None where there is none to speak of. Of what is nearly a hinge not that of
            `hinge`, but the one about which the joint turns most (`calibrate_joint`).
        center: the joint centre as seen from both sensors; None where the motion says next to nothing of it.
        gyr_bias1, gyr_bias2: (3,) subtract from the rates, rad/s. Default 0.
        acc_bias1, acc_bias2: (3,) subtract from the specific forces, m/s². Default 0.
        gyr_bias_std: standard deviation of each gyroscope bias channel, rad/s. Default 0.0087 (0.5 deg/s).
        relative_gyr_bias_std: what both biases leave uncertain of each channel of the relative rate, rad/s; less than √2
            gyr_bias_std where they were found from how the sensors move against each other. None: as much as that.
        acc_bias_covariance: (6, 6) of the stacked accelerometer biases, (m/s²)². Default 0.
        noise: of the sensors and of the joint; None where unknown.
        rate_ratio: how much the joint turns about its second axis over how much about its first; None where unknown.
        why: what stands in the way of acceptance, in words.
        history: the steps of the hinge's calibration.
        hinge: all that the hinge's calibration found; None by hand, after `load` and where it was not asked.
        estimate: all that the centre's estimate found; likewise.

    Raises:
        InputError: shapes that do not fit, values that are not finite, axes that are not unit vectors.
    """

    verdict: Verdict = Verdict.NOT_ENOUGH_INFORMATION
    accepted: bool = False
    axis: JointAxis | None = None
    center: JointCenter | None = None
    gyr_bias1: Array = field(default_factory=_zeros3)
    gyr_bias2: Array = field(default_factory=_zeros3)
    acc_bias1: Array = field(default_factory=_zeros3)
    acc_bias2: Array = field(default_factory=_zeros3)
    gyr_bias_std: float = 0.0087
    relative_gyr_bias_std: float | None = None
    acc_bias_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)), repr=False)
    noise: SensorNoise | None = None
    rate_ratio: float | None = None
    why: tuple[str, ...] = ()
    history: tuple[HingeStep, ...] = field(default=(), repr=False)
    hinge: HingeCalibration | None = field(default=None, repr=False)
    estimate: CenterEstimate | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, most in (("gyr_bias1", 100.0), ("gyr_bias2", 100.0), ("acc_bias1", 1e3), ("acc_bias2", 1e3)):
            object.__setattr__(self, name, _checked(name, getattr(self, name), (3,), most))
        name = "acc_bias_covariance"
        object.__setattr__(self, name, _checked(name, self.acc_bias_covariance, (6, 6)))
        if not isinstance(self.verdict, Verdict):
            object.__setattr__(self, "verdict", _verdict(self.verdict))
        if not isinstance(self.accepted, (bool, np.bool_)):
            raise InputError(f"accepted must be True or False, got {self.accepted!r}")
        object.__setattr__(self, "gyr_bias_std", _number("gyr_bias_std", self.gyr_bias_std, 1e9))
        if self.relative_gyr_bias_std is not None:
            name = "relative_gyr_bias_std"
            object.__setattr__(self, name, _number(name, self.relative_gyr_bias_std, 1e9))
        if self.rate_ratio is not None:
            object.__setattr__(self, "rate_ratio", _number("rate_ratio", self.rate_ratio, 1e3))
        if isinstance(self.why, str) or not all(isinstance(reason, str) for reason in self.why):
            raise InputError(f"why must be a tuple of sentences, got {self.why!r}")
        if self.axis is not None:
            if not isinstance(self.axis, JointAxis):
                raise InputError(f"axis must be a JointAxis or None, got {type(self.axis).__name__}")
            for name in ("axis1", "axis2"):
                vector = _checked(f"axis.{name}", getattr(self.axis, name), (3,))
                if abs(float(np.linalg.norm(vector)) - 1.0) > 1e-6:
                    raise InputError(f"axis.{name} must be a unit vector, got {vector.tolist()}")
            _checked("axis.covariance", self.axis.covariance, (6, 6))
            _checked("axis.bound95_deg", self.axis.bound95_deg, (2,))
        if self.center is not None:
            if not isinstance(self.center, JointCenter):
                raise InputError(f"center must be a JointCenter or None, got {type(self.center).__name__}")
            for name in ("in_sensor1", "in_sensor2"):
                _checked(f"center.{name}", getattr(self.center, name), (3,), 1e3)
            _checked("center.covariance", self.center.covariance, (6, 6))
            _checked("center.undetermined", self.center.undetermined, (np.shape(self.center.undetermined)[:1] or (0,)) + (6,))
        if self.noise is not None:
            if not isinstance(self.noise, SensorNoise):
                raise InputError(f"noise must be a SensorNoise or None, got {type(self.noise).__name__}")
            for name, value in asdict(self.noise).items():
                if name != "link_std" or value is not None:
                    _number(f"noise.{name}", value, 1e9)
        super().__post_init__()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as versioned JSON (`schema`, `schema_version`; units in the names), whole or not at all. `hinge` and
        `estimate`, the evidence, are not part of it.

        Raises:
            InputError: the path cannot be written.
        """
        write_text(path, json.dumps(self._plain(), allow_nan=True, indent=1) + "\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> JointCalibration:
        """The calibration that `save` wrote.

        Raises:
            InputError: no such file, not a calibration, damaged, or of a newer version.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError, TypeError, ValueError) as error:
            raise InputError(f"path {str(path)!r} cannot be read as a calibration: {error}") from None
        try:
            plain = json.loads(text)
            if not isinstance(plain, dict) or plain.get("schema") != SCHEMA:
                raise ValueError("it is not a joint calibration that imufast saved")
            if plain["schema_version"] > SCHEMA_VERSION:
                raise ValueError(f"it is of version {plain['schema_version']}, this imufast knows {SCHEMA_VERSION}: update it")
            return cls._from_plain(plain)
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError, InputError) as error:
            reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            raise InputError(f"path {str(path)!r} holds no calibration: {reason}") from None

    def _plain(self) -> dict[str, Any]:
        axis, center = self.axis, self.center
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict.value,
            "accepted": self.accepted,
            "rate_ratio": self.rate_ratio,
            "why": list(self.why),
            "axis": axis
            and {
                "axis1": axis.axis1.tolist(),
                "axis2": axis.axis2.tolist(),
                "covariance_rad2": axis.covariance.tolist(),
                "bound95_deg": axis.bound95_deg.tolist(),
            },
            "center": center
            and {
                "in_sensor1_m": center.in_sensor1.tolist(),
                "in_sensor2_m": center.in_sensor2.tolist(),
                "covariance_m2": center.covariance.tolist(),
                "undetermined": center.undetermined.tolist(),
            },
            "gyr_bias1_rad_s": self.gyr_bias1.tolist(),
            "gyr_bias2_rad_s": self.gyr_bias2.tolist(),
            "gyr_bias_std_rad_s": self.gyr_bias_std,
            "relative_gyr_bias_std_rad_s": self.relative_gyr_bias_std,
            "acc_bias1_m_s2": self.acc_bias1.tolist(),
            "acc_bias2_m_s2": self.acc_bias2.tolist(),
            "acc_bias_covariance_m2_s4": self.acc_bias_covariance.tolist(),
            "noise": self.noise and asdict(self.noise),
            "history": [step.plain() for step in self.history],
        }

    @classmethod
    def _from_plain(cls, plain: dict[str, Any]) -> JointCalibration:
        axis, center, noise = plain["axis"], plain["center"], plain["noise"]
        for name in ("why", "history"):
            if not isinstance(plain[name], list):
                raise ValueError(f"{name} is no list")
        return cls(
            verdict=Verdict(plain["verdict"]),
            accepted=plain["accepted"],
            axis=None
            if axis is None
            else JointAxis(
                _checked("axis1", axis["axis1"], (3,)),
                _checked("axis2", axis["axis2"], (3,)),
                np.array(axis["covariance_rad2"], np.float64).reshape(6, 6),
                np.array(axis["bound95_deg"], np.float64).reshape(2),
            ),
            center=None
            if center is None
            else JointCenter(
                _checked("in_sensor1_m", center["in_sensor1_m"], (3,)),
                _checked("in_sensor2_m", center["in_sensor2_m"], (3,)),
                np.array(center["covariance_m2"], np.float64).reshape(6, 6),
                np.array(center["undetermined"], np.float64).reshape(-1, 6),
            ),
            gyr_bias1=plain["gyr_bias1_rad_s"],
            gyr_bias2=plain["gyr_bias2_rad_s"],
            gyr_bias_std=plain["gyr_bias_std_rad_s"],
            relative_gyr_bias_std=plain.get("relative_gyr_bias_std_rad_s"),
            acc_bias1=plain["acc_bias1_m_s2"],
            acc_bias2=plain["acc_bias2_m_s2"],
            acc_bias_covariance=plain["acc_bias_covariance_m2_s4"],
            noise=None if noise is None else SensorNoise(**noise),
            rate_ratio=plain.get("rate_ratio"),
            why=tuple(str(reason) for reason in plain["why"]),
            history=tuple(HingeStep.from_plain(step) for step in plain["history"]),
        )


def _checked(name: str, value: object, shape: tuple[int, ...], most: float = 1e12) -> Array:
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be numbers of shape {shape}, got {type(value).__name__}") from None
    if array.shape != shape or not (np.abs(array) <= most).all():
        raise InputError(f"{name} must be finite numbers of shape {shape} and at most {most:g} in size, got {value!r}")
    array.flags.writeable = False
    return array


def _number(name: str, value: object, most: float) -> float:
    try:
        return check_number(name, value, 0.0, most)
    except SettingsError as error:
        raise InputError(str(error)) from None


def _verdict(value: object) -> Verdict:
    try:
        return Verdict(value)
    except ValueError:
        raise InputError(f"verdict must be one of {', '.join(Verdict)}, got {value!r}") from None
