"""Settings of the algorithms: frozen, checked when made, refusing what they do not know."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from numbers import Integral, Real
from typing import Any, TypeVar, cast

from imufast.errors import SettingsError

__all__ = ["AxisSettings", "CenterSettings", "HingeSettings", "settings_from"]


def check_number(name: str, value: object, low: float, high: float, *, low_open: bool = False) -> float:
    """The value as a plain float; what is not a real number within [low, high] is refused."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise SettingsError(f"{name} must be a number, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = float("nan")
    if not low <= number <= high or (low_open and number == low):
        raise SettingsError(f"{name} must be between {low:g} and {high:g}, got {value!r}")
    return number


def check_count(name: str, value: object, low: int, high: int) -> int:
    """The value as a plain int; what is not a whole number within [low, high] is refused."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= int(value) <= high:
        raise SettingsError(f"{name} must be a whole number between {low} and {high}, got {value!r}")
    return int(value)


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Refuse what is not one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise SettingsError(f"{name} must be one of {', '.join(map(repr, choices))}, got {value!r}")


SettingsT = TypeVar("SettingsT", bound="Settings")
_DEFAULTS: dict[type[Any], Any] = {}


def settings_from(kind: type[SettingsT], settings: SettingsT | None, keywords: dict[str, Any]) -> SettingsT:
    """`settings`, or the defaults of `kind`, with the keywords put in; unknown keywords are refused by name."""
    if not keywords:
        if settings is None:
            if kind not in _DEFAULTS:
                _DEFAULTS[kind] = kind()
            return cast(SettingsT, _DEFAULTS[kind])
        if isinstance(settings, kind):
            return settings
    known = [f.name for f in fields(kind)]
    for name in keywords:
        if name not in known:
            raise SettingsError(f"unknown setting {name!r}; known are {', '.join(known)}")
    if settings is None:
        return kind(**keywords)
    if not isinstance(settings, kind):
        raise SettingsError(f"settings must be {kind.__name__}, got {type(settings).__name__}")
    return replace(settings, **keywords) if keywords else settings


class Checked:
    """Checks that leave plain values behind in frozen settings."""

    def _number(self, name: str, low: float, high: float, *, low_open: bool = False) -> None:
        object.__setattr__(self, name, check_number(name, getattr(self, name), low, high, low_open=low_open))

    def _count(self, name: str, low: int, high: int) -> None:
        object.__setattr__(self, name, check_count(name, getattr(self, name), low, high))

    def _flag(self, name: str) -> None:
        if not isinstance(getattr(self, name), bool):
            raise SettingsError(f"{name} must be True or False, got {getattr(self, name)!r}")


@dataclass(frozen=True, kw_only=True)
class Settings(Checked):
    """What the settings of axis and centre share."""

    lowpass_hz: float | None = None

    def _lowpass(self) -> None:
        if self.lowpass_hz is not None:
            self._number("lowpass_hz", 0.0, 1e6)
            if 0.0 < self.lowpass_hz < 0.01:
                raise SettingsError(f"lowpass_hz must be 0 (off) or at least 0.01, got {self.lowpass_hz!r}")


@dataclass(frozen=True, kw_only=True)
class AxisSettings(Settings):
    """How samples are chosen and the hinge axis is estimated from them (Olsson et al. 2020, Algorithms 1 to 3).

    Args:
        weight_ratio: weight w_0 of the gyroscope against the accelerometer residual (eq. 70); small trusts gravity, large
            trusts the rates. Default 50, as published; the paper finds 10 to 1e5 alike.
        starts: "deterministic" (four starts that need no luck) or "random" (uniform over both spheres, as published).
        random_starts: how many random starts; only with `starts="random"`. Default 1, as published.
        seed: seed of the random starts; only they take one. Default 0.
        lowpass_hz: cut-off (-6 dB) of the one low-pass that both signals of both sensors go through first, Hz; None or 0: raw
            signals, as published. Default None. On a walking person 4 Hz decides between the knee and the wobble of the strap.
        max_iterations: Gauss-Newton iterations of one descent. Default 300.
        max_samples: most gyroscope samples and most accelerometer samples that selection keeps (N_max). Default 1000.
        window_s: length of the window that scores a sample (eqs 44-45), s. Default 0.42.
        floor_deg: part of every bound that no data show (cross-axis sensitivity, housing), degrees. Default 0.5.
        energy_threshold: accelerometer samples are passed over where the quieter sensor's mean angular rate energy is above
            this (E_th), rad²/s². Default 1.

    Raises:
        SettingsError: a value is out of its range.
    """

    weight_ratio: float = 50.0
    starts: str = "deterministic"
    random_starts: int = 1
    seed: int = 0
    max_iterations: int = 300
    max_samples: int = 1000
    window_s: float = 0.42
    energy_threshold: float = 1.0
    floor_deg: float = 0.5

    def __post_init__(self) -> None:
        self._number("weight_ratio", 1e-12, 1e12)
        check_choice("starts", self.starts, ("deterministic", "random"))
        self._count("random_starts", 1, 1_000_000)
        self._count("seed", 0, 2**63)
        if self.starts != "random" and (self.random_starts, self.seed) != (1, 0):
            raise SettingsError('seed and random_starts only mean something with starts="random"; leave them out')
        self._lowpass()
        self._count("max_iterations", 1, 100_000)
        self._count("max_samples", 4, 10_000_000)
        self._number("window_s", 0.0, 60.0)
        self._number("floor_deg", 0.0, 90.0)
        self._number("energy_threshold", 0.0, 1e9, low_open=True)

    @classmethod
    def as_published(cls) -> AxisSettings:
        """The paper's own choice: raw signals, weight ratio 50, one random start with its sign pair."""
        return cls(starts="random")


