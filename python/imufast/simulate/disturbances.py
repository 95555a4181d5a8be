"""What accelerometers feel beyond the rigid-body model: collisions, and soft tissue as in eq. 29 of Olsson & Halvorsen 2017."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypedDict

import numpy as np
from numpy.typing import NDArray

from imufast.errors import SettingsError

from .checks import FloatArray, number, seed_number, whole
from .signals import stream
from .timing import Timeline

__all__ = ["Collisions", "TissueMatrices", "random_tissue"]


@dataclass(frozen=True)
class Collisions:
    """Parts of the rig that hit each other: impulses at random instants, in random directions, in the accelerometers alone.

    A collision begins at the same sample in both sensors, as the blow runs through both links; its size and direction are
    drawn for each. It is largest at its first sample and dies linearly over as many samples as it lasts.

    Attributes:
        per_s: mean number of collisions per second; default 0.5. Their instants are independent of each other.
        least_m_s2, most_m_s2: bounds of the size at the first sample, m/s², drawn uniformly; defaults 10 and 60.
        most_samples: a collision lasts 1 to this many samples; default 3. The end of a motion or a lost packet cuts it short.
        sensors: which sensors feel them; default (1, 2).
        motions: names of the motions with collisions, as in `BallJointSimulation.motion`; default None, all. The paper's rig
            collided in ("S6", "S7").

    Raises:
        SettingsError: a value out of range; the message names it.
    """

    per_s: float = 0.5
    least_m_s2: float = 10.0
    most_m_s2: float = 60.0
    most_samples: int = 3
    sensors: tuple[Literal[1, 2], ...] = (1, 2)
    motions: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        number("per_s", self.per_s, least=0.0)
        number("least_m_s2", self.least_m_s2, least=0.0)
        if number("most_m_s2", self.most_m_s2, least=0.0) < self.least_m_s2:
            raise SettingsError(f"most_m_s2 must not be less than least_m_s2 = {self.least_m_s2:g}; got {self.most_m_s2:g}")
        whole("most_samples", self.most_samples, least=1)
        if not isinstance(self.sensors, tuple) or self.sensors not in ((1,), (2,), (1, 2)):
            raise SettingsError(f"sensors must be (1,), (2,) or (1, 2); got {self.sensors!r}")
        if self.motions is not None and not (
            isinstance(self.motions, tuple) and all(isinstance(name, str) for name in self.motions)
        ):
            raise SettingsError(f"motions must be a tuple of names or None; got {self.motions!r}")

    def impulses(self, seed: int, timeline: Timeline, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """What either sensor feels (N, 3), m/s²; `names` are those of the motions, one for each stretch."""
        unknown = sorted(set(self.motions or ()) - set(names))
        if unknown:
            raise SettingsError(f"motions of Collisions must be motions of the recording; {', '.join(unknown)} is not")
        counts = timeline.counts
        n = sum(counts)
        part = np.repeat(np.arange(len(counts)), counts)
        struck = np.repeat([self.motions is None or name in self.motions for name in names], counts)
        # The median step, so that nothing is felt of what happened while nothing was recorded.
        chance = -math.expm1(-self.per_s * float(np.median(np.diff(timeline.time_s))))
        rng = stream(seed, "collisions")
        begins = (rng.random(n) < chance) & struck
        samples = rng.integers(1, self.most_samples + 1, n)
        first, second = (
            self._felt(stream(seed, f"collisions {i}"), begins, samples, part) if i in self.sensors else np.zeros((n, 3))
            for i in (1, 2)
        )
        return first, second

    def _felt(
        self, rng: np.random.Generator, begins: NDArray[np.bool_], samples: NDArray[np.int64], part: NDArray[np.int64]
    ) -> FloatArray:
        size = rng.uniform(self.least_m_s2, self.most_m_s2, len(begins))
        direction = rng.standard_normal((len(begins), 3))
        blow = size[:, None] * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        felt: FloatArray = np.zeros_like(blow)
        for k in range(self.most_samples):
            here = np.flatnonzero(begins & (samples > k))
            here = here[here + k < len(begins)]
            here = here[part[here + k] == part[here]]
            felt[here + k] += (1.0 - k / samples[here])[:, None] * blow[here]
        return felt


class TissueMatrices(TypedDict):
    """H of eq. 29 for both sensors, under the names that `simulate_ball_joint` takes: (3, 3), m/rad."""

    tissue_matrix1: FloatArray
    tissue_matrix2: FloatArray


def random_tissue(seed: int = 0, *, std_m_rad: float = 0.018 / np.pi) -> TissueMatrices:
    """Random soft tissue for eq. 29, d_a = H ω̇: all elements of H are independent and Gaussian with mean zero (section V-D).

    Args:
        seed: non-negative integer; the same seed gives the same matrices.
        std_m_rad: standard deviation of each element, m/rad; default the paper's 18/π mm/rad.

    Returns:
        A mapping to hand on: `simulate_ball_joint("S3", **random_tissue(7))`.

    Raises:
        SettingsError: a negative size or seed.
    """
    rng = stream(seed_number(seed), "tissue")
    std_m_rad = number("std_m_rad", std_m_rad, least=0.0)
    return TissueMatrices(
        tissue_matrix1=std_m_rad * rng.standard_normal((3, 3)), tissue_matrix2=std_m_rad * rng.standard_normal((3, 3))
    )
