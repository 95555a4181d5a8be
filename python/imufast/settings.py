"""Settings of the algorithms: frozen, checked when made, refusing what they do not know."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real

from imufast.errors import SettingsError

__all__ = ["HingeSettings"]


def check_number(name: str, value: object, low: float, high: float, *, low_open: bool = False) -> None:
    """Refuse what is not a real number within [low, high]."""
    if isinstance(value, bool) or not isinstance(value, Real) or value != value:
        raise SettingsError(f"{name} must be a number, got {value!r}")
    if not low <= value <= high or (low_open and value == low):
        raise SettingsError(f"{name} must be between {low:g} and {high:g}, got {value!r}")


def check_count(name: str, value: object, low: int, high: int) -> None:
    """Refuse what is not a whole number within [low, high]."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not low <= value <= high:
        raise SettingsError(f"{name} must be a whole number between {low} and {high}, got {value!r}")


def check_choice(name: str, value: object, choices: tuple[str, ...]) -> None:
    """Refuse what is not one of the choices."""
    if not isinstance(value, str) or value not in choices:
        raise SettingsError(f"{name} must be one of {', '.join(map(repr, choices))}, got {value!r}")


@dataclass(frozen=True, kw_only=True)
class HingeSettings:
    """How the hinge axis is estimated (Olsson et al. 2020).

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
    lowpass_hz: float | None = None
    max_iterations: int = 300
    max_samples: int = 1000
    window_s: float = 0.42
    energy_threshold: float = 1.0
    floor_deg: float = 0.5

    def __post_init__(self) -> None:
        check_number("weight_ratio", self.weight_ratio, 1e-12, 1e12)
        check_choice("starts", self.starts, ("deterministic", "random"))
        check_count("random_starts", self.random_starts, 1, 1_000_000)
        check_count("seed", self.seed, 0, 2**63)
        if self.starts != "random" and (self.random_starts, self.seed) != (1, 0):
            raise SettingsError('seed and random_starts only mean something with starts="random"; leave them out')
        if self.lowpass_hz is not None:
            check_number("lowpass_hz", self.lowpass_hz, 0.0, 1e6)
            if 0.0 < self.lowpass_hz < 0.01:
                raise SettingsError(f"lowpass_hz must be 0 (off) or at least 0.01, got {self.lowpass_hz!r}")
        check_count("max_iterations", self.max_iterations, 1, 100_000)
        check_count("max_samples", self.max_samples, 4, 10_000_000)
        check_number("window_s", self.window_s, 0.0, 60.0)
        check_number("floor_deg", self.floor_deg, 0.0, 90.0)
        check_number("energy_threshold", self.energy_threshold, 0.0, 1e9, low_open=True)

    @classmethod
    def as_published(cls) -> HingeSettings:
        """The paper's own choice: raw signals, weight ratio 50, one random start with its sign pair."""
        return cls(starts="random")
