"""From the truth of all stretches to a recording: noise, bias and disturbance on every row, then lost packets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from imufast.errors import SettingsError

from .checks import FloatArray, number, vector3
from .motion_base import MotionBase
from .pair import SensorPair
from .pose import Movement
from .sensors import noisy
from .signals import stream
from .timing import Timeline, arrived

__all__ = ["Readout", "true_rows"]


@dataclass(frozen=True, eq=False)
class Readout:
    """What stands between the truth and a recording.

    Attributes:
        biases: "gyr_bias1", "acc_bias1", "gyr_bias2", "acc_bias2": (3,), rad/s and m/s².
        noise: "gyr", "acc": standard deviation of the white noise, rad/s and m/s².
        packet_loss: fraction of packets that each sensor loses.
        burst_length: mean number of packets lost in a row.
    """

    biases: dict[str, FloatArray]
    noise: dict[str, float]
    packet_loss: float
    burst_length: float

    @classmethod
    def checked(
        cls,
        *,
        gyr_noise: float,
        acc_noise: float,
        gyr_bias1: ArrayLike,
        gyr_bias2: ArrayLike,
        acc_bias1: ArrayLike,
        acc_bias2: ArrayLike,
        packet_loss: float,
        burst_length: float,
    ) -> Readout:
        """The settings of a simulation, checked."""
        return cls(
            biases={
                "gyr_bias1": vector3("gyr_bias1", gyr_bias1),
                "gyr_bias2": vector3("gyr_bias2", gyr_bias2),
                "acc_bias1": vector3("acc_bias1", acc_bias1),
                "acc_bias2": vector3("acc_bias2", acc_bias2),
            },
            noise={"gyr": number("gyr_noise", gyr_noise, least=0.0), "acc": number("acc_noise", acc_noise, least=0.0)},
            packet_loss=number("packet_loss", packet_loss, least=0.0, below=0.5),
            burst_length=number("burst_length", burst_length, least=1.0),
        )

    def recorded(
        self,
        seed: int,
        timeline: Timeline,
        motions: Sequence[MotionBase],
        pair: SensorPair,
        truth: Mapping[str, FloatArray],
        disturbed: Mapping[str, FloatArray] | None = None,
    ) -> dict[str, Any]:
        """The fields of a `PairSimulation`, all but `dof`, and those of `truth`, with the rows that arrive.

        `disturbed` holds "acc1", "acc2": (N, 3), where noise and bias come on top of something else than the truth.
        """
        quiet = {f"{kind}{i}": truth[f"{kind}{i}_true"] for kind in ("gyr", "acc") for i in (1, 2)} | dict(disturbed or {})
        # Noise falls on all rows before packets are lost, so that loss takes rows away and changes nothing else.
        measured = {
            f"{kind}{i}": noisy(
                quiet[f"{kind}{i}"], self.biases[f"{kind}_bias{i}"], self.noise[kind], stream(seed, f"{kind} noise {i}")
            )
            for kind in ("gyr", "acc")
            for i in (1, 2)
        }
        stamps, counts = timeline.time_s, timeline.counts
        kept = np.flatnonzero(
            arrived(stream(seed, "packets1"), len(stamps), self.packet_loss, self.burst_length)
            & arrived(stream(seed, "packets2"), len(stamps), self.packet_loss, self.burst_length)
        )
        if len(kept) < 2:
            raise SettingsError("packet_loss leaves fewer than 2 samples")
        return {
            "time_s": stamps[kept],
            "rate_hz": timeline.rate_hz if timeline.unbroken and len(kept) == len(stamps) else None,
            **{name: values[kept] for name, values in (measured | dict(truth)).items()},
            "motion": np.repeat([m.name for m in motions], counts)[kept],
            "part": np.repeat(np.arange(len(motions), dtype=np.int64), counts)[kept],
            "row": kept,
            "axis1": pair.axes[0],
            "axis2": pair.axes[1],
            "joint_in_sensor1": pair.joints[0],
            "joint_in_sensor2": pair.joints[1],
            **self.biases,
            "clock_offset_s": pair.clock_offset_s,
        }


def true_rows(
    pair: SensorPair, movements: Sequence[Movement], motions: Sequence[MotionBase], timeline: Timeline
) -> dict[str, FloatArray]:
    """The truth of all stretches, one after the other."""
    pieces = [
        pair.truth(movement, part, motion.start_s)
        for movement, motion, part in zip(movements, motions, timeline.parts, strict=True)
        if len(part.time_s)
    ]
    return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
