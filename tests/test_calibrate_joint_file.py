"""Saving and loading a JointCalibration: everything comes back, and what is damaged is refused with an InputError."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imufast import (
    InputError,
    JointAxis,
    JointCalibration,
    JointCenter,
    SensorNoise,
    Verdict,
    calibrate_joint,
    simulate_ball_joint,
    simulate_hinge,
    track,
)

PARTS = ("axis", "center", "noise")


@cache
def found(kind: str) -> JointCalibration:
    sim: Any = simulate_hinge(seed=1, duration_s=40.0) if kind == "hinge" else simulate_ball_joint(seed=1, duration_s=20.0)
    return calibrate_joint(sim.imu1, sim.imu2)


def by_hand() -> JointCalibration:
    return JointCalibration(
        verdict=Verdict.HINGE,
        accepted=True,
        axis=JointAxis(np.array([0.0, 1.0, 0.0]), np.array([0.6, 0.8, 0.0]), np.eye(6) * 1e-4, np.array([1.0, 2.0])),
        center=JointCenter(np.array([0.1, 0.0, 0.2]), np.array([-0.1, 0.0, 0.3]), np.eye(6) * 1e-6, np.eye(6)[:1]),
        gyr_bias1=np.array([0.01, 0.0, 0.0]),
        acc_bias2=np.array([0.0, 0.1, 0.0]),
        acc_bias_covariance=np.eye(6) * 0.01,
        gyr_bias_std=0.001,
        relative_gyr_bias_std=0.0004,
        noise=SensorNoise(0.001, 0.002, 0.01, 0.02, 100.0),
        rate_ratio=0.01,
        why=("because ⊥",),
        history=found("hinge").history,
    )


def same(one: JointCalibration, other: JointCalibration) -> None:
    assert json.dumps(one._plain()) == json.dumps(other._plain())


@pytest.mark.parametrize("make", [lambda: found("hinge"), lambda: found("ball"), by_hand, JointCalibration])
def test_what_is_saved_comes_back(tmp_path: Path, make: Any) -> None:
    calibration = make()
    calibration.save(tmp_path / "one.json")
    loaded = JointCalibration.load(tmp_path / "one.json")
    same(calibration, loaded)
    assert loaded.verdict is calibration.verdict
    assert loaded.accepted is calibration.accepted
    assert (loaded.noise, loaded.rate_ratio, loaded.why) == (calibration.noise, calibration.rate_ratio, calibration.why)
    assert loaded.gyr_bias_std == calibration.gyr_bias_std
    assert loaded.relative_gyr_bias_std == calibration.relative_gyr_bias_std
    for name in ("gyr_bias1", "gyr_bias2", "acc_bias1", "acc_bias2", "acc_bias_covariance"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(calibration, name))
    for part in ("axis", "center"):
        assert (getattr(loaded, part) is None) == (getattr(calibration, part) is None)
    if calibration.axis is not None:
        np.testing.assert_array_equal(loaded.axis.axis1, calibration.axis.axis1)  # type: ignore[union-attr]
        np.testing.assert_array_equal(loaded.axis.bound95_deg, calibration.axis.bound95_deg)  # type: ignore[union-attr]
    if calibration.center is not None:
        np.testing.assert_array_equal(loaded.center.covariance, calibration.center.covariance)  # type: ignore[union-attr]
    assert len(loaded.history) == len(calibration.history)
    for one, other in zip(loaded.history, calibration.history, strict=True):
        assert (one.time_s, one.verdict, one.accepted, one.why) == (other.time_s, other.verdict, other.accepted, other.why)
        np.testing.assert_array_equal(one.axis1, other.axis1)
    assert loaded.hinge is None
    assert loaded.estimate is None
    loaded.save(tmp_path / "two.json")
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


def test_the_file_states_schema_version_and_units(tmp_path: Path) -> None:
    by_hand().save(tmp_path / "joint.json")
    plain = json.loads((tmp_path / "joint.json").read_text(encoding="utf-8"))
    assert plain["schema"] == "imufast.joint-calibration"
    assert plain["schema_version"] == 1
    assert plain["verdict"] == "HINGE"
    assert plain["gyr_bias1_rad_s"] == [0.01, 0.0, 0.0]
    assert plain["center"]["in_sensor1_m"] == [0.1, 0.0, 0.2]


def test_saving_again_replaces_the_file_and_leaves_no_other(tmp_path: Path) -> None:
    path = tmp_path / "joint.json"
    JointCalibration().save(path)
    by_hand().save(str(path))
    same(JointCalibration.load(str(path)), by_hand())
    assert [p.name for p in tmp_path.iterdir()] == ["joint.json"]


@pytest.mark.parametrize("path", ["", None, 3, b"x", "a\0b"])
def test_what_is_no_path_is_refused(path: Any) -> None:
    with pytest.raises(InputError, match="path"):
        JointCalibration.load(path)
    with pytest.raises(InputError, match="path"):
        JointCalibration().save(path)


def test_folders_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="none\\.json"):
        JointCalibration.load(tmp_path / "none.json")
    for act in (JointCalibration.load, JointCalibration().save):
        with pytest.raises(InputError, match="path"):
            act(tmp_path)
    with pytest.raises(InputError, match="path"):
        JointCalibration().save(tmp_path / "missing" / "joint.json")


def plain() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(json.dumps(by_hand()._plain()))
    return content


def load(tmp_path: Path, content: Any) -> JointCalibration:
    path = tmp_path / "joint.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
    return JointCalibration.load(path)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{}",
        "[]",
        "null",
        "3",
        '"text"',
        '{"schema": "imufast.joint-calibration"}',
        '{"schema": "other", "schema_version": 1}',
        "[" * 100_000,
        '{"schema": "imufast.joint-calibration", "schema_version": ' + "1" * 5000 + "}",
    ],
    ids=lambda text: text[:20],
)
def test_other_files_are_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match="joint\\.json"):
        load(tmp_path, content)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "joint.json").write_bytes(b"\xff\xfe\x00\x01" * 100)
    with pytest.raises(InputError, match="joint\\.json"):
        JointCalibration.load(tmp_path / "joint.json")


def test_newer_versions_are_refused_with_advice(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"version 2, this imufast knows 1: update"):
        load(tmp_path, plain() | {"schema_version": 2})
    versions: list[Any] = [math.inf, None, "1", [1], {}]
    for version in versions:
        with pytest.raises(InputError):
            load(tmp_path, plain() | {"schema_version": version})


def test_names_that_it_does_not_know_are_passed_over(tmp_path: Path) -> None:
    same(load(tmp_path, plain() | {"later": 1}), by_hand())


@pytest.mark.parametrize("name", sorted(set(by_hand()._plain()) - {"rate_ratio", "relative_gyr_bias_std_rad_s"}))
def test_missing_names_are_refused(tmp_path: Path, name: str) -> None:
    content = plain()
    del content[name]
    with pytest.raises(InputError, match="schema|saved" if name == "schema" else name):
        load(tmp_path, content)


@pytest.mark.parametrize(("part", "name"), [(p, n) for p in PARTS for n in plain()[p] if n != "link_std"])
def test_missing_names_in_parts_are_refused(tmp_path: Path, part: str, name: str) -> None:
    content = plain()
    del content[part][name]
    with pytest.raises(InputError, match=name):
        load(tmp_path, content)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_cut_files_are_refused(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    text = json.dumps(plain())
    with pytest.raises(InputError):
        load(tmp_path_factory.getbasetemp(), text[: data.draw(st.integers(0, len(text) - 1))])


def put(content: dict[str, Any], part: str | None, name: str, value: Any) -> None:
    """Sets a number, or the first number of an array."""
    place: Any = content if part is None else content[part]
    if isinstance(place[name], list) and isinstance(value, float):
        array = np.array(place[name], dtype=float)
        array.flat[0] = value
        value = array.tolist()
    place[name] = value


CHECKED = [
    (None, "gyr_bias1_rad_s"),
    (None, "gyr_bias2_rad_s"),
    (None, "acc_bias1_m_s2"),
    (None, "acc_bias2_m_s2"),
    (None, "acc_bias_covariance_m2_s4"),
    (None, "gyr_bias_std_rad_s"),
    ("axis", "axis1"),
    ("axis", "axis2"),
    ("center", "in_sensor1_m"),
    ("center", "in_sensor2_m"),
]
UNCHECKED = [
    ("axis", "covariance_rad2"),
    ("axis", "bound95_deg"),
    ("center", "covariance_m2"),
    ("center", "undetermined"),
    ("noise", "gyr_std1"),
    ("noise", "gyr_std2"),
    ("noise", "acc_std1"),
    ("noise", "acc_std2"),
    ("noise", "rate_hz"),
    ("noise", "link_std"),
    (None, "rate_ratio"),
]


@pytest.mark.parametrize(("part", "name"), CHECKED)
@pytest.mark.parametrize("value", [math.nan, math.inf, "x", [1.0], {}])
def test_values_that_are_none_are_refused(tmp_path: Path, part: str | None, name: str, value: Any) -> None:
    content = plain()
    put(content, part, name, value)
    with pytest.raises(InputError, match=name[:8]):
        load(tmp_path, content)


ARRAYS = UNCHECKED[:4]


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        *((part, name, "x") for part, name in ARRAYS),
        *((part, name, value) for part, name in UNCHECKED for value in (math.nan, math.inf)),
        *((part, name, "x") for part, name in UNCHECKED[4:]),
    ],
)
def test_values_that_are_none_are_refused_in_every_part(tmp_path: Path, part: str | None, name: str, value: Any) -> None:
    content = plain()
    put(content, part, name, value)
    with pytest.raises(InputError):
        load(tmp_path, content)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("verdict", "LOOSE"),
        ("verdict", None),
        ("why", None),
        ("why", 3),
        ("history", None),
        ("history", [1]),
        ("history", "x"),
        ("axis", 3),
        ("center", "x"),
        ("noise", [0.1]),
        ("noise", {"gyr_std1": 1.0, "other": 2.0}),
    ],
)
def test_parts_of_another_kind_are_refused(tmp_path: Path, name: str, value: Any) -> None:
    with pytest.raises(InputError):
        load(tmp_path, plain() | {name: value})


@pytest.mark.parametrize(
    ("name", "value"), [("accepted", "yes"), ("accepted", 1), ("why", "word"), ("why", {}), ("history", {})]
)
def test_parts_of_a_similar_kind_are_refused(tmp_path: Path, name: str, value: Any) -> None:
    with pytest.raises(InputError):
        load(tmp_path, plain() | {name: value})


@pytest.mark.parametrize(("name", "value"), [("time_s", "x"), ("axis1", [1.0, 2.0]), ("misfit", "x"), ("accepted", 3)])
def test_history_is_checked(tmp_path: Path, name: str, value: Any) -> None:
    content = plain()
    content["history"][0][name] = value
    with pytest.raises(InputError):
        load(tmp_path, content)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.data())
def test_whatever_loads_can_be_used_and_saved(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """One value anywhere is exchanged: it is refused, or everything after it works."""
    folder, content = tmp_path_factory.getbasetemp(), deepcopy(plain())
    content["history"] = content["history"][:1]
    part, name = data.draw(st.sampled_from([*CHECKED, *((p, n) for p, n in UNCHECKED if p == "axis")]))
    put(content, part, name, data.draw(st.sampled_from([0.0, -1.0, 1e-300, 1e5, math.nan, None, "x", True, []])))
    try:
        loaded = load(folder, content)
    except InputError:
        return
    loaded.save(folder / "again.json")
    same(JointCalibration.load(folder / "again.json"), loaded)
    sim = simulate_ball_joint(seed=1, duration_s=1.0)
    for method in ("mekf", "complementary", "smoother"):
        try:
            result = track(sim.imu1, sim.imu2, loaded, method)
        except InputError:
            continue
        assert np.isfinite(result.q_12).all()
