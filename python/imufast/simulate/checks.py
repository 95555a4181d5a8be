"""Checks of the simulator's settings: each returns the value in its clean form or raises and names the setting."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast.errors import SettingsError

__all__ = ["FloatArray", "matrix33", "number", "one_of", "quaternion", "seed_number", "times", "vector3", "whole"]

FloatArray = NDArray[np.float64]


def number(name: str, value: object, *, above: float = -math.inf, least: float = -math.inf, below: float = math.inf) -> float:
    """A finite float with `above` < value, `least` <= value and value < `below`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise SettingsError(f"{name} must be a number, not {type(value).__name__}")
    clean = float(value)
    if not (math.isfinite(clean) and clean > above and clean >= least and clean < below):
        limits = [f"> {above:g}"] * (above > -math.inf) + [f">= {least:g}"] * (least > -math.inf)
        limits += [f"< {below:g}"] * (below < math.inf)
        raise SettingsError(f"{name} must be finite{''.join(' and ' + limit for limit in limits)}; got {clean!r}")
    return clean


def whole(name: str, value: object, *, least: int) -> int:
    """An integer not below `least`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise SettingsError(f"{name} must be an integer >= {least}; got {value!r}")
    return int(value)


def seed_number(seed: object) -> int:
    """A seed: a non-negative integer."""
    return whole("seed", seed, least=0)


def one_of(name: str, value: Any, choices: tuple[Any, ...]) -> Any:
    """The value, if it is one of the choices."""
    if not any(type(value) is type(choice) and value == choice for choice in choices):
        raise SettingsError(f"{name} must be one of {', '.join(map(repr, choices))}; got {value!r}")
    return value


def _array(name: str, value: ArrayLike) -> FloatArray:
    try:
        clean = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SettingsError(f"{name} must be an array of numbers; got {value!r}") from error
    if not np.isfinite(clean).all():
        raise SettingsError(f"{name} must be finite; it holds NaN or infinity")
    return clean


def vector3(name: str, value: ArrayLike) -> FloatArray:
    """A finite (3,) vector."""
    clean = _array(name, value)
    if clean.shape != (3,):
        raise SettingsError(f"{name} must have shape (3,); got {clean.shape}")
    return clean


def matrix33(name: str, value: ArrayLike) -> FloatArray:
    """A finite (3, 3) matrix."""
    clean = _array(name, value)
    if clean.shape != (3, 3):
        raise SettingsError(f"{name} must have shape (3, 3); got {clean.shape}")
    return clean


def quaternion(name: str, value: ArrayLike) -> FloatArray:
    """A unit quaternion (4,), scalar first; one whose norm is off by more than 1e-3 is taken for a mistake."""
    clean = _array(name, value)
    if clean.shape != (4,):
        raise SettingsError(f"{name} must be a quaternion of shape (4,), scalar first; got shape {clean.shape}")
    norm = float(np.linalg.norm(clean))
    if abs(norm - 1.0) > 1e-3:
        raise SettingsError(f"{name} must be a unit quaternion; its norm is {norm:.6g}")
    return clean / norm


def times(name: str, value: ArrayLike) -> FloatArray:
    """Strictly increasing times (N,), s, N >= 2."""
    clean = _array(name, value)
    if clean.ndim != 1 or len(clean) < 2:
        raise SettingsError(f"{name} must have shape (N,) with N >= 2; got shape {clean.shape}")
    if not (np.diff(clean) > 0.0).all():
        first = int(np.argmin(np.diff(clean) > 0.0))
        raise SettingsError(f"{name} must increase strictly; it does not after row {first}")
    return clean
