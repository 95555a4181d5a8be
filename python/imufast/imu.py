"""Imu and Recording: checked arrays on a time base.

Stated once, true everywhere. The step of a recording is its median time step. A *gap* is a step longer than 1.5 steps:
at least one sample is missing. One missing sample (up to 2.5 steps) is bridged as irregular time; a longer gap is a
*break*, which no derivative, window or filter crosses.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.errors import InputError
from imufast.plausibility import (
    check_plausible,
    median_rate,
    parse_units,
    read_rate,
    read_times,
    read_vectors,
    warn_user,
)

__all__ = ["BREAK_STEPS", "GAP_STEPS", "Imu", "ReadInfo", "Recording"]

Array: TypeAlias = NDArray[np.float64]

GAP_STEPS = 1.5
"""A time step longer than this many median steps is a gap: samples are missing."""
BREAK_STEPS = 2.5
"""A time step longer than this many median steps is a break: nothing is computed across it."""
SAME_TIME_STEPS = 1e-3
"""Times that differ by less than this many median steps are the same time."""


class Imu:
    """One sensor's recording: angular rate and specific force on a time base, immutable.

    Args:
        gyr: (N, 3) angular rate, rad/s unless `units` says otherwise; N ≥ 1.
        acc: (N, 3) specific force (gravity included: about 9.81 at rest), m/s² unless `units` says otherwise.
        rate_hz: samples per second, when they are evenly spaced and none is missing.
        time_s: (N,) time of each sample in seconds, strictly increasing, any step; a gap is a jump. Give `rate_hz` or
            `time_s`; with both, `rate_hz` is only compared with the median step (ImufastWarning beyond 2 %).
        name: what the sensor is called in messages and recordings; default "imu".
        units: units to convert from, such as "deg/s, g", "g", "SI" or {"gyr": "deg/s"}; default SI. A stated
            acceleration unit is believed even where gravity contradicts it.

    Arrays that already are float64, C-contiguous and in SI are viewed, not copied: do not change them afterwards.

    Raises:
        InputError: wrong type, shape, values (NaN, infinite, time not increasing) or combination of arguments.
        UnitError: gravity reads about 1 or 1000 where 9.81 m/s² is expected.
    """

    __slots__ = ("_acc", "_even_s", "_gyr", "_name", "_rate_hz", "_time_s")

    _gyr: Array
    _acc: Array
    _time_s: Array | None
    """As given; None: even, from 0 on, and as numbers in `_even_s` once somebody has asked."""
    _even_s: Array | None
    _rate_hz: float
    _name: str

    def __init__(
        self,
        gyr: object,
        acc: object,
        rate_hz: float | None = None,
        *,
        time_s: object = None,
        name: str = "imu",
        units: object = None,
    ) -> None:
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"name must be a non-empty string, got {name!r}")
        stated = parse_units(units)
        gyr_si = read_vectors("gyr", gyr, stated.gyr_factor)
        acc_si = read_vectors("acc", acc, stated.acc_factor)
        if len(gyr_si) != len(acc_si):
            raise InputError(f"gyr and acc must have the same length, got {len(gyr_si)} and {len(acc_si)} rows")
        rate = None if rate_hz is None else read_rate(rate_hz)
        if time_s is None:
            if rate is None:
                raise InputError("give rate_hz (samples per second) or time_s (time of each sample); got neither")
            self._set(gyr_si, acc_si, None, rate, name)
        else:
            time = read_times(time_s, len(gyr_si))
            measured = median_rate(time, rate)
            if rate is not None and abs(measured - rate) > 0.02 * rate:
                warn_user(
                    f"imu {name!r}: rate_hz={rate:.6g} contradicts time_s, whose median step says {measured:.6g} Hz; "
                    "time_s is used"
                )
            self._set(gyr_si, acc_si, time, measured, name)
        check_plausible(self._gyr, self._acc, self._rate_hz, name, stated)

    def _set(self, gyr: Array, acc: Array, time_s: Array | None, rate_hz: float, name: str) -> Imu:
        self._gyr, self._acc = _read_only(gyr), _read_only(acc)
        self._time_s = None if time_s is None else _read_only(time_s)
        self._even_s = None
        self._rate_hz, self._name = rate_hz, name
        return self

    def _replace(self, **changes: Any) -> Imu:
        """The same with some of gyr, acc, time_s, rate_hz, name exchanged for what is already known to be sound."""
        now: dict[str, Any] = {
            "gyr": self._gyr,
            "acc": self._acc,
            "time_s": self._time_s,
            "rate_hz": self._rate_hz,
            "name": self._name,
        }
        return object.__new__(Imu)._set(**now | changes)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self._gyr, self._acc, self._time_s, self._rate_hz, self._name)

    @property
    def gyr(self) -> Array:
        """(N, 3) angular rate, rad/s, read-only."""
        return self._gyr

    @property
    def acc(self) -> Array:
        """(N, 3) specific force, m/s², read-only."""
        return self._acc

    @property
    def time_s(self) -> Array:
        """(N,) time of each sample, s, read-only; from `rate_hz` it starts at 0."""
        if self._time_s is not None:
            return self._time_s
        if self._even_s is None:
            time_s = np.arange(len(self), dtype=np.float64)
            time_s /= self._rate_hz
            self._even_s = _read_only(time_s)
        return self._even_s

    def _has_times_of(self, other: Imu) -> bool:
        """Whether the time bases of both, equally long, are the same without a look at the numbers."""
        if self._time_s is None and other._time_s is None:
            return self._rate_hz == other._rate_hz
        return self._time_s is other._time_s

    @property
    def rate_hz(self) -> float:
        """Samples per second: as given, or one over the median time step. A slice keeps its recording's rate."""
        return self._rate_hz

    @property
    def name(self) -> str:
        """What the sensor is called."""
        return self._name

    def __len__(self) -> int:
        return len(self._gyr)

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @property
    def gaps(self) -> NDArray[np.int64]:
        """(k, 2) one row a gap: index of the first sample after it, and the number of samples missing before that."""
        steps = np.diff(self.time_s) * self._rate_hz
        after = np.flatnonzero(steps > GAP_STEPS)
        return np.stack([after + 1, np.rint(steps[after]).astype(np.int64) - 1], axis=1)

    @property
    def lost(self) -> int:
        """Number of missing samples, over all gaps."""
        return int(self.gaps[:, 1].sum())

    def segments(self) -> list[tuple[int, int]]:
        """The stretches (start, stop) without a break, in order; algorithms treat each as continuous."""
        cuts = np.flatnonzero(np.diff(self.time_s) * self._rate_hz > BREAK_STEPS) + 1
        edges = [0, *cuts.tolist(), len(self)]
        return list(pairwise(edges))

    def __getitem__(self, rows: slice) -> Imu:
        """The samples of a slice such as `imu[100:200]`, on the recording's own time. No steps: that would be resampling."""
        if not isinstance(rows, slice) or rows.step not in (None, 1):
            raise InputError(f"an Imu takes slices without a step, such as imu[100:200]; got {rows!r}")
        try:
            start, stop, _ = rows.indices(len(self))
        except TypeError:
            raise InputError(f"an Imu takes slices of whole numbers, such as imu[100:200]; got {rows!r}") from None
        if start >= stop:
            raise InputError(f"imu[{rows.start}:{rows.stop}] holds no sample; the imu has {len(self)}")
        return self._replace(gyr=self._gyr[start:stop], acc=self._acc[start:stop], time_s=self.time_s[start:stop])

    def between(self, start_s: float | None = None, stop_s: float | None = None) -> Imu:
        """The samples with start_s ≤ time < stop_s, s; None leaves an end open. Raises InputError when none is there."""
        return self[_rows_between(self.time_s, start_s, stop_s)]

    def __repr__(self) -> str:
        return f"Imu({self._name!r}, {_summary(self)})"


