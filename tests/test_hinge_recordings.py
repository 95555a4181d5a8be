"""calibrate_hinge on real recordings (a rig with a hinge, 2 and 3 degrees of freedom; a walking person), and mountings that
change in mid-recording, real and simulated."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imufast import HingeCalibration, HingeCalibrator, Imu, Verdict, calibrate_hinge, simulate_hinge
from numpy.typing import NDArray
from reference.compare import angle_deg

Array = NDArray[np.float64]

# The real files repeat a few rows where packets were lost; that the Imu says so is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")

HINGES = ("1D_01", "1D_02", "1D_04")
NO_HINGES = ("2D_01", "2D_02", "2D_05", "3D_01", "3D_02", "3D_04")
CHANNELS = ("gyr1", "acc1", "gyr2", "acc2")


@cache
def load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        pytest.skip(f"the real recording {path.name} is missing in {path.parent} (set IMUFAST_DATA)")
    with np.load(path) as arrays:
        return dict(arrays)


def rig(data: Path, name: str) -> dict[str, Any]:
    return load(data / "two_imu_joint" / f"{name}.npz")


def calibrate(arrays: dict[str, Any], rows: slice = slice(None), **settings: Any) -> HingeCalibration:
    gyr1, acc1, gyr2, acc2 = (arrays[name][rows] for name in CHANNELS)
    return calibrate_hinge(Imu(gyr1, acc1, 50.0), Imu(gyr2, acc2, 50.0), **settings)


def errors_deg(result: HingeCalibration, axis1: Array, axis2: Array) -> Array:
    """Angle of each axis to the truth; 180 where the signs are paired wrongly."""
    assert result.axis1 is not None
    assert result.axis2 is not None
    if (result.axis1 @ axis1) * (result.axis2 @ axis2) < 0.0:
        return np.array([180.0, 180.0])
    return np.array([angle_deg(result.axis1, axis1), angle_deg(result.axis2, axis2)])


def starts(arrays: dict[str, Any], count: int) -> list[int]:
    """Evenly spread rows with at least 40 s to go."""
    return [int(k) for k in np.linspace(0, len(arrays["gyr1"]) - 2000, count)]


@pytest.mark.parametrize("name", HINGES)
def test_the_rigs_hinge_is_accepted_and_the_bound_holds(shared_data: Path, name: str) -> None:
    arrays = rig(shared_data, name)
    result = calibrate(arrays)
    assert result.verdict is Verdict.HINGE
    assert result.accepted
    assert result.accepted_at_s is not None
    assert result.accepted_at_s <= 20.0  # measured: 15 s
    error = errors_deg(result, arrays["hinge_axis1_reference"], arrays["hinge_axis2_reference"])
    # Measured: 0.04 and 0.18, 0.16 and 0.30, 0.21 and 0.30 deg; bounds 0.8 deg; misfit 0.010.
    assert (error <= np.asarray(result.bound95_deg)).all()
    assert error.max() <= 0.5
    assert result.bound95_deg is not None
    assert result.bound95_deg.max() <= 1.5
    assert result.misfit is not None
    assert result.misfit < 0.02


@pytest.mark.parametrize("name", HINGES)
def test_it_is_accepted_from_wherever_the_recording_begins(shared_data: Path, name: str) -> None:
    arrays = rig(shared_data, name)
    results = [calibrate(arrays, slice(k, None)) for k in starts(arrays, 8)]
    assert all(result.accepted for result in results)
    truth = arrays["hinge_axis1_reference"], arrays["hinge_axis2_reference"]
    errors = np.array([errors_deg(result, *truth) for result in results])
    assert errors.max() <= 1.5
    assert np.mean(errors <= [np.asarray(result.bound95_deg) for result in results]) >= 0.9
    for result in results:
        for step in result.history:
            if step.accepted:
                assert step.verdict in (Verdict.HINGE, Verdict.APPROXIMATE_HINGE)


@pytest.mark.parametrize("name", NO_HINGES)
def test_other_joints_are_not_accepted_on_the_whole_file(shared_data: Path, name: str) -> None:
    result = calibrate(rig(shared_data, name))
    # Measured misfit: 0.34 to 0.46 (2D), 0.54 to 0.67 (3D).
    assert result.verdict is Verdict.NOT_A_HINGE
    assert not result.accepted
    assert result.accepted_at_s is None
    assert result.misfit is not None
    assert result.misfit > 0.3
    assert "misfit" in result.why[0]


@pytest.mark.parametrize("name", NO_HINGES)
def test_other_joints_are_seldom_accepted_even_for_a_while(shared_data: Path, name: str) -> None:
    results = [calibrate(rig(shared_data, name), slice(k, None)) for k in starts(rig(shared_data, name), 8)]
    assert not any(result.accepted for result in results)
    assert not any(step.accepted for result in results for step in result.history)  # measured: in none of 48


@pytest.mark.parametrize("name", HINGES + NO_HINGES)
def test_nothing_has_slipped_in_the_real_files(shared_data: Path, name: str) -> None:
    for k in starts(rig(shared_data, name), 8):
        assert calibrate(rig(shared_data, name), slice(k, None)).mounting_changed_at_s == ()


@pytest.mark.parametrize("name", HINGES)
def test_a_real_recording_streams_as_it_is_read(shared_data: Path, name: str) -> None:
    arrays = rig(shared_data, name)
    offline, stream = calibrate(arrays), HingeCalibrator(50.0)
    for at in range(0, len(arrays["gyr1"]), 333):
        if at == 999:
            stream = HingeCalibrator.restore(stream.state())
        result = stream.push(*(arrays[c][at : at + 333] for c in CHANNELS))
    assert (result.verdict, result.accepted_at_s, result.misfit) == (offline.verdict, offline.accepted_at_s, offline.misfit)
    np.testing.assert_array_equal(result.axis1, offline.axis1)
    np.testing.assert_array_equal(result.axis2, offline.axis2)
    np.testing.assert_array_equal(result.bound95_deg, offline.bound95_deg)


@pytest.mark.parametrize("side", ["left", "right"])
def test_walking_knees_are_approximate_hinges_that_repeat(shared_data: Path, side: str) -> None:
    arrays = load(shared_data / "lower_body" / "full_body_walk.npz")
    halves = []
    for begin, end in ((0.56, 0.74), (0.77, 0.95)):  # the walk, without its turn
        rows = slice(int(begin * len(arrays["hip.gyr"])), int(end * len(arrays["hip.gyr"])))
        names = (f"upper_leg_{side}", f"lower_leg_{side}")
        imu1, imu2 = (Imu(arrays[f"{n}.gyr"][rows], arrays[f"{n}.acc"][rows], rate_hz=100.0, name=n) for n in names)
        halves.append(calibrate_hinge(imu1, imu2))
    for half in halves:
        assert half.verdict in (Verdict.HINGE, Verdict.APPROXIMATE_HINGE)
        assert half.misfit is not None
        assert 0.05 < half.misfit < 0.25  # measured: 0.14 to 0.16
    first, second = halves
    assert second.axis1 is not None
    assert second.axis2 is not None
    # Measured: 2.4 and 6.7 deg (left), 2.9 and 3.6 (right); the bounds are 8 to 10 deg each.
    apart = errors_deg(first, second.axis1, second.axis2)
    assert apart.max() <= 8.0
    assert (apart <= np.hypot(np.asarray(first.bound95_deg), np.asarray(second.bound95_deg))).all()
    # It is the knee, not the wobble of the strap about the limb: far from where gravity lies in standing.
    standing = arrays[f"upper_leg_{side}.acc"][:400].mean(axis=0)
    for half in halves:
        assert half.axis1 is not None
        assert angle_deg(half.axis1, standing / np.linalg.norm(standing)) >= 55.0


def turned(about: Array, by_deg: float) -> Array:
    """Rotation matrix about a direction perpendicular to the given axis, picked by its own components."""
    direction = np.cross(about, np.eye(3)[int(np.argmin(np.abs(about)))])
    x, y, z = direction / np.linalg.norm(direction)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(np.radians(by_deg)) * k + (1.0 - np.cos(np.radians(by_deg))) * k @ k)


def slip(arrays: dict[str, Any], at_s: float, by_deg: float, axis1: Array) -> tuple[HingeCalibration, Array]:
    """Sensor 1 turned after a moment; the result and where its axis is now."""
    turn, row = turned(axis1, by_deg), int(at_s * 50)
    moved = {c: arrays[c].copy() for c in CHANNELS}
    for channel in ("gyr1", "acc1"):
        moved[channel][row:] = moved[channel][row:] @ turn.T
    return calibrate(moved), turn @ axis1


def simulated(kind: str, seed: int, duration_s: float = 110.0) -> tuple[dict[str, Any], Array, Array]:
    sim = simulate_hinge(kind, duration_s=duration_s, seed=seed)
    return {c: getattr(sim, c) for c in CHANNELS}, sim.axis1, sim.axis2


def check_found(result: HingeCalibration, at_s: float) -> None:
    """Found within 30 s of informative motion, and not before it happened."""
    assert result.mounting_changed_at_s
    found = result.mounting_changed_at_s[0]
    assert found > at_s
    moving = {step.time_s: step.moving_s for step in result.history}
    assert moving[found] - moving[at_s] < 30.0
    step = next(step for step in result.history if step.time_s == found)
    assert step.verdict is Verdict.MOUNTING_CHANGED
    assert not step.accepted
    assert step.why


# Measured: found after 12 to 21 s, of which the joint moved 8 to 13 s.
@pytest.mark.parametrize(("name", "at_s"), [("1D_01", 30), ("1D_02", 30), ("1D_04", 60), ("1D_04", 150), ("1D_04", 250)])
def test_a_strap_that_slips_by_20_degrees_is_found_in_real_files(shared_data: Path, name: str, at_s: int) -> None:
    arrays = rig(shared_data, name)
    result, _ = slip(arrays, at_s, 20.0, arrays["hinge_axis1_reference"])
    check_found(result, at_s)


@pytest.mark.parametrize("seed", [0, 2, 3])
@pytest.mark.parametrize("kind", ["mixed", "free", "walking"])
def test_a_strap_that_slips_by_20_degrees_is_found(kind: str, seed: int) -> None:
    arrays, axis1, _ = simulated(kind, seed)
    result, _ = slip(arrays, 50, 20.0, axis1)
    check_found(result, 50)


MISSED = pytest.mark.xfail(
    strict=True,
    reason="bug: where the slow thigh of a walk slips, motion misfits the old axes by less than a hinge may (0.05); the "
    "old acceptance stands, 18 deg off with a bound of 2 deg (3 of 12 seeds)",
)
WALK = pytest.param("walking", 1, marks=MISSED)


@pytest.mark.parametrize(("kind", "seed"), [("mixed", 5), ("free", 1), WALK, ("planar", 0)])
def test_a_strap_that_slips_by_20_degrees_is_always_found(kind: str, seed: int) -> None:
    arrays, axis1, _ = simulated(kind, seed)
    result, _ = slip(arrays, 50, 20.0, axis1)
    check_found(result, 50)


@pytest.mark.parametrize(("kind", "seed"), [("free", 1), WALK])
def test_a_slip_that_is_missed_does_not_leave_a_false_bound(kind: str, seed: int) -> None:
    arrays, axis1, axis2 = simulated(kind, seed)
    result, axis1 = slip(arrays, 50, 20.0, axis1)
    assert not result.accepted or (errors_deg(result, axis1, axis2) <= np.asarray(result.bound95_deg)).all()


@pytest.mark.parametrize("kind", ["mixed", "free", "sit_to_stand"])
def test_after_a_slip_the_new_axis_is_found_and_accepted(kind: str) -> None:
    arrays, axis1, axis2 = simulated(kind, 1, 130.0)
    result, axis1 = slip(arrays, 50, 20.0, axis1)
    assert len(result.mounting_changed_at_s) == 1
    assert result.accepted
    assert result.verdict is Verdict.HINGE
    assert result.accepted_at_s is not None
    assert result.accepted_at_s > result.mounting_changed_at_s[0]
    assert (errors_deg(result, axis1, axis2) <= np.asarray(result.bound95_deg)).all()
    # What was known before stays in the history.
    assert any(step.accepted for step in result.history if step.time_s < 50.0)


@pytest.mark.parametrize("name", ["1D_04"])
def test_after_a_slip_the_new_axis_is_found_and_accepted_in_real_files(shared_data: Path, name: str) -> None:
    arrays = rig(shared_data, name)
    result, axis1 = slip(arrays, 60, 20.0, arrays["hinge_axis1_reference"])
    assert result.accepted
    assert len(result.mounting_changed_at_s) == 1
    assert (errors_deg(result, axis1, arrays["hinge_axis2_reference"]) <= np.asarray(result.bound95_deg)).all()


def test_after_a_slip_the_memory_of_motion_grows_again() -> None:
    arrays, axis1, _ = simulated("mixed", 1)
    result, _ = slip(arrays, 50, 20.0, axis1)
    assert result.history[-1].moving_s > 15.0


@pytest.mark.parametrize("by_deg", [60.0, 90.0])
@pytest.mark.parametrize("kind", ["mixed", "walking"])
def test_a_strap_that_slips_far_is_found_too(kind: str, by_deg: float) -> None:
    arrays, axis1, _ = simulated(kind, 0)
    result, _ = slip(arrays, 50, by_deg, axis1)
    check_found(result, 50)


@pytest.mark.parametrize("name", ["1D_01", "1D_02"])
def test_a_strap_that_slips_far_is_found_in_real_files(shared_data: Path, name: str) -> None:
    arrays = rig(shared_data, name)
    result, _ = slip(arrays, 30, 60.0, arrays["hinge_axis1_reference"])
    check_found(result, 30)


def two_donnings(seed: int) -> tuple[HingeCalibration, Array, Array]:
    """The same joint worn twice, both sensors mounted anew, with a pause in between."""
    first, second = (simulate_hinge("mixed", duration_s=60, seed=s) for s in (seed, seed + 100))
    gyr1, acc1, gyr2, acc2 = (np.concatenate([getattr(first, c), getattr(second, c)]) for c in CHANNELS)
    time = np.concatenate([first.time_s, 600.0 + second.time_s])
    return calibrate_hinge(Imu(gyr1, acc1, time_s=time), Imu(gyr2, acc2, time_s=time)), second.axis1, second.axis2


@pytest.mark.parametrize("seed", range(3))
def test_axes_of_the_first_donning_do_not_stay_accepted(seed: int) -> None:
    result, axis1, axis2 = two_donnings(seed)
    assert any(step.accepted for step in result.history if step.time_s < 60.0)
    assert not result.accepted or (errors_deg(result, axis1, axis2) <= np.asarray(result.bound95_deg)).all()


@pytest.mark.parametrize("seed", range(3))
def test_two_donnings_in_one_file_are_told_apart(seed: int) -> None:
    result, axis1, axis2 = two_donnings(seed)
    assert len(result.mounting_changed_at_s) == 1
    assert 600.0 < result.mounting_changed_at_s[0] < 645.0
    assert result.accepted
    assert (errors_deg(result, axis1, axis2) <= np.asarray(result.bound95_deg)).all()
