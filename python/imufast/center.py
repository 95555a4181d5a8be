"""The centre of a joint as seen from the two sensors on its segments: Olsson & Halvorsen 2017."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.errors import InputError, SettingsError
from imufast.imu import Imu
from imufast.pairs import check_pair
from imufast.quaternion import continuous
from imufast.samples import ReadOnly, as_array
from imufast.settings import CenterSettings, check_choice, check_number, settings_from
from imufast.state import pack, unpack

__all__ = [
    "CenterEstimate",
    "CenterStatus",
    "JointCenter",
    "JointCenterEstimator",
    "estimate_joint_center",
    "fit_joint_center",
]

Array = NDArray[np.float64]
METHODS = ("ls", "ss", "sa")
UNEXPLAINED_LIMIT = 0.25
"""Where the best centre leaves this share of what no lever arm leaves, the two sensors share no joint that the motion shows.
Measured, low-passed: mechanical joints 0.02-0.07, knees, ankles and elbows 0.04-0.15, a hip 0.245; sensors that share no joint
0.25-0.75."""


class CenterStatus(str, Enum):
    """What became of a joint-centre estimate."""

    CONVERGED = "CONVERGED"
    """At a minimum, and the motion determines all six coordinates."""
    PARTLY_DETERMINED = "PARTLY_DETERMINED"
    """At a minimum, but the motion leaves some directions open: see `undetermined`. A hinge always has one, along its axis."""
    NOT_IDENTIFIABLE = "NOT_IDENTIFIABLE"
    """The motion says next to nothing of the centre, or contradicts that there is one."""
    STALLED = "STALLED"
    """No step lowered the cost although one was promised; take the numbers with care."""
    MAX_ITERATIONS = "MAX_ITERATIONS"
    """The iterations ran out before the minimum."""
    NUMERICAL_ERROR = "NUMERICAL_ERROR"
    """The numbers overflow; are they in the right unit?"""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class JointCenter(ReadOnly):
    """Where a joint sits as seen from the sensors on its two segments.

    Attributes:
        in_sensor1, in_sensor2: (3,) the joint centre in the frame of each sensor, m (−r of the paper, s of McGrath).
        covariance: (6, 6) of the stacked centres, m²; large along `undetermined`.
        undetermined: (k, 6) unit directions of the stacked centres that the motion did not determine; along these the smallest
            centre is given. For a hinge the place along its axis: (axis1, axis2)/√2.
    """

    in_sensor1: Array
    in_sensor2: Array
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)), repr=False)
    undetermined: Array = field(default_factory=lambda: np.zeros((0, 6)))

    @property
    def determined_std(self) -> Array:
        """(2,) standard deviation of each centre without the undetermined directions, root of the trace, m."""
        across = np.eye(6) - self.undetermined.T @ self.undetermined
        variance = np.diag(across @ self.covariance @ across)
        return np.asarray(np.sqrt(variance.reshape(2, 3).sum(axis=1)))


@dataclass(frozen=True, eq=False, kw_only=True)
class CenterEstimate(JointCenter):
    """A joint centre from motion, and how far to trust it.

    Attributes (beyond those of JointCenter):
        status: what became of it.
        method: "ls", "ss" or "sa".
        acc_bias1, acc_bias2: (3,) accelerometer biases, m/s²; 0 where they were not unknowns. They show in gravity's direction
            as the sensors turn; a prior holds them where the motion does not tell.
        acc_bias_covariance: (6, 6) of the stacked biases, (m/s²)².
        acc_bias_undetermined: (m, 6) unit directions of the stacked biases of which the motion told little more than the prior.
        gyr_bias1, gyr_bias2: (3,) gyroscope biases that rest has shown and that were subtracted, rad/s; or None.
        residual_std: standard deviation of the residual ‖a1−b1−K1r1‖ − ‖a2−b2−K2r2‖ (eq. 16; of LS, of a channel), m/s².
        unexplained: rms residual over the rms that zero lever arms leave: near 1 the centre explains nothing.
        cost: the minimum: Σe² (eqs 13, 15) or Σ|e| (eq. 20) alone, without the prior.
        n_samples: instants that it rests on.
        iterations: passes over these.
        residual_time_s, residuals: (M,) some of the residuals (500 at most, evenly spread) and their times, m/s² and s.
        settings: what it was made with.
    """

    status: CenterStatus
    method: str
    acc_bias1: Array
    acc_bias2: Array
    acc_bias_covariance: Array = field(repr=False)
    acc_bias_undetermined: Array
    gyr_bias1: Array | None
    gyr_bias2: Array | None
    residual_std: float
    unexplained: float
    cost: float
    n_samples: int
    iterations: int
    residual_time_s: Array = field(repr=False)
    residuals: Array = field(repr=False)
    settings: CenterSettings = field(repr=False)


class Axis(Protocol):
    """A hinge axis in both sensor frames with one common sign."""

    @property
    def axis1(self) -> Array | None: ...
    @property
    def axis2(self) -> Array | None: ...


_STATE_VERSION = b"imufast.JointCenterEstimator\x01"


class JointCenterEstimator:
    """Estimates a joint centre from a stream, in bounded memory, for as long as it runs.

    Samples may come one by one or in blocks; however they are cut, `result()` is the same bits as `estimate_joint_center` on
    the whole. The low-pass and the derivative make it late by `delay_s`.

    Args:
        rate_hz: nominal rate of the samples, Hz.
        method: "ss" (eqs 15-19) or "sa" (eqs 20-23). Default "sa".
        axis: a hinge axis (`axis1`, `axis2`): the place along it is then not asked. Default None.
        gyr_bias: (3,) biases of both gyroscopes where they are known, rad/s. Default None: as rest shows them.
        settings: a `CenterSettings`; default `CenterSettings()`.
        **keywords: fields of `CenterSettings`; they win over `settings`.

    Raises:
        InputError: rate_hz is not a positive number, or an axis that is none.
        SettingsError: an unknown method or setting, or one out of its range.
    """

    def __init__(
        self,
        rate_hz: float,
        *,
        method: str = "sa",
        axis: Axis | None = None,
        gyr_bias: tuple[ArrayLike, ArrayLike] | None = None,
        settings: CenterSettings | None = None,
        **keywords: Any,
    ) -> None:
        try:
            self._rate_hz = check_number("rate_hz", rate_hz, 0.0, 1e9, low_open=True)
        except SettingsError as error:
            raise InputError(str(error)) from None
        self._settings = settings_from(CenterSettings, settings, keywords)
        if method == "ls":
            raise SettingsError('method "ls" needs relative orientations: use estimate_joint_center(..., q_12=...)')
        check_choice("method", method, METHODS)
        self._method = method
        self._axis = _axis_pair(axis)
        self._stream = _new_stream(self._rate_hz, self._settings, gyr_bias)

    @property
    def delay_s(self) -> float:
        """By how much the low-pass and the derivative are late, s."""
        return self._stream.delay_s

    def push(self, gyr1: ArrayLike, acc1: ArrayLike, gyr2: ArrayLike, acc2: ArrayLike, time_s: ArrayLike | None = None) -> None:
        """Take samples.

        Args:
            gyr1, acc1, gyr2, acc2: (3,) one sample or (N, 3) a block, rad/s and m/s², in sensor frames.
            time_s: time of the sample or (N,) times, s, increasing also from call to call, any step; with every call or with
                none (then `rate_hz` is exact and nothing is lost).

        Raises:
            InputError: shapes that do not fit, values that are not finite, time that goes back. Nothing of the block is taken.
        """
        _push(self._stream, gyr1, acc1, gyr2, acc2, time_s)

    def result(self) -> CenterEstimate:
        """The joint centre from all samples so far."""
        return _solve(self._stream, self._method, self._axis, self._settings)

    def state(self) -> bytes:
        """Everything it knows, as bytes of a stated version: `restore` goes on exactly where this stands."""
        plain = {
            "rate_hz": self._rate_hz,
            "method": self._method,
            "axis": self._axis,
            "settings": asdict(self._settings),
        }
        return pack(_STATE_VERSION, plain, self._stream.state())

    @classmethod
    def restore(cls, state: bytes) -> JointCenterEstimator:
        """The estimator whose `state` this is. Raises InputError when the bytes are damaged or of another version."""
        plain, stream = unpack(_STATE_VERSION, state, "JointCenterEstimator")
        try:
            self = cls(plain["rate_hz"], method=plain["method"], settings=CenterSettings(**plain["settings"]))
            self._axis = plain["axis"]
            self._stream = _core.CenterStream.restore(stream)
        except (ValueError, TypeError, KeyError) as error:
            raise InputError(f"state cannot be restored: {error}") from None
        return self


def estimate_joint_center(
    imu1: Imu,
    imu2: Imu,
    method: str = "sa",
    *,
    q_12: ArrayLike | None = None,
    axis: Axis | None = None,
    gyr_bias: tuple[ArrayLike, ArrayLike] | None = None,
    settings: CenterSettings | None = None,
    **keywords: Any,
) -> CenterEstimate:
    """Find the centre of a joint in the frames of the two sensors on its segments: Olsson & Halvorsen 2017.

    Minimises the difference of the specific forces that both sensors see at the joint centre, a_i − b_i − K(ω_i, ω̇_i) r_i:
    of their norms, squared ("ss", eqs 15-19) or absolute ("sa", eqs 20-23), or, where the relative orientation is known, of
    the vectors, squared ("ls", eqs 9-14). By default both signals go through a low-pass and the accelerometer biases b are
    unknowns, too; `CenterSettings.as_published()` is the paper's own. The low-pass acts in a frame that does not turn, where
    the equation stays exact: with the orientation R(t) of a sensor, h∗(R a) = h∗(R b) + (h∗R)¨ r + what both sensors share.

    Args:
        imu1, imu2: the sensors on the two segments, same time base. Any mounting.
        method: "sa" (default), "ss" or "ls".
        q_12: (N, 4) unit quaternions, scalar first, that take sensor 2 to sensor 1 at every sample; with "ls" only.
        axis: a hinge axis (anything with `axis1`, `axis2`, as `estimate_hinge_axis` gives): the place along it, which no
            motion of a hinge tells, is then not asked. Default None: what is open is found out.
        gyr_bias: (3,) biases of both gyroscopes where they are known, rad/s. Default None: as rest shows them, from then on.
        settings: a `CenterSettings`; default `CenterSettings()`.
        **keywords: fields of `CenterSettings`, such as `lowpass_hz=5.0`, `acc_bias_std=0.3`; they win over `settings`.

    Returns:
        CenterEstimate. Motion that does not determine the centre gives a status and the undetermined directions, not an
        exception.

    Raises:
        InputError: not two Imus of one time base, too few samples, or q_12 that does not fit.
        SettingsError: an unknown method or setting, or one out of its range.
    """
    chosen = settings_from(CenterSettings, settings, keywords)
    check_choice("method", method, METHODS)
    check_pair(imu1, imu2, same_data=True)
    pair = _axis_pair(axis)
    if (q_12 is None) == (method == "ls"):
        raise InputError('method "ls" needs q_12, the other methods do not take it')
    quaternions = None if q_12 is None else _quaternions(q_12, len(imu1))
    stream = _new_stream(imu1.rate_hz, chosen, gyr_bias)
    stream.push(imu1.gyr, imu1.acc, imu2.gyr, imu2.acc, imu1.time_s, trusted=True)
    if quaternions is None:
        return _solve(stream, method, pair, chosen)
    fit = stream.fit_linear(
        _at_times(quaternions, imu1.time_s, stream.times()),
        chosen.acc_bias_std or 0.0,
        chosen.lever_std,
        _bias_std(stream, chosen),
        pair,
        chosen.undetermined_std,
    )
    return _estimate(fit, method, chosen, stream)


def fit_joint_center(
    gyr1: ArrayLike,
    gyr_dot1: ArrayLike,
    acc1: ArrayLike,
    gyr2: ArrayLike,
    gyr_dot2: ArrayLike,
    acc2: ArrayLike,
    method: str = "sa",
    *,
    time_s: ArrayLike | None = None,
    q_12: ArrayLike | None = None,
    axis: Axis | None = None,
    settings: CenterSettings | None = None,
    **keywords: Any,
) -> CenterEstimate:
    """`estimate_joint_center` where the angular accelerations are known: on the instants as they are given, in any order of
    motion, nothing low-passed or differentiated.

    Args:
        gyr1, gyr_dot1, acc1, gyr2, gyr_dot2, acc2: (N, 3) rates (rad/s), angular accelerations (rad/s²), specific forces
            (m/s²) in sensor frames 1 and 2.
        method, q_12, axis, settings, **keywords: as in `estimate_joint_center`; of the settings, those that make instants from
            recordings (lowpass_hz, derivative, least_rate, max_samples, bias_from_rest) mean nothing here.
        time_s: (N,) ascending times, s: residuals within a second are taken as correlated. Default None: all independent.

    Raises:
        InputError: shapes that do not fit or values that are not finite.
        SettingsError: an unknown method or setting, or one out of its range.
    """
    chosen = settings_from(CenterSettings, settings, keywords)
    check_choice("method", method, METHODS)
    names = ("gyr1", "gyr_dot1", "acc1", "gyr2", "gyr_dot2", "acc2")
    moments = [_rows(name, value, 3) for name, value in zip(names, (gyr1, gyr_dot1, acc1, gyr2, gyr_dot2, acc2), strict=True)]
    count = len(moments[0])
    times = np.arange(count, dtype=np.float64) if time_s is None else _rows("time_s", time_s, None)
    if (np.diff(times) < 0.0).any():
        raise InputError("time_s must ascend")
    for name, value in zip((*names, "time_s"), (*moments, times), strict=True):
        if len(value) != count:
            raise InputError(f"{name} has {len(value)} rows but gyr1 has {count}")
    if count < 4:
        raise InputError(f"gyr1 has {count} rows; at least 4 are needed")
    pair = _axis_pair(axis)
    prior = (chosen.acc_bias_std or 0.0, chosen.lever_std, 1.0, 0.0, pair, chosen.undetermined_std)
    if (q_12 is None) == (method == "ls"):
        raise InputError('method "ls" needs q_12, the other methods do not take it')
    if q_12 is not None:
        fit = _core.fit_center_linear(moments, times, _quaternions(q_12, count), *prior)
    else:
        fit = _core.fit_center(moments, times, _core_method(method, chosen), *prior, chosen.minimum_norm, chosen.max_iterations)
    return _estimate(fit, method, chosen, None)


def _core_method(method: str, settings: CenterSettings) -> str:
    return "huber" if method == "ss" and settings.robust else method


def _new_stream(rate_hz: float, settings: CenterSettings, gyr_bias: tuple[ArrayLike, ArrayLike] | None) -> _core.CenterStream:
    lowpass_hz = settings.lowpass_hz or 0.0
    if lowpass_hz and rate_hz / lowpass_hz > 1e5:
        raise InputError(
            f"rate_hz={rate_hz:g} makes the window of lowpass_hz={settings.lowpass_hz} longer than a hundred thousand samples"
        )
    if gyr_bias is not None:
        if not isinstance(gyr_bias, tuple) or len(gyr_bias) != 2:
            raise InputError(f"gyr_bias must be a tuple of two vectors, got {type(gyr_bias).__name__}")
        for number, vector in enumerate(gyr_bias, 1):
            if np.shape(vector) != (3,) or not np.isfinite(as_array("gyr_bias", vector)).all():
                raise InputError(f"gyr_bias of sensor {number} must be three finite numbers, got {vector!r}")
    return _core.CenterStream(
        rate_hz=rate_hz,
        lowpass_hz=lowpass_hz,
        five_points=settings.derivative == "five-point",
        least_rate=settings.least_rate,
        max_samples=settings.max_samples,
        gyr_bias=None if gyr_bias is None else [as_array("gyr_bias", vector).tolist() for vector in gyr_bias],
        bias_from_rest=settings.bias_from_rest,
    )


def _push(stream: _core.CenterStream, gyr1: Any, acc1: Any, gyr2: Any, acc2: Any, time_s: Any) -> None:
    try:
        stream.push(gyr1, acc1, gyr2, acc2, time_s)
    except (TypeError, ValueError):
        # Not arrays as the core wants them: convert, and let the core say what is wrong with the rest.
        names = ("gyr1", "acc1", "gyr2", "acc2")
        values = (gyr1, acc1, gyr2, acc2)
        gyr1, acc1, gyr2, acc2 = (as_array(name, value) for name, value in zip(names, values, strict=True))
        time = None if time_s is None else np.atleast_1d(as_array("time_s", time_s))
        try:
            stream.push(gyr1, acc1, gyr2, acc2, time)
        except ValueError as error:
            raise InputError(str(error)) from None


def _bias_std(stream: _core.CenterStream, settings: CenterSettings) -> float:
    return settings.gyr_bias_std if None in stream.gyr_bias else settings.gyr_bias_rest_std


def _solve(stream: _core.CenterStream, method: str, pair: _Pair | None, settings: CenterSettings) -> CenterEstimate:
    fit = stream.fit(
        _core_method(method, settings),
        settings.acc_bias_std or 0.0,
        settings.lever_std,
        _bias_std(stream, settings),
        pair,
        settings.undetermined_std,
        settings.minimum_norm,
        settings.max_iterations,
    )
    return _estimate(fit, method, settings, stream)


MOST_RESIDUALS = 500


def _estimate(fit: _core.CenterFit, method: str, settings: CenterSettings, stream: _core.CenterStream | None) -> CenterEstimate:
    times, residuals = np.zeros(0), np.zeros(0)
    gyr_bias: list[list[float] | None] = [None, None]
    if stream is not None:
        times, residuals = stream.residuals(fit.in_sensor1, fit.in_sensor2, fit.acc_bias1, fit.acc_bias2, MOST_RESIDUALS)
        gyr_bias = stream.gyr_bias
    undetermined = np.array(fit.undetermined).reshape(-1, 6)
    status = CenterStatus(fit.status)
    if status is not CenterStatus.NUMERICAL_ERROR:
        if len(undetermined) >= 3 or fit.unexplained > UNEXPLAINED_LIMIT:
            status = CenterStatus.NOT_IDENTIFIABLE
        elif len(undetermined) and status is CenterStatus.CONVERGED:
            status = CenterStatus.PARTLY_DETERMINED
    bias1, bias2 = (None if bias is None else np.array(bias) for bias in gyr_bias)
    return CenterEstimate(
        in_sensor1=np.array(fit.in_sensor1),
        in_sensor2=np.array(fit.in_sensor2),
        covariance=np.array(fit.covariance),
        undetermined=undetermined,
        status=status,
        method=method,
        acc_bias1=np.array(fit.acc_bias1),
        acc_bias2=np.array(fit.acc_bias2),
        acc_bias_covariance=np.array(fit.acc_bias_covariance),
        acc_bias_undetermined=np.array(fit.acc_bias_undetermined).reshape(-1, 6),
        gyr_bias1=bias1,
        gyr_bias2=bias2,
        residual_std=fit.residual_std,
        unexplained=fit.unexplained,
        cost=fit.cost,
        n_samples=fit.n_samples,
        iterations=fit.iterations,
        residual_time_s=times,
        residuals=residuals,
        settings=settings,
    )


_Pair = list[list[float]]


def _axis_pair(axis: Axis | None) -> _Pair | None:
    if axis is None:
        return None
    pair = [getattr(axis, name, None) for name in ("axis1", "axis2")]
    for name, value in zip(("axis1", "axis2"), pair, strict=True):
        if not isinstance(value, np.ndarray) or value.shape != (3,) or not abs(np.linalg.norm(value) - 1.0) < 1e-6:
            raise InputError(f"axis.{name} must be a unit vector of shape (3,), got {value!r}")
    return [value.tolist() for value in pair if value is not None]


def _rows(name: str, value: object, width: int | None) -> Array:
    array = as_array(name, value)
    shape = "(N,)" if width is None else f"(N, {width})"
    if array.ndim != (1 if width is None else 2) or (width is not None and array.shape[1] != width):
        raise InputError(f"{name} must have shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds values that are not finite")
    return array


def _quaternions(q_12: object, count: int) -> Array:
    q = _rows("q_12", q_12, 4)
    if len(q) != count:
        raise InputError(f"q_12 has {len(q)} rows for {count} samples")
    if np.abs(np.linalg.norm(q, axis=1) - 1.0).max() > 1e-3:
        raise InputError("q_12 must hold unit quaternions [w, x, y, z]")
    return q


def _at_times(q: Array, time_s: Array, wanted_s: Array) -> Array:
    """Orientations between the samples: linear between neighbours of one sign, which normalising makes all but exact."""
    smooth = continuous(q)
    between = np.stack([np.interp(wanted_s, time_s, smooth[:, k]) for k in range(4)], axis=1)
    return np.ascontiguousarray(between / np.linalg.norm(between, axis=1, keepdims=True))
