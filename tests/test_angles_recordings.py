"""Joint angles on real recordings: hinges against optics, and a walking person's knees."""

from __future__ import annotations

from pathlib import Path

import imufast
import numpy as np
import pytest
from imufast.hinge_angle import flexion_axis, hinge_turn
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@pytest.mark.parametrize("name", ["1D_01", "1D_02", pytest.param("1D_04", marks=pytest.mark.slow)])
def test_hinge_angles_follow_optics(shared_data: Path, name: str) -> None:
    z = np.load(shared_data / "two_imu_joint" / f"{name}.npz")
    imu1, imu2 = (imufast.Imu(z[f"gyr{i}"], z[f"acc{i}"], rate_hz=float(z["rate_hz"])) for i in (1, 2))
    axes, valid = (z["hinge_axis1_reference"], z["hinge_axis2_reference"]), z["reference_valid"].astype(bool)
    truth = np.degrees(hinge_turn(z["q_12_reference"][valid], *axes)[0])
    calibration = imufast.calibrate_joint(imu1, imu2)
    assert calibration.axis is not None
    axis = calibration.axis.oriented(towards1=axes[0])
    for method, limit in (("smoother", 0.5), ("mekf", 0.8)):
        found = imufast.hinge_angle(imufast.track(imu1, imu2, calibration, method), axis)
        error = found.angles_deg[valid, 0] - truth
        error -= error.mean()
        assert float(np.sqrt((error**2).mean())) < limit
        # The reference itself errs by about 0.25 degrees.
        inside = np.abs(error) <= 2.0 * np.hypot(found.std_deg[valid, 0], 0.25)
        assert inside.mean() > 0.9
        assert found.status is imufast.AngleStatus.FOUND


@pytest.mark.slow
@pytest.mark.parametrize("side", ["left", "right"])
def test_knees_look_like_gait(shared_data: Path, side: str) -> None:
    z = np.load(shared_data / "lower_body" / "full_body_walk.npz")
    thigh, shank = (imufast.Imu(z[f"{n}_{side}.gyr"], z[f"{n}_{side}.acc"], rate_hz=100.0) for n in ("upper_leg", "lower_leg"))
    calibration = imufast.calibrate_joint(thigh.between(55, 99), shank.between(55, 99))
    assert calibration.axis is not None
    rel = imufast.track(thigh, shank, calibration)
    axis = flexion_axis(rel, calibration.axis, zero=(0.0, 2.0), flexion="excursion")
    frame1, frame2 = (
        imufast.segment_frame(side, flexion_axis=axis, sensor=k, joint="knee", standing=imu.between(0, 2))
        for k, imu in ((1, thigh), (2, shank))
    )
    hinge = imufast.hinge_angle(rel, axis, zero=(0.0, 2.0), flexion="axis")
    three = imufast.joint_angles(rel, frame1, frame2)
    time = rel.time_s
    walk = (time > 57.0) & (time < 98.0)
    for found, standing in ((hinge, 1.0), (three, 8.0)):
        assert found.status is imufast.AngleStatus.FOUND
        flexion = found["flexion"]
        # Standing, standing again half a minute later, sitting in between.
        assert abs(flexion[time < 2.0].mean()) < standing
        assert abs(flexion[(time > 46.0) & (time < 48.0)].mean() - flexion[time < 2.0].mean()) < 3.0
        assert 65.0 < flexion[(time > 17.0) & (time < 34.0)].mean() < 100.0
        # One stride a second, by the autocorrelation; 60 to 85 degrees of flexion in swing, near straight between.
        x = flexion[walk] - flexion[walk].mean()
        alike = np.correlate(x, x, "full")[len(x) - 1 :]
        assert 0.9 < (70 + int(alike[70:140].argmax())) / 100.0 < 1.1
        assert 60.0 < np.quantile(flexion[walk], 0.98) < 85.0
        assert -12.0 < np.quantile(flexion[walk], 0.02) < 10.0
        # No drift: the level of the walk's two halves, the turn between them left out.
        early, late = ((time > a) & (time < b) for a, b in ((57.0, 73.0), (79.0, 98.0)))
        assert abs(flexion[early].mean() - flexion[late].mean()) < 4.0
    # Adduction and rotation stay within what skin and knees do.
    assert (three.angles_deg[walk][:, 1:].std(axis=0) < 15.0).all()
    assert (three.std_deg[walk] > 3.0).all()


@pytest.mark.slow
def test_bands_hold_the_bones_of_simulated_knees() -> None:
    inside = []
    for seed in range(4):
        for motion in ("walking", "sit_to_stand"):
            s = imufast.simulate_hinge(
                motion, duration_s=40, rate_hz=100, seed=seed, soft_tissue=imufast.SoftTissue(tilt_rad=0.05)
            )
            calibration = imufast.calibrate_joint(s.imu1, s.imu2)
            if calibration.axis is None:
                continue
            found = imufast.hinge_angle(imufast.track(s.imu1, s.imu2, calibration), calibration.axis.oriented(towards1=s.axis1))
            truth = np.degrees(s.angle_rad - s.angle_rad.mean())
            error = found.angles_deg[:, 0] - truth
            assert float(np.sqrt((error**2).mean())) < 3.0
            inside.append(float((np.abs(error) <= 2.0 * found.std_deg[:, 0]).mean()))
    assert len(inside) >= 6
    assert min(inside) > 0.9


@pytest.mark.parametrize(("method", "rounding_deg"), [("smoother", 1e-6), ("mekf", 1e-5)])
def test_a_mounting_leaves_the_angle_of_raw_data_as_it_is(shared_data: Path, method: str, rounding_deg: float) -> None:
    # From raw data to the angle, calibration included: what is left is rounding, which iterations and a filter's gains enlarge.
    z = np.load(shared_data / "two_imu_joint" / "1D_01.npz")
    truth = np.array(z["hinge_axis1_reference"])
    found = []
    for on1, on2 in ((Rotation.identity(), Rotation.identity()), tuple(Rotation.random(2, random_state=3))):
        imu1, imu2 = (
            imufast.Imu(on.apply(z[f"gyr{i}"]), on.apply(z[f"acc{i}"]), rate_hz=50.0) for i, on in ((1, on1), (2, on2))
        )
        calibration = imufast.calibrate_joint(imu1, imu2)
        assert calibration.axis is not None
        axis = calibration.axis.oriented(towards1=on1.apply(truth))
        found.append(imufast.hinge_angle(imufast.track(imu1, imu2, calibration, method), axis))
    np.testing.assert_allclose(found[1].angles_deg, found[0].angles_deg, atol=rounding_deg)
    np.testing.assert_allclose(found[1].std_deg, found[0].std_deg, atol=rounding_deg)
