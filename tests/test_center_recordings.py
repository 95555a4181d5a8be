"""The joint centre on real recordings of one rig: a hinge (1D) and joints of two and three degrees of freedom (2D, 3D)."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imufast import CenterEstimate, CenterSettings, CenterStatus, Imu, estimate_hinge_axis, estimate_joint_center
from numpy.typing import NDArray
from reference import center as reference

Array = NDArray[np.float64]

# A few rows repeat where packets were lost; that the Imu says so is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")

HINGES = ("1D_01", "1D_02", "1D_04")
NO_HINGES = ("2D_01", "2D_02", "2D_05", "3D_01", "3D_02", "3D_04")
PUBLISHED = CenterSettings.as_published()


@cache
def load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        pytest.skip(f"the real recording {path.name} is missing in {path.parent} (set IMUFAST_DATA)")
    with np.load(path) as arrays:
        return dict(arrays)


def rig(data: Path, name: str) -> dict[str, Any]:
    return load(data / "two_imu_joint" / f"{name}.npz")


HALF = slice(0, 1500)  # rows that suffice to compare with the slow oracle


def imus(data: Path, name: str, rows: slice = slice(None)) -> tuple[Imu, Imu]:
    arrays = rig(data, name)
    first, second = (
        Imu(arrays[f"gyr{i}"][rows], arrays[f"acc{i}"][rows], float(arrays["rate_hz"]), name=f"{name} {i}") for i in (1, 2)
    )
    return first, second


def stacked(center: CenterEstimate) -> Array:
    return np.concatenate([center.in_sensor1, center.in_sensor2])


def optical(data: Path, name: str) -> Array:
    arrays = rig(data, name)
    return np.concatenate([arrays["joint_in_sensor1_optical"], arrays["joint_in_sensor2_optical"]])


def literal(data: Path, name: str) -> reference.Problem:
    a = rig(data, name)
    gyr1, acc1, gyr2, acc2 = (a[channel][HALF] for channel in ("gyr1", "acc1", "gyr2", "acc2"))
    return reference.Problem(reference.moments_of(gyr1, acc1, gyr2, acc2, 1.0 / float(a["rate_hz"])))


@pytest.mark.parametrize("name", ["2D_01", "3D_02"])
def test_as_published_is_the_least_sum(shared_data: Path, name: str) -> None:
    problem = literal(shared_data, name)
    r, cost = problem.squares(np.zeros(6))
    ss = estimate_joint_center(*imus(shared_data, name, HALF), "ss", settings=PUBLISHED)
    assert ss.cost == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(stacked(ss), -r, atol=1e-4)
    r, cost = problem.absolutes(r)
    sa = estimate_joint_center(*imus(shared_data, name, HALF), "sa", settings=PUBLISHED)
    assert sa.cost == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(stacked(sa), -r, atol=2e-4)


def test_as_published_is_the_least_sum_of_a_hinge_too(shared_data: Path) -> None:
    # Along the axis next to nothing is determined, and the smallest centre is given: the costs must all but agree.
    problem = literal(shared_data, "1D_01")
    r, cost = problem.squares(np.zeros(6))
    ss = estimate_joint_center(*imus(shared_data, "1D_01", HALF), "ss", settings=PUBLISHED)
    assert cost * (1.0 - 1e-6) <= ss.cost < cost * 1.003
    sa = estimate_joint_center(*imus(shared_data, "1D_01", HALF), "sa", settings=PUBLISHED)
    _, cost = problem.absolutes(r)
    assert cost * (1.0 - 1e-6) <= sa.cost < cost * 1.003


@pytest.mark.parametrize("method", ["ss", "sa"])
@pytest.mark.parametrize("name", NO_HINGES)
def test_the_rigs_centre_is_found(shared_data: Path, name: str, method: str) -> None:
    # Measured against cameras: 4 to 7 mm, of which the reference itself is good to a few.
    center = estimate_joint_center(*imus(shared_data, name), method)
    assert center.status is CenterStatus.CONVERGED
    assert center.undetermined.shape == (0, 6)
    error = stacked(center) - optical(shared_data, name)
    assert np.linalg.norm(error[:3]) < 0.01
    assert np.linalg.norm(error[3:]) < 0.01
    assert center.determined_std.max() < 0.01
    assert center.unexplained < 0.1


@pytest.mark.parametrize("method", ["ss", "sa"])
@pytest.mark.parametrize("name", HINGES)
def test_of_the_rigs_hinge_the_place_along_the_axis_is_open(shared_data: Path, name: str, method: str) -> None:
    arrays = rig(shared_data, name)
    center = estimate_joint_center(*imus(shared_data, name), method)
    along = np.concatenate([arrays["hinge_axis1_reference"], arrays["hinge_axis2_reference"]])
    along = along / np.linalg.norm(along)
    assert center.status is CenterStatus.PARTLY_DETERMINED
    assert center.undetermined.shape == (1, 6)
    assert abs(center.undetermined[0] @ along) > np.cos(np.radians(3.0))
    assert abs(stacked(center) @ center.undetermined[0]) < 1e-6
    error = (np.eye(6) - np.outer(along, along)) @ (stacked(center) - optical(shared_data, name))
    assert np.linalg.norm(error) < 0.01
    assert len(center.acc_bias_undetermined) >= 1


@pytest.mark.parametrize("name", HINGES)
def test_with_the_axis_found_before_the_answer_is_the_same_across_it(shared_data: Path, name: str) -> None:
    first, second = imus(shared_data, name)
    axis = estimate_hinge_axis(first, second, lowpass_hz=4.0)
    free, given = (estimate_joint_center(first, second, axis=a) for a in (None, axis))
    along = np.concatenate([axis.axis1, axis.axis2]) / np.sqrt(2.0)
    assert abs(stacked(given) @ along) < 1e-9
    assert np.linalg.norm((np.eye(6) - np.outer(along, along)) @ (stacked(free) - stacked(given))) < 0.003


@pytest.mark.parametrize("name", ["2D_02", "2D_05", "3D_01", "3D_04"])
def test_halves_of_a_recording_agree_as_well_as_they_say(shared_data: Path, name: str) -> None:
    first, second = imus(shared_data, name)
    half = len(first) // 2
    one, other = (estimate_joint_center(first[rows], second[rows]) for rows in (slice(0, half), slice(half, None)))
    difference = stacked(one) - stacked(other)
    scale = np.sqrt(np.trace(one.covariance) + np.trace(other.covariance))
    assert np.linalg.norm(difference) < 4.0 * scale
    assert np.linalg.norm(difference) < 0.02


def test_the_sensors_of_two_recordings_share_no_joint(shared_data: Path) -> None:
    (first, _), (_, second) = imus(shared_data, "3D_01"), imus(shared_data, "3D_02")
    count = min(len(first), len(second))
    center = estimate_joint_center(first[:count], second[:count])
    assert center.status is CenterStatus.NOT_IDENTIFIABLE
