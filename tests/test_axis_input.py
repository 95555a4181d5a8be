"""What the estimate of a hinge axis refuses, and how its overall sign is chosen."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import imufast
import numpy as np
import pytest
from imufast import HingeAxis, HingeSimulation, Imu, estimate_hinge_axis, simulate_hinge
from reference.compare import estimate

# Fast simulated motion and dead sensors look odd to an Imu, which says so; that is tested elsewhere.
pytestmark = pytest.mark.filterwarnings("ignore::imufast.ImufastWarning")


@pytest.fixture(scope="module")
def mixed() -> HingeSimulation:
    return simulate_hinge("mixed", duration_s=20, seed=4)


@pytest.fixture(scope="module")
def mixed_axis(mixed: HingeSimulation) -> HingeAxis:
    return estimate(mixed)


# The overall sign


def test_flipped_twice_is_the_same_and_once_the_opposite(mixed_axis: HingeAxis) -> None:
    once = mixed_axis.flipped()
    np.testing.assert_array_equal(once.axis1, -mixed_axis.axis1)
    np.testing.assert_array_equal(once.axis2, -mixed_axis.axis2)
    np.testing.assert_array_equal(once.covariance, mixed_axis.covariance)
    np.testing.assert_array_equal(once.flipped().axis1, mixed_axis.axis1)
    assert (once.cost, once.status) == (mixed_axis.cost, mixed_axis.status)


@pytest.mark.parametrize("name", ["towards1", "towards2"])
def test_oriented_points_to_a_direction(mixed_axis: HingeAxis, name: str) -> None:
    own = mixed_axis.axis1 if name == "towards1" else mixed_axis.axis2
    for direction in (own, -own, 100.0 * own + np.cross(own, [0.2, 0.5, 0.9]), np.eye(3)[0], [0, -1, 0]):
        chosen_by: dict[str, Any] = {name: direction}
        oriented = mixed_axis.oriented(**chosen_by)
        same = oriented.axis1 if name == "towards1" else oriented.axis2
        assert same @ np.asarray(direction, float) > 0.0
        # Both axes turn together, and turning before changes nothing.
        assert oriented.axis1 @ mixed_axis.axis1 == pytest.approx(oriented.axis2 @ mixed_axis.axis2)
        np.testing.assert_array_equal(mixed_axis.flipped().oriented(**chosen_by).axis1, oriented.axis1)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e-3, 1e200, 1e308])
def test_a_direction_may_have_any_length(mixed_axis: HingeAxis, length: float) -> None:
    k = int(np.abs(mixed_axis.axis1).argmax())
    direction = np.zeros(3)
    direction[k] = -length * np.sign(mixed_axis.axis1[k])
    np.testing.assert_array_equal(mixed_axis.oriented(towards1=direction).axis1, -mixed_axis.axis1)


def test_oriented_by_flexion_lets_the_joint_angle_grow() -> None:
    simulation = simulate_hinge("sit_to_stand", duration_s=20, seed=3)
    axis = estimate(simulation)
    low, high = int(simulation.angle_rad[:500].argmin()), int(simulation.angle_rad[:500].argmax())
    start, stop = min(low, high), max(low, high)
    flexing = (simulation.imu1[start:stop], simulation.imu2[start:stop])
    oriented = axis.oriented(flexing=flexing)
    np.testing.assert_array_equal(axis.flipped().oriented(flexing=flexing).axis1, oriented.axis1)
    # The truth's own axis has flexion positive; here the angle falls or grows over the cut.
    assert float(oriented.axis1 @ simulation.axis1) * (1.0 if high > low else -1.0) > 0.99


# Refusals


@pytest.fixture(scope="module")
def pair(mixed: HingeSimulation) -> tuple[Imu, Imu]:
    return mixed.imu1[:500], mixed.imu2[:500]


def chosen(gyr: object, acc: object = None) -> Any:
    return SimpleNamespace(gyr_index=gyr, acc_index=np.arange(500) if acc is None else acc)


def anything(value: Any) -> Any:
    """A value of a type that type checkers would refuse."""
    return value


Pair = tuple[Any, Any]
ALL = np.arange(500)
BAD_INPUT: dict[str, tuple[Callable[[Any, Any], object], str]] = {
    "imu1 a string": (lambda a, b: estimate_hinge_axis("thigh", b), "^imu1 must be an imufast.Imu, got str"),  # type: ignore[arg-type]
    "imu1 None": (lambda a, b: estimate_hinge_axis(None, b), "^imu1 must be .* NoneType"),  # type: ignore[arg-type]
    "imu1 an array": (lambda a, b: estimate_hinge_axis(a.gyr, b), "^imu1 must be .* ndarray"),
    "imu2 a number": (lambda a, b: estimate_hinge_axis(a, 3), "^imu2 must be .* int"),  # type: ignore[arg-type]
    "imu2 a recording": (lambda a, b: estimate_hinge_axis(a, imufast.Recording({"x": b})), "^imu2 must be .* Recording"),  # type: ignore[arg-type]
    "imu2 a pair": (lambda a, b: estimate_hinge_axis(a, (a, b)), "^imu2 must be .* tuple"),  # type: ignore[arg-type]
    "lengths differ": (lambda a, b: estimate_hinge_axis(a, b[:499]), "imu1 has 500 samples but imu2 has 499"),
    "rates differ": (lambda a, b: estimate_hinge_axis(a, Imu(b.gyr, b.acc, 100.0)), "imu1.*different time bases.*s apart"),
    "starts differ": (
        lambda a, b: estimate_hinge_axis(a, Imu(b.gyr, b.acc, time_s=b.time_s + 0.5)),
        "imu1.*different time bases.*0.5 s apart",
    ),
    "one row late": (lambda a, b: estimate_hinge_axis(a[:499], b[1:]), "imu1.*different time bases"),
    "same imu twice": (lambda a, b: estimate_hinge_axis(a, a), "imu1 .* and imu2 .* hold the same gyr data"),
    "same data twice": (
        lambda a, b: estimate_hinge_axis(a, Imu(a.gyr.copy(), b.acc, 50.0, name="other")),
        "imu2 .'other'. hold the same gyr data",
    ),
    "one sample": (lambda a, b: estimate_hinge_axis(a[:1], b[:1]), "imu1 and imu2 have 1 samples; at least 4"),
    "three samples": (lambda a, b: estimate_hinge_axis(a[:3], b[:3]), "imu1 and imu2 have 3 samples; at least 4"),
    "too short to filter": (
        lambda a, b: estimate_hinge_axis(a[:20], b[:20], lowpass_hz=4.0),
        "no unbroken stretch of 0.5 s, which lowpass_hz=4 needs",
    ),
    "index past the end": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL + 1)), "gyr_index must ascend within 0 to 499"),
    "index below 0": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL - 1)), "gyr_index must ascend within 0 to 499"),
    "index descends": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL[::-1])), "gyr_index must ascend"),
    "index repeats": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, [1, 1])), "acc_index must ascend"),
    "index of floats": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL * 1.0)), "gyr_index must be a vector of whole"),
    "index a mask": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, ALL > 5)), "acc_index must be a vector.* of bool"),
    "index of strings": (lambda a, b: estimate_hinge_axis(a, b, chosen(["1", "2"])), "gyr_index must be a vector of whole"),
    "index empty": (
        lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, np.zeros(0, np.int64))),
        r"acc_index must be a vector.*\(0,\)",
    ),
    "index a table": (lambda a, b: estimate_hinge_axis(a, b, chosen(ALL[None])), r"gyr_index must be a vector.*\(1, 500\)"),
    "index a number": (lambda a, b: estimate_hinge_axis(a, b, chosen(3)), r"gyr_index must be a vector.*\(\)"),
    "index missing": (lambda a, b: estimate_hinge_axis(a, b, chosen("none")), "gyr_index must be a vector"),
    "index beyond int64": (
        lambda a, b: estimate_hinge_axis(a, b, chosen(np.array([0, 2**63 + 5], np.uint64))),
        "gyr_index must ascend",
    ),
    "unsigned index descends": (
        lambda a, b: estimate_hinge_axis(a, b, chosen(ALL, np.array([5, 3, 7], np.uint64))),
        "acc_index must ascend",
    ),
    "index ragged": (lambda a, b: estimate_hinge_axis(a, b, chosen([[1], [1, 2]])), "gyr_index and .acc_index.*Namespace"),
    "samples a list": (lambda a, b: estimate_hinge_axis(a, b, anything([1, 2, 3])), "^samples must have vectors.*got list"),
    "samples a dict": (lambda a, b: estimate_hinge_axis(a, b, anything({"gyr_index": ALL})), "^samples must .*got dict"),
    "samples an array": (lambda a, b: estimate_hinge_axis(a, b, anything(ALL)), "^samples must .*got ndarray"),
    "samples one kind only": (
        lambda a, b: estimate_hinge_axis(a, b, anything(SimpleNamespace(gyr_index=ALL))),
        "^samples must have vectors of whole numbers .gyr_index and .acc_index",
    ),
}


@pytest.mark.parametrize("case", BAD_INPUT)
def test_bad_input_is_refused_with_the_argument_that_is_wrong(pair: Pair, case: str) -> None:
    call, message = BAD_INPUT[case]
    with pytest.raises(imufast.InputError, match=message):
        call(*pair)


BAD_DIRECTIONS: dict[str, tuple[Callable[[HingeAxis, Any, Any], object], str]] = {
    "nothing": (lambda x, a, b: x.oriented(), "exactly one of towards1, towards2, flexing; got none"),
    "two": (lambda x, a, b: x.oriented(towards1=[1, 0, 0], towards2=[1, 0, 0]), "exactly one of .*towards1', 'towards2"),
    "two numbers": (lambda x, a, b: x.oriented(towards1=[1.0, 0.0]), "^towards1 must be three finite numbers"),
    "zero": (lambda x, a, b: x.oriented(towards2=[0, 0, 0]), "^towards2 must be three finite numbers"),
    "NaN": (lambda x, a, b: x.oriented(towards1=[np.nan, 0, 1]), "^towards1 must be three finite numbers"),
    "perpendicular": (
        lambda x, a, b: x.oriented(towards1=np.cross(x.axis1, [0.3, 0.2, 0.5])),
        "^towards1 does not tell the sign",
    ),
    "still": (lambda x, a, b: x.oriented(flexing=(a[:50], b[:50])), "^flexing does not tell the sign"),
    "flexing same imu": (lambda x, a, b: x.oriented(flexing=(a, a)), "hold the same gyr data"),
    "a word": (lambda x, a, b: x.oriented(towards1=anything("up")), "^towards1 must be three finite numbers"),
    "ragged": (lambda x, a, b: x.oriented(towards1=anything([[1], 2, 3])), "^towards1 must be three finite numbers"),
    "a table": (lambda x, a, b: x.oriented(towards2=np.eye(3)), "^towards2 must be three finite numbers"),
    "infinite": (lambda x, a, b: x.oriented(towards2=[0, np.inf, 1]), "^towards2 must be three finite numbers"),
    "flexing three": (lambda x, a, b: x.oriented(flexing=anything((a, b, a))), "^flexing must be a tuple of two Imus"),
    "flexing one": (lambda x, a, b: x.oriented(flexing=anything(a)), "^flexing must be a tuple of two Imus, got Imu"),
    "flexing a number": (lambda x, a, b: x.oriented(flexing=anything(3)), "^flexing must be a tuple of two Imus, got int"),
    "flexing no imu": (lambda x, a, b: x.oriented(flexing=(None, b)), "imu1 must be an imufast.Imu"),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("case", BAD_DIRECTIONS)
def test_a_direction_that_does_not_tell_is_refused(mixed_axis: HingeAxis, pair: Pair, case: str) -> None:
    call, message = BAD_DIRECTIONS[case]
    with pytest.raises(imufast.InputError, match=message):
        call(mixed_axis, *pair)
