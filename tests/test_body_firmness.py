"""How firmly sensors sit: told from how far apart they see their joints while these move."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from imufast.body.firmness import LEAST, REPEATS_S, firmness
from imufast.body.layout import Layout
from imufast.body.settings import LowerBodySettings

KNEE = Layout({"thigh_left": "a", "shank_left": "b"})


def seen(apart: Any, rates: Any) -> tuple[Any, Any]:
    """A graph and a fit of one knee: (K,) how far apart it is seen, in stated standard deviations, each way, and (K,) rates."""
    squares = np.zeros((len(apart), 1, 4))
    squares[:, 0, 0] = 3.0 * np.square(apart)
    turned = np.zeros((len(apart), 2, 3))
    turned[:, 1, 0] = rates
    return SimpleNamespace(rates=turned), SimpleNamespace(joint_squares=squares)


@pytest.mark.parametrize("step_s", [0.05, 0.1, 0.2])
def test_a_share_is_what_residuals_that_repeat_show_whatever_the_step(step_s: float) -> None:
    settings = LowerBodySettings(key_step_s=step_s)
    # The same movement of the joint, m: what is stated at each moment falls with the square root of the step.
    white = np.full(200, 0.7 * np.sqrt(step_s / REPEATS_S))
    assert firmness(KNEE, *seen(white, np.ones(200)), settings) == pytest.approx([0.7])
    assert firmness(KNEE, *seen(10.0 * white, np.ones(200)), settings) == pytest.approx([1.0])
    assert firmness(KNEE, *seen(0.1 * white, np.ones(200)), settings) == pytest.approx([LEAST])


def test_rest_says_nothing_of_how_firmly_a_sensor_sits() -> None:
    settings = LowerBodySettings()
    loose = np.full(100, np.sqrt(settings.key_step_s / REPEATS_S))
    rest = np.zeros(900)
    moved, rested = seen(loose, np.ones(100)), seen(np.r_[loose, rest], np.r_[np.ones(100), rest])
    assert firmness(KNEE, *rested, settings) == pytest.approx(firmness(KNEE, *moved, settings), rel=1e-3)
    assert np.isfinite(firmness(KNEE, *seen(rest, rest), settings)).all()
