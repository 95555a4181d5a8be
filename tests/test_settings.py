"""AxisSettings and HingeSettings: refuse what they do not know, name what is wrong, and hold no setting without effect."""

from __future__ import annotations

import dataclasses
from typing import Any

import imufast
import numpy as np
import pytest
from imufast import AxisSettings, HingeSettings

# Another value for each setting, with what else must be set for it to mean anything.
ANOTHER: dict[str, dict[str, Any]] = {
    "weight_ratio": {"weight_ratio": 5.0},
    "starts": {"starts": "random"},
    "random_starts": {"starts": "random", "random_starts": 4},
    "seed": {"starts": "random", "seed": 1},
    "lowpass_hz": {"lowpass_hz": 5.0},
    "max_iterations": {"max_iterations": 1},
    "max_samples": {"max_samples": 100},
    "window_s": {"window_s": 1.0},
    "energy_threshold": {"energy_threshold": 0.01},
    "floor_deg": {"floor_deg": 2.0},
    "max_error_deg": {"max_error_deg": 1.0},
    "max_error_approximate_deg": {"max_error_approximate_deg": 6.0},
    "n_consistent": {"n_consistent": 3},
    "step_s": {"step_s": 2.0},
    "hinge_misfit": {"hinge_misfit": 0.2},
    "approximate_misfit": {"approximate_misfit": 0.06},
    "rate_scale": {"rate_scale": 1.0},
    "offset_prior": {"offset_prior": 100.0},
    "gyr_bias_std": {"gyr_bias_std": 0.05},
    "gyr_bias_rest_std": {"gyr_bias_rest_std": 0.02},
    "acc_bias_std": {"acc_bias_std": 1.0},
    "bias_from_rest": {"bias_from_rest": False},
    "acceptance": {"acceptance": "published"},
}
# AxisSettings of select_samples; its others act on estimate_hinge_axis.
OF_SELECTION = {"max_samples", "window_s", "energy_threshold"}
OF_CALIBRATION = {f.name for f in dataclasses.fields(HingeSettings)} - {f.name for f in dataclasses.fields(AxisSettings)}


@pytest.fixture(scope="module")
def knee() -> imufast.HingeSimulation:
    return imufast.simulate_hinge("mixed", duration_s=12, rate_hz=100.0, seed=2, soft_tissue=imufast.SoftTissue())


@pytest.fixture(scope="module")
def joints() -> list[imufast.HingeSimulation]:
    """A knee and a plain hinge, which rest now and then, and a hinge that never rests."""
    biases = imufast.random_biases(5)
    return [
        imufast.simulate_hinge("mixed", duration_s=40, seed=2, soft_tissue=imufast.SoftTissue()),
        imufast.simulate_hinge("mixed", duration_s=40, seed=2, **biases),
        imufast.simulate_hinge("free", duration_s=20, seed=2, **biases),
    ]


def outcome(simulation: imufast.HingeSimulation, of_selection: bool, settings: AxisSettings) -> list[object]:
    imu1, imu2 = simulation.imu1, simulation.imu2
    if of_selection:
        chosen = imufast.select_samples(imu1, imu2, settings=settings)
        return [chosen.gyr_index.tolist(), chosen.acc_index.tolist(), chosen.gyr_score.tolist()]
    axis = imufast.estimate_hinge_axis(imu1, imu2, settings=settings)
    return [axis.axis1.tolist(), axis.bound95_deg.tolist(), axis.cost, axis.iterations, [m.cost for m in axis.minima]]


def plain_and_changed(kind: type[AxisSettings], name: str) -> tuple[Any, Any]:
    assert name in ANOTHER, f"add a changed value of the new setting {name!r} to this test"
    needed = {k: v for k, v in ANOTHER[name].items() if k != name}
    plain, changed = kind(**needed), kind(**ANOTHER[name])
    assert getattr(plain, name) != getattr(changed, name)
    return plain, changed


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(AxisSettings)])
def test_every_setting_changes_the_axis_or_the_selection(knee: imufast.HingeSimulation, name: str) -> None:
    plain, changed = plain_and_changed(AxisSettings, name)
    of_selection = name in OF_SELECTION
    assert outcome(knee, of_selection, plain) != outcome(knee, of_selection, changed)


def calibration(simulation: imufast.HingeSimulation, settings: HingeSettings) -> list[object]:
    result = imufast.calibrate_hinge(simulation.imu1, simulation.imu2, settings=settings)
    numbers = [a if a is None else a.tolist() for step in result.history for a in (step.axis1, step.bound95_deg)]
    return [[(step.verdict, step.accepted) for step in result.history], numbers]


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(HingeSettings)])
def test_every_setting_changes_the_calibration(joints: list[imufast.HingeSimulation], name: str) -> None:
    plain, changed = plain_and_changed(HingeSettings, name)
    assert [calibration(joint, plain) for joint in joints] != [calibration(joint, changed) for joint in joints]


