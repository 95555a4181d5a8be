"""When to trust a hinge: from the core's records, one a step, to verdicts and acceptance.

Two rules live here. "calibrated" is ours: is there enough motion, is it a hinge (misfit), is the sign pairing settled, does a
rival minimum stand, is the calibrated bound small, and have the axes stayed for `n_consistent` steps in which the joint has
moved; revocable. "published" is Algorithm 4 of Olsson et al. 2020.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.samples import ReadOnly
from imufast.settings import HingeSettings

__all__ = ["Decider", "Estimate", "HingeStep", "Past", "Verdict"]

Array = NDArray[np.float64]

MOVING_S = 3.0
"""The joint must have moved this long before anything is said, s."""
ENERGY = 5.0
"""...and with this much energy: ∫(relative rate)² dt, rad²/s. Below it a stiff joint looks like a bad hinge."""
REFUSE_MOVING_S = 10.0
"""The joint must have moved this long before it is refused, s."""
PIECES = 6
"""Pieces of time that bounds must rest on."""
PAIRING_MOTION = 0.7
"""Evidence from planar motion that settles the sign pairing: logarithm of how much more the other leaves unexplained, so twice
as much. Measured: rigs 2.4-4.6, knees 1.1-2.3; wrong pairings under biases of 1 deg/s and 1 m/s² up to 0.56."""
PAIRING_ACC = (2.0, 4.0)
"""Otherwise the accelerometers settle it: significance, and cost of the other pairing over this one's (wrong pairings under
these biases: 1.5-2 times)."""
RIVAL = (1.64, 4.0)
"""A rival minimum is refuted by the significance or by the ratio of its cost."""
DETERMINED_DEG = 25.0
"""With a bound as wide as this, degrees, nothing is said: where one sensor rests, any motion looks like a hinge."""
GRACE_STEPS = 3
"""An accepted run may fail so many steps, less one, before acceptance is revoked."""
SLIP_RATIO, SLIP_MISFIT, SLIP_DEG, SLIP_STEPS = 3.0, 0.03, 6.0, 3
"""A strap has slipped when present motion is a hinge about its own axes, misfits those from before so many times more and more
than this, its own lie this far away (degrees), and all that for so many steps."""


class Verdict(str, Enum):
    """What a joint is, as far as its motion has shown."""

    NOT_ENOUGH_INFORMATION = "NOT_ENOUGH_INFORMATION"
    HINGE = "HINGE"
    APPROXIMATE_HINGE = "APPROXIMATE_HINGE"
    NOT_A_HINGE = "NOT_A_HINGE"
    MOUNTING_CHANGED = "MOUNTING_CHANGED"
    BALL_JOINT = "BALL_JOINT"
    """Not a hinge but with a determined centre; of `calibrate_joint` alone."""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, eq=False)
class HingeStep(ReadOnly):
    """One step of calibration.

    Attributes:
        time_s: in the recording's time, s.
        verdict, accepted: as of this step.
        why: what stands in the way of acceptance, in words; empty when nothing does.
        axis1, axis2: (3,) latest axes, or None while there is no estimate.
        bound95_deg: (2,) bound for each axis, degrees; or None.
        published_bound_deg: (2,) the paper's local uncertainty μ + 2σ (eqs 57-65), degrees; or None.
        change_deg: how far the axes moved since the last estimate (SEQAD, eq. 67), degrees; 180 at the first; or None.
        misfit: see `HingeCalibration`; or None.
        relative_rate: rms rate of the joint while it moves, rad/s.
        moving_s: how long the joint has moved so far, s.
        n_gyr, n_acc: selected samples of each kind.
    """

    time_s: float
    verdict: Verdict
    accepted: bool
    why: tuple[str, ...]
    axis1: Array | None = field(default=None, repr=False)
    axis2: Array | None = field(default=None, repr=False)
    bound95_deg: Array | None = None
    published_bound_deg: Array | None = field(default=None, repr=False)
    change_deg: float | None = None
    misfit: float | None = None
    relative_rate: float = 0.0
    moving_s: float = 0.0
    n_gyr: int = 0
    n_acc: int = 0

    def plain(self) -> dict[str, Any]:
        """The same as plain JSON."""
        values = asdict(self)
        return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}

    @classmethod
    def from_plain(cls, plain: dict[str, Any]) -> HingeStep:
        """The step that `plain` wrote. Raises TypeError, KeyError or ValueError where it did not."""
        lengths = {"axis1": 3, "axis2": 3, "bound95_deg": 2, "published_bound_deg": 2}
        values: dict[str, Any] = {"verdict": Verdict(plain["verdict"]), "why": tuple(map(str, plain["why"]))}
        for name, value in plain.items():
            if name in values or value is None:
                continue
            if name == "accepted":
                fits = isinstance(value, bool)
            elif name in lengths:
                value = np.array(value, np.float64)
                fits = value.shape == (lengths[name],)
            else:
                fits = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not fits:
                raise ValueError(f"{name} of a step is {value!r}")
            values[name] = value
        return cls(**values)


@dataclass(frozen=True)
class Estimate:
    """What decisions need of a record of the core, in plain numbers (meanings as in `_core.HingeRecord`)."""

    axis1: list[float]
    axis2: list[float]
    covariance: list[list[float]]
    deviation: list[tuple[float, float]]
    published_deviation: list[tuple[float, float]]
    pieces: int
    pairing: float
    acc_pairing: tuple[float, float]
    rival: tuple[float, float] | None
    n_gyr: int
    n_acc: int

    @classmethod
    def of(cls, record: _core.HingeRecord) -> Estimate:
        """Read a record."""
        return cls(**{f.name: getattr(record, f.name) for f in fields(cls)})


@dataclass(frozen=True)
class Past:
    """Axes that were accepted as a hinge when the joint had moved so often, and their bound."""

    seen: int
    axis1: list[float]
    axis2: list[float]
    bound_deg: float


def angle_deg(a: Sequence[float], b: Sequence[float]) -> float:
    """Angle between two unit vectors, degrees; exact also near 0 and 180."""
    sums = [x + y for x, y in zip(a, b, strict=True)]
    return math.degrees(2.0 * math.atan2(math.dist(a, b), math.hypot(*sums)))


def paired_angle_deg(a: tuple[Array, Array], b: tuple[Array, Array]) -> float:
    """Worse angle between two axis pairs, the common sign free, degrees."""
    apart = [angle_deg(one.tolist(), other.tolist()) for one, other in zip(a, b, strict=True)]
    return min(max(apart), 180.0 - min(apart))


class Decider:
    """Turns records into steps; its state is small and plain."""

    def __init__(self, settings: HingeSettings) -> None:
        self.settings = settings
        self.accepted_at_s: float | None = None
        self.mounting_changed_at_s: list[float] = []
        self.start_over()

    def start_over(self) -> None:
        """Forget what belongs to one mounting."""
        self.accepted_at_s = None
        self.run = 0
        self.failed = 0
        self.slipping = 0
        self.last_seen = -1
        self.axes: tuple[Array, Array] | None = None
        self.taken: Estimate | None = None
        self.past: deque[Past] = deque()

    @property
    def accepted(self) -> bool:
        """Whether the current axes are accepted."""
        return self.accepted_at_s is not None

    def waiting_verdict(self) -> Verdict:
        """What is said while there is too little to say more."""
        return Verdict.MOUNTING_CHANGED if self.mounting_changed_at_s else Verdict.NOT_ENOUGH_INFORMATION

    def step(self, record: Estimate | None, time_s: float, stream: _core.HingeStream) -> HingeStep:
        """Judge the record of a step that ends at `time_s`."""
        if record is None:
            return HingeStep(time_s, self.waiting_verdict(), False, ("fewer samples than an estimate needs",))
        change = self._take_axes(record)
        axis1, axis2 = self.axes or (np.zeros(3), np.zeros(3))
        misfit, relative_rate, moving_s = stream.witness(record.axis1, record.axis2)
        bound = self._bound(record, misfit)
        published = np.degrees([mean + 2.0 * std for mean, std in record.published_deviation])
        seen = stream.moving_seen
        if self.settings.acceptance == "published":
            verdict, why = self._published(published, change, time_s)
        else:
            facts = _Facts(misfit, relative_rate, moving_s, float(bound.max()), change, seen > self.last_seen)
            verdict, why = self._calibrated(record, facts, time_s)
            if self._slipped(stream, seen, verdict, float(bound.max())):
                self.mounting_changed_at_s.append(time_s)
                verdict, why = Verdict.MOUNTING_CHANGED, ("the sensors sit otherwise than before: starting over",)
        self.last_seen = seen
        return HingeStep(
            time_s=time_s,
            verdict=verdict,
            accepted=self.accepted and not why,
            why=why,
            axis1=axis1,
            axis2=axis2,
            bound95_deg=bound,
            published_bound_deg=published,
            change_deg=change,
            misfit=misfit,
            relative_rate=relative_rate,
            moving_s=moving_s,
            n_gyr=record.n_gyr,
            n_acc=record.n_acc,
        )

    def _take_axes(self, record: Estimate) -> float:
        """Makes the record's axes the latest ones, with the sign of those before; returns how far they moved, degrees."""
        if record is self.taken:
            return 0.0
        self.taken = record
        axes, before = (np.array(record.axis1), np.array(record.axis2)), self.axes
        if before is not None and axes[0] @ before[0] + axes[1] @ before[1] < 0.0:
            axes = (-axes[0], -axes[1])
        self.axes = axes
        return 180.0 if before is None else paired_angle_deg(axes, before)

    def _bound(self, record: Estimate, misfit: float | None) -> Array:
        """Calibrated bound of each axis: scatter and biases, what is no hinge, and what no data show; degrees."""
        model = math.degrees(math.atan(1.0 if misfit is None else misfit))
        shown = [math.degrees(mean + 2.0 * std) for mean, std in record.deviation]
        return np.array([min(math.hypot(b, model, self.settings.floor_deg), 180.0) for b in shown])

    def _published(self, bound: Array, change: float, time_s: float) -> tuple[Verdict, tuple[str, ...]]:
        """Algorithm 4: local uncertainty and SEQAD below E_max for n_min estimates; then it stands."""
        limit = self.settings.max_error_deg
        small, steady = bool(bound.max() < limit), change < limit
        self.run = self.run + 1 if steady else 0
        if not self.accepted and small and self.run >= self.settings.n_consistent:
            self.accepted_at_s = time_s
        why: tuple[str, ...] = () if small else (f"local uncertainty {bound.max():.3g}° is not below {limit:g}°",)
        if self.run < self.settings.n_consistent:
            why += (f"{self.run} of {self.settings.n_consistent} estimates in a row agree so far",)
        return (Verdict.HINGE, ()) if self.accepted else (Verdict.NOT_ENOUGH_INFORMATION, why)

    def _calibrated(self, record: Estimate, facts: _Facts, time_s: float) -> tuple[Verdict, tuple[str, ...]]:
        verdict, why = self._verdict(record, facts)
        settings = self.settings
        hinge = facts.misfit is not None and facts.misfit < settings.hinge_misfit
        limit = settings.max_error_deg if hinge else settings.max_error_approximate_deg
        judged = verdict in (Verdict.HINGE, Verdict.APPROXIMATE_HINGE)
        if judged and not facts.bound_deg < limit:
            why += (f"the bound {facts.bound_deg:.3g}° is not below {limit:g}°",)
        # Estimates agree whatever their bound is and while the pairing is still open (another pairing would be a jump);
        # standing still adds nothing to it.
        if not judged and not facts.pairing_open:
            self.run = 0
        elif not facts.change_deg < limit:
            self.run = 1
            if facts.change_deg < 180.0:  # the first estimate has none before it
                why += (f"the axes moved by {facts.change_deg:.3g}° since the last estimate",)
        elif facts.moved or self.run == 0:
            self.run += 1
        if not self.accepted and not why and self.run < settings.n_consistent:
            why = (f"{self.run} of {settings.n_consistent} estimates in a row agree so far",)
        if not self.accepted:
            if not why:
                self.accepted_at_s, self.failed = time_s, 0
        else:
            self.failed = self.failed + 1 if why else 0
            if self.failed >= GRACE_STEPS or verdict is Verdict.NOT_A_HINGE:
                self.accepted_at_s, self.run = None, 0
        return verdict, why

    def _verdict(self, record: Estimate, facts: _Facts) -> tuple[Verdict, tuple[str, ...]]:
        settings, misfit = self.settings, facts.misfit
        if misfit is None or facts.moving_s < MOVING_S:
            return self.waiting_verdict(), (f"the joint has moved for {facts.moving_s:.1f} s; {MOVING_S:g} s are the least",)
        energy = facts.relative_rate**2 * facts.moving_s
        if energy < ENERGY:
            return self.waiting_verdict(), (f"the joint has hardly turned: {energy:.1f} of {ENERGY:g} rad²/s",)
        if misfit > settings.approximate_misfit:
            why = (f"misfit {misfit:.2f} is above {settings.approximate_misfit:g}",)
            return (Verdict.NOT_A_HINGE if facts.moving_s >= REFUSE_MOVING_S else self.waiting_verdict()), why
        blocks: tuple[str, ...] = ()
        if record.pieces < PIECES:
            blocks += (f"the estimate rests on {record.pieces} s of the recording; {PIECES} s are the least",)
        if not facts.bound_deg < DETERMINED_DEG:
            blocks += (f"the motion does not determine the axes yet: the bound is {facts.bound_deg:.0f}°",)
        significance, ratio = record.acc_pairing
        by_acc = abs(record.pairing) <= PAIRING_MOTION and significance > PAIRING_ACC[0] and ratio > PAIRING_ACC[1]
        if not (record.pairing > PAIRING_MOTION or by_acc):
            facts.pairing_open = not blocks and record.rival is None
            blocks += ("the motion does not tell yet which way the two axes belong together",)
        if record.rival is not None and record.rival[0] <= RIVAL[0] and record.rival[1] <= RIVAL[1]:
            blocks += ("another axis explains the motion about as well",)
        if blocks:
            return self.waiting_verdict(), blocks
        return (Verdict.HINGE if misfit < settings.hinge_misfit else Verdict.APPROXIMATE_HINGE), ()

    def _slipped(self, stream: _core.HingeStream, seen: int, verdict: Verdict, bound_deg: float) -> bool:
        """Whether the latest ten seconds of motion are those of another hinge than the one accepted before them."""
        assert self.axes is not None  # noqa: S101 - set by the caller
        window = _core.PRESENT_MOVING
        if self.accepted and verdict is Verdict.HINGE:
            if self.past and self.past[-1].seen == seen:
                self.past.pop()
            self.past.append(Past(seen, self.axes[0].tolist(), self.axes[1].tolist(), bound_deg))
        # The latest axes that were trusted before these ten seconds; they stay when trust is lost.
        while len(self.past) > 1 and self.past[1].seen <= seen - window:
            self.past.popleft()
        before = self.past[0] if self.past else None
        slipped = before is not None and before.seen <= seen - window and self._contradicts(stream, before)
        self.slipping = self.slipping + 1 if slipped else 0
        return self.slipping >= SLIP_STEPS

    def _contradicts(self, stream: _core.HingeStream, before: Past) -> bool:
        fit = stream.refit(before.axis1, before.axis2)
        if fit is None:
            return False
        misfit_before, misfit, axis1, axis2, deviation = fit
        if misfit_before <= max(SLIP_RATIO * misfit, SLIP_MISFIT) or misfit >= self.settings.hinge_misfit:
            return False
        # The rates alone do not pair the signs: each axis is a line here.
        angles = [angle_deg(new, old) for new, old in ((axis1, before.axis1), (axis2, before.axis2))]
        apart = max(min(angle, 180.0 - angle) for angle in angles)
        fit_bound = max(math.degrees(mean + 2.0 * std) for mean, std in deviation)
        return apart > max(SLIP_DEG, 2.0 * math.hypot(fit_bound, before.bound_deg))


@dataclass
class _Facts:
    """What a step is judged by, beside the record; `pairing_open`: nothing but the pairing stands in the way of a verdict."""

    misfit: float | None
    relative_rate: float
    moving_s: float
    bound_deg: float
    change_deg: float
    moved: bool
    pairing_open: bool = False
