"""Filters of the relative orientation: their settings, and the filter that runs sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.calibration import JointCalibration
from imufast.errors import InputError, SettingsError
from imufast.samples import as_array
from imufast.settings import Checked, check_choice, check_number

__all__ = ["Complementary", "Mekf", "OrientationFilter"]

Array: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class FilterSettings(Checked):
    """What both filters share.

    Args:
        midpoint: the turn between two samples is the mean of their rates; False: the later rate alone, as published.
            Default True.
        start_std: the closed-form start ends when it knows the orientation to this, rad (root of the trace); small waits long,
            large begins vaguely. Default 0.035 (2 degrees).
        start_fade_s: time constant with which old instants fade in the start, s; after as long, a start three times as vague
            will do. Default 10.
        max_gap_s: a longer gap makes the filter start anew, s; a shorter one widens its uncertainty. Default 0.5.
        restart: start anew after such a gap, and when the horizontal accelerations of the two sensors contradict the heading.
            Default True.
        scale_noise: uncertainty that turning adds, rad per √s for each rad/s: gyroscope scales and cross-axis errors. Small
            trusts the gyroscopes. Default 0.0014 (0.4 % that holds for a tenth of a second or so).
        precision: "double" or "single". Default "double".

    Raises:
        SettingsError: a value is out of its range.
    """

    midpoint: bool = True
    start_std: float = 0.035
    start_fade_s: float = 10.0
    max_gap_s: float = 0.5
    restart: bool = True
    scale_noise: float = 0.0014
    precision: str = "double"

    def __post_init__(self) -> None:
        self._flag("midpoint")
        self._flag("restart")
        self._number("start_std", 1e-6, 10.0)
        self._number("start_fade_s", 0.01, 1e6)
        self._number("max_gap_s", 0.0, 1e6)
        self._number("scale_noise", 0.0, 1.0)
        check_choice("precision", self.precision, ("double", "single"))

    def start(
        self, calibration: JointCalibration, *, rate_hz: float, q_12: ArrayLike | None = None, angle_std_deg: float = 2.0
    ) -> OrientationFilter:
        """A filter for samples as they come.

        Args:
            calibration: of the joint; what it does not know (centre, biases, noise) is taken as zero or typical.
            rate_hz: nominal rate of the samples, Hz.
            q_12: (4,) orientation at the first sample, w x y z, sensor 2 to sensor 1; None: the closed form over the first
                seconds finds it.
            angle_std_deg: how well `q_12` is known, degrees (root of the trace).

        Raises:
            InputError: not a calibration, not a rate, not a quaternion.
        """
        return OrientationFilter(_core.OrientationFilter(plan(self, calibration, rate_hz, q_12, angle_std_deg)))

    def _method(self) -> dict[str, Any]:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Complementary(FilterSettings):
    """The complementary filter of Remmerswaal et al. 2021 (Algorithm 1): half the price of the Kalman filter.

    Args:
        beta: speed of the correction (eq. 12), rad/s; small trusts the gyroscopes. Default 0.1.
        beta_extra: added to `beta` after a start, fading with `settle_s`, rad/s. Default 0.
        settle_s: time constant of that, s. Default 5.
        heading_gain: the part of the gradient about the vertical counts so many times; tilt is seen at every instant, heading
            only where the joint accelerates sideways. Less so where accelerations have no common direction, as gravity gives
            them. Default 8; 1 is the paper's.
        soft_angle: angle between the two accelerations at which the normalised step has 0.7 of its size, rad: below it noise
            rules. Default 0.01; 0 is the paper's.
        drift_limit: the correction is at most as fast as √3 standard deviations of the drift that it undoes, as in the paper;
            of what grows with motion (scale and cross-axis errors, biases) so many times these, for it is known less well than
            the gyroscopes' noise. Default 1.5; 0: as fast as `beta` says, as published.
        bias_gain: feedback of the correction to the gyroscope biases, 1/s. Default 0: none.
        literal: the gradient at the previous orientation and the first-order step of eq. 5b, as published. Default False.

    Further settings as in `FilterSettings`: midpoint, start_std, start_fade_s, max_gap_s, restart, scale_noise, precision.

    Raises:
        SettingsError: a value is out of its range.
    """

    beta: float = 0.1
    beta_extra: float = 0.0
    settle_s: float = 5.0
    heading_gain: float = 8.0
    soft_angle: float = 0.01
    drift_limit: float = 1.5
    bias_gain: float = 0.0
    literal: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._number("beta", 0.0, 1e3)
        self._number("beta_extra", 0.0, 1e3)
        self._number("settle_s", 1e-3, 1e6)
        self._number("heading_gain", 0.0, 1e6)
        self._number("soft_angle", 0.0, math.pi)
        self._number("drift_limit", 0.0, 1e6)
        self._number("bias_gain", 0.0, 1e3)
        self._flag("literal")

    @classmethod
    def as_published(cls, gyr_std: float = math.radians(1.0)) -> Complementary:
        """The paper's own choice: Algorithm 1 to the letter with β = √3 σ of the gyroscopes (rad/s; theirs is 1 deg/s)."""
        beta = math.sqrt(3.0) * check_number("gyr_std", gyr_std, 0.0, 1e3)
        return cls(
            beta=beta,
            heading_gain=1.0,
            soft_angle=0.0,
            drift_limit=0.0,
            literal=True,
            midpoint=False,
            restart=False,
            scale_noise=0.0,
        )

    def _method(self) -> dict[str, Any]:
        names = ("beta", "beta_extra", "settle_s", "heading_gain", "soft_angle", "drift_limit", "bias_gain", "literal")
        return {"method": "complementary"} | _KALMAN_UNUSED | {name: getattr(self, name) for name in names}


