"""The lower body on bad input: dead, frozen and swapped sensors, wrong units, a still subject, gaps, odd rates."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast.body import BodyStatus, LowerBodySettings, estimate_lower_body
from imufast.body.checks import misplaced
from imufast.body.layout import SEGMENTS, SIDES, layout
from imufast.body.timing import out_of_step
from imufast.errors import InputError, UnitError
from imufast.imu import Imu, Recording
from imufast.simulate import LegTissue, LowerBodySimulation, simulate_lower_body
from numpy.typing import NDArray

Array = NDArray[np.float64]
WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05, "soft_tissue": LegTissue()}
FEW = LowerBodySettings(max_iterations=2)


def swapped(*pairs: tuple[str, str]) -> dict[str, str]:
    """A placement with the sensors of these pairs of segments exchanged; sensors are named like their segments."""
    place = {segment: segment for segment in SEGMENTS}
    for one, other in pairs:
        place[one], place[other] = place[other], place[one]
    return place


def sides(kind: str) -> tuple[str, str]:
    return f"{kind}_right", f"{kind}_left"


MISTAKES = {
    "thighs": [sides("thigh")],
    "shanks": [sides("shank")],
    "feet": [sides("foot")],
    "thigh and shank": [("thigh_right", "shank_right")],
    "both thighs and shanks": [(f"thigh_{side}", f"shank_{side}") for side in SIDES],
    "shank and foot": [("shank_left", "foot_left")],
    "pelvis and thigh": [("pelvis", "thigh_left")],
    "pelvis and shank": [("pelvis", "shank_left")],
}
LEGS = [sides(kind) for kind in ("thigh", "shank", "foot")]


def changed(
    truth: LowerBodySimulation, name: str, change: Callable[[Array, Array], tuple[Array, Array]], **given: Any
) -> Recording:
    """The recording with one sensor's gyr and acc changed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own = change(truth.gyr[name].copy(), truth.acc[name].copy())
        imus = {segment: truth.recording[segment] for segment in SEGMENTS}
        imus[name] = Imu(*own, time_s=truth.recording.time_s, name=name, **given)
        return Recording(imus)


@pytest.fixture(scope="module")
def walk() -> LowerBodySimulation:
    return simulate_lower_body("walking", seed=1, duration_s=25.0, rate_hz=50.0, **WORN)


@pytest.mark.parametrize("seed", range(3))
def test_swapped_sensors_of_a_walk_are_named_and_right_ones_are_not(seed: int) -> None:
    recording = simulate_lower_body("walking", seed=seed, duration_s=25.0, **WORN).recording
    assert misplaced(recording, layout(recording, swapped())) == []
    assert misplaced(recording, layout(recording, swapped(*LEGS))) == []  # a mirror image makes the same joints
    for pairs in MISTAKES.values():
        place = swapped(*pairs)
        (said,) = misplaced(recording, layout(recording, place))
        wrong = {segment for pair in pairs for segment in pair}
        assert {segment for segment in SEGMENTS if f"imu {place[segment]!r}, placed on {segment}, moves" in said} == wrong


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("motion", ["sit_to_stand", "profile", "ankles_and_knees", "standing"])
def test_right_placements_raise_no_alarm(motion: str, seed: int) -> None:
    recording = simulate_lower_body(motion, seed=seed, duration_s=30.0, **WORN).recording
    assert misplaced(recording, layout(recording, swapped())) == []
    if motion == "sit_to_stand":
        for name, pairs in MISTAKES.items():
            # Feet that rest side by side are alike.
            assert bool(misplaced(recording, layout(recording, swapped(*pairs)))) == (name != "feet")


def test_a_swapped_sensor_is_a_status(walk: LowerBodySimulation) -> None:
    found = estimate_lower_body(walk.recording, swapped(sides("shank")), settings=FEW)
    assert found.status is BodyStatus.PLACEMENT_CONTRADICTED
    assert "imu 'shank_left', placed on shank_right" in found.why[0]
    assert found.knee_angles_deg["right"].shape == (len(found.time_s), 3)


@pytest.mark.parametrize("motion", ["walking", "sit_to_stand"])
def test_swapped_legs_are_found_by_the_way_knees_bend(motion: str) -> None:
    truth = simulate_lower_body(motion, seed=2, duration_s=20.0, rate_hz=50.0, **WORN)
    right, wrong = (estimate_lower_body(truth.recording, place, settings=FEW) for place in (swapped(), swapped(*LEGS)))
    assert right.status is not BodyStatus.PLACEMENT_CONTRADICTED
    assert wrong.status is BodyStatus.PLACEMENT_CONTRADICTED
    assert wrong.why[0].startswith("right and left look swapped")
    assert "'thigh_left', 'shank_left', 'foot_left' are on the left leg" in wrong.why[0]


