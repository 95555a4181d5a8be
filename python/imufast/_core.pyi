"""Numerical core of imufast, in Rust. Arrays must be C-contiguous float64; lengths are checked, units are not."""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "PRESENT_MOVING",
    "BodyFit",
    "BodyProblem",
    "CenterFit",
    "CenterStream",
    "HingeFit",
    "HingeRecord",
    "HingeStream",
    "OrientationFilter",
    "SmootherFit",
    "angular_deviation",
    "build_profile",
    "condition",
    "filter_innovations",
    "fit_center",
    "fit_center_linear",
    "hinge_axis",
    "hinge_residuals",
    "select_samples",
    "smooth_orientation",
    "track_filter",
    "track_filter_batch",
]

PRESENT_MOVING: int
build_profile: str

@final
class HingeFit:
    @property
    def axis1(self) -> list[float]: ...
    @property
    def axis2(self) -> list[float]: ...
    @property
    def cost(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def iterations(self) -> int: ...
    @property
    def minima(self) -> list[tuple[list[float], list[float], float]]: ...
    @property
    def covariance(self) -> list[list[float]]: ...
    @property
    def published_covariance(self) -> list[list[float]]: ...
    @property
    def deviation(self) -> list[tuple[float, float]]: ...
    @property
    def published_deviation(self) -> list[tuple[float, float]]: ...
    @property
    def gyr_residual_std(self) -> float: ...
    @property
    def acc_residual_std(self) -> float: ...
    @property
    def unexplained(self) -> float: ...
    @property
    def pieces(self) -> int: ...

_Deviations: TypeAlias = list[tuple[float, float]]

@final
class HingeRecord:
    @property
    def time_s(self) -> float: ...
    @property
    def axis1(self) -> list[float]: ...
    @property
    def axis2(self) -> list[float]: ...
    @property
    def cost(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def minima(self) -> list[tuple[list[float], list[float], float]]: ...
    @property
    def covariance(self) -> list[list[float]]: ...
    @property
    def deviation(self) -> _Deviations: ...
    @property
    def published_deviation(self) -> _Deviations: ...
    @property
    def gyr_residual_std(self) -> float: ...
    @property
    def acc_residual_std(self) -> float: ...
    @property
    def unexplained(self) -> float: ...
    @property
    def pieces(self) -> int: ...
    @property
    def pairing(self) -> float: ...
    @property
    def acc_pairing(self) -> tuple[float, float]: ...
    @property
    def rival(self) -> tuple[float, float] | None: ...
    @property
    def misfit(self) -> float | None: ...
    @property
    def relative_rate(self) -> float: ...
    @property
    def moving_s(self) -> float: ...
    @property
    def n_gyr(self) -> int: ...
    @property
    def n_acc(self) -> int: ...

@final
class HingeStream:
    def __new__(
        cls,
        rate_hz: float,
        lowpass_hz: float,
        window_s: float,
        max_samples: int,
        energy_threshold: float,
        always_quiet: bool,
        settle_pairing: bool,
        bias_from_rest: bool,
        max_iterations: int,
        weight_ratio: float,
        rate_scale: float,
        offset_prior: float,
        step_s: float,
    ) -> HingeStream: ...
    def push(
        self,
        gyr1: NDArray[np.float64],
        acc1: NDArray[np.float64],
        gyr2: NDArray[np.float64],
        acc2: NDArray[np.float64],
        time_s: NDArray[np.float64] | None,
        start: int,
    ) -> int: ...
    def estimate(
        self, gyr_offset_std: float, acc_offset_std: float, starts: NDArray[np.float64] | None
    ) -> HingeRecord | None: ...
    def next_step(self) -> None: ...
    @property
    def next_step_s(self) -> float: ...
    @property
    def mean_step_s(self) -> float | None: ...
    @property
    def changes(self) -> tuple[int, int]: ...
    @property
    def moving_seen(self) -> int: ...
    @property
    def gyr_bias(self) -> list[list[float] | None]: ...
    def witness(self, axis1: list[float], axis2: list[float]) -> tuple[float | None, float, float]: ...
    def refit(
        self, axis1: list[float], axis2: list[float]
    ) -> tuple[float, float, list[float], list[float], _Deviations] | None: ...
    def chosen_times(self) -> tuple[list[float], list[float]]: ...
    def restart(self) -> None: ...
    def state(self) -> bytes: ...
    @staticmethod
    def restore(state: bytes) -> HingeStream: ...

def hinge_axis(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64],
    gyr_index: NDArray[np.int64] | None,
    acc_index: NDArray[np.int64] | None,
    weight_ratio: float,
    starts: NDArray[np.float64] | None,
    max_iterations: int,
) -> HingeFit: ...
def hinge_residuals(
    gyr1: NDArray[np.float64], gyr2: NDArray[np.float64], axis1: list[float], axis2: list[float]
) -> NDArray[np.float64]: ...
def angular_deviation(p: list[list[float]]) -> tuple[float, float]: ...
def condition(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64],
    rate_hz: float,
    cutoff_hz: float,
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]: ...
def select_samples(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64],
    rate_hz: float,
    max_samples: int,
    window_s: float,
    energy_threshold: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]: ...