@dataclass(frozen=True, kw_only=True)
class Mekf(FilterSettings):
    """Multiplicative extended Kalman filter on the link constraint (Weygers & Kok 2020), with an honest covariance.

    Args:
        outliers: innovations larger than expected are used all the same ("none"), not used ("reject"), or count less the
            larger they are ("downweight"). Default "downweight".
        limit: squared normalised innovation from which on that is so. Default 5; the paper's gate is 7.81 (95 % of χ² with
            three degrees of freedom).
        adapt: the innovations set the measurement noise and the drift; False: both stay as given, as published. Default True.

    Further settings as in `FilterSettings`: midpoint, start_std, start_fade_s, max_gap_s, restart, scale_noise, precision.

    Raises:
        SettingsError: a value is out of its range.
    """

    outliers: str = "downweight"
    limit: float = 5.0
    adapt: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("outliers", self.outliers, ("none", "reject", "downweight"))
        self._number("limit", 0.0, 1e9, low_open=True)
        self._flag("adapt")

    @classmethod
    def as_published(cls, outliers: str = "reject") -> Mekf:
        """The paper's own choice: fixed noise, the later rate holds, `outliers` "none" or "reject" with the 95 % gate."""
        return cls(outliers=outliers, limit=7.81, adapt=False, midpoint=False, restart=False, scale_noise=0.0)

    def _method(self) -> dict[str, Any]:
        return {"method": "mekf"} | _COMPLEMENTARY_UNUSED | {name: getattr(self, name) for name in _KALMAN_UNUSED}


_KALMAN_UNUSED: dict[str, Any] = {"outliers": "none", "limit": 1.0, "adapt": False}
_COMPLEMENTARY_UNUSED: dict[str, Any] = {
    "beta": 0.0,
    "beta_extra": 0.0,
    "settle_s": 1.0,
    "heading_gain": 1.0,
    "soft_angle": 0.0,
    "drift_limit": 0.0,
    "bias_gain": 0.0,
    "literal": False,
}
TYPICAL_GYR_STD = 0.004
TYPICAL_ACC_STD = 0.05


def plan(
    settings: FilterSettings,
    calibration: JointCalibration,
    rate_hz: float,
    q_12: ArrayLike | None = None,
    angle_std_deg: float = 2.0,
    names: tuple[str, str] = ("q_12", "angle_std_deg"),
) -> dict[str, Any]:
    """What the core needs to know; `names` are what the caller calls the last two."""
    if not isinstance(calibration, JointCalibration):
        raise InputError(f"calibration must be a JointCalibration, got {type(calibration).__name__}")
    center, noise = calibration.center, calibration.noise
    try:
        rate = check_number("rate_hz", rate_hz, 0.0, 9e8, low_open=True)
        std = math.radians(check_number(names[1], angle_std_deg, 0.0, 180.0, low_open=True))
    except SettingsError as error:
        raise InputError(str(error)) from None
    gyr_std, acc_std = TYPICAL_GYR_STD, TYPICAL_ACC_STD
    if noise is not None:
        # Seen in a recording full of impacts they hold motion, which the filter is not to take for noise.
        gyr_std = min(math.hypot(noise.gyr_std1, noise.gyr_std2) / math.sqrt(2.0), 5.0 * TYPICAL_GYR_STD)
        acc_std = min(math.hypot(noise.acc_std1, noise.acc_std2) / math.sqrt(2.0), 5.0 * TYPICAL_ACC_STD)
    relative_std = calibration.relative_gyr_bias_std
    if relative_std is None:
        relative_std = math.sqrt(2.0) * calibration.gyr_bias_std
    return {
        "single": settings.precision == "single",
        "rate_hz": rate,
        "r1": [0.0, 0.0, 0.0] if center is None else [-x for x in center.in_sensor1.tolist()],
        "r2": [0.0, 0.0, 0.0] if center is None else [-x for x in center.in_sensor2.tolist()],
        "gyr_bias": [calibration.gyr_bias1.tolist(), calibration.gyr_bias2.tolist()],
        "acc_bias": [calibration.acc_bias1.tolist(), calibration.acc_bias2.tolist()],
        "relative_bias_std": min(relative_std, 1.0),
        "gyr_std": gyr_std,
        "acc_std": acc_std,
        "start": None if q_12 is None else _quaternion(names[0], q_12),
        "start_given_std": std,
        "midpoint": settings.midpoint,
        "start_std": settings.start_std,
        "start_fade_s": settings.start_fade_s,
        "max_gap_s": settings.max_gap_s,
        "restart": settings.restart,
        "scale_noise": settings.scale_noise,
    } | settings._method()


