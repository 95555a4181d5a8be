"""The closed form of the angular deviation against the paper's Monte Carlo."""

from __future__ import annotations

import imufast
import numpy as np
import pytest


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (1.0, 0.3), (1.0, 1e-3), (2.0, 0.0)])
def test_closed_form_is_the_limit_of_the_papers_draws(a: float, b: float) -> None:
    rng = np.random.default_rng(1)
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    covariance = (frame * np.radians([0.0, a, b]) ** 2) @ frame.T
    closed = imufast.angular_deviation_deg(frame[:, 0], covariance)
    drawn = imufast.angular_deviation_deg(frame[:, 0], covariance, draws=200_000)
    assert closed == pytest.approx(drawn, rel=0.01)


def test_of_an_estimate() -> None:
    sim = imufast.simulate_hinge(duration_s=20.0, seed=4)
    axis = imufast.estimate_hinge_axis(sim.imu1, sim.imu2)
    for j, block, bound in (
        (axis.axis1, axis.covariance[:3, :3], axis.bound95_deg[0]),
        (axis.axis2, axis.covariance[3:, 3:], axis.bound95_deg[1]),
    ):
        mean, std = imufast.angular_deviation_deg(j, block)
        assert np.hypot(mean + 2.0 * std, 0.5) == pytest.approx(bound, rel=1e-6)


def test_undetermined_is_infinite() -> None:
    assert imufast.angular_deviation_deg([0, 0, 1], np.full((3, 3), np.inf)) == (np.inf, np.inf)


@pytest.mark.parametrize(
    ("axis", "covariance", "name"),
    [([0, 0, 2], np.eye(3), "axis"), ([0, 1], np.eye(3), "axis"), ([0, 0, 1], np.eye(6), "covariance")],
)
def test_wrong_input_is_named(axis: list[float], covariance: np.ndarray, name: str) -> None:
    with pytest.raises(imufast.InputError, match=name):
        imufast.angular_deviation_deg(axis, covariance)


def test_draws_are_checked() -> None:
    with pytest.raises(imufast.SettingsError, match="draws"):
        imufast.angular_deviation_deg([0, 0, 1], np.eye(3), draws=1)
