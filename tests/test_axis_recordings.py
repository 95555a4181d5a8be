"""Algorithm 1 on real recordings of one rig: a hinge (1D) and joints that are none (2D, 3D)."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import imufast
import numpy as np
import pytest
from imufast import Imu, SolveStatus, estimate_hinge_axis
from reference import hinge_axis as reference
from reference.compare import angle_deg

# A few rows repeat where packets were lost; that the Imu says so is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")

HINGES = ("1D_01", "1D_02", "1D_04")
NO_HINGES = ("2D_01", "2D_02", "2D_05", "3D_01", "3D_02", "3D_04")


@cache
def load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        pytest.skip(f"the real recording {path.name} is missing in {path.parent} (set IMUFAST_DATA)")
    with np.load(path) as arrays:
        return dict(arrays)


def imus(data: Path, name: str, rows: slice = slice(None)) -> tuple[Imu, Imu]:
    arrays = load(data / "two_imu_joint" / f"{name}.npz")
    rate = float(arrays["rate_hz"])
    first, second = (Imu(arrays[f"gyr{i}"][rows], arrays[f"acc{i}"][rows], rate, name=f"{name} {i}") for i in (1, 2))
    return first, second


@pytest.mark.parametrize("name", HINGES)
def test_hinge_axes_are_within_half_a_degree_and_paired(shared_data: Path, name: str) -> None:
    # Measured: 0.06 and 0.24, 0.23 and 0.40, 0.20 and 0.28 deg; the reference itself is good to about 0.3 deg.
    axis = estimate_hinge_axis(*imus(shared_data, name))
    truth = load(shared_data / "two_imu_joint" / f"{name}.npz")
    truth1, truth2 = truth["hinge_axis1_reference"], truth["hinge_axis2_reference"]
    assert axis.status is SolveStatus.CONVERGED
    assert angle_deg(axis.axis1, truth1) <= 0.5
    assert angle_deg(axis.axis2, truth2) <= 0.5
    assert (axis.axis1 @ truth1) * (axis.axis2 @ truth2) > 0.0
    # The other pairing costs at least ten times as much: the sign is certain.
    assert axis.minima[1].cost > 10.0 * axis.cost
    # The scatter alone says less than 0.3 deg; with the floor, the reference lies within.
    assert estimate_hinge_axis(*imus(shared_data, name), floor_deg=0.0).bound95_deg.max() < 0.3
    assert angle_deg(axis.axis1, truth1) <= axis.bound95_deg[0] < 0.6
    assert angle_deg(axis.axis2, truth2) <= axis.bound95_deg[1] < 0.6
    assert axis.gyr_residual_std < 0.06


@pytest.mark.parametrize("name", NO_HINGES)
def test_joints_that_are_no_hinge_leave_a_residual_and_a_wide_bound(shared_data: Path, name: str) -> None:
    axis = estimate_hinge_axis(*imus(shared_data, name))
    assert axis.gyr_residual_std > 0.2
    assert axis.bound95_deg.min() > 3.0
    assert axis.minima[1].cost < 1.2 * axis.cost


@pytest.mark.parametrize("name", HINGES + NO_HINGES)
def test_200_random_starts_find_nothing_better(shared_data: Path, name: str) -> None:
    pair = imus(shared_data, name)
    ours = estimate_hinge_axis(*pair)
    lucky = estimate_hinge_axis(*pair, starts="random", random_starts=200)
    assert ours.cost <= lucky.cost * (1.0 + 1e-9)


# The literal algorithm keeps a matrix of all samples: the first minute is enough for it.
@pytest.mark.parametrize("name", HINGES + NO_HINGES)
def test_the_literal_algorithm_ends_in_the_same_minimum(shared_data: Path, name: str) -> None:
    imu1, imu2 = imus(shared_data, name, slice(0, 3000))
    axis = estimate_hinge_axis(imu1, imu2)
    data = reference.Data(imu1.gyr, imu2.gyr, imu1.acc, imu2.acc)
    # Non-hinges have several valleys, and where the literal algorithm starts is luck: begin one descent where ours ended.
    ours = np.concatenate([reference.angles(axis.axis1), reference.angles(axis.axis2)])
    nearby = reference.algorithm_1(ours, data)
    assert angle_deg(axis.axis1, nearby.axis1) < 1e-4
    assert angle_deg(axis.axis2, nearby.axis2) < 1e-4
    lucky = reference.best_of(data, starts=3 if name in HINGES else 2, seed=1)
    assert axis.cost <= min(nearby.cost, lucky.cost) * (1.0 + 1e-9)
    if name in HINGES:
        assert angle_deg(axis.axis1, lucky.axis1) < 1e-4
        assert angle_deg(axis.axis2, lucky.axis2) < 1e-4


def test_halves_of_a_recording_agree_within_their_bounds(shared_data: Path) -> None:
    # Sensors on a rig do not move; what differs is the movement and slow errors such as biases, hence a factor 2.
    for name in HINGES:
        count = len(imus(shared_data, name)[0])
        first = estimate_hinge_axis(*imus(shared_data, name, slice(0, count // 2)), floor_deg=0.0)
        second = estimate_hinge_axis(*imus(shared_data, name, slice(count // 2, count)), floor_deg=0.0)
        for i in (0, 1):
            apart = angle_deg((first.axis1, first.axis2)[i], (second.axis1, second.axis2)[i])
            assert apart < 2.0 * float(np.hypot(first.bound95_deg[i], second.bound95_deg[i]))


def test_the_low_pass_turns_from_the_strap_to_the_knee_of_a_walking_person(shared_data: Path) -> None:
    # No truth here, but a knee has one axis, which repeats between the halves of the walk. Measured with 4 Hz: thigh 2.1 and
    # 2.7, shank 0.4 and 3.0 deg (left, right). Raw, the right shank is 18 deg apart, and the thigh repeats the strap.
    arrays = load(shared_data / "lower_body" / "full_body_walk.npz")
    for side in ("left", "right"):
        halves = []
        for rows in (slice(5500, 7700), slice(7700, 9900)):
            thigh, shank = (
                Imu(arrays[f"{segment}_{side}.gyr"][rows], arrays[f"{segment}_{side}.acc"][rows], 100.0, name=segment)
                for segment in ("upper_leg", "lower_leg")
            )
            halves.append([estimate_hinge_axis(thigh, shank, lowpass_hz=hz) for hz in (None, 4.0)])
        (raw, smooth), (_, again) = halves
        assert angle_deg(smooth.axis1, again.axis1) < 6.0, side
        assert angle_deg(smooth.axis2, again.axis2) < 6.0, side
        assert angle_deg(raw.axis1, smooth.axis1) > 45.0, side


def test_selected_samples_do_as_well_as_all(shared_data: Path) -> None:
    for name in HINGES:
        pair = imus(shared_data, name)
        axis = estimate_hinge_axis(*pair, imufast.select_samples(*pair))
        truth = load(shared_data / "two_imu_joint" / f"{name}.npz")
        assert angle_deg(axis.axis1, truth["hinge_axis1_reference"]) <= 0.5
        assert angle_deg(axis.axis2, truth["hinge_axis2_reference"]) <= 0.5
        assert axis.n_gyr <= 1000
