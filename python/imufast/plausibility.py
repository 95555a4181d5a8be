"""Units, the checks that an argument is sound, and those that ask whether it looks like a body-worn IMU in SI units.

The latter cost little: a long recording is judged by evenly spaced blocks of about a thousand rows.
They err on the silent side: what real recordings do (straps at 27 rad/s, feet averaging 21 m/s²) is not remarked on.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.errors import ImufastWarning, InputError, UnitError

__all__ = [
    "STANDARD_GRAVITY",
    "Units",
    "check_plausible",
    "check_units",
    "dead_channels",
    "median_rate",
    "parse_unit",
    "parse_units",
    "read_rate",
    "read_times",
    "read_vectors",
    "warn_user",
]

Array: TypeAlias = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665
"""m/s² in one g."""
LARGEST = 1e9
"""Numbers beyond this, in SI, are no sensor's; squares of those below stay finite."""

_GYR_FACTORS = {"rad/s": 1.0, "deg/s": pi / 180, "mdeg/s": pi / 180e3}
_ACC_FACTORS = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000}
_SPELLINGS = {
    **dict.fromkeys(("rad/s", "rads", "rad/sec", "rads-1", "radian/s", "radians/s"), "rad/s"),
    **dict.fromkeys(("deg/s", "degs", "dps", "deg/sec", "degs-1", "degree/s", "degrees/s", "degree/sec"), "deg/s"),
    **dict.fromkeys(("mdeg/s", "mdps"), "mdeg/s"),
    **dict.fromkeys(("m/s2", "ms-2", "m/s/s", "m/sec2", "m/ss", "mps2"), "m/s^2"),
    **dict.fromkeys(("g", "gs"), "g"),
    **dict.fromkeys(("mg", "mgs"), "mg"),
}
_SYMBOLS = str.maketrans({"²": "2", "°": "deg", "⁻": "-", "¹": "1", "−": "-"} | dict.fromkeys(" ^*·()[]"))


@dataclass(frozen=True)
class Units:
    """Units of a sensor's numbers as somebody stated them; None: not stated, SI is assumed and the checks may object."""

    gyr: str | None = None
    acc: str | None = None

    @property
    def gyr_factor(self) -> float:
        """What turns the stated unit into rad/s."""
        return _GYR_FACTORS[self.gyr or "rad/s"]

    @property
    def acc_factor(self) -> float:
        """What turns the stated unit into m/s²."""
        return _ACC_FACTORS[self.acc or "m/s^2"]

    def over(self, other: Units) -> Units:
        """These units, and where they say nothing, the other's."""
        return Units(self.gyr or other.gyr, self.acc or other.acc)


def parse_unit(text: str) -> str | None:
    """The one spelling of a unit of gyr or acc (`°/s`, `dps` → `deg/s`; `mG` → `mg`), or None for anything else."""
    return _SPELLINGS.get(text.lower().translate(_SYMBOLS))


def parse_units(units: object) -> Units:
    """Read what users write as `units=`: `"deg/s, g"`, `"g"`, `"SI"`, `{"gyr": "deg/s"}`, or None.

    Raises InputError for a unit that is not known, or stated twice for one signal.
    """
    names = ", ".join([*_GYR_FACTORS, *_ACC_FACTORS])
    known = f"known are {names} and SI, alone or as 'deg/s, g' or {{'gyr': 'deg/s', 'acc': 'g'}}"
    if units is None or isinstance(units, Units):
        return units or Units()
    if isinstance(units, str):
        named = [(None, part) for part in units.replace(";", ",").split(",")]
    elif isinstance(units, Mapping):
        named = list(units.items())
    else:
        raise InputError(f"units must be a string or a mapping, got {type(units).__name__}; {known}")
    found: dict[str, str] = {}
    for signal, text in named:
        if signal is None and text.strip().upper() == "SI":
            parsed = [("gyr", "rad/s"), ("acc", "m/s^2")]
        else:
            unit = parse_unit(text) if isinstance(text, str) else None
            if unit is None:
                raise InputError(f"units: {text!r} is not a unit of gyr or acc; {known}")
            parsed = [("gyr" if unit in _GYR_FACTORS else "acc", unit)]
        for key, unit in parsed:
            if signal not in (None, key):
                raise InputError(f"units: {signal!r} cannot be in {text!r}; {known}")
            if key in found:
                raise InputError(f"units: {key} is stated twice in {units!r}; {known}")
            found[key] = unit
    return Units(found.get("gyr"), found.get("acc"))


