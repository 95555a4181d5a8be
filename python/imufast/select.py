"""Which samples of a recording to estimate the hinge axis from: Algorithms 2 and 3 of Olsson et al. 2020."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.imu import Imu
from imufast.pairs import pair_signals
from imufast.samples import ReadOnly
from imufast.settings import AxisSettings, settings_from

__all__ = ["SampleSelection", "select_samples"]


@dataclass(frozen=True, eq=False)
class SampleSelection(ReadOnly):
    """The samples that tell most about the axis.

    Indices count the samples of the conditioned signals: without a low-pass those of the Imus. Give the selection to
    `estimate_hinge_axis` with the same `lowpass_hz`.

    Attributes:
        gyr_index, acc_index: ascending indices of the chosen gyroscope and accelerometer samples.
        gyr_score: (M,) s_ω of every sample (eqs 42-44), rad/s; 0 where its window is not complete.
        acc_score: (M,) s_a of every sample (eqs 45-46), rad²/s²; infinite where its window is not complete.
        time_s: (M,) times of the samples, s.
    """

    gyr_index: NDArray[np.int64]
    acc_index: NDArray[np.int64]
    gyr_score: NDArray[np.float64]
    acc_score: NDArray[np.float64]
    time_s: NDArray[np.float64]


def select_samples(imu1: Imu, imu2: Imu, *, settings: AxisSettings | None = None, **keywords: Any) -> SampleSelection:
    """Choose the most informative samples: Algorithm 2 (gyroscope) and Algorithm 3 (accelerometer).

    Gyroscope: half of `max_samples` with the highest and half with the lowest windowed difference of the two sensors' rates.
    Accelerometer: samples during which one sensor hardly turns, pruned where they repeat what others say; where coherence is
    spread so evenly that no row exceeds 0.5, the worst score goes. A recording with no more than `max_samples` samples keeps
    all of them. A sample is a candidate only once its window is complete, and no window reaches across a break.

    Args:
        imu1, imu2: the sensors on the two segments, same time base.
        settings: an `AxisSettings`; default `AxisSettings()`.
        **keywords: fields of `AxisSettings`; here `max_samples=1000`, `window_s=0.42` (s), `energy_threshold=1.0` (rad²/s²)
            and `lowpass_hz=None` (Hz) matter.

    Raises:
        InputError: not two Imus of one time base, the same data twice, or too few samples.
        SettingsError: an unknown setting or one out of its range.
    """
    chosen = settings_from(AxisSettings, settings, keywords)
    signals = pair_signals(imu1, imu2, chosen.lowpass_hz)
    gyr_index, acc_index, gyr_score, acc_score = _core.select_samples(
        signals.gyr1,
        signals.acc1,
        signals.gyr2,
        signals.acc2,
        signals.time_s,
        signals.rate_hz,
        chosen.max_samples,
        chosen.window_s,
        chosen.energy_threshold,
    )
    return SampleSelection(gyr_index, acc_index, gyr_score, acc_score, signals.time_s)
