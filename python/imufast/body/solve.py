"""One search over one recording: from the start to the most probable body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.anatomy import positions
from imufast.body.layout import Layout
from imufast.body.problem import problem
from imufast.body.samples import unwound
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.stance import Rests, signed
from imufast.body.start import BodyStart
from imufast.body.tissue import Tissue, skins
from imufast.imu import Recording

__all__ = ["Ask", "Progress", "Solved", "solve"]

Array = NDArray[np.float64]
Progress = Callable[[int, float, float, float, str], object]
UNWINDS = 3
"""So often at most the search is repeated from where moments that it had turned the wrong way round are put right."""
STATE = ("q", "velocity", "position", "gyr_bias", "acc_bias", "centers", "axes", "skins")


@dataclass(frozen=True)
class Ask:
    """What a caller of `estimate_lower_body` has asked for, besides the recording."""

    layout: Layout
    anthropometry: Anthropometry
    settings: LowerBodySettings
    progress: Progress | None


@dataclass(frozen=True, eq=False)
class Solved:
    """A search and its end.

    Attributes:
        recording: what it saw.
        start: where it started.
        rows: (K,) the samples of its moments.
        fit: what it found.
        tissue: what moves the sensors on their bones.
        history: (T, 5) of its linear systems.
        why: what the reader should know.
    """

    recording: Recording
    start: BodyStart
    rows: NDArray[np.intp]
    fit: _core.BodyFit
    tissue: Tissue
    history: Array
    why: tuple[str, ...]


def solve(recording: Recording, ask: Ask, start: BodyStart, stage: str, held: Solved | None = None) -> Solved:
    """The most probable body.

    Args:
        recording: of one layout.
        ask: what is wanted.
        start: where to start, of this recording. Its uprights become those of quiet standing, which a search tells from other
            rests, unless there is an earlier fit.
        stage: what `progress` is told that this search is.
        held: an earlier search, whose constants (joint centres, axes, skins) stay as they are, as uncertain as it says. Default
            None: they are searched for, and the search is repeated where an axis turns out to point to the left.
    """
    placed, how = ask.layout, ask.settings
    moved = skins(placed, how)
    graph = problem(recording, placed, ask.anthropometry, how, start.biases, moved)
    rows = graph.samples.astype(np.intp)
    q = np.ascontiguousarray(start.q[rows])
    if held is None:
        centers, axes = start.constants(ask.anthropometry)
        rests = Rests(recording, placed)
        axes = signed(placed, q, centers, axes, start.up, rests)
        still, tissue = np.zeros((len(moved), 2, 3)), Tissue(moved, q)
    else:
        centers, axes, still, tissue = held.fit.centers, held.fit.axes, held.fit.skins, held.tissue
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
        "skins": still,
    }
    covariance = None if held is None else held.fit.constants_covariance
    driven = tissue.drives(q, axes)
    history: list[Array] = []
    imus = [recording[name] for name in placed.placed.values()]

    def search(state: dict[str, Array], driven: Array) -> _core.BodyFit:
        fit = _search(graph, state, driven, ask, stage, covariance)
        history.append(fit.trials)
        for _ in range(UNWINDS):
            turned = np.stack([unwound(imu, fit.q[:, k], rows, how.bridge_s) for k, imu in enumerate(imus)], axis=1)
            if np.array_equal(turned, fit.q):
                break
            again = {name: getattr(fit, name) for name in STATE} | {"q": turned}
            other = _search(graph, again, driven, ask, stage, covariance)
            history.append(other.trials)
            if not other.cost < fit.cost:
                break
            fit = other
        return fit

    fit = search(state, driven)
    why: list[str] = []
    if held is None:
        again = signed(placed, fit.q, fit.centers, fit.axes, start.up, rests)
        if not np.array_equal(again, fit.axes):
            # An axis that pointed to the left has pushed the knee's centre aside: search once more.
            state = {name: getattr(fit, name) for name in STATE} | {"axes": again, "skins": still}
            driven = tissue.drives(fit.q, again)
            fit = search(state, driven)
            why.append("a knee's axis was turned round and the search repeated")
        start.stand(Rests(recording, placed, fit.acc_bias.mean(axis=0)), fit)
    return Solved(recording, start, rows, fit, tissue, np.concatenate(history), tuple(why))


def _search(
    graph: _core.BodyProblem, state: dict[str, Array], driven: Array, ask: Ask, stage: str, covariance: Array | None
) -> _core.BodyFit:
    q, velocity, position, gyr_bias, acc_bias, centers, axes, still = (
        np.ascontiguousarray(state[name], dtype=np.float64) for name in STATE
    )
    descent = (ask.settings.max_iterations, ask.settings.tolerance, 1e-3)
    progress, watch = ask.progress, None
    if progress is not None:

        def watch(iteration: int, cost: float, promised: float, damping: float) -> None:
            progress(iteration, cost, promised, damping, stage)

    held = None if covariance is None else np.ascontiguousarray(covariance)
    parts = (q, velocity, position, gyr_bias, acc_bias, centers, axes, still, np.ascontiguousarray(driven))
    return graph.minimise(*parts, descent, True, watch, held)
