"""One search over one recording: from the start to the most probable body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imufast import _core
from imufast.body.anatomy import positions
from imufast.body.firmness import firmness
from imufast.body.layout import Layout
from imufast.body.problem import problem, rest_information, usual_postures
from imufast.body.samples import unwound
from imufast.body.settings import Anthropometry, LowerBodySettings
from imufast.body.stance import Rests, resting, signed
from imufast.body.start import BodyStart
from imufast.body.tissue import Tissue, skins
from imufast.imu import Recording

__all__ = ["Ask", "Progress", "Solved", "solve"]

Array = NDArray[np.float64]
Progress = Callable[[int, float, float, float, str], object]
UNWINDS = 3
"""So often at most the search is repeated from where moments that it had turned the wrong way round are put right."""
STATE = ("q", "velocity", "position", "gyr_bias", "acc_bias", "centers", "axes", "skins")
EARLY = 1.0
"""A first search ends where a step promises less, in log-likelihood: by then joints are seen as far apart as at the end."""


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
        shares: (J,) share of the stated standard deviations of joint centres that was taken.
        history: (T, 5) of its linear systems.
        why: what the reader should know.
    """

    recording: Recording
    start: BodyStart
    rows: NDArray[np.intp]
    fit: _core.BodyFit
    tissue: Tissue
    shares: Array
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
    graph = problem(recording, placed, ask.anthropometry, how, start.biases, moved, None if held is None else held.shares)
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
    driven = tissue.drives(q, axes)
    quiet = rest_information(resting(recording, placed, rows), how.key_step_s, how)
    held_by = (quiet, *usual_postures(placed, start.postures, rows))
    imus = [recording[name] for name in placed.placed.values()]
    trials: list[Array] = []
    why: list[str] = []

    def search(state: dict[str, Array], covariance: Array | None = None, *, early: bool = False) -> _core.BodyFit:
        """From `state` on, and again from where moments that were turned the wrong way round are put right."""
        given = (driven, *held_by)
        fit = _search(graph, state, given, ask, stage, trials, centers, covariance, early=early)
        trials.append(fit.trials)
        for _ in range(UNWINDS):
            turned = np.stack([unwound(imu, fit.q[:, k], rows, how.bridge_s) for k, imu in enumerate(imus)], axis=1)
            if np.array_equal(turned, fit.q):
                break
            again = reached(fit) | {"q": turned}
            other = _search(graph, again, given, ask, stage, trials, centers, covariance, early=early, anew=True)
            trials.append(other.trials)
            if not other.cost < fit.cost:
                break
            fit = other
        return fit

    if held is None:
        # What the joints' standard deviations are, and which way axes point, a search that ends early tells as well.
        fit = search(state, early=True)
        state = reached(fit)
        again = signed(placed, fit.q, fit.centers, fit.axes, start.up, rests)
        if not np.array_equal(again, fit.axes):
            # An axis that pointed to the left has pushed the knee's centre aside: search once more.
            driven = tissue.drives(fit.q, again)
            fit = search(state | {"axes": again, "skins": still}, early=True)
            state = reached(fit)
            why.append("a knee's axis was turned round and the search repeated")
        shares = firmness(placed, graph, fit, how)
        graph = problem(recording, placed, ask.anthropometry, how, start.biases, moved, shares)
    else:
        shares = held.shares
    fit = search(state, None if held is None else held.fit.constants_covariance)
    if held is None:
        start.stand(Rests(recording, placed, fit.acc_bias.mean(axis=0)), fit)
    return Solved(recording, start, rows, fit, tissue, shares, np.concatenate(trials), tuple(why))


def reached(fit: _core.BodyFit) -> dict[str, Array]:
    """The state that a search ended in, to go on from."""
    return {name: getattr(fit, name) for name in STATE}


def _search(
    graph: _core.BodyProblem,
    state: dict[str, Array],
    given: tuple[Array, ...],
    ask: Ask,
    stage: str,
    trials: list[Array],
    beforehand: Array,
    held: Array | None,
    *,
    early: bool,
    anew: bool = False,
) -> _core.BodyFit:
    """What is left of a search after the systems in `trials`, or one of its own (`anew`).

    `given`: angles that move the skins, information on where nothing moves, usual postures. `early`: it may end early, and
    tells nothing of how uncertain it is.
    """
    q, velocity, position, gyr_bias, acc_bias, centers, axes, still = (
        np.ascontiguousarray(state[name], dtype=np.float64) for name in STATE
    )
    done = sum(map(len, trials))
    tolerance = max(ask.settings.tolerance, EARLY) if early else ask.settings.tolerance
    descent = (ask.settings.max_iterations if anew else max(ask.settings.max_iterations - done, 0), tolerance, 1e-3)
    progress, watch = ask.progress, None
    if progress is not None:

        def watch(iteration: int, cost: float, promised: float, damping: float) -> None:
            progress(done + iteration, cost, promised, damping, stage)

    constants = None if held is None else np.ascontiguousarray(held)
    driven, *known = (np.ascontiguousarray(part) for part in given)
    parts = (q, velocity, position, gyr_bias, acc_bias, centers, axes, still, driven)
    return graph.minimise(*parts, descent, not early, watch, constants, np.ascontiguousarray(beforehand), *known)
