"""Numerical core of imufast, in Rust. Arrays must be C-contiguous float64; lengths are checked, units are not."""

from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "HingeFit",
    "angular_deviation",
    "build_profile",
    "condition",
    "hinge_axis",
    "hinge_residuals",
    "select_samples",
]

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
