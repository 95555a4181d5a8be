"""`calibrate_joint`: verdicts on simulations and on real joints, its options, a mounting that changes, and refusals."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    CenterSettings,
    HingeSettings,
    Imu,
    InputError,
    JointAxis,
    JointCalibration,
    JointCenter,
    SensorNoise,
    SettingsError,
    Verdict,
    calibrate_hinge,
    calibrate_joint,
    estimate_joint_center,
    simulate_ball_joint,
    simulate_hinge,
    track,
)
from numpy.typing import NDArray
from reference.compare import angle_deg
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")


@cache
def load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        pytest.skip(f"the real recording {path.name} is missing in {path.parent} (set IMUFAST_DATA)")
    with np.load(path) as arrays:
        return dict(arrays)


@cache
def rig(data: Path, name: str) -> tuple[Imu, Imu]:
    a = load(data / "two_imu_joint" / f"{name}.npz")
    return Imu(a["gyr1"], a["acc1"], 50.0, name="one"), Imu(a["gyr2"], a["acc2"], 50.0, name="two")


def worn(data: Path, name: str, start_s: float, stop_s: float) -> Imu:
    a, rows = load(data / "lower_body" / "full_body_walk.npz"), slice(int(100 * start_s), int(100 * stop_s))
    return Imu(a[f"{name}.gyr"][rows], a[f"{name}.acc"][rows], 100.0, name=name)


def knee(data: Path, side: str, start_s: float, stop_s: float) -> JointCalibration:
    return calibrate_joint(worn(data, f"upper_leg_{side}", start_s, stop_s), worn(data, f"lower_leg_{side}", start_s, stop_s))


@pytest.mark.parametrize("name", ["1D_01", "1D_02", "1D_04"])
def test_the_rigs_hinge_is_a_hinge(shared_data: Path, name: str) -> None:
    found = calibrate_joint(*rig(shared_data, name))
    assert found.verdict is Verdict.HINGE
    assert found.accepted
    assert found.why == ()
    assert found.axis is not None
    arrays = load(shared_data / "two_imu_joint" / f"{name}.npz")
    assert angle_deg(found.axis.axis1, arrays["hinge_axis1_reference"]) < 1.0
    assert found.center is not None
    assert len(found.center.undetermined) == 1  # the place along the axis
    assert found.rate_ratio is not None
    assert found.rate_ratio < 0.03
    assert found.hinge is not None
    assert found.estimate is not None
    assert len(found.history) == len(found.hinge.history)


@pytest.mark.parametrize("name", ["2D_01", "2D_02", "2D_05", "3D_01", "3D_02", "3D_04"])
def test_the_rigs_other_joints_are_ball_joints(shared_data: Path, name: str) -> None:
    found = calibrate_joint(*rig(shared_data, name))
    assert found.verdict is Verdict.BALL_JOINT
    assert found.accepted
    assert found.axis is None
    assert found.center is not None
    arrays = load(shared_data / "two_imu_joint" / f"{name}.npz")
    assert np.linalg.norm(found.center.in_sensor1 - arrays["joint_in_sensor1_optical"]) < 0.02
    assert np.linalg.norm(found.center.in_sensor2 - arrays["joint_in_sensor2_optical"]) < 0.02
    assert found.rate_ratio is not None
    assert found.rate_ratio > 0.75
    assert found.hinge is not None
    assert found.hinge.verdict is Verdict.NOT_A_HINGE


@pytest.mark.parametrize(
    ("side", "start_s", "stop_s"),
    [("left", 56.0, 74.0), ("left", 77.0, 95.0), ("right", 77.0, 95.0), ("right", 56.0, 74.0)],
)
def test_walking_knees_are_approximate_hinges(shared_data: Path, side: str, start_s: float, stop_s: float) -> None:
    found = knee(shared_data, side, start_s, stop_s)
    assert found.verdict is Verdict.APPROXIMATE_HINGE
    assert found.axis is not None
    assert found.center is not None
    assert 0.05 < np.linalg.norm(found.center.in_sensor1) < 0.5
    assert found.rate_ratio is not None
    assert found.rate_ratio < 0.6


@pytest.mark.parametrize(
    ("side", "start_s", "stop_s"),
    [("left", 77.0, 95.0), ("right", 77.0, 95.0), ("left", 56.0, 74.0), ("right", 56.0, 74.0)],
)
def test_the_rate_ratio_of_knees_is_as_documented(shared_data: Path, side: str, start_s: float, stop_s: float) -> None:
    found = knee(shared_data, side, start_s, stop_s)
    assert found.rate_ratio is not None
    assert 0.1 < found.rate_ratio < 0.36


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hip_is_no_hinge_to_be_trusted(shared_data: Path, side: str) -> None:
    found = calibrate_joint(worn(shared_data, "hip", 0.0, 100.0), worn(shared_data, f"upper_leg_{side}", 0.0, 100.0))
    # This person's right hip turns about one axis as much as a knee does.
    expected = {"left": Verdict.BALL_JOINT, "right": Verdict.APPROXIMATE_HINGE}[side]
    assert found.verdict is expected
    assert found.accepted is (expected is Verdict.BALL_JOINT)
    assert (found.axis is None) is (expected is Verdict.BALL_JOINT)
    assert found.center is not None
    walking = calibrate_joint(worn(shared_data, "hip", 56.0, 74.0), worn(shared_data, f"upper_leg_{side}", 56.0, 74.0))
    assert not walking.accepted  # a walk turns a hip about one axis mostly
    assert walking.why


@pytest.mark.parametrize("seed", range(4))
def test_simulated_joints_are_told_apart(seed: int) -> None:
    hinge = simulate_hinge(seed=seed, duration_s=60.0)
    found = calibrate_joint(hinge.imu1, hinge.imu2)
    assert (found.verdict, found.accepted) == (Verdict.HINGE, True)
    assert found.axis is not None
    assert angle_deg(found.axis.axis1, hinge.axis1) < 3.0
    assert found.rate_ratio is not None
    assert found.rate_ratio < 0.05
    ball = simulate_ball_joint(seed=seed, duration_s=60.0)
    found = calibrate_joint(ball.imu1, ball.imu2)
    assert (found.verdict, found.accepted) == (Verdict.BALL_JOINT, True)
    assert found.axis is None
    assert found.center is not None
    np.testing.assert_allclose(found.center.in_sensor1, ball.joint_in_sensor1, atol=0.005)
    assert found.rate_ratio is not None
    assert found.rate_ratio > 0.45


@pytest.mark.parametrize(
    "sim",
    [
        lambda: simulate_hinge("stationary", seed=1, duration_s=20.0),
        lambda: simulate_hinge("stiff", seed=1, duration_s=30.0),
        lambda: simulate_ball_joint("stationary", seed=1, duration_s=20.0),
        lambda: simulate_ball_joint(seed=1, duration_s=0.5),
    ],
)
@pytest.mark.parametrize("joint", ["auto", "hinge", "ball"])
def test_too_little_motion_is_a_verdict(sim: Any, joint: str) -> None:
    simulated = sim()
    found = calibrate_joint(simulated.imu1, simulated.imu2, joint)
    assert found.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert not found.accepted
    assert found.why
    assert found.rate_ratio is None


@pytest.mark.parametrize("seeds", [(0, 77), (1, 78), (2, 79), (3, 80)])
def test_sensors_that_share_no_joint_are_not_accepted(seeds: tuple[int, int]) -> None:
    one, other = (simulate_ball_joint(seed=seed, duration_s=30.0) for seed in seeds)
    found = calibrate_joint(one.imu1, other.imu2)
    assert not found.accepted
    assert found.why


@cache
def hinge_sim() -> Any:
    return simulate_hinge(seed=2, duration_s=60.0, gyr_bias1=(0.004, 0.0, 0.0))


@cache
def ball_sim() -> Any:
    return simulate_ball_joint(seed=2, duration_s=60.0, acc_bias1=(0.1, 0.0, 0.0))


def test_asking_for_a_hinge_calls_nothing_a_ball_joint() -> None:
    found = calibrate_joint(ball_sim().imu1, ball_sim().imu2, joint="hinge")
    assert found.verdict is Verdict.NOT_A_HINGE
    assert not found.accepted
    assert found.why
    assert found.axis is None
    assert calibrate_joint(hinge_sim().imu1, hinge_sim().imu2, joint="hinge").verdict is Verdict.HINGE


def test_asking_for_a_ball_joint_leaves_the_axis_out() -> None:
    found = calibrate_joint(ball_sim().imu1, ball_sim().imu2, joint="ball")
    assert (found.verdict, found.accepted) == (Verdict.BALL_JOINT, True)
    assert found.hinge is None
    assert found.axis is None
    assert found.history == ()
    # The place along a hinge is open, so that it is no ball joint.
    other = calibrate_joint(hinge_sim().imu1, hinge_sim().imu2, joint="ball")
    assert other.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert "directions of the joint centre open" in other.why[0]


def test_its_parts_are_those_of_the_building_blocks() -> None:
    found = calibrate_joint(ball_sim().imu1, ball_sim().imu2)
    hinge = calibrate_hinge(ball_sim().imu1, ball_sim().imu2)
    assert found.hinge is not None
    assert found.hinge.verdict is hinge.verdict
    rest = None if hinge.gyr_bias1 is None or hinge.gyr_bias2 is None else (hinge.gyr_bias1, hinge.gyr_bias2)
    center = estimate_joint_center(ball_sim().imu1, ball_sim().imu2, "sa", gyr_bias=rest)
    assert found.center is not None
    np.testing.assert_array_equal(found.center.in_sensor1, center.in_sensor1)
    np.testing.assert_array_equal(found.acc_bias1, center.acc_bias1)
    assert found.noise is not None
    assert found.noise.link_std == pytest.approx(center.residual_std)


def test_settings_are_passed_on() -> None:
    imus = hinge_sim().imu1, hinge_sim().imu2
    plain = calibrate_joint(*imus)
    strict = calibrate_joint(*imus, hinge_settings=HingeSettings(max_error_deg=0.01))
    assert plain.accepted
    assert not strict.accepted
    assert strict.hinge is not None
    assert strict.hinge.settings.max_error_deg == 0.01
    centred = calibrate_joint(*imus, center_settings=CenterSettings(acc_bias_std=None))
    assert centred.estimate is not None
    assert centred.estimate.settings.acc_bias_std is None
    assert (centred.acc_bias1 == 0.0).all()
    published = calibrate_joint(
        *imus, hinge_settings=HingeSettings.as_published(), center_settings=CenterSettings.as_published()
    )
    assert published.verdict is Verdict.HINGE


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_after_a_strap_has_slipped_the_time_since_counts(seed: int) -> None:
    sim = simulate_hinge("mixed", seed=seed, duration_s=140.0)
    half, turn = 60 * 50, np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    gyr2, acc2 = sim.gyr2.copy(), sim.acc2.copy()
    gyr2[half:], acc2[half:] = gyr2[half:] @ turn.T, acc2[half:] @ turn.T
    found = calibrate_joint(sim.imu1, Imu(gyr2, acc2, 50.0))
    assert found.hinge is not None
    assert found.hinge.mounting_changed_at_s
    assert found.center is not None
    # Seen from sensor 2 the centre has turned along; the place along the axis is free.
    off = found.center.in_sensor2 - turn @ sim.joint_in_sensor2
    across = off - (off @ (turn @ sim.axis2)) * (turn @ sim.axis2)
    assert np.linalg.norm(across) < 0.02


@pytest.mark.parametrize("joint", ["knee", "", None, 1, "Hinge", ["hinge"]])
def test_unknown_joints_are_refused(joint: Any) -> None:
    with pytest.raises(SettingsError, match="joint must be one of 'auto', 'hinge', 'ball'"):
        calibrate_joint(ball_sim().imu1, ball_sim().imu2, joint)


def test_wrong_arguments_are_refused_by_name() -> None:
    one, other = ball_sim().imu1, ball_sim().imu2
    for message, arguments in (
        ("imu1 must be", (None, other)),
        ("imu2 must be", (one, other.gyr)),
        ("same gyr data", (one, one)),
        ("samples", (one, other[:99])),
        ("at least 4", (one[:3], other[:3])),
    ):
        with pytest.raises(InputError, match=message):
            calibrate_joint(*arguments)
    for name in ("hinge_settings", "center_settings"):
        with pytest.raises(SettingsError):
            calibrate_joint(one, other, **{name: {"lowpass_hz": 3.0}})  # type: ignore[arg-type]


@pytest.mark.parametrize("rows", [4, 5, 8, 30, 100])
@pytest.mark.parametrize("joint", ["auto", "hinge", "ball"])
def test_very_short_recordings_have_a_verdict(rows: int, joint: str) -> None:
    found = calibrate_joint(ball_sim().imu1[:rows], ball_sim().imu2[:rows], joint)
    assert found.verdict is Verdict.NOT_ENOUGH_INFORMATION
    assert not found.accepted


def writeable(value: Any, name: str = "") -> list[str]:
    """The arrays within that can be written to."""
    if isinstance(value, np.ndarray):
        return [name] if value.flags.writeable else []
    if is_dataclass(value):
        return [found for f in fields(value) for found in writeable(getattr(value, f.name), f"{name}.{f.name}")]
    return []


def test_its_own_arrays_are_read_only_and_it_is_frozen() -> None:
    found = calibrate_joint(hinge_sim().imu1, hinge_sim().imu2)
    for name in ("gyr_bias1", "gyr_bias2", "acc_bias1", "acc_bias2", "acc_bias_covariance"):
        assert not getattr(found, name).flags.writeable
    with pytest.raises(FrozenInstanceError):
        found.accepted = False  # type: ignore[misc]
    given = np.zeros(3)
    by_hand = JointCalibration(gyr_bias1=given)
    given[0] = 1.0
    assert by_hand.gyr_bias1[0] == 0.0


def test_all_its_arrays_are_read_only(tmp_path: Path) -> None:
    found = calibrate_joint(hinge_sim().imu1, hinge_sim().imu2)
    found.save(tmp_path / "joint.json")
    for calibration in (found, JointCalibration.load(tmp_path / "joint.json")):
        assert writeable(calibration.axis) == []
        assert writeable(calibration.center) == []


def test_it_can_be_pickled() -> None:
    found = calibrate_joint(hinge_sim().imu1, hinge_sim().imu2)
    copy = pickle.loads(pickle.dumps(found))
    assert (copy.verdict, copy.accepted, copy.rate_ratio, copy.noise) == (
        found.verdict,
        found.accepted,
        found.rate_ratio,
        found.noise,
    )
    np.testing.assert_array_equal(copy.center.in_sensor1, found.center.in_sensor1)  # type: ignore[union-attr]
    assert "\n" not in repr(JointCalibration())
    assert len(repr(JointCalibration())) < 500


def test_the_same_twice_gives_the_same() -> None:
    one, other = (calibrate_joint(ball_sim().imu1, ball_sim().imu2) for _ in range(2))
    assert pickle.dumps(one._plain()) == pickle.dumps(other._plain())


def test_what_it_finds_serves_to_track() -> None:
    for sim in (hinge_sim(), ball_sim()):
        found = calibrate_joint(sim.imu1, sim.imu2)
        for method in ("complementary", "mekf", "smoother"):
            assert str(track(sim.imu1, sim.imu2, found, method).status) == "TRACKED"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("gyr_bias1", [1.0, 2.0]),
        ("gyr_bias2", [np.nan, 0.0, 0.0]),
        ("acc_bias1", "x"),
        ("acc_bias2", None),
        ("acc_bias_covariance", np.zeros((3, 3))),
        ("acc_bias_covariance", np.full((6, 6), np.inf)),
        ("gyr_bias_std", -1.0),
        ("gyr_bias_std", np.nan),
        ("gyr_bias_std", "x"),
        ("verdict", "LOOSE"),
        ("verdict", 3),
        ("axis", np.zeros((2, 3))),
        ("axis", JointAxis(np.array([2.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.zeros((6, 6)), np.zeros(2))),
        ("center", np.zeros((2, 3))),
        ("center", JointCenter(np.zeros(2), np.zeros(3))),
        ("center", JointCenter(np.full(3, np.nan), np.zeros(3))),
        ("noise", 0.004),
    ],
)
def test_what_does_not_fit_is_refused_by_name(name: str, value: Any) -> None:
    with pytest.raises(InputError, match=name):
        JointCalibration(**{name: value})


NONSENSE: list[tuple[str, Any]] = [
    ("center", JointCenter(np.zeros(3), np.zeros(3), np.full((6, 6), np.nan))),
    ("center", JointCenter(np.zeros(3), np.zeros(3), np.zeros((3, 3)))),
    ("center", JointCenter(np.full(3, 1e7), np.zeros(3))),
    ("noise", SensorNoise(np.nan, 0.004, 0.05, 0.05, 100.0)),
    ("noise", SensorNoise(-1.0, 0.004, 0.05, 0.05, 100.0)),
    ("noise", SensorNoise(None, 0.004, 0.05, 0.05, 100.0)),  # type: ignore[arg-type]
    ("gyr_bias1", [1e7, 0.0, 0.0]),
    ("acc_bias1", [1e300, 0.0, 0.0]),
    ("gyr_bias_std", 1e300),
]


@pytest.mark.parametrize("method", ["mekf", "complementary", "smoother"])
@pytest.mark.parametrize(("name", "value"), NONSENSE)
def test_nonsense_is_refused_when_made_or_when_used_but_never_crashes(method: str, name: str, value: Any) -> None:
    try:
        calibration = JointCalibration(**{name: value})
        found = track(ball_sim().imu1, ball_sim().imu2, calibration, method)
    except InputError:
        return
    assert np.isfinite(found.q_12).all()
    assert np.isfinite(found.angle_std_deg).all()


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.data())
def test_nothing_panics(data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 10_000)))
    count, size = data.draw(st.sampled_from([4, 9, 60, 700])), data.draw(st.sampled_from([1e-12, 1e-3, 1.0, 30.0]))
    up = np.array([0.0, 0.0, 9.81])
    first, second = (
        Imu(size * rng.normal(size=(count, 3)), up + size * rng.normal(size=(count, 3)), 50.0, units="SI") for _ in range(2)
    )
    found = calibrate_joint(first, second, data.draw(st.sampled_from(["auto", "hinge", "ball"])))
    assert isinstance(found.verdict, Verdict)
    assert found.accepted in (True, False)


def test_no_array_of_a_result_can_be_written_to_and_the_callers_own_stay_as_they_are() -> None:
    mine = np.array([0.0, 0.0, 1.0])
    axis = JointAxis(axis1=mine, axis2=mine, covariance=np.zeros((6, 6)), bound95_deg=np.ones(2))
    center = JointCenter(in_sensor1=mine, in_sensor2=mine, covariance=np.eye(6), undetermined=np.zeros((0, 6)))
    calibration = JointCalibration(axis=axis, center=center, gyr_bias1=mine)
    for array in (axis.axis1, center.in_sensor2, center.covariance, calibration.gyr_bias1, calibration.acc_bias_covariance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    mine[0] = 0.5


def test_motion_shows_the_biases_where_there_is_no_rest() -> None:
    off, stated = [], []
    for seed in range(6):
        biases = np.random.default_rng(seed).normal(0.0, 0.0087, (2, 3))
        sim = simulate_ball_joint(seed=seed, duration_s=40.0, gyr_bias1=biases[0], gyr_bias2=biases[1])
        found = calibrate_joint(sim.imu1, sim.imu2)
        assert found.relative_gyr_bias_std is not None
        assert found.relative_gyr_bias_std < np.sqrt(2.0) * found.gyr_bias_std < 0.004
        turn = Rotation.from_quat(sim.q_12[:, [1, 2, 3, 0]])
        first = turn.inv().apply(found.gyr_bias1 - sim.gyr_bias1)
        off.append(np.mean((first - (found.gyr_bias2 - sim.gyr_bias2)) ** 2))
        stated.append(found.relative_gyr_bias_std**2)
    assert 0.4 < np.mean(off) / np.mean(stated) < 2.5


@pytest.mark.parametrize("loss", [0.1, 0.2])
def test_lost_packets_do_not_cost_the_centre(loss: float) -> None:
    # Hardly a second is left in one piece: the low-pass has nothing to work on.
    sim = simulate_ball_joint(seed=4, duration_s=30.0, packet_loss=loss, burst_length=4.0)
    found = calibrate_joint(sim.imu1, sim.imu2)
    assert found.center is not None
    np.testing.assert_allclose(found.center.in_sensor1, sim.joint_in_sensor1, atol=0.003)
    np.testing.assert_allclose(found.center.in_sensor2, sim.joint_in_sensor2, atol=0.003)
    assert not found.accepted
