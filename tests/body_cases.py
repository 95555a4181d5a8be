"""A lower body as found, for tests of what is made of it."""

from __future__ import annotations

from functools import cache
from typing import Any

import imufast

WORN: dict[str, Any] = {"gyr_bias": 0.005, "acc_bias": 0.05}


@cache
def simulated() -> imufast.LowerBodySimulation:
    """Half a minute of the motion that determines all."""
    return imufast.simulate_lower_body("profile", seed=1, duration_s=30.0, rate_hz=50.0, **WORN)


@cache
def found(*missing: str) -> imufast.LowerBody:
    """What is found of it, without some of its sensors."""
    truth = simulated()
    placement = {segment: name for segment, name in truth.placement.items() if segment not in missing}
    return imufast.estimate_lower_body(truth.recording, placement)