@pytest.mark.parametrize(("motion", "seed", "loss"), [("profile", 1, 0.2), ("walking", 0, 0.05), ("profile", 1, 0.1)])
def test_lost_packets_widen_bands_and_accuse_nobody(motion: str, seed: int, loss: float) -> None:
    truth = simulate_lower_body(
        motion, seed=seed, duration_s=45.0, gyr_bias=0.005, acc_bias=0.05, packet_loss=loss, burst_length=5.0
    )
    found = estimate_lower_body(truth.recording, truth.placement)
    assert found.status is not BodyStatus.PLACEMENT_CONTRADICTED
    assert "gaps leave too few samples in a row to check the placement and the sensors' clocks" in found.why
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    for side in SIDES:
        off = found.knee_angles_deg[side] - truth.knee_angles_deg[side][rows]
        assert np.mean(np.abs(off) < 2.0 * found.knee_std_deg[side]) > 0.95
    # With a fifth of each sensor's packets a fifth of the rows is left, in pieces: no joint is certain.
    assert any(joint.determined for joint in found.joints.values()) == (loss == 0.1)


@pytest.mark.parametrize(("rate_hz", "few"), [(20.0, True), (50.0, False)])
def test_few_samples_a_second_are_said(rate_hz: float, few: bool) -> None:
    truth = simulate_lower_body("walking", seed=1, duration_s=15.0, rate_hz=rate_hz, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement, settings=FEW)
    assert any(why.startswith("recording has 20 samples a second: impacts") for why in found.why) == few


def test_swapped_legs_are_found_in_a_recording_with_gaps() -> None:
    truth = simulate_lower_body("profile", seed=1, duration_s=45.0, packet_loss=0.05, burst_length=5.0)
    wrong = estimate_lower_body(truth.recording, swapped(*LEGS))
    assert wrong.status is BodyStatus.PLACEMENT_CONTRADICTED
    assert wrong.why[0].startswith("right and left look swapped")


WALKER = {
    segment: segment.replace("pelvis", "hip").replace("thigh", "upper_leg").replace("shank", "lower_leg")
    for segment in SEGMENTS
}
"""Segment to sensor of the recorded walk."""


def test_swapped_sensors_of_a_real_walk_are_named(shared_data: Path) -> None:
    recording = imufast.read(shared_data / "lower_body" / "full_body_walk.npz")
    assert misplaced(recording, layout(recording, WALKER)) == []
    for pairs in MISTAKES.values():
        place = {segment: WALKER[worn] for segment, worn in swapped(*pairs).items()}
        (said,) = misplaced(recording, layout(recording, place))
        for segment in {segment for pair in pairs for segment in pair}:
            assert f"imu {place[segment]!r}, placed on {segment}, moves" in said


@pytest.mark.slow
def test_swapped_legs_of_a_real_walk_are_found(shared_data: Path) -> None:
    recording = imufast.read(shared_data / "lower_body" / "full_body_walk.npz").between(40.0, 100.0)
    legs = {segment: WALKER[worn] for segment, worn in swapped(*LEGS).items()}
    right, wrong = (estimate_lower_body(recording, place, settings=FEW) for place in (WALKER, legs))
    assert right.status is not BodyStatus.PLACEMENT_CONTRADICTED
    assert wrong.status is BodyStatus.PLACEMENT_CONTRADICTED


def late(recording: Recording, name: str, samples: int) -> Recording:
    """One sensor's data come later than its time stamps say."""
    gyr, acc = (np.roll(rows, samples, axis=0) for rows in (recording[name].gyr, recording[name].acc))
    return Recording(dict(recording) | {name: Imu(gyr, acc, time_s=recording.time_s, name=name)})


@pytest.mark.parametrize("segment", SEGMENTS)
def test_a_sensor_behind_the_others_is_named(shared_data: Path, segment: str) -> None:
    recording = imufast.read(shared_data / "lower_body" / "full_body_walk.npz")
    found = out_of_step(late(recording, WALKER[segment], 4), layout(recording, WALKER))
    assert list(found) == [segment]
    assert found[segment] == pytest.approx(0.04, abs=0.021)


def test_sensors_in_step_raise_no_alarm(shared_data: Path) -> None:
    recording = imufast.read(shared_data / "lower_body" / "full_body_walk.npz")
    assert out_of_step(recording, layout(recording, WALKER)) == {}
    for motion in ("walking", "sit_to_stand", "profile", "ankles_and_knees", "standing"):
        worn = WORN | {"soft_tissue": LegTissue(wobble_rad_s=3.0)}
        recording = simulate_lower_body(motion, seed=4, duration_s=40.0, rate_hz=60.0, **worn).recording
        assert out_of_step(recording, layout(recording, swapped())) == {}