@dataclass(frozen=True, kw_only=True)
class HingeSettings(AxisSettings):
    """How a hinge is calibrated and judged: `AxisSettings` and what follows.

    Args:
        lowpass_hz: as in `AxisSettings`, but default 4: on a walking person the thigh's strap wobbles faster than that and
            would win; mechanical hinges are found alike.
        max_error_deg: largest `bound95_deg` with which a HINGE is accepted (E_max), degrees. Default 3.
        max_error_approximate_deg: the same for an APPROXIMATE_HINGE, degrees. Default 12.
        n_consistent: so many estimates in a row must agree and be good before acceptance (n_min). Default 10.
        step_s: time between estimates, s. Default 1.
        hinge_misfit: up to this misfit a joint is a HINGE. Default 0.05 (mechanical hinges 0.005-0.02).
        approximate_misfit: up to this an APPROXIMATE_HINGE, above it NOT_A_HINGE. Default 0.25 (knees in walking and
            sit-to-stand 0.08-0.22; joints with two degrees of freedom 0.26-0.46).
        rate_scale: a gyroscope residual counts c/(c + ‖ω1‖ + ‖ω2‖) with this c, rad/s; small distrusts fast motion, inf treats
            all alike, as published. Default 3.
        offset_prior: the accelerations along the axis may differ by a constant (biases) that is held towards 0 as if so many
            samples said so; inf: no such constant, as published. Default 5.
        gyr_bias_std: gyroscope bias that the bound considers, rad/s, one standard deviation of each channel. Default 0.0087
            (0.5 deg/s); with rest, `gyr_bias_rest_std`.
        gyr_bias_rest_std: what is left of it after rest has shown the bias, rad/s. Default 0.0026 (0.15 deg/s).
        acc_bias_std: constant difference of the accelerations along the axis that the bound considers, m/s². Default 0.3.
        bias_from_rest: subtract the gyroscope biases that rest shows. Default True.
        acceptance: "calibrated" (verdicts from misfit, pairing and rivals, calibrated bounds, revocable) or "published"
            (Algorithm 4: μ+2σ of eq. 57 and SEQAD below `max_error_deg`, `n_consistent` times; every joint is a hinge).
            Default "calibrated".

    Raises:
        SettingsError: a value is out of its range.
    """

    lowpass_hz: float | None = 4.0
    max_error_deg: float = 3.0
    max_error_approximate_deg: float = 12.0
    n_consistent: int = 10
    step_s: float = 1.0
    hinge_misfit: float = 0.05
    approximate_misfit: float = 0.25
    rate_scale: float = 3.0
    offset_prior: float = 5.0
    gyr_bias_std: float = 0.0087
    gyr_bias_rest_std: float = 0.0026
    acc_bias_std: float = 0.3
    bias_from_rest: bool = True
    acceptance: str = "calibrated"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._count("max_samples", 20, 10_000_000)  # fewer say nothing of a joint
        self._number("max_error_deg", 0.0, 90.0, low_open=True)
        self._number("max_error_approximate_deg", 0.0, 90.0, low_open=True)
        self._count("n_consistent", 1, 1_000_000)
        self._number("step_s", 1e-3, 1e6)
        self._number("hinge_misfit", 0.0, 10.0)
        self._number("approximate_misfit", self.hinge_misfit, 10.0)
        self._number("rate_scale", 0.0, float("inf"), low_open=True)
        self._number("offset_prior", 0.0, float("inf"))
        self._number("gyr_bias_std", 0.0, 10.0)
        self._number("gyr_bias_rest_std", 0.0, 10.0)
        self._number("acc_bias_std", 0.0, 100.0)
        self._flag("bias_from_rest")
        check_choice("acceptance", self.acceptance, ("calibrated", "published"))

    @classmethod
    def as_published(cls) -> HingeSettings:
        """The paper's own choice: raw signals, one random start an estimate, plain weights, Algorithm 4."""
        inf = float("inf")
        return cls(
            starts="random",
            lowpass_hz=None,
            rate_scale=inf,
            offset_prior=inf,
            bias_from_rest=False,
            acceptance="published",
        )