def warn_user(message: str) -> None:
    """Give an ImufastWarning that points at the user's own line: the first frame outside this package."""
    level = 1
    frame = sys._getframe()
    while frame.f_back is not None and f"{frame.f_globals.get('__name__')}.".startswith("imufast."):
        frame = frame.f_back
        level += 1
    warnings.warn(message, ImufastWarning, stacklevel=level)


def _numbers(argument: str, values: object) -> NDArray[Any]:
    """The array behind an argument, if it holds real numbers and no masked ones."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise InputError(f"{argument} has masked values; leave those samples out and give time_s with the jumps that remain")
    try:
        array = np.asarray(values)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"{argument} cannot be made an array of numbers: {error}") from None
    if array.dtype.kind not in "iuf":
        raise InputError(f"{argument} must hold real numbers, got {type(values).__name__} of dtype {array.dtype}")
    return array


def _finite(argument: str, array: NDArray[Any]) -> Array:
    """The array as float64, C-contiguous, all finite and of a size that a sensor can have."""
    with np.errstate(over="ignore"):
        out: Array = np.require(array, np.float64, ["C", "A"])
    if len(out) == 0:
        raise InputError(f"{argument} is empty; at least one sample is needed")
    # The extremes are NaN or infinite exactly if any value is; they cost no memory.
    low, high = out.min(), out.max()
    if not (np.isfinite(low) and np.isfinite(high)):
        bad = ~np.isfinite(out).reshape(len(out), -1).all(axis=1)
        raise InputError(
            f"{argument} has NaN or infinite values in {int(bad.sum())} of {len(out)} rows, first in row {int(bad.argmax())}; "
            "leave those samples out and give time_s with the jumps that remain"
        )
    return out


def read_vectors(argument: str, values: object, factor: float) -> Array:
    """An (N, 3) argument times a unit's factor; viewed where it already fits, else copied. Raises InputError."""
    array = _numbers(argument, values)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = f"; transpose it ({argument}.T)" if array.ndim == 2 and array.shape[0] == 3 else ""
        raise InputError(f"{argument} must have the shape (N, 3), one row a sample; got {array.shape}{hint}")
    out = _finite(argument, array)
    largest = max(-out.min(), out.max())
    if largest > LARGEST:
        raise InputError(f"{argument} reaches {largest:.3g}, which no sensor measures; up to {LARGEST:.0e} is accepted")
    return out if factor == 1.0 else out * factor


def read_rate(rate_hz: object) -> float:
    """A sampling rate, Hz. Raises InputError for what is none."""
    number = isinstance(rate_hz, (int, float, np.integer, np.floating)) and not isinstance(rate_hz, bool)
    # The range also keeps every time that follows from the rate finite.
    if not number or not 1e-6 <= rate_hz <= 1e9:  # type: ignore[operator]
        raise InputError(f"rate_hz must be a positive number of samples per second (1e-6 to 1e9), got {rate_hz!r}")
    return float(rate_hz)  # type: ignore[arg-type]


def read_times(time_s: object, rows: int) -> Array:
    """A (rows,) argument of strictly increasing times, s. Raises InputError."""
    array = _numbers("time_s", time_s)
    if array.shape != (rows,):
        raise InputError(f"time_s must have the shape ({rows},), one time a sample as gyr and acc have; got {array.shape}")
    time = _finite("time_s", array)
    with np.errstate(over="ignore"):
        steps = np.diff(time)
    if not (steps > 0).all():
        row = int((steps > 0).argmin())
        raise InputError(
            f"time_s must increase strictly, but row {row + 1} ({time[row + 1]!s} s) does not follow "
            f"row {row} ({time[row]!s} s)"
        )
    return time


def median_rate(time_s: Array, stated: float | None) -> float:
    """One over the median step, Hz; with a single time, the stated rate. Raises InputError if no clock steps so."""
    if len(time_s) == 1:
        if stated is None:
            raise InputError("time_s has one sample, which gives no rate; give rate_hz as well")
        return stated
    # The median of the steps, each of which is a step that was measured.
    step = float(np.median(np.diff(time_s)))
    span = float(time_s[-1] - time_s[0])
    if not (1e-9 <= step <= 1e6 and span / step < 2**52):
        raise InputError(f"time_s must be in seconds, got a median step of {step:.3g} over a span of {span:.3g}")
    return 1.0 / step