def _quaternion(name: str, value: ArrayLike) -> list[float]:
    try:
        q = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be four numbers, got {type(value).__name__}") from None
    if q.shape != (4,) or not abs(float(np.linalg.norm(q)) - 1.0) < 1e-3:
        raise InputError(f"{name} must be a unit quaternion w, x, y, z, got {value!r}")
    return [float(x) for x in q / np.linalg.norm(q)]


class OrientationFilter:
    """A filter of the relative orientation, sample by sample; made by `Complementary(...).start` or `Mekf(...).start`.

    The accelerations of a sample are used `delay_s` later, when its neighbours are there to differentiate the rates with; until
    then the gyroscopes bridge, so what `update` returns always belongs to the sample just given. Any cutting into blocks gives
    the same bits.
    """

    __slots__ = ("_core", "_update")

    def __init__(self, core: _core.OrientationFilter) -> None:
        self._core = core
        self._update = core.update

    def update(
        self, gyr1: ArrayLike, acc1: ArrayLike, gyr2: ArrayLike, acc2: ArrayLike, time_s: ArrayLike | None = None
    ) -> Array:
        """Take samples and return q_12, (4,) or (N, 4): w x y z, sensor 2 to sensor 1, at each sample.

        Args:
            gyr1, acc1, gyr2, acc2: (3,) one sample or (N, 3) a block, rad/s and m/s², in sensor frames.
            time_s: time of the sample or (N,) times, s, increasing also from call to call; with every call or with none.

        Raises:
            InputError: shapes that do not fit, values that are not finite, time that goes back. Nothing of the block is taken.
        """
        try:
            return self._update(gyr1, acc1, gyr2, acc2, time_s)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            names = ("gyr1", "acc1", "gyr2", "acc2")
            values = (gyr1, acc1, gyr2, acc2)
            g1, a1, g2, a2 = (as_array(name, value) for name, value in zip(names, values, strict=True))
            time = None if time_s is None else np.atleast_1d(as_array("time_s", time_s))
            try:
                return self._update(g1, a1, g2, a2, time)
            except ValueError as error:
                raise InputError(str(error)) from None

    @property
    def angle_std_deg(self) -> float:
        """Standard deviation of the latest q_12: root of the trace of its 3x3 error covariance, degrees."""
        return math.degrees(self._core.angle_std)

    @property
    def status(self) -> str:
        """Of the latest q_12: "starting" (the motion does not determine it yet), "tracking" or "coasting" (vague by now)."""
        return self._core.status

    @property
    def heading_power(self) -> float:
        """What relative heading is seen by: mean square of the joint's horizontal acceleration over ten seconds, (m/s²)². It is
        the smallest eigenvalue of the mean of [a×]ᵀ[a×]; near 0 only the gyroscopes carry the heading."""
        return self._core.heading_power

    @property
    def restarts(self) -> int:
        """How often the filter has started anew."""
        return self._core.restarts

    @property
    def delay_s(self) -> float:
        """By how much later than its sample an acceleration is used, s."""
        return self._core.delay_s

    def state(self) -> bytes:
        """Everything it knows, as bytes of a stated version: `restore` goes on exactly where this stands."""
        return self._core.state()

    @classmethod
    def restore(cls, state: bytes) -> OrientationFilter:
        """The filter whose `state` this is. Raises InputError when the bytes are damaged or of another version."""
        if not isinstance(state, bytes):
            raise InputError(f"state must be the bytes that OrientationFilter.state() gave, got {type(state).__name__}")
        try:
            return cls(_core.OrientationFilter.restore(state))
        except ValueError as error:
            raise InputError(f"state cannot be restored: {error}") from None