@dataclass(frozen=True)
class ReadInfo:
    """What reading one sensor's file found: counts in rows, rate as the file's header states it (None: it does not)."""

    file: str
    format: str
    rows: int
    lost_rows: int
    invalid_rows: int
    first_counter: int | None = None
    header_rate_hz: float | None = None
    notes: tuple[str, ...] = ()


class Recording(Mapping[str, Imu]):
    """Sensors on one time base: a mapping from name to Imu, immutable.

    Args:
        imus: a mapping from name to Imu (the name wins over the Imu's own) or Imus with different names. All must have
            the same sample times, within a thousandth of a step; `imufast.align` brings others there.
        info: what reading found, by sensor name; `imufast.read` fills it.

    Raises:
        InputError: not Imus, none, equal names, or different time bases.
    """

    __slots__ = ("_imus", "_info")

    def __init__(self, imus: Mapping[str, Imu] | Iterable[Imu], *, info: Mapping[str, ReadInfo] | None = None) -> None:
        if isinstance(imus, Imu) or not isinstance(imus, Iterable):
            raise InputError(f"imus must be a mapping from name to Imu or a list of Imu, got {type(imus).__name__}")
        named = list(imus.items()) if isinstance(imus, Mapping) else [(getattr(imu, "name", ""), imu) for imu in imus]
        self._imus: dict[str, Imu] = {}
        self._info = dict(info or {})
        for name, imu in named:
            if not isinstance(imu, Imu):
                raise InputError(f"imus must hold Imu objects, got {type(imu).__name__}")
            if not isinstance(name, str) or not name.strip():
                raise InputError(f"imus: a name must be a non-empty string, got {name!r}")
            if name in self._imus:
                raise InputError(f"imus: two sensors are named {name!r}; give a mapping from name to Imu")
            first = next(iter(self._imus.values()), imu)
            if imu is not first:
                check_same_time(first, imu, f"imus: {first.name!r} and {imu.name!r}")
            self._imus[name] = imu._replace(name=name, time_s=first.time_s, rate_hz=first.rate_hz)
        if not self._imus:
            raise InputError("imus is empty; a recording needs at least one Imu")

    @property
    def _first(self) -> Imu:
        return next(iter(self._imus.values()))

    def __getitem__(self, name: str) -> Imu:
        try:
            return self._imus[name]
        except (KeyError, TypeError):
            raise KeyError(f"no sensor {name!r}; there are {', '.join(map(repr, self._imus))}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._imus)

    def __len__(self) -> int:
        return len(self._imus)

    @property
    def time_s(self) -> Array:
        """(N,) time of each sample, s, the same array for all sensors."""
        return self._first.time_s

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        return self._first.rate_hz

    @property
    def info(self) -> dict[str, ReadInfo]:
        """What reading found, by sensor name; empty for a recording made from arrays."""
        return dict(self._info)

    def between(self, start_s: float | None = None, stop_s: float | None = None) -> Recording:
        """The samples with start_s ≤ time < stop_s, s; None leaves an end open. Raises InputError when none is there."""
        rows = _rows_between(self.time_s, start_s, stop_s)
        return Recording({name: imu[rows] for name, imu in self.items()}, info=self._info)

    def pair(self, name1: str | None = None, name2: str | None = None) -> tuple[Imu, Imu]:
        """Two sensors by name; without names, the two of a recording that has exactly two."""
        names = [name for name in (name1, name2) if name is not None] or list(self)
        if len(names) != 2 or names[0] == names[1] or any(name not in self._imus for name in names):
            raise InputError(
                f"name1, name2: name two different sensors of {', '.join(map(repr, self))}; got {name1!r}, {name2!r}"
            )
        return self[names[0]], self[names[1]]

    def __repr__(self) -> str:
        width = max(map(len, self))
        lines = [f"Recording({len(self)} sensor{'s' * (len(self) > 1)}, {_summary(self._first)})"]
        for name in self:
            info = self._info.get(name)
            found = f"  {info.rows} rows, {info.lost_rows} lost, {info.invalid_rows} invalid  {info.file}" if info else ""
            lines.append(f"  {name:<{width}}{found}")
        return "\n".join(lines)


def _summary(imu: Imu) -> str:
    gaps = f", {imu.lost} lost in {len(imu.gaps)} gaps" if len(imu.gaps) else ""
    return f"{len(imu)} samples, {imu.rate_hz:.6g} Hz, {imu.time_s[0]:.6g} to {imu.time_s[-1]:.6g} s{gaps}"


def _restore(gyr: Array, acc: Array, time_s: Array | None, rate_hz: float, name: str) -> Imu:
    return object.__new__(Imu)._set(gyr, acc, time_s, rate_hz, name)


def _read_only(array: Array) -> Array:
    if not array.flags.writeable:
        return array
    # A view of its own, so that the caller's array keeps its writeable flag.
    view: Array = array.view()
    view.flags.writeable = False
    return view


def check_same_time(first: Imu, other: Imu, who: str) -> None:
    """Raises InputError unless both have the same sample times, within a thousandth of a step; `who`: how it names them."""
    differ = f"{who} have different time bases"
    advice = "align them with imufast.align([...]), or cut both to the same samples"
    if len(first) != len(other):
        raise InputError(f"{differ}: {len(first)} and {len(other)} samples; {advice}")
    if first._has_times_of(other):
        return
    apart = np.subtract(first.time_s, other.time_s)
    np.abs(apart, out=apart)
    if apart.max() * first.rate_hz > SAME_TIME_STEPS:
        row = int(apart.argmax())
        raise InputError(f"{differ}: up to {apart[row]:.3g} s apart (row {row}); {advice}")


def _rows_between(time_s: Array, start_s: float | None, stop_s: float | None) -> slice:
    for argument, value in (("start_s", start_s), ("stop_s", stop_s)):
        if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float)) or value != value):
            raise InputError(f"{argument} must be a time in seconds or None, got {value!r}")
    start = 0 if start_s is None else int(np.searchsorted(time_s, start_s))
    stop = len(time_s) if stop_s is None else int(np.searchsorted(time_s, stop_s))
    if start >= stop:
        raise InputError(
            f"start_s={start_s}, stop_s={stop_s} hold no sample; the recording goes from {time_s[0]:.6g} to {time_s[-1]:.6g} s"
        )
    return slice(start, stop)
