"""The lower body from up to seven IMUs: `estimate_lower_body`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.anatomy import positions, signed
from imufast.body.layout import layout
from imufast.body.problem import problem
from imufast.body.reading import Reading
from imufast.body.result import LowerBody
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.start import BodyStart
from imufast.errors import InputError, SettingsError
from imufast.imu import Recording

__all__ = ["estimate_lower_body"]

Array = NDArray[np.float64]
Progress = Callable[[int, float, float, float], object]


def estimate_lower_body(
    recording: Recording,
    placement: Mapping[str, str],
    anthropometry: Anthropometry | None = None,
    *,
    settings: LowerBodySettings | None = None,
    progress: Progress | None = None,
) -> LowerBody:
    """Estimate pelvis and legs from IMUs strapped on anyhow: no magnetometer, no calibration pose (McGrath & Stirling 2020).

    Each joint is first calibrated and tracked by its two sensors alone; from there one maximum a posteriori search over all
    sensors, joints and the body's measures (eqs 4-18).

    Stated standard deviations of angles, centres and lengths count what no sensor shows, too: how far soft tissue turns and
    shifts the sensors in step with the movement (`settings.soft_tissue_deg`, `soft_tissue_m`), and how upright a pelvis and a
    foot stand whose frames are taken from standing. Impacts that are faster than the samples follow widen the increments they
    fall into.

    Not finished: swapped or dead sensors are not found out.

    Args:
        recording: all sensors on one time base.
        placement: segment to sensor name; segments are "pelvis", "thigh_right", "shank_right", "foot_right", "thigh_left" ...
            Missing feet, a missing leg or a missing pelvis with a single leg make a smaller model.
        anthropometry: lengths and angles of the subject; default the population's.
        settings: default `LowerBodySettings()`.
        progress: called with (iteration, cost, fall that the step promised, damping) after each iteration; may raise to stop.

    Returns:
        LowerBody. What the motion leaves open is said joint by joint, not raised.

    Raises:
        InputError: not a recording; a placement that names no segment or sensor, uses a sensor twice, or leaves segments
            unconnected; less than 5 s.
        SettingsError: not an Anthropometry or LowerBodySettings.
    """
    placed = layout(recording, placement)
    if anthropometry is not None and not isinstance(anthropometry, Anthropometry):
        raise SettingsError(f"anthropometry must be an Anthropometry or None, got {type(anthropometry).__name__}")
    if settings is not None and not isinstance(settings, LowerBodySettings):
        raise SettingsError(f"settings must be a LowerBodySettings or None, got {type(settings).__name__}")
    if recording.time_s[-1] - recording.time_s[0] < LEAST_S:
        raise InputError(f"recording lasts {recording.time_s[-1] - recording.time_s[0]:.3g} s; give at least 5 s of motion")
    measures, how = anthropometry or Anthropometry(), settings or LowerBodySettings()
    start = BodyStart(recording, placed)
    graph = problem(recording, placed, measures, how, start.biases)
    rows = graph.samples.astype(np.intp)
    q = np.ascontiguousarray(start.q[rows])
    centers, axes = start.constants(measures)
    axes = signed(placed, q, centers, axes, start.up)
    position = positions(placed, q, centers)
    time_s = recording.time_s[rows]
    state: dict[str, Array] = {
        "q": q,
        "velocity": np.gradient(position, time_s, axis=0) if len(time_s) > 1 else np.zeros_like(position),
        "position": position,
        "gyr_bias": np.tile(start.biases[:, 0], (len(rows), 1, 1)),
        "acc_bias": np.tile(start.biases[:, 1], (len(rows), 1, 1)),
        "centers": centers,
        "axes": axes,
    }
    fit = _search(graph, state, how, progress)
    why: list[str] = []
    history = [fit.trials]
    again = signed(placed, fit.q, fit.centers, fit.axes, start.up)
    if not np.array_equal(again, fit.axes):
        # An axis that pointed to the left has pushed the knee's centre aside: search once more.
        state = {name: getattr(fit, name) for name in STATE} | {"axes": again}
        fit = _search(graph, state, how, progress)
        history.append(fit.trials)
        why.append("a knee's axis was turned round and the search repeated")
    return Reading(recording, placed, measures, start, rows, fit, how).read(np.concatenate(history), why)


STATE = ("q", "velocity", "position", "gyr_bias", "acc_bias", "centers", "axes")
LEAST_S = 5.0
"""Less cannot show how a body moves, s."""


def _search(
    graph: _core.BodyProblem, state: Mapping[str, Array], settings: LowerBodySettings, progress: Progress | None
) -> _core.BodyFit:
    q, velocity, position, gyr_bias, acc_bias, centers, axes = (
        np.ascontiguousarray(state[name], dtype=np.float64) for name in STATE
    )
    descent = (settings.max_iterations, settings.tolerance, 1e-3)
    return graph.minimise(q, velocity, position, gyr_bias, acc_bias, centers, axes, descent, True, progress)