@final
class CenterFit:
    @property
    def in_sensor1(self) -> list[float]: ...
    @property
    def in_sensor2(self) -> list[float]: ...
    @property
    def acc_bias1(self) -> list[float]: ...
    @property
    def acc_bias2(self) -> list[float]: ...
    @property
    def covariance(self) -> list[list[float]]: ...
    @property
    def acc_bias_covariance(self) -> list[list[float]]: ...
    @property
    def undetermined(self) -> list[list[float]]: ...
    @property
    def acc_bias_undetermined(self) -> list[list[float]]: ...
    @property
    def status(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def iterations(self) -> int: ...
    @property
    def residual_std(self) -> float: ...
    @property
    def unexplained(self) -> float: ...
    @property
    def pieces(self) -> int: ...
    @property
    def n_samples(self) -> int: ...

_Array: TypeAlias = NDArray[np.float64]

@final
class CenterStream:
    def __new__(
        cls,
        rate_hz: float,
        lowpass_hz: float,
        five_points: bool,
        least_rate: float,
        max_samples: int,
        gyr_bias: list[list[float]] | None,
        bias_from_rest: bool,
    ) -> CenterStream: ...
    def push(
        self, gyr1: _Array, acc1: _Array, gyr2: _Array, acc2: _Array, time_s: _Array | None, trusted: bool = False
    ) -> None: ...
    def fit(
        self,
        method: str,
        bias_std: float,
        lever_std: float,
        gyr_bias_std: float,
        axis: list[list[float]] | None,
        undetermined_std: float,
        minimum_norm: bool,
        max_iterations: int,
    ) -> CenterFit: ...
    def fit_linear(
        self,
        q_12: _Array,
        bias_std: float,
        lever_std: float,
        gyr_bias_std: float,
        axis: list[list[float]] | None,
        undetermined_std: float,
    ) -> CenterFit: ...
    def times(self) -> _Array: ...
    def residuals(
        self,
        in_sensor1: list[float],
        in_sensor2: list[float],
        acc_bias1: list[float],
        acc_bias2: list[float],
        most: int,
    ) -> tuple[_Array, _Array]: ...
    @property
    def correlated(self) -> float: ...
    @property
    def delay_s(self) -> float: ...
    @property
    def count(self) -> int: ...
    @property
    def gyr_bias(self) -> list[list[float] | None]: ...
    def state(self) -> bytes: ...
    @staticmethod
    def restore(state: bytes) -> CenterStream: ...

def fit_center(
    moments: list[_Array],
    time_s: _Array,
    method: str,
    bias_std: float,
    lever_std: float,
    correlated: float,
    gyr_bias_std: float,
    axis: list[list[float]] | None,
    undetermined_std: float,
    minimum_norm: bool,
    max_iterations: int,
) -> CenterFit: ...
def fit_center_linear(
    moments: list[_Array],
    time_s: _Array,
    q_12: _Array,
    bias_std: float,
    lever_std: float,
    correlated: float,
    gyr_bias_std: float,
    axis: list[list[float]] | None,
    undetermined_std: float,
) -> CenterFit: ...

_TimedArrays: TypeAlias = tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64] | None
]

@final
class OrientationFilter:
    def __new__(cls, plan: dict[str, Any]) -> OrientationFilter: ...
    def update(
        self,
        gyr1: NDArray[np.float64],
        acc1: NDArray[np.float64],
        gyr2: NDArray[np.float64],
        acc2: NDArray[np.float64],
        time_s: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]: ...
    @property
    def angle_std(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def heading_power(self) -> float: ...
    @property
    def restarts(self) -> int: ...
    @property
    def delay_s(self) -> float: ...
    def state(self) -> bytes: ...
    @staticmethod
    def restore(state: bytes) -> OrientationFilter: ...

def track_filter(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64] | None,
    plan: dict[str, Any],
    q_12: NDArray[np.float64],
    std_deg: NDArray[np.float64],
    vague_deg: float,
) -> tuple[int, list[tuple[int, int]], int]: ...
def track_filter_batch(
    recordings: list[_TimedArrays],
    plans: list[dict[str, Any]],
    q_12: NDArray[np.float64],
    std_deg: NDArray[np.float64],
    vague_deg: float,
) -> list[tuple[int, list[tuple[int, int]], int]]: ...
def filter_innovations(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64],
    plan: dict[str, Any],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