@pytest.mark.parametrize("samples", [2, -2])
def test_a_leg_out_of_step_is_said(samples: int) -> None:
    recording = simulate_lower_body("walking", seed=1, duration_s=30.0, rate_hz=50.0, **WORN).recording
    for segment in ("thigh_left", "shank_left", "foot_left"):
        recording = late(recording, segment, samples)
    found = estimate_lower_body(recording, swapped(), settings=FEW)
    way = "behind" if samples > 0 else "ahead of"
    for segment in ("thigh_left", "shank_left", "foot_left"):
        assert any(why.startswith(f"imu '{segment}' on {segment} is about 40 ms {way} the others") for why in found.why)
    assert not any("'pelvis'" in why for why in found.why)


def frozen(start: int, stop: int | None) -> Callable[[Array, Array], tuple[Array, Array]]:
    def change(gyr: Array, acc: Array) -> tuple[Array, Array]:
        gyr[start:stop], acc[start:stop] = gyr[start], acc[start]
        return gyr, acc

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda gyr, acc: (0.0 * gyr, acc), "gyr is zero throughout"),
        (lambda gyr, acc: (gyr, 0.0 * acc + [0.0, 0.0, 9.8]), "acc never changes"),
        (lambda gyr, acc: (gyr * [1.0, 0.0, 1.0], acc), r"gyr\[:, 1\] \(y\) never changes"),
        (frozen(300, None), "repeats one row for 76 % of the recording, first at 6 s"),
    ],
)
def test_a_dead_sensor_is_refused_by_name(walk: LowerBodySimulation, change: Any, says: str) -> None:
    recording = changed(walk, "shank_left", change)
    with pytest.raises(InputError, match=rf"placement\['shank_left'\]: imu 'shank_left'.*{says}"):
        estimate_lower_body(recording, walk.placement)
    without = {segment: name for segment, name in walk.placement.items() if segment not in ("shank_left", "foot_left")}
    assert len(estimate_lower_body(recording, without, settings=FEW).joints) == 4


def test_a_frozen_stretch_is_a_gap(walk: LowerBodySimulation) -> None:
    found = estimate_lower_body(changed(walk, "foot_right", frozen(600, 800)), walk.placement)
    assert found.why[0] == "imu 'foot_right' on foot_right is frozen from 12 to 15.98 s: a gap to all"
    assert not ((found.time_s >= 12.0) & (found.time_s < 16.0)).any()
    assert found.status is BodyStatus.CONVERGED


@pytest.mark.parametrize(
    ("change", "given", "says"),
    [
        (lambda gyr, acc: (np.degrees(gyr), acc), {}, "deg/s looks likely"),
        (lambda gyr, acc: (gyr, acc / 9.80665), {"units": "m/s^2"}, "acc looks like g"),
    ],
)
def test_wrong_units_are_refused_by_name(walk: LowerBodySimulation, change: Any, given: Any, says: str) -> None:
    with pytest.raises(UnitError, match=rf"placement\['thigh_right'\]: imu 'thigh_right'.*{says}"):
        estimate_lower_body(changed(walk, "thigh_right", change, **given), walk.placement)


def test_of_a_still_subject_nothing_is_known() -> None:
    truth = simulate_lower_body("standing", seed=1, duration_s=12.0, rate_hz=50.0)
    found = estimate_lower_body(truth.recording, truth.placement)
    assert found.status is BodyStatus.NOT_OBSERVABLE
    assert found.why == ("the subject stands still: no sensor turns faster than 0.3 rad/s",)
    for side in SIDES:
        for kind in ("hip", "knee", "ankle"):
            assert np.isinf(getattr(found, f"{kind}_std_deg")[side]).all()
    assert not any(joint.determined or np.isfinite(joint.in_sensors_std).any() for joint in found.joints.values())


def test_legs_without_a_pelvis_are_two_parts(walk: LowerBodySimulation) -> None:
    place = {segment: name for segment, name in walk.placement.items() if segment != "pelvis"}
    found = estimate_lower_body(walk.recording, place)
    assert found.status is BodyStatus.CONVERGED
    assert set(found.joints) == {f"{kind}_{side}" for kind in ("knee", "ankle") for side in SIDES}
    assert found.placement == place
    for side in SIDES:
        alone = {segment: name for segment, name in place.items() if segment.endswith(side)}
        one = estimate_lower_body(walk.recording, alone)
        assert np.array_equal(one.knee_angles_deg[side], found.knee_angles_deg[side])
    rows = np.searchsorted(walk.time_s, found.time_s - 1e-9)
    for side in SIDES:
        assert np.std(found.knee_angles_deg[side][:, 0] - walk.knee_angles_deg[side][rows, 0]) < 3.0