def check_plausible(gyr: Array, acc: Array, rate_hz: float, name: str, units: Units) -> None:
    """Judge whether gyr (N, 3) rad/s and acc (N, 3) m/s² can be what they claim; see the module's text.

    `units` is what the user stated: with a stated acceleration unit the level of gravity is not an error but a warning.
    Less than a second of data is not judged. Raises UnitError or InputError, gives ImufastWarning.
    """
    if rate_hz < 2.0:
        warn_user(f"imu {name!r}: a rate of {rate_hz:.4g} Hz; time_s must be in seconds and rate_hz in 1/s (milliseconds?)")
    if len(gyr) < max(rate_hz, 10.0):
        return
    # A tenth of a second is averaged for the gyro's scale; five of those are the half second of a quiet window.
    tenth = max(1, round(0.1 * rate_hz))
    with np.errstate(all="ignore"):
        (gyr_blocks, gyr_edge), (acc_blocks, acc_edge) = (_blocks(x, 5 * tenth) for x in (gyr, acc))
        _check_gravity(acc_blocks, 5 * tenth, name, stated=units.acc is not None)
        dead = _dead(gyr_blocks, acc_blocks)
        messages = dead + (
            _gyro_scale(gyr_blocks, acc_blocks, tenth, rate_hz)
            + _clipping(gyr_blocks, "gyr", 2.0, "rad/s")
            + _clipping(acc_blocks, "acc", 15.0, "m/s²")
        )
        if not dead:
            messages += _repeats(gyr_edge, acc_edge, rate_hz)
    for message in messages:
        warn_user(f"imu {name!r}: {message}")


def check_units(gyr: Array, acc: Array, rate_hz: float, name: str) -> str | None:
    """As `check_plausible`, where a wrong unit would spoil all that follows: what is wrong with the scale of gyr, or None.

    Raises UnitError where gravity is off, whatever unit was stated. Less than a second of data is not judged.
    """
    if len(gyr) < max(rate_hz, 10.0):
        return None
    tenth = max(1, round(0.1 * rate_hz))
    with np.errstate(all="ignore"):
        (gyr_blocks, _), (acc_blocks, _) = (_blocks(x, 5 * tenth) for x in (gyr, acc))
        _check_gravity(acc_blocks, 5 * tenth, name, stated=False)
        return next(iter(_gyro_scale(gyr_blocks, acc_blocks, tenth, rate_hz)), None)


def dead_channels(gyr: Array, acc: Array) -> list[str]:
    """The signals, or single channels of them, that never change."""
    dead = _dead(gyr[None], acc[None])
    if dead:
        return dead
    return [
        f"{signal}[:, {axis}] ({letter}) never changes: a dead channel"
        for signal, rows in (("gyr", gyr), ("acc", acc))
        for axis, letter in enumerate("xyz")
        if (rows[:, axis] == rows[0, axis]).all()
    ]