@final
class SmootherFit:
    @property
    def q_12(self) -> NDArray[np.float64]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def covariance_known(self) -> NDArray[np.float64]: ...
    @property
    def constants(self) -> NDArray[np.float64]: ...
    @property
    def constants_covariance(self) -> NDArray[np.float64]: ...
    @property
    def status(self) -> str: ...
    @property
    def iterations(self) -> int: ...
    @property
    def link_std(self) -> float: ...
    @property
    def drift_std(self) -> float: ...
    @property
    def trust(self) -> float: ...
    @property
    def link_samples(self) -> NDArray[np.uint64]: ...
    @property
    def link_squares(self) -> NDArray[np.float64]: ...

def smooth_orientation(
    gyr1: NDArray[np.float64],
    acc1: NDArray[np.float64],
    gyr2: NDArray[np.float64],
    acc2: NDArray[np.float64],
    time_s: NDArray[np.float64],
    rate_hz: float,
    prior_mean: NDArray[np.float64],
    prior_precision: NDArray[np.float64],
    window_s: float,
    key_step_s: float,
    bridge_s: float,
    tail: float,
    drift_std: float | None,
    link_std: float | None,
    rest_bias_std: float | None,
    max_iterations: int,
) -> SmootherFit: ...

_Joint = tuple[int, int, list[float], float | None, float | None]
_End = tuple[int, int]
_Bone = tuple[_End, _End, tuple[float, float] | None, tuple[float, float] | None]

@final
class BodyFit:
    @property
    def q(self) -> NDArray[np.float64]: ...
    @property
    def velocity(self) -> NDArray[np.float64]: ...
    @property
    def position(self) -> NDArray[np.float64]: ...
    @property
    def gyr_bias(self) -> NDArray[np.float64]: ...
    @property
    def acc_bias(self) -> NDArray[np.float64]: ...
    @property
    def centers(self) -> NDArray[np.float64]: ...
    @property
    def axes(self) -> NDArray[np.float64]: ...
    @property
    def skins(self) -> NDArray[np.float64]: ...
    @property
    def link_squares(self) -> NDArray[np.float64]: ...
    @property
    def joint_squares(self) -> NDArray[np.float64]: ...
    @property
    def status(self) -> str: ...
    @property
    def cost(self) -> float: ...
    @property
    def trials(self) -> NDArray[np.float64]: ...
    @property
    def joint_covariance(self) -> NDArray[np.float64] | None: ...
    @property
    def joint_constants(self) -> NDArray[np.float64] | None: ...
    @property
    def constants_covariance(self) -> NDArray[np.float64] | None: ...

@final
class BodyProblem:
    def __new__(
        cls,
        time_s: NDArray[np.float64],
        gyr: NDArray[np.float64],
        acc: NDArray[np.float64],
        rate_hz: float,
        intervals: bool,
        spacing: tuple[int, int, float],
        biases: NDArray[np.float64],
        joints: Sequence[_Joint],
        bones: Sequence[_Bone],
        angles: list[tuple[_End, int, float, float]],
        differences: list[tuple[int, int, float]],
        noise: list[float],
        gravity: float,
        skins: list[tuple[int, float, float]],
    ) -> BodyProblem: ...
    @property
    def samples(self) -> NDArray[np.uintp]: ...
    @property
    def linked(self) -> NDArray[np.bool_]: ...
    @property
    def rates(self) -> NDArray[np.float64]: ...
    def minimise(
        self,
        q: NDArray[np.float64],
        velocity: NDArray[np.float64],
        position: NDArray[np.float64],
        gyr_bias: NDArray[np.float64],
        acc_bias: NDArray[np.float64],
        centers: NDArray[np.float64],
        axes: NDArray[np.float64],
        skins: NDArray[np.float64],
        drives: NDArray[np.float64],
        descent: tuple[int, float, float],
        covariance: bool,
        watch: Callable[[int, float, float, float], object] | None = None,
        held: NDArray[np.float64] | None = None,
        beforehand: NDArray[np.float64] | None = None,
        rests: NDArray[np.float64] | None = None,
        postures: NDArray[np.float64] | None = None,
        usual: NDArray[np.float64] | None = None,
    ) -> BodyFit: ...