def test_the_same_settings_give_the_same_bits(knee: imufast.HingeSimulation) -> None:
    for settings in (AxisSettings(), AxisSettings(starts="random", random_starts=5, seed=3)):
        assert outcome(knee, False, settings) == outcome(knee, False, settings)
    for more in (HingeSettings(), HingeSettings(starts="random", random_starts=5, seed=3)):
        assert calibration(knee, more) == calibration(knee, more)


def test_keywords_equal_settings_and_win_over_them(knee: imufast.HingeSimulation) -> None:
    def cost(**given: Any) -> float:
        return imufast.estimate_hinge_axis(knee.imu1, knee.imu2, **given).cost

    assert cost(weight_ratio=7.0) == cost(settings=AxisSettings(weight_ratio=7.0))
    assert cost(settings=AxisSettings(weight_ratio=3.0), weight_ratio=7.0) == cost(weight_ratio=7.0)
    assert cost(lowpass_hz=None) == cost(lowpass_hz=0) == cost()
    # HingeSettings are AxisSettings with more, and another low-pass.
    assert cost(settings=HingeSettings()) == cost(lowpass_hz=4.0) != cost()
    assert cost(settings=HingeSettings(), lowpass_hz=None) == cost()


def test_as_published_is_the_papers_own_choice(knee: imufast.HingeSimulation) -> None:
    for paper in (AxisSettings.as_published(), HingeSettings.as_published()):
        assert (paper.weight_ratio, paper.starts, paper.random_starts, paper.lowpass_hz) == (50.0, "random", 1, None)
        assert paper.max_samples == 1000
        assert paper.energy_threshold == 1.0
        # 21 samples in total at 50 Hz (section 7.3).
        assert round(paper.window_s * 50.0) == 21
        axis = imufast.estimate_hinge_axis(knee.imu1, knee.imu2, settings=paper)
        # One start and its opposite sign pairing.
        assert 1 <= len(axis.minima) <= 2
    more = HingeSettings.as_published()
    assert np.isinf([more.rate_scale, more.offset_prior]).all()
    assert (more.acceptance, more.bias_from_rest) == ("published", False)


def test_it_is_frozen_compares_by_value_and_takes_no_positions() -> None:
    for kind in (AxisSettings, HingeSettings):
        settings = kind(weight_ratio=10.0)
        with pytest.raises(dataclasses.FrozenInstanceError):
            settings.weight_ratio = 3.0  # type: ignore[misc]
        assert settings == kind(weight_ratio=10.0) != kind()
        assert hash(settings) == hash(kind(weight_ratio=10.0))
        with pytest.raises(TypeError):
            kind(50.0)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("weight_ratio", 0),
        ("weight_ratio", -1.0),
        ("weight_ratio", float("nan")),
        ("weight_ratio", float("inf")),
        ("weight_ratio", 1e13),
        ("weight_ratio", "50"),
        ("weight_ratio", None),
        ("weight_ratio", True),
        ("weight_ratio", 1j),
        ("weight_ratio", [50.0]),
        ("starts", "lucky"),
        ("starts", "RANDOM"),
        ("starts", None),
        ("starts", ["random"]),
        ("random_starts", 0),
        ("random_starts", 2.0),
        ("random_starts", True),
        ("random_starts", 10**7),
        ("seed", -1),
        ("seed", 0.5),
        ("seed", 2**64),
        ("lowpass_hz", -1.0),
        ("lowpass_hz", float("nan")),
        ("lowpass_hz", float("inf")),
        ("lowpass_hz", "4 Hz"),
        ("lowpass_hz", 1e-9),
        ("lowpass_hz", 0.0099),
        ("lowpass_hz", 1e7),
        ("max_iterations", 0),
        ("max_iterations", 1.5),
        ("max_iterations", 10**9),
        ("max_samples", 0),
        ("max_samples", 100.0),
        ("window_s", -0.1),
        ("window_s", float("inf")),
        ("window_s", 61.0),
        ("floor_deg", -0.1),
        ("floor_deg", 90.1),
        ("floor_deg", float("nan")),
        ("floor_deg", None),
        ("energy_threshold", 0.0),
        ("energy_threshold", "1"),
        ("max_error_deg", 0.0),
        ("max_error_deg", 91.0),
        ("max_error_approximate_deg", 0.0),
        ("n_consistent", 0),
        ("n_consistent", 1.0),
        ("step_s", 0.0),
        ("step_s", float("inf")),
        ("hinge_misfit", -0.1),
        ("hinge_misfit", float("nan")),
        ("approximate_misfit", 0.04),
        ("rate_scale", 0.0),
        ("rate_scale", float("nan")),
        ("offset_prior", -1.0),
        ("gyr_bias_std", -1.0),
        ("gyr_bias_rest_std", "0"),
        ("acc_bias_std", float("inf")),
        ("bias_from_rest", 1),
        ("bias_from_rest", None),
        ("acceptance", "strict"),
    ],
)
def test_a_value_out_of_its_range_is_refused_by_name(knee: imufast.HingeSimulation, name: str, value: object) -> None:
    given: dict[str, Any] = {"starts": "random"} if name in ("random_starts", "seed") else {}
    given[name] = value
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        HingeSettings(**given)
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        imufast.calibrate_hinge(knee.imu1, knee.imu2, **given)
    if name in OF_CALIBRATION:
        return
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        AxisSettings(**given)
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        imufast.estimate_hinge_axis(knee.imu1, knee.imu2, **given)