def _blocks(rows: Array, window: int) -> tuple[Array, Array]:
    """What is looked at: (blocks, rows, 3), and the same rows with any remainder as (M, 3)."""
    count, size = 64, window * -(-1000 // window)
    if len(rows) <= count * size:
        return rows[None, : len(rows) - len(rows) % window], rows
    starts = np.linspace(0, len(rows) - size, count).astype(np.int64)
    blocks = np.stack([rows[start : start + size] for start in starts])
    return blocks, blocks.reshape(-1, 3)


def _check_gravity(acc: Array, window: int, name: str, *, stated: bool) -> None:
    """At its quietest an accelerometer reads the gravity of the earth: 9.81, not 1, not 1000 and not 0."""
    windows = acc.reshape(-1, window, 3)
    spread = windows.var(axis=1).sum(axis=1)
    quietest = np.argsort(spread)[: max(1, len(spread) // 20)]
    level = float(np.median(np.linalg.norm(windows[quietest], axis=2)))
    is_quiet = np.sqrt(np.median(spread[quietest])) < 0.2 * level
    seen = f"imu {name!r}: |acc| is {level:.3g} m/s² at its quietest, where gravity alone should read 9.81"
    error: type[InputError] = UnitError
    if 0.8 <= level <= 1.25:
        said = f"{seen}: acc looks like g; give units='g'"
    elif 800 <= level <= 1250:
        said = f"{seen}: acc looks like mg; give units='mg'"
    elif level < 0.3:
        error = InputError
        said = (
            f"{seen}: acc has gravity removed (an export such as 'FreeAcc') or the sensor was dead; "
            "give acc as the accelerometer measured it, gravity included"
        )
    elif not 4 <= level <= 30 or (is_quiet and not 7 <= level <= 13):
        return warn_user(f"{seen}: check the unit and the scale of acc")
    else:
        return None
    if stated:
        return warn_user(f"{said} (kept as it is, for its unit was stated)")
    raise error(f"{said} (or units='m/s^2' to insist)")


def _gyro_scale(gyr: Array, acc: Array, tenth: int, rate_hz: float) -> list[str]:
    """While a sensor turns gently, gravity turns in its frame: d(acc)/dt = −ω × acc. That weighs the gyro's unit."""
    advice = "deg/s looks likely; if so give units='deg/s'"
    means = [x[:, : x.shape[1] // tenth * tenth].reshape(len(x), -1, tenth, 3).mean(axis=2) for x in (gyr, acc)]
    turn, gravity = means
    off = np.abs(np.linalg.norm(gravity, axis=2) - STANDARD_GRAVITY)
    gentle = np.maximum(np.maximum(off[:, :-2], off[:, 1:-1]), off[:, 2:]) < 0.7
    change = (gravity[:, 2:] - gravity[:, :-2])[gentle]
    predicted = -np.cross(turn, gravity)[:, 1:-1][gentle] * (2 * tenth / rate_hz)
    product, power = float((change * predicted).sum()), float((predicted**2).sum())
    energy = float((change**2).sum())
    # In real recordings at the right scale: a ratio of 0.85–1.25 wherever the correlation passes 0.7.
    clear = len(change) >= 20 and product > 0.7 * np.sqrt(power * energy) > 0
    ratio = product / power if clear else 0.0
    if clear and 1 / 90 < ratio < 1 / 35:
        return [f"gyr turns {1 / ratio:.0f} times faster than gravity does in acc: {advice}"]
    if clear and 35 < ratio < 90:
        return [f"gyr turns {ratio:.0f} times slower than gravity does in acc: was it converted from deg/s twice?"]
    fastest = float(np.abs(gyr).max())
    if fastest > 40 and not (clear and 0.5 < ratio < 2):
        return [f"gyr reaches {fastest:.4g} rad/s, more than gyroscopes measure: {advice}"]
    return []


def _clipping(blocks: Array, signal: str, least: float, unit: str) -> list[str]:
    """An extreme value held for three samples or more, three times or more. Below `least` no sensor's range ends."""
    said = []
    for axis, letter in enumerate("xyz"):
        size = np.abs(blocks[:, :, axis])
        top = float(size.max())
        held = size == top
        triple = held[:, :-2] & held[:, 1:-1] & held[:, 2:]
        runs = int(triple[:, 0].sum() + (triple[:, 1:] & ~triple[:, :-1]).sum()) if triple.size else 0
        if top >= least and runs >= 3:
            said.append(f"{signal}[:, {axis}] ({letter}) is clipped at ±{top:.4g} {unit}, {runs} times in what was looked at")
    return said


def _dead(gyr: Array, acc: Array) -> list[str]:
    """A signal that never changes."""
    said = []
    if not gyr.any():
        said.append("gyr is zero throughout: a sensor without a gyroscope, or a gyroscope switched off?")
    elif (gyr == gyr[0, 0]).all():
        said.append("gyr never changes: the gyroscope is stuck")
    if (acc == acc[0, 0]).all():
        said.append("acc never changes: the accelerometer is stuck")
    return said


def _repeats(gyr: Array, acc: Array, rate_hz: float) -> list[str]:
    """Whole rows that repeat the row before. Radio links repeat a row here and there (up to 2 % seen in good files)."""
    same = (gyr[1:] == gyr[:-1]).all(axis=1) & (acc[1:] == acc[:-1]).all(axis=1)
    # Between two fresh rows lies a run of repeats.
    fresh = np.flatnonzero(np.concatenate(([True], ~same, [True])))
    longest = int(np.diff(fresh).max()) - 1
    share = float(same.mean())
    if share > 0.05 or longest >= max(3.0, 0.5 * rate_hz):
        return [f"{100 * share:.2g} % of the rows repeat the row before, up to {longest} in a row: a stuck or upsampled signal"]
    return []