def test_rates_and_times_of_any_kind(walk: LowerBodySimulation) -> None:
    def knee(truth: LowerBodySimulation, **settings: Any) -> float:
        found = estimate_lower_body(truth.recording, truth.placement, settings=LowerBodySettings(**settings))
        assert found.status is BodyStatus.CONVERGED
        rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
        return float(np.std(found.knee_angles_deg["right"][:, 0] - truth.knee_angles_deg["right"][rows, 0]))

    given: dict[str, Any] = {"seed": 3, "gyr_bias": 0.005, "acc_bias": 0.05}
    assert knee(simulate_lower_body("walking", duration_s=6.0, rate_hz=1000.0, **given)) < 2.0
    steps = np.random.default_rng(1).uniform(0.006, 0.014, 1200)
    assert knee(simulate_lower_body("walking", time_s=np.cumsum(steps), **given)) < 2.0


@pytest.mark.parametrize("seed", range(2))
def test_few_samples_a_second_cost_little(seed: int) -> None:
    truth = simulate_lower_body("walking", seed=seed, duration_s=40.0, rate_hz=30.0, **WORN)
    found = estimate_lower_body(truth.recording, truth.placement)
    off = found.knee_angles_deg["left"][:, 0] - truth.knee_angles_deg["left"][:, 0]
    assert float(np.sqrt(np.mean(off**2))) < 2.0


def test_lost_packets_cost_certainty_not_honesty() -> None:
    # Each sensor loses 3 %, in bursts: a fifth of the rows is not common to all.
    truth = simulate_lower_body("walking", seed=1, duration_s=20.0, packet_loss=0.03, gyr_bias=0.005, acc_bias=0.05)
    found = estimate_lower_body(truth.recording, truth.placement)
    rows = np.searchsorted(truth.time_s, found.time_s - 1e-9)
    for side in SIDES:
        off = found.knee_angles_deg[side] - truth.knee_angles_deg[side][rows]
        assert (np.abs(off) < 2.0 * found.knee_std_deg[side]).mean() > 0.9


def test_a_long_break_leaves_both_sides_sound(walk: LowerBodySimulation) -> None:
    keep = (walk.time_s < 11.0) | (walk.time_s > 14.0)
    far = np.where(walk.time_s > 14.0, walk.time_s + 3600.0, walk.time_s)[keep]
    imus = {name: Imu(walk.gyr[name][keep], walk.acc[name][keep], time_s=far, name=name) for name in SEGMENTS}
    found = estimate_lower_body(Recording(imus), walk.placement)
    assert found.status is BodyStatus.CONVERGED
    rows = np.searchsorted(far, found.time_s - 1e-9)
    off = found.knee_angles_deg["right"][:, 0] - walk.knee_angles_deg["right"][keep][rows, 0]
    assert np.std(off[found.time_s < 12.0]) < 3.0
    assert np.std(off[found.time_s > 12.0]) < 3.0


@pytest.mark.parametrize("left", [1, 10])
def test_a_stub_beyond_a_gap_is_left_out(walk: LowerBodySimulation, left: int) -> None:
    keep = np.r_[0 : len(walk.time_s) - 200, len(walk.time_s) - left : len(walk.time_s)]
    imus = {n: Imu(walk.gyr[n][keep], walk.acc[n][keep], time_s=walk.time_s[keep], name=n) for n in SEGMENTS}
    found = estimate_lower_body(Recording(imus), walk.placement)
    assert found.time_s[-1] < walk.time_s[-190]
    assert "left out: 1 piece shorter than 0.5 s between gaps" in found.why


def test_unequal_lengths_and_bad_numbers_are_refused_by_name(walk: LowerBodySimulation) -> None:
    short = Imu(walk.gyr["pelvis"][:-5], walk.acc["pelvis"][:-5], rate_hz=50.0, name="pelvis")
    with pytest.raises(InputError, match=r"'thigh_right' and 'pelvis'.*align"):
        Recording([Imu(walk.gyr["thigh_right"], walk.acc["thigh_right"], rate_hz=50.0, name="thigh_right"), short])
    hole = walk.gyr["pelvis"].copy()
    hole[100:120] = np.nan
    with pytest.raises(InputError, match="NaN or infinite values in 20 of 1250 rows, first in row 100"):
        Imu(hole, walk.acc["pelvis"], rate_hz=50.0, name="pelvis")