@dataclass(frozen=True, kw_only=True)
class CenterSettings(Settings):
    """How a joint centre is estimated (Olsson & Halvorsen 2017, and what makes it good).

    Args:
        lowpass_hz: cut-off (-6 dB) of the low-pass, Hz, which acts in a frame that does not turn and needs no derivative of the
            rates; None or 0: none, as published. Default 2.25: rigs are served alike from 2 to 8 Hz, straps wobble above 3.
        derivative: without a low-pass, "three-point" (eq. 8, as published) or "five-point" central differences of the rates.
            Default "five-point".
        least_rate: instants at which neither sensor turns faster than this are passed over, rad/s. Default 0; the paper's
            gate is 1.2.
        acc_bias_std: standard deviation of each accelerometer bias channel beforehand, m/s²; biases are then unknowns like the
            centres. None: no biases, as published. Default 0.3; much more lets soft tissue pass for bias.
        lever_std: standard deviation of a lever arm beforehand, m; inf: nothing is known, as published. Default 0.5.
        robust: with method "ss": squares of small residuals, absolute values of those beyond 1.345 standard deviations
            (Huber). Default False.
        max_samples: most instants that an estimate rests on; of more, the most exciting. Default 16384: half an hour of
            unbroken motion.
        bias_from_rest: take gyroscope biases off as soon as rest shows them. Default True.
        gyr_bias_std: gyroscope bias that the covariance considers, rad/s, one standard deviation of each channel. Default 0.005
            (0.5 deg/s in norm); with rest, `gyr_bias_rest_std`.
        gyr_bias_rest_std: what is left of it after rest has shown the bias, rad/s. Default 0.0015.
        undetermined_std: directions in which the centre is less certain than this are `undetermined`, m; so are those that
            are twenty times less certain than the third most certain one. Default 0.08.
        minimum_norm: along undetermined directions the smallest centre is given; False: wherever the descent ended, as
            published ("ls" gives the smallest in any case). Default True.
        max_iterations: Newton steps of one descent. Default 200.

    Raises:
        SettingsError: a value is out of its range.
    """

    lowpass_hz: float | None = 2.25
    derivative: str = "five-point"
    least_rate: float = 0.0
    acc_bias_std: float | None = 0.3
    lever_std: float = 0.5
    robust: bool = False
    max_samples: int = 16384
    bias_from_rest: bool = True
    gyr_bias_std: float = 0.005
    gyr_bias_rest_std: float = 0.0015
    undetermined_std: float = 0.08
    minimum_norm: bool = True
    max_iterations: int = 200

    def __post_init__(self) -> None:
        self._lowpass()
        check_choice("derivative", self.derivative, ("five-point", "three-point"))
        self._number("least_rate", 0.0, 100.0)
        if self.acc_bias_std is not None:
            self._number("acc_bias_std", 0.0, 100.0)
        self._number("lever_std", 0.0, float("inf"), low_open=True)
        self._flag("robust")
        self._flag("bias_from_rest")
        self._count("max_samples", 20, 10_000_000)
        self._number("gyr_bias_std", 0.0, 10.0)
        self._number("gyr_bias_rest_std", 0.0, 10.0)
        self._number("undetermined_std", 0.0, 100.0, low_open=True)
        self._flag("minimum_norm")
        self._count("max_iterations", 1, 100_000)

    @classmethod
    def as_published(cls) -> CenterSettings:
        """The paper's own choice: raw signals, eq. 8, nothing known beforehand, every sample, nothing held."""
        inf = float("inf")
        return cls(
            lowpass_hz=None,
            derivative="three-point",
            acc_bias_std=None,
            lever_std=inf,
            max_samples=1_000_000,
            bias_from_rest=False,
            minimum_norm=False,
        )
