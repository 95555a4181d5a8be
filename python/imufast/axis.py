"""The hinge axis of a joint from two sensors: Algorithm 1 of Olsson et al. 2020 and what it returns."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from imufast import _core
from imufast.errors import InputError
from imufast.imu import Imu
from imufast.pairs import PairSignals, pair_signals
from imufast.samples import ReadOnly
from imufast.settings import AxisSettings, settings_from

__all__ = ["HingeAxis", "HingeMinimum", "JointAxis", "SolveStatus", "estimate_hinge_axis"]

Array = NDArray[np.float64]
JointAxisT = TypeVar("JointAxisT", bound="JointAxis")


UNEXPLAINED_LIMIT = 0.9
"""Motion tells nothing where the best axes leave this share of the plain difference of the two rates; of n samples
0.96 − 2.6/√n where that is less, since axes fitted to a little noise explain some of it. Measured: still or stiff joints above
it, mechanical hinges up to 0.07, knees 0.4-0.6, joints with more degrees of freedom 0.67-0.89."""


class SolveStatus(str, Enum):
    """How a search for the hinge axis ended."""

    CONVERGED = "CONVERGED"
    """At a minimum that the data determine."""
    STALLED = "STALLED"
    """No step lowered the cost although one was promised; take the numbers with care."""
    MAX_ITERATIONS = "MAX_ITERATIONS"
    """The iterations ran out before the minimum."""
    NOT_IDENTIFIABLE = "NOT_IDENTIFIABLE"
    """The motion does not determine the axes: their direction could as well be another."""
    NUMERICAL_ERROR = "NUMERICAL_ERROR"
    """The numbers overflow; are they in the right unit?"""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class HingeMinimum:
    """One minimum of the cost: axes in both sensor frames (3,) and cost V (eq. 23)."""

    axis1: Array
    axis2: Array
    cost: float


@dataclass(frozen=True)
class JointAxis(ReadOnly):
    """The axis of a hinge in the frames of the two sensors on its segments.

    Attributes:
        axis1, axis2: (3,) unit vectors in sensor frames 1 and 2 with one common sign. The relative rate about the axis is
            `axis2·gyr2 − axis1·gyr1`; its integral is the joint angle.
        covariance: (6, 6) of the stacked axes in sensor coordinates, rad²; singular along each axis.
        bound95_deg: (2,) bound meant to hold the angle between each axis and the truth in 95 % of cases, degrees.
    """

    axis1: Array
    axis2: Array
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)), repr=False)
    bound95_deg: Array = field(default_factory=lambda: np.zeros(2))

    def flipped(self: JointAxisT) -> JointAxisT:
        """The same axis with the overall sign turned."""
        return replace(self, axis1=-self.axis1, axis2=-self.axis2)

    def oriented(
        self: JointAxisT,
        *,
        towards1: ArrayLike | None = None,
        towards2: ArrayLike | None = None,
        flexing: tuple[Imu, Imu] | None = None,
    ) -> JointAxisT:
        """The same axis with its overall sign chosen by exactly one of:

        Args:
            towards1, towards2: (3,) a direction in the frame of sensor 1 or 2 to which the axis shall point.
            flexing: two Imus cut to a time in which the joint flexes on the whole; the joint angle shall grow over it.

        Raises:
            InputError: none or several given, a direction that is perpendicular to the axis, or no net rotation.
        """
        given = [
            (name, value)
            for name, value in (("towards1", towards1), ("towards2", towards2), ("flexing", flexing))
            if value is not None
        ]
        if len(given) != 1:
            raise InputError(f"give exactly one of towards1, towards2, flexing; got {[name for name, _ in given] or 'none'}")
        name, value = given[0]
        if name == "flexing":
            if not isinstance(value, tuple) or len(value) != 2:
                raise InputError(f"flexing must be a tuple of two Imus, got {type(value).__name__}")
            signals = pair_signals(*value)
            along = float(signals.relative_rate(self.axis1, self.axis2)[:-1] @ np.diff(signals.time_s))
            small = np.radians(1.0)
        else:
            along = float(_direction(name, value) @ (self.axis1 if name == "towards1" else self.axis2))
            small = 1e-3
        if abs(along) < small:
            raise InputError(f"{name} does not tell the sign: it is perpendicular to the axis, or the joint hardly turns")
        return self if along > 0 else self.flipped()


@dataclass(frozen=True, kw_only=True)
class HingeAxis(JointAxis):
    """A hinge axis in both sensor frames, with the numbers that say how far to trust it.

    Attributes:
        axis1, axis2: (3,) unit vectors in sensor frames 1 and 2 with one common sign. The relative rate about the axis is
            `axis2·gyr2 − axis1·gyr1`. The overall sign is canonical (largest component of `axis1` positive) until `oriented`.
        covariance: (6, 6) of the stacked axes in sensor coordinates, rad²; singular along each axis. Residuals may be
            correlated within a second and of any distribution (sandwich over pieces of 1 s). Infinite where the motion does
            not determine the axes or is shorter than five pieces.
        bound95_deg: (2,) bound meant to hold the angle between each axis and the truth in 95 % of cases, degrees: μ + 2σ of
            eqs 64-65, in closed form, from `covariance`, and `floor_deg` for what no data show (root of the sum of squares).
        published_bound_deg: (2,) the same from the paper's covariance (eq. 57), which takes residuals as independent.
        status: how the search ended.
        cost: V of eq. 23 at the axes.
        minima: all distinct minima found, best first; the first is the estimate.
        gyr_residual_std, acc_residual_std: sample standard deviations of the residuals (eq. 58), rad/s and m/s².
        n_gyr, n_acc: how many samples of each kind were used.
        iterations: Gauss-Newton iterations over all starts.
    """

    published_bound_deg: Array
    status: SolveStatus
    cost: float
    minima: tuple[HingeMinimum, ...] = field(repr=False)
    gyr_residual_std: float
    acc_residual_std: float
    n_gyr: int
    n_acc: int
    iterations: int


def _direction(name: str, value: object) -> Array:
    try:
        direction = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        direction = np.zeros(0)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(f"{name} must be three finite numbers, not all zero; got {value!r}")
    scaled = direction / np.abs(direction).max()
    return np.asarray(scaled / np.linalg.norm(scaled))


class Selection(Protocol):
    """Which samples to use: indices into the conditioned signals, ascending."""

    @property
    def gyr_index(self) -> NDArray[np.int64]: ...
    @property
    def acc_index(self) -> NDArray[np.int64]: ...


def estimate_hinge_axis(
    imu1: Imu, imu2: Imu, samples: Selection | None = None, *, settings: AxisSettings | None = None, **keywords: Any
) -> HingeAxis:
    """Find the axis of a hinge joint in the frames of the two sensors on its segments: Algorithm 1 of Olsson et al. 2020.

    Minimises Σ e_ω² + e_a² (eqs 22-25) by Gauss-Newton on the tangent planes of both axes, from four deterministic starts and
    the opposite sign pairing of each. It does not judge whether the joint is a hinge: see `calibrate_hinge`.

    Args:
        imu1, imu2: the sensors on the two segments, same time base. Any mounting.
        samples: which samples to use (`.gyr_index`, `.acc_index`); default all.
        settings: an `AxisSettings` (or `HingeSettings`, which are more); default `AxisSettings()`.
        **keywords: any field of `AxisSettings`, such as `weight_ratio=50.0`, `starts="deterministic"`, `lowpass_hz=4.0`;
            they win over `settings`.

    Returns:
        HingeAxis. Motion that does not determine the axes gives the status NOT_IDENTIFIABLE, not an exception.

    Raises:
        InputError: not two Imus of one time base, the same data twice, or too few samples.
        SettingsError: an unknown setting or one out of its range.
    """
    chosen = settings_from(AxisSettings, settings, keywords)
    signals = pair_signals(imu1, imu2, chosen.lowpass_hz)
    if samples is None:
        return fit_axis(signals, chosen)
    gyr_index, acc_index = (_index(samples, name, len(signals)) for name in ("gyr_index", "acc_index"))
    return fit_axis(signals, chosen, gyr_index, acc_index)


def _index(samples: Selection, name: str, count: int) -> NDArray[np.int64]:
    try:
        array = np.asarray(getattr(samples, name))
    except (AttributeError, ValueError):
        raise InputError(
            "samples must have vectors of whole numbers .gyr_index and .acc_index, as select_samples gives; "
            f"got {type(samples).__name__}"
        ) from None
    if array.ndim != 1 or array.dtype.kind not in "iu" or not len(array):
        raise InputError(f"samples.{name} must be a vector of whole numbers, got shape {array.shape} of {array.dtype}")
    if array.min() < 0 or array.max() >= count or (np.diff(array.astype(np.int64)) <= 0).any():
        raise InputError(f"samples.{name} must ascend within 0 to {count - 1}, got {array.min()} to {array.max()}")
    return np.ascontiguousarray(array, np.int64)


def fit_axis(
    signals: PairSignals,
    settings: AxisSettings,
    gyr_index: NDArray[np.int64] | None = None,
    acc_index: NDArray[np.int64] | None = None,
) -> HingeAxis:
    """Algorithm 1 on conditioned signals."""
    starts = None
    if settings.starts == "random":
        starts = np.random.default_rng(settings.seed).normal(size=(settings.random_starts, 2, 3))
    fit = _core.hinge_axis(
        signals.gyr1,
        signals.acc1,
        signals.gyr2,
        signals.acc2,
        signals.time_s,
        gyr_index,
        acc_index,
        settings.weight_ratio,
        starts,
        settings.max_iterations,
    )
    bound = np.hypot(np.degrees([mean + 2.0 * std for mean, std in fit.deviation]), settings.floor_deg)
    status = SolveStatus(fit.status)
    n_gyr = len(signals) if gyr_index is None else len(gyr_index)
    told = fit.unexplained < min(UNEXPLAINED_LIMIT, 0.96 - 2.6 / math.sqrt(n_gyr)) and (fit.pieces < 5 or bound.max() < 90.0)
    if status is not SolveStatus.NUMERICAL_ERROR and not told:
        status = SolveStatus.NOT_IDENTIFIABLE
    return HingeAxis(
        axis1=np.array(fit.axis1),
        axis2=np.array(fit.axis2),
        covariance=np.array(fit.covariance),
        bound95_deg=bound,
        published_bound_deg=np.degrees([mean + 2.0 * std for mean, std in fit.published_deviation]),
        status=status,
        cost=fit.cost,
        minima=tuple(HingeMinimum(np.array(a), np.array(b), cost) for a, b, cost in fit.minima),
        gyr_residual_std=fit.gyr_residual_std,
        acc_residual_std=fit.acc_residual_std,
        n_gyr=n_gyr,
        n_acc=len(signals) if acc_index is None else len(acc_index),
        iterations=fit.iterations,
    )