def test_unknown_settings_are_refused_by_name_with_what_is_known(knee: imufast.HingeSimulation) -> None:
    pair = knee.imu1, knee.imu2
    for function in (imufast.estimate_hinge_axis, imufast.select_samples, imufast.calibrate_hinge):
        with pytest.raises(imufast.SettingsError, match=r"'weigth_ratio'.*known are .*weight_ratio.*max_iterations"):
            function(*pair, weigth_ratio=3.0)
        with pytest.raises(imufast.SettingsError, match=r"settings must be (Axis|Hinge)Settings, got dict"):
            function(*pair, settings={"weight_ratio": 3.0})  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="weigth_ratio"):
        HingeSettings(weigth_ratio=3.0)  # type: ignore[call-arg]
    # What only a calibration knows, and settings that lack it.
    with pytest.raises(imufast.SettingsError, match=r"unknown setting 'max_error_deg'"):
        imufast.estimate_hinge_axis(*pair, max_error_deg=3.0)
    with pytest.raises(imufast.SettingsError, match=r"settings must be HingeSettings, got AxisSettings"):
        imufast.calibrate_hinge(*pair, settings=AxisSettings())  # type: ignore[arg-type]


@pytest.mark.parametrize("lucky", [{"seed": 3}, {"random_starts": 5}])
def test_a_seed_without_random_starts_is_refused_not_ignored(lucky: dict[str, int]) -> None:
    with pytest.raises(imufast.SettingsError, match=r'seed and random_starts only mean something with starts="random"'):
        AxisSettings(**lucky)  # type: ignore[arg-type]


def test_random_starts_are_reproducible_by_seed(knee: imufast.HingeSimulation) -> None:
    def run(seed: int) -> imufast.HingeAxis:
        return imufast.estimate_hinge_axis(knee.imu1, knee.imu2, starts="random", random_starts=3, seed=seed)

    first, again = run(11), run(11)
    np.testing.assert_array_equal(first.axis1, again.axis1)
    np.testing.assert_array_equal(first.covariance, again.covariance)
    assert (first.cost, first.iterations) == (again.cost, again.iterations)
    assert len({run(seed).iterations for seed in range(6)}) > 1


@pytest.mark.parametrize(
    ("name", "value"), [("weight_ratio", 10**400), ("starts", np.zeros((2, 2)))], ids=["beyond float", "array"]
)
def test_values_that_cannot_be_compared_are_refused_by_name(name: str, value: object) -> None:
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        HingeSettings(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "given",
    [
        {"weight_ratio": np.float32(5.0)},
        {"weight_ratio": np.int64(5)},
        {"lowpass_hz": np.float32(4.0)},
        {"floor_deg": np.uint8(1)},
        {"max_iterations": np.int64(50)},
        {"starts": "random", "random_starts": np.int32(3), "seed": np.uint64(2)},
    ],
    ids=str,
)
def test_numpy_scalars_are_numbers(knee: imufast.HingeSimulation, given: dict[str, Any]) -> None:
    values: dict[str, Any] = {k: v if isinstance(v, str) else v.item() for k, v in given.items()}
    assert AxisSettings(**given) == AxisSettings(**values)
    assert outcome(knee, False, AxisSettings(**given)) == outcome(knee, False, AxisSettings(**values))
    assert calibration(knee, HingeSettings(**given)) == calibration(knee, HingeSettings(**values))


def test_half_floats_are_numbers() -> None:
    assert AxisSettings(lowpass_hz=np.float16(4.0)) == AxisSettings(lowpass_hz=4.0)


@pytest.mark.parametrize("given", [{"max_error_deg": np.float32(2.0)}, {"n_consistent": np.int64(5)}], ids=str)
def test_numpy_scalars_are_saved_with_the_state(given: dict[str, Any]) -> None:
    calibrator = imufast.HingeCalibrator(50.0, **given)
    restored = imufast.HingeCalibrator.restore(calibrator.state())
    assert restored.result().settings == calibrator.result().settings


@pytest.mark.parametrize("given", [{"max_samples": np.int16(100)}, {"window_s": np.float32(1.0)}], ids=str)
def test_numpy_scalars_are_numbers_for_the_selection(knee: imufast.HingeSimulation, given: dict[str, Any]) -> None:
    plain = AxisSettings(**{k: v.item() for k, v in given.items()})
    assert outcome(knee, True, AxisSettings(**given)) == outcome(knee, True, plain)


@pytest.mark.parametrize(("name", "value"), [("weight_ratio", np.bool_(True)), ("max_iterations", np.float64(50.0))])
def test_numpy_scalars_of_another_kind_are_refused(name: str, value: object) -> None:
    with pytest.raises(imufast.SettingsError, match=rf"^{name} must be"):
        HingeSettings(**{name: value})  # type: ignore[arg-type]
