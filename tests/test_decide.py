"""The rules of acceptance, on estimates made by hand: no stream, no data, every number known."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from imufast import HingeSettings, HingeStep, Verdict, _core
from imufast.decide import Decider, Estimate

SMALL_STD = math.radians(0.2)


def unit(angle_deg: float) -> list[float]:
    """In the plane of x and z, from z."""
    return [math.sin(math.radians(angle_deg)), 0.0, math.cos(math.radians(angle_deg))]


GOOD = Estimate(
    axis1=unit(0.0),
    axis2=unit(0.0),
    covariance=np.zeros((6, 6)).tolist(),
    deviation=[(SMALL_STD, 0.0), (SMALL_STD, 0.0)],
    published_deviation=[(SMALL_STD, 0.0), (SMALL_STD, 0.0)],
    pieces=30,
    pairing=2.0,
    acc_pairing=(0.0, 1.0),
    rival=None,
    n_gyr=1000,
    n_acc=1000,
)


def tilted(by_deg: float, **changes: Any) -> Estimate:
    """The good estimate with both axes turned."""
    return replace(GOOD, axis1=unit(by_deg), axis2=unit(by_deg), **changes)


@dataclass
class FakeStream:
    """What a Decider asks of a stream; every look finds more motion unless `still`."""

    misfit: float | None = 0.01
    relative_rate: float = 2.0
    moving_s: float = 20.0
    moving_seen: int = 0
    still: bool = False
    fit: Any = None

    def witness(self, axis1: list[float], axis2: list[float]) -> tuple[float | None, float, float]:
        return self.misfit, self.relative_rate, self.moving_s

    def refit(self, axis1: list[float], axis2: list[float]) -> Any:
        return self.fit


class Trial:
    """A decider and its stream, one step a second."""

    def __init__(self, **settings: Any) -> None:
        self.decider = Decider(HingeSettings(**settings))
        self.stream = FakeStream()
        self.time_s = 0.0

    def step(self, estimate: Estimate | None = GOOD, **stream: Any) -> HingeStep:
        self.time_s += 1.0
        for name, value in stream.items():
            setattr(self.stream, name, value)
        self.stream.moving_seen += 0 if self.stream.still else 12
        fake: Any = self.stream
        return self.decider.step(estimate, self.time_s, fake)

    def steps(self, count: int, estimate: Estimate | None = GOOD, **stream: Any) -> list[HingeStep]:
        return [self.step(estimate, **stream) for _ in range(count)]


def accepted(n_consistent: int = 4, **settings: Any) -> Trial:
    """A trial that has just been accepted."""
    trial = Trial(n_consistent=n_consistent, **settings)
    assert [s.accepted for s in trial.steps(n_consistent)] == [False] * (n_consistent - 1) + [True]
    return trial


@pytest.mark.parametrize("n_consistent", [2, 3, 10])
def test_so_many_estimates_in_a_row_must_agree(n_consistent: int) -> None:
    # The first has nothing to agree with: it begins the run and counts as one.
    steps = Trial(n_consistent=n_consistent).steps(15)
    assert [s.accepted for s in steps] == [False] * (n_consistent - 1) + [True] * (16 - n_consistent)
    assert [bool(s.why) for s in steps] == [not s.accepted for s in steps]


def test_where_one_estimate_is_enough_nothing_stands_in_its_way() -> None:
    step = Trial(n_consistent=1).step()
    assert step.accepted
    assert step.why == ()


def test_the_moment_of_acceptance_is_that_of_the_step_and_stays() -> None:
    trial = accepted()
    assert trial.decider.accepted_at_s == 4.0
    trial.steps(50)
    assert trial.decider.accepted_at_s == 4.0


def test_steps_without_motion_count_for_nothing() -> None:
    trial = Trial(n_consistent=4)
    trial.steps(3)
    assert not any(s.accepted for s in trial.steps(20, still=True))
    assert "agree so far" in trial.step(still=True).why[0]
    assert trial.step(still=False).accepted


def test_an_accepted_hinge_stays_accepted_at_rest() -> None:
    trial = accepted()
    assert all(s.accepted for s in trial.steps(100, still=True))


def test_a_jump_begins_a_new_run() -> None:
    trial = Trial(n_consistent=4)
    trial.steps(3)
    jump = trial.step(tilted(5.0))
    assert not jump.accepted
    assert jump.change_deg == pytest.approx(5.0)
    assert "moved by 5°" in jump.why[0]
    # The estimate after the jump is the first of the new run, as the first of all was.
    assert [s.accepted for s in trial.steps(4, tilted(5.0))] == [False, False, True, True]


def test_small_changes_are_no_jumps() -> None:
    trial = Trial(n_consistent=4)
    assert [trial.step(tilted(2.5 * (k % 2))).accepted for k in range(6)] == [False] * 3 + [True] * 3


def test_a_bad_estimate_empties_the_run() -> None:
    trial = Trial(n_consistent=3)
    trial.steps(2)
    trial.step(replace(GOOD, pieces=2))
    assert [s.accepted for s in trial.steps(3)] == [False, False, True]


def test_grace_two_failing_steps_are_forgiven_and_the_third_revokes() -> None:
    wide = replace(GOOD, deviation=[(math.radians(5.0), 0.0)] * 2)
    for failures in (1, 2):
        trial = accepted()
        trial.steps(failures, wide)
        after = trial.step()
        assert after.accepted
        assert trial.decider.accepted_at_s == 4.0
    trial = accepted()
    trial.steps(3, wide)
    assert trial.decider.accepted_at_s is None
    # Then a whole new run is needed, and its moment is its own.
    again = trial.steps(4)
    assert [s.accepted for s in again] == [False, False, False, True]
    assert trial.decider.accepted_at_s == trial.time_s == 11.0


def test_failures_apart_do_not_add_up() -> None:
    trial = accepted()
    for _ in range(5):
        trial.steps(2, replace(GOOD, pieces=2))
        assert trial.step().accepted


@pytest.mark.parametrize(
    "failing",
    [
        pytest.param(replace(GOOD, pieces=2), id="verdict"),
        pytest.param(replace(GOOD, deviation=[(math.radians(5.0), 0.0)] * 2), id="bound"),
    ],
)
def test_accepted_implies_its_verdict_and_its_bound(failing: Estimate) -> None:
    step = (trial := accepted()).step(failing)
    limit = {Verdict.HINGE: 3.0, Verdict.APPROXIMATE_HINGE: 12.0}.get(step.verdict, 0.0)
    assert step.bound95_deg is not None
    assert not step.accepted or step.bound95_deg.max() < limit, trial


def test_what_is_no_hinge_is_revoked_at_once() -> None:
    trial = accepted()
    step = trial.step(misfit=0.4)
    assert step.verdict is Verdict.NOT_A_HINGE
    assert not step.accepted
    assert trial.decider.accepted_at_s is None
    assert "misfit 0.40 is above 0.25" in step.why


@pytest.mark.parametrize(
    ("misfit", "verdict"),
    [
        (0.0, Verdict.HINGE),
        (0.0499, Verdict.HINGE),
        (0.0501, Verdict.APPROXIMATE_HINGE),
        (0.2, Verdict.APPROXIMATE_HINGE),
        (0.2501, Verdict.NOT_A_HINGE),
        (3.0, Verdict.NOT_A_HINGE),
        (None, Verdict.NOT_ENOUGH_INFORMATION),
    ],
)
def test_misfit_decides_what_the_joint_is(misfit: float | None, verdict: Verdict) -> None:
    assert Trial().step(misfit=misfit).verdict is verdict


def test_limits_of_misfit_are_settings() -> None:
    assert Trial(hinge_misfit=0.2).step(misfit=0.15).verdict is Verdict.HINGE
    assert Trial(approximate_misfit=0.4).step(misfit=0.35).verdict is Verdict.APPROXIMATE_HINGE
    assert Trial(approximate_misfit=0.1).step(misfit=0.15).verdict is Verdict.NOT_A_HINGE


NOT_YET = {
    "hardly moved": (GOOD, {"moving_s": 2.9}, "the joint has moved for 2.9 s"),
    "hardly turned": (GOOD, {"relative_rate": 0.4}, "the joint has hardly turned"),
    "no hinge, but too soon": (GOOD, {"misfit": 0.6, "moving_s": 9.0}, "misfit 0.60"),
    "few pieces": (replace(GOOD, pieces=5), {}, "rests on 5 s"),
    "unpaired": (replace(GOOD, pairing=0.69), {}, "which way the two axes belong together"),
    "wrongly paired": (replace(GOOD, pairing=-1.0, acc_pairing=(9.0, 9.0)), {}, "which way the two axes belong together"),
    "gravity unsure": (replace(GOOD, pairing=0.1, acc_pairing=(1.9, 9.0)), {}, "which way the two axes belong together"),
    "gravity weak": (replace(GOOD, pairing=0.1, acc_pairing=(9.0, 3.9)), {}, "which way the two axes belong together"),
    "a rival": (replace(GOOD, rival=(1.6, 3.9)), {}, "another axis explains the motion about as well"),
}


@pytest.mark.parametrize("case", NOT_YET)
def test_what_is_not_enough_is_said_in_words(case: str) -> None:
    estimate, stream, words = NOT_YET[case]
    step = Trial(n_consistent=1).step(estimate, **stream)
    assert step.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert not step.accepted
    assert any(words in reason for reason in step.why), step.why


@pytest.mark.parametrize(
    "estimate",
    [
        replace(GOOD, pairing=0.1, acc_pairing=(2.1, 4.1)),
        replace(GOOD, rival=(1.7, 1.0)),
        replace(GOOD, rival=(0.0, 4.1)),
        replace(GOOD, pieces=6),
    ],
)
def test_what_is_enough_is_a_hinge(estimate: Estimate) -> None:
    assert Trial().step(estimate).verdict is Verdict.HINGE


def test_no_estimate_is_a_step_too() -> None:
    step = Trial().step(None)
    assert step.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert step.axis1 is None
    assert step.bound95_deg is None
    assert not step.accepted


def test_the_bound_is_the_root_of_the_sum_of_squares() -> None:
    estimate = replace(GOOD, deviation=[(0.01, 0.005), (0.02, 0.0)])
    step = Trial(floor_deg=0.7).step(estimate, misfit=0.04)
    model = math.degrees(math.atan(0.04))
    expected = [math.sqrt(math.degrees(0.02) ** 2 + model**2 + 0.7**2)] * 2
    assert np.asarray(step.bound95_deg) == pytest.approx(np.array(expected))
    assert np.asarray(step.published_bound_deg) == pytest.approx(np.degrees([SMALL_STD] * 2))
    infinite = Trial().step(replace(GOOD, deviation=[(math.inf, 0.0), (0.0, 0.0)]))
    assert infinite.bound95_deg is not None
    assert infinite.bound95_deg[0] == 180.0


@pytest.mark.parametrize(("misfit", "limit"), [(0.02, "max_error_deg"), (0.1, "max_error_approximate_deg")])
def test_every_kind_of_hinge_has_its_own_limit(misfit: float, limit: str) -> None:
    bound = Trial().step(misfit=misfit).bound95_deg
    assert bound is not None
    for factor, expected in ((1.01, True), (0.99, False)):
        settings: dict[str, Any] = {limit: float(bound.max()) * factor}
        trial = Trial(n_consistent=2, **settings)
        assert trial.steps(5, misfit=misfit)[-1].accepted is expected


def test_signs_follow_those_before() -> None:
    trial = Trial()
    flipped = replace(tilted(1.0), axis1=[-x for x in unit(1.0)], axis2=[-x for x in unit(1.0)])
    steps = [trial.step(), trial.step(flipped), trial.step(tilted(2.0)), trial.step(flipped)]
    for step in steps:
        assert step.axis1 is not None
        assert step.axis2 is not None
        assert step.axis1[2] > 0.9
        assert step.axis2[2] > 0.9
    assert [round(s.change_deg or 0.0, 6) for s in steps] == [180.0, 1.0, 1.0, 1.0]


def test_the_change_is_that_of_the_worse_axis_and_sees_a_turned_pair() -> None:
    trial = Trial(n_consistent=2)
    trial.steps(4)
    turned = replace(GOOD, axis2=[-x for x in GOOD.axis2])
    assert trial.step(turned).change_deg == pytest.approx(180.0)
    one = Trial()
    one.step()
    assert one.step(replace(GOOD, axis2=unit(7.0))).change_deg == pytest.approx(7.0)


PUBLISHED: dict[str, Any] = {"acceptance": "published"}


@pytest.mark.parametrize("n_consistent", [1, 3, 10])
def test_the_published_rule_wants_small_and_steady_estimates(n_consistent: int) -> None:
    steps = Trial(n_consistent=n_consistent, **PUBLISHED).steps(n_consistent + 3)
    # SEQAD of the first estimate is 180 degrees (eq. 67): the run begins with the second.
    assert [s.accepted for s in steps] == [False] * n_consistent + [True] * 3
    assert steps[-1].verdict is Verdict.HINGE
    assert steps[0].verdict is Verdict.NOT_ENOUGH_INFORMATION


def test_the_published_rule_calls_every_joint_a_hinge_and_never_takes_it_back() -> None:
    trial = Trial(n_consistent=3, **PUBLISHED)
    assert trial.steps(4, replace(GOOD, pieces=0, pairing=-9.0, rival=(0.0, 1.0)), misfit=0.9, moving_s=0.0)[-1].accepted
    wide = replace(tilted(60.0), published_deviation=[(1.0, 1.0)] * 2)
    assert trial.step(wide).accepted
    assert trial.decider.accepted_at_s == 4.0


@pytest.mark.parametrize("deviation", [(math.radians(2.9), 0.0), (math.radians(1.0), math.radians(0.95))])
def test_the_published_bound_is_mean_and_two_deviations(deviation: tuple[float, float]) -> None:
    trial = Trial(n_consistent=1, **PUBLISHED)
    assert trial.steps(2, replace(GOOD, published_deviation=[deviation, (0.0, 0.0)]))[-1].accepted
    mean, std = deviation
    wider = [(0.0, 0.0), (mean * 1.05, std * 1.05)]
    trial = Trial(n_consistent=1, **PUBLISHED)
    assert not trial.steps(5, replace(GOOD, published_deviation=wider))[-1].accepted


def test_a_jump_begins_a_new_published_run() -> None:
    trial = Trial(n_consistent=3, **PUBLISHED)
    trial.steps(3)
    assert [s.accepted for s in [trial.step(tilted(3.1)), *trial.steps(3, tilted(3.1))]] == [False, False, False, True]


def slipped(by_deg: float, misfit_before: float = 0.3, misfit: float = 0.01) -> tuple[Any, ...]:
    return misfit_before, misfit, unit(by_deg), unit(0.0), [(0.001, 0.0), (0.001, 0.0)]


def test_a_slip_needs_three_steps_that_say_so() -> None:
    trial = accepted()
    trial.steps(15)  # the axes from before the window of present motion
    assert _core.PRESENT_MOVING < 15 * 12
    steps = trial.steps(3, fit=slipped(20.0))
    assert [s.verdict for s in steps] == [Verdict.HINGE, Verdict.HINGE, Verdict.MOUNTING_CHANGED]
    assert [s.accepted for s in steps] == [True, True, False]
    assert trial.decider.mounting_changed_at_s == [trial.time_s]


@pytest.mark.parametrize(
    "fit",
    [
        pytest.param(None, id="too little motion"),
        pytest.param(slipped(5.0), id="near"),
        pytest.param(slipped(20.0, misfit_before=0.028), id="old axes still explain"),
        pytest.param(slipped(20.0, misfit=0.06), id="no hinge either"),
        pytest.param(slipped(20.0, misfit_before=0.11, misfit=0.04), id="hardly better"),
        pytest.param((0.3, 0.01, unit(20.0), unit(0.0), [(0.2, 0.0), (0.2, 0.0)]), id="unsure"),
        pytest.param((0.3, 0.01, [-x for x in unit(2.0)], unit(178.0), [(0.0, 0.0)] * 2), id="same lines"),
    ],
)
def test_what_is_no_slip(fit: Any) -> None:
    trial = accepted()
    trial.steps(15)
    assert all(s.verdict is Verdict.HINGE for s in trial.steps(20, fit=fit))


def test_axes_that_were_never_accepted_cannot_slip() -> None:
    trial = Trial(n_consistent=1000)
    assert all(s.verdict is Verdict.HINGE for s in trial.steps(40, fit=slipped(20.0)))


def test_a_slip_is_found_also_where_the_misfit_rises_at_once() -> None:
    trial = accepted()
    trial.steps(30)
    # The first step after the slip already says APPROXIMATE_HINGE; from the tenth on only new motion is present.
    trial.steps(10, misfit=0.15)
    assert any(s.verdict is Verdict.MOUNTING_CHANGED for s in trial.steps(30, misfit=0.3, fit=slipped(60.0)))


def test_after_a_slip_waiting_is_said_as_such_and_acceptance_is_earned_anew() -> None:
    trial = accepted(n_consistent=3)
    trial.steps(15)
    trial.steps(3, fit=slipped(20.0))
    trial.decider.start_over()
    trial.stream = FakeStream()
    waiting = trial.step(replace(tilted(20.0), pieces=2))
    assert waiting.verdict is Verdict.MOUNTING_CHANGED
    assert waiting.change_deg == 180.0
    assert trial.steps(4, tilted(20.0))[-1].accepted
    assert len(trial.decider.mounting_changed_at_s) == 1
