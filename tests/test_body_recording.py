"""The lower body of a real walking person: seven straps at 100 Hz, standing, sitting for half a minute, walking to and fro."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imufast.body import JOINTS, BodyStatus, LowerBody, LowerBodySettings, estimate_lower_body
from imufast.body.bands import MCGRATH, angles_deg
from imufast.calibrate import calibrate_joint
from imufast.imu import Imu, Recording
from imufast.quaternion import conjugate, matrix, multiply
from imufast.track import track
from numpy.typing import NDArray
from scipy.signal import resample_poly
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
SIDES = ("right", "left")
PLACEMENT = {"pelvis": "hip"} | {
    f"{segment}_{side}": f"{strap}_{side}"
    for segment, strap in (("thigh", "upper_leg"), ("shank", "lower_leg"), ("foot", "foot"))
    for side in SIDES
}
WALKING_S = 57.0


@pytest.fixture(scope="module")
def recording(shared_data: Path) -> Recording:
    z = np.load(shared_data / "lower_body" / "full_body_walk.npz")
    rate_hz = float(z["rate_hz"])
    return Recording({name: Imu(z[f"{name}.gyr"], z[f"{name}.acc"], rate_hz=rate_hz, name=name) for name in PLACEMENT.values()})


@pytest.fixture(scope="module")
def body(recording: Recording) -> LowerBody:
    return estimate_lower_body(recording, PLACEMENT)


def test_it_converges_and_determines_every_joint(body: LowerBody) -> None:
    assert body.status is BodyStatus.CONVERGED
    assert body.why == ()
    assert body.iterations <= 20
    for joint in body.joints.values():
        assert joint.determined
        assert float(np.median(joint.heading_std_deg)) < 5.0


def test_lengths_are_those_of_a_person(body: LowerBody) -> None:
    for name, (usual, spread) in {"femur": (0.394, 0.030), "tibia": (0.411, 0.026), "hips": (0.187, 0.009)}.items():
        for bone, (length, std) in body.lengths_m.items():
            if bone.startswith(name):
                assert abs(length - usual) < 2.0 * float(np.hypot(spread, std))
                assert std < 0.015
    for name in ("femur", "tibia"):
        (right, std), (left, _) = body.lengths_m[f"{name}_right"], body.lengths_m[f"{name}_left"]
        assert abs(right - left) < 2.0 * std


@pytest.mark.parametrize("side", SIDES)
def test_knees_are_those_of_two_sensors_alone(recording: Recording, body: LowerBody, side: str) -> None:
    thigh, shank = f"thigh_{side}", f"shank_{side}"
    upper, lower = recording[PLACEMENT[thigh]], recording[PLACEMENT[shank]]
    rel = track(upper, lower, calibrate_joint(upper, lower, joint="hinge"))
    rows = np.searchsorted(rel.time_s, body.time_s - 1e-9)
    frames = [matrix(multiply(conjugate(body.q[s]), body.q_segment[s])) @ MCGRATH.T for s in (thigh, shank)]
    alone = angles_deg("knee", side, np.swapaxes(frames[0], 1, 2) @ matrix(rel.q_12[rows]) @ frames[1])
    off = body.knee_angles_deg[side] - alone
    assert float(off[:, 0].std()) < 1.5
    # The two share their sensors, so they differ by less than either errs.
    assert (np.abs(off) < 2.0 * body.knee_std_deg[side]).mean() > 0.95


@pytest.mark.parametrize("side", SIDES)
def test_knees_look_like_gait(body: LowerBody, side: str) -> None:
    time, knee, hip = body.time_s, body.knee_angles_deg[side][:, 0], body.hip_angles_deg[side][:, 0]
    walking = time > WALKING_S
    assert abs(float(knee[time < 2.0].mean())) < 8.0
    assert abs(float(knee[(time > 46.0) & (time < 48.0)].mean() - knee[time < 2.0].mean())) < 3.0
    assert 65.0 < float(knee[(time > 17.0) & (time < 34.0)].mean()) < 100.0
    assert 50.0 < float(np.percentile(knee[walking], 97.0)) < 80.0
    assert -10.0 < float(np.percentile(knee[walking], 3.0)) < 12.0
    # The pelvis is upright when standing, though the subject sits still for longer.
    assert abs(float(hip[time < 2.0].mean())) < 12.0
    # The hip swings by 40 degrees or so, and bends most when the other leg is behind.
    assert 30.0 < float(np.ptp(np.percentile(hip[walking], [5.0, 95.0]))) < 65.0
    other = body.hip_angles_deg["left" if side == "right" else "right"][walking, 0]
    assert float(np.corrcoef(hip[walking], other)[0, 1]) < -0.8


def test_both_legs_head_the_same_way(body: LowerBody) -> None:
    """Whoever walks to and fro has both knees and both feet ahead: pairs of sensors alone let the feet diverge by 30."""
    walking = body.time_s > WALKING_S

    def heading(segment: str, direction: Array) -> Array:
        seen = matrix(body.q[segment][walking]) @ direction
        return np.asarray(np.arctan2(seen[:, 1], seen[:, 0]))

    feet = [heading(f"foot_{side}", -body.joints[f"ankle_{side}"].in_sensors[1]) for side in SIDES]
    knees = [heading(f"thigh_{side}", body.knee_axis[f"thigh_{side}"]) for side in SIDES]
    for right, left in (feet, knees):
        assert abs(np.degrees(np.angle(np.exp(1j * (right - left)).mean()))) < 15.0


@pytest.mark.slow
def test_bands_hold_what_other_spacings_find(recording: Recording, body: LowerBody) -> None:
    other = estimate_lower_body(recording, PLACEMENT, settings=LowerBodySettings(key_step_s=0.2))
    assert other.status is BodyStatus.CONVERGED
    for name, (length, std) in body.lengths_m.items():
        assert abs(other.lengths_m[name][0] - length) < 2.0 * std
    for name in JOINTS:
        for side in (0, 1):
            moved = other.joints[name].in_sensors[side] - body.joints[name].in_sensors[side]
            assert float(np.linalg.norm(moved)) < 3.0 * float(body.joints[name].in_sensors_std[side])


def test_who_sits_does_not_stand(recording: Recording, body: LowerBody) -> None:
    standing, sitting = body.time_s < 5.0, (body.time_s > 17.0) & (body.time_s < 34.0)
    # Standing is the zero of the pelvis; who sits tilts it back.
    assert abs(float(np.median(body.pelvis_angles_deg[standing, 0]))) < 3.0
    assert 15.0 < float(np.median(body.pelvis_angles_deg[sitting, 0])) < 35.0


@pytest.mark.parametrize("segments", [("thigh", "shank", "foot"), ("thigh", "shank")])
def test_knees_bend_the_right_way_without_hips(recording: Recording, body: LowerBody, segments: tuple[str, ...]) -> None:
    names = [f"{segment}_right" for segment in segments]
    alone = estimate_lower_body(recording, {name: PLACEMENT[name] for name in names})
    off = alone.knee_angles_deg["right"][:, 0] - body.knee_angles_deg["right"][:, 0]
    # Zero is how the subject stands, not half way between that and a chair.
    assert abs(float(off.mean())) < 8.0
    assert float(np.std(off)) < 4.0
    # What a pelvis says of a knee is little, and where the whole body is says nothing of its heading.
    assert alone.status is BodyStatus.CONVERGED
    np.testing.assert_allclose(alone.joints["knee_right"].heading_std_deg, body.joints["knee_right"].heading_std_deg, rtol=0.35)


def test_without_standing_the_zero_of_what_has_no_bone_is_open(recording: Recording, body: LowerBody) -> None:
    rows = slice(5700, 8700)
    walking = Recording({n: Imu(imu.gyr[rows], imu.acc[rows], rate_hz=100.0, name=n) for n, imu in recording.items()})
    alone = estimate_lower_body(walking, {name: PLACEMENT[name] for name in ("thigh_right", "shank_right")})
    assert any("never stands" in why and "thigh_right, shank_right" in why for why in alone.why)
    whole = body.time_s.searchsorted(alone.time_s + 57.0 - 1e-9)
    off = alone.knee_angles_deg["right"][:, 0] - body.knee_angles_deg["right"][whole, 0]
    assert 10.0 < abs(float(off.mean())) < float(alone.knee_std_deg["right"][:, 0].mean())


def without(recording: Recording, *gaps: tuple[float, float]) -> Recording:
    keep = np.ones(len(recording.time_s), dtype=bool)
    for start, stop in gaps:
        keep &= (recording.time_s < start) | (recording.time_s >= stop)
    time_s = recording.time_s[keep]
    return Recording({n: Imu(imu.gyr[keep], imu.acc[keep], time_s=time_s, name=n) for n, imu in recording.items()})


def test_who_sits_between_two_breaks_faces_as_before(recording: Recording, body: LowerBody) -> None:
    """Next to nothing shows the headings of who sits still: the search starts from how the knees stand otherwise."""
    found = estimate_lower_body(without(recording, (10.5, 12.5), (38.5, 42.4)), PLACEMENT)
    assert found.status is BodyStatus.CONVERGED
    assert found.iterations <= 30
    whole = np.searchsorted(body.time_s, found.time_s - 1e-9)
    for side in SIDES:
        off = found.hip_angles_deg[side][:, 0] - body.hip_angles_deg[side][whole, 0]
        assert float(np.abs(off).max()) < 10.0
    # How the thighs are turned is open then, and said to be: neither is it read from how the body drifts about.
    resting = (found.time_s > 13.0) & (found.time_s < 38.0)
    for side in SIDES:
        assert any(why.startswith(f"hip_{side}") and "open from 12 to 38 s" in why for why in found.why)
        off = (found.hip_angles_deg[side] - body.hip_angles_deg[side][whole])[resting]
        assert float(np.abs(off).max()) < 25.0
        assert (np.abs(off) < 2.0 * found.hip_std_deg[side][resting]).all()


def test_who_is_seen_to_sit_down_and_sits_has_knees(recording: Recording, body: LowerBody) -> None:
    found = estimate_lower_body(recording.between(5.0, 40.0), PLACEMENT)
    assert found.status is BodyStatus.CONVERGED
    assert any("only sits" in why for why in found.why)
    rows = np.searchsorted(body.time_s, found.time_s - 1e-9)
    for side in SIDES:
        for kind in ("knee", "hip"):
            off = getattr(found, f"{kind}_angles_deg")[side] - getattr(body, f"{kind}_angles_deg")[side][rows]
            assert (np.abs(off) < 2.0 * getattr(found, f"{kind}_std_deg")[side]).mean() > 0.9


def test_who_is_hardly_seen_to_move_is_not_said_to_stand(recording: Recording, body: LowerBody) -> None:
    """The second half of sitting down and a long rest: thighs that lie, next to nothing of which way they point."""
    found = estimate_lower_body(recording.between(10.0, 40.0), PLACEMENT)
    assert found.status is BodyStatus.NOT_OBSERVABLE
    assert any("stands or sits is open" in why for why in found.why)
    rows = np.searchsorted(body.time_s, found.time_s - 1e-9)
    for side in SIDES:
        off = found.knee_angles_deg[side] - body.knee_angles_deg[side][rows]
        assert (np.abs(off[:, 0]) < 2.0 * found.knee_std_deg[side][:, 0]).mean() > 0.9


def test_who_only_walks_is_found(recording: Recording) -> None:
    found = estimate_lower_body(recording.between(60.0, 95.0), PLACEMENT)
    assert found.status is BodyStatus.CONVERGED
    assert found.iterations <= 44


def apart_in_stds(one: LowerBody, other: LowerBody, sides: dict[str, str]) -> float:
    """How far all angles are apart at most, in standard deviations: the search ends where it promises to move by less."""
    return max(
        float(
            np.max(np.abs(getattr(one, f"{kind}_angles_deg")[side] - getattr(other, f"{kind}_angles_deg")[sides[side]]) / std)
        )
        for kind in ("knee", "hip", "ankle")
        for side, std in getattr(one, f"{kind}_std_deg").items()
    )


def test_how_sensors_are_strapped_on_changes_nothing(recording: Recording, body: LowerBody) -> None:
    turns = dict(zip(recording, Rotation.random(7, random_state=5).as_matrix(), strict=True))
    imus = {n: Imu(imu.gyr @ turns[n], imu.acc @ turns[n], rate_hz=100.0, name=n) for n, imu in recording.items()}
    found = estimate_lower_body(Recording(imus), PLACEMENT)
    assert apart_in_stds(found, body, {side: side for side in SIDES}) < 0.15


def test_a_mirrored_person_has_mirrored_angles(recording: Recording, body: LowerBody) -> None:
    """What a mirror shows: vectors with x turned round, rates the other way besides."""
    flip = np.array([-1.0, 1.0, 1.0])
    imus = {n: Imu(-imu.gyr * flip, imu.acc * flip, rate_hz=100.0, name=n) for n, imu in recording.items()}
    other = {"right": "left", "left": "right"}
    placement = {
        segment.replace(side, other[side]): PLACEMENT[segment] for side in SIDES for segment in PLACEMENT if side in segment
    }
    found = estimate_lower_body(Recording(imus), placement | {"pelvis": PLACEMENT["pelvis"]})
    assert apart_in_stds(found, body, other) < 0.15


@pytest.mark.parametrize("keep", [2, 4])
def test_other_rates_find_the_same_knees(recording: Recording, body: LowerBody, keep: int) -> None:
    def fewer(rows: Array) -> Array:
        return np.asarray(resample_poly(rows, 1, keep, padtype="line"))

    imus = {n: Imu(fewer(imu.gyr), fewer(imu.acc), rate_hz=100.0 / keep, name=n) for n, imu in recording.items()}
    found = estimate_lower_body(Recording(imus), PLACEMENT)
    assert found.status is BodyStatus.CONVERGED
    for side in SIDES:
        off = found.knee_angles_deg[side] - body.knee_angles_deg[side][::keep][: len(found.time_s)]
        assert float(off[:, 0].std()) < {2: 1.25, 4: 4.0}[keep]
        assert (np.abs(off) < 2.0 * found.knee_std_deg[side]).mean() > 0.9
