"""Long recordings: what does not change from informative pieces, then window by window with that held.

Joint centres and knee axes come from one search over the pieces that say most of them, with gaps between; each window then
searches for its motion alone, held to these constants, whose uncertainty enters that of the angles (Schmidt 1966). Neighbouring
windows overlap and are cut in the middle of that. So memory does not grow with the recording, but for the result's.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.body.reading import Reading
from imufast.body.residuals import over_windows
from imufast.body.result import BodyJoint, BodyStatus, BodyWindow, LowerBody, worst
from imufast.body.settings import LowerBodySettings
from imufast.body.solve import Ask, Solved, solve
from imufast.body.stance import STILL, Rests
from imufast.body.start import BodyStart
from imufast.imu import BREAK_STEPS, Recording
from imufast.quaternion import conjugate, multiply, rotate

__all__ = ["excerpt", "through_windows"]

Array = NDArray[np.float64]
WHOLE = 2.5
"""Recordings of up to so many windows are solved whole."""
PIECES, CHOSEN = 4, 8
"""A window is so many pieces long, and so many are chosen for the constants."""
OVERLAP = 6
"""Windows overlap by one over this of their length."""
MEAN_S = 0.1
"""Rates are averaged over so long before they are differentiated, s: impacts would outweigh motion."""
QUIET_S = 1.0
"""The quietest piece says what is upright, if the subject stands in it for so long, s."""


def excerpt(recording: Recording, names: list[str], settings: LowerBodySettings) -> Recording | None:
    """The pieces of a long recording that say most of joint centres, and one in which the subject stands; None where it is
    short enough to be solved whole.

    A centre moves with acceleration K r against its sensor, K = [ω̇×] + [ω×]²: a piece says Σ KᵀK of each sensor. Pieces are
    chosen one after the other by how much they add to the logarithms of the determinants.
    """
    rate_hz = recording.rate_hz
    if len(recording.time_s) <= WHOLE * settings.window_s * rate_hz:
        return None
    mean = max(round(MEAN_S * rate_hz), 1)
    per_piece = max(round(settings.window_s * rate_hz / PIECES / mean), 3)
    count = len(recording.time_s) // (mean * per_piece)
    used = count * per_piece * mean
    time_s = recording.time_s[:used:mean].reshape(count, per_piece)
    information, fastest = [], np.zeros((count, per_piece))
    for name in names:
        rates = recording[name].gyr[:used].reshape(count, per_piece, mean, 3).mean(axis=2)
        fastest = np.maximum(fastest, np.linalg.norm(rates, axis=2))
        information.append(_information(rates, time_s))
    said = np.stack(information, axis=1)
    total, chosen = np.broadcast_to(np.eye(3), said.shape[1:]), np.zeros(count, dtype=bool)
    for _ in range(min(CHOSEN, count)):
        gain = np.linalg.slogdet(total + said)[1].sum(axis=1)
        best = int(np.argmax(np.where(chosen, -np.inf, gain)))
        chosen[best] = True
        total = total + said[best]
    quiet = (fastest < STILL).sum(axis=1) * mean / rate_hz
    if quiet.max() >= QUIET_S:
        chosen[int(np.argmax(quiet))] = True
    rows = np.repeat(chosen, per_piece * mean)
    return _taken(recording, names, np.flatnonzero(rows))


def through_windows(recording: Recording, informative: Recording, ask: Ask) -> LowerBody:
    """A long recording, window by window, with constants from its informative pieces."""
    begin = BodyStart(informative, ask.layout)
    known = solve(informative, ask, begin, "constants")
    begin.stand(Rests(recording, ask.layout, known.fit.acc_bias.mean(axis=0)), known.fit)
    whole = Reading(known, ask)
    edges = _windows(recording, ask.settings)
    names = list(ask.layout.placed.values())
    found: list[LowerBody] = []
    for n, (start, stop) in enumerate(edges):
        part = _taken(recording, names, np.arange(start, stop))
        begun = BodyStart(part, ask.layout, known.start)
        if found:
            _carry_on(found[-1], begun, part, ask)
        solved = solve(part, ask, begun, f"window {n + 1} of {len(edges)}", known)
        reading = Reading(solved, ask, whole.frames)
        body = reading.read(solved.history, [])
        if found:
            middle = recording.time_s[(start + edges[n - 1][1]) // 2]
            body = _turned_to(found[-1], body)
            found[-1] = _cut(found[-1], found[-1].time_s < middle)
            body = _cut(body, body.time_s >= middle)
        found.append(body)
    return _joined(found, known)


def _information(rates: Array, time_s: Array) -> Array:
    """(P, 3, 3) Σ KᵀK of one sensor in each piece, from (P, M, 3) mean rates."""
    span = time_s[:, 2:] - time_s[:, :-2]
    slope = (rates[:, 2:] - rates[:, :-2]) / span[:, :, None]
    rate = rates[:, 1:-1]
    zero = np.zeros(slope.shape[:2])
    cross = np.stack(
        [zero, -slope[..., 2], slope[..., 1], slope[..., 2], zero, -slope[..., 0], -slope[..., 1], slope[..., 0], zero]
    )
    k = np.moveaxis(cross, 0, -1).reshape(*slope.shape[:2], 3, 3) + rate[..., :, None] * rate[..., None, :]
    k -= (rate**2).sum(axis=-1)[..., None, None] * np.eye(3)
    # Across a break no rate is a slope.
    k *= (span < 1.5 * np.median(span))[:, :, None, None]
    return np.asarray(np.einsum("pmki,pmkj->pij", k, k))


def _taken(recording: Recording, names: list[str], rows: NDArray[np.intp]) -> Recording:
    """Some samples of some sensors."""
    time_s = recording.time_s[rows]
    return Recording(
        {
            name: recording[name]._replace(gyr=recording[name].gyr[rows], acc=recording[name].acc[rows], time_s=time_s)
            for name in names
        }
    )


def _windows(recording: Recording, settings: LowerBodySettings) -> list[tuple[int, int]]:
    """First sample and the one after the last of each window, on the moments that the whole recording would have."""
    count, rate_hz = len(recording.time_s), recording.rate_hz
    length = settings.window_s * rate_hz
    overlap = length / OVERLAP
    number = int(np.ceil((count - overlap) / (length - overlap)))
    key = max(round(settings.key_step_s * rate_hz), 1)
    longest = max(settings.bridge_s, BREAK_STEPS / rate_hz)
    stretches = np.concatenate([[0], np.flatnonzero(np.diff(recording.time_s) > longest) + 1])
    advance = (count - overlap) / number
    starts = []
    for n in range(number):
        row = int(n * advance)
        begin = int(stretches[np.searchsorted(stretches, row, side="right") - 1])
        starts.append(begin + (row - begin) // key * key)
    stops = [min(int(np.ceil((n + 1) * advance + overlap)), count) for n in range(number)]
    return list(zip(starts, stops, strict=True))


def _carry_on(before: LowerBody, begun: BodyStart, part: Recording, ask: Ask) -> None:
    """Where the two sensors of a joint alone do not show its heading in this window, the window before says it: turns the
    start."""
    layout = ask.layout
    rows = np.searchsorted(part.time_s, before.time_s)
    rows = np.minimum(rows, len(part.time_s) - 1)
    common = part.time_s[rows] == before.time_s
    if not common.any() or all(joint.seen for joint in begun.joints.values()):
        return
    rows = rows[common]
    for name, (upper, lower) in layout.joints.items():
        begun.q[:, lower] = multiply(begun.q[:, upper], begun.joints[name].rel.q_12)
        if not begun.joints[name].seen:
            high, low = (before.q[layout.segments[k]][common] for k in (upper, lower))
            # Both windows' headings of the lower sensor against the upper one.
            turn = _heading(low, begun.q[rows, lower]) - _heading(high, begun.q[rows, upper])
            begun.q[:, lower] = multiply(np.broadcast_to(_about_z(turn), begun.q[:, lower].shape), begun.q[:, lower])


def _heading(q: Array, other: Array) -> float:
    """By how much (K, 4) `other` must be turned about the upright to come to `q`, rad."""
    off = multiply(q, conjugate(other))
    return float(np.angle(((off[:, 0] + 1j * off[:, 3]) ** 2).sum()))


def _about_z(angle: float) -> Array:
    return np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])


def _turned_to(before: LowerBody, body: LowerBody) -> LowerBody:
    """The next window's body with the heading and the place that it has in the one before, where they overlap."""
    _, old, new = np.intersect1d(before.time_s, body.time_s, return_indices=True)
    if not len(old):
        return body
    q = np.concatenate([before.q[name][old] for name in before.q])
    other = np.concatenate([body.q[name][new] for name in before.q])
    turn = np.broadcast_to(_about_z(_heading(q, other)), (len(body.time_s), 4))
    position = {name: rotate(turn, place) for name, place in body.position.items()}
    shift = np.mean([before.position[name][old] - position[name][new] for name in position], axis=(0, 1))
    return replace(
        body,
        q={name: multiply(turn, own) for name, own in body.q.items()},
        q_segment={name: multiply(turn, own) for name, own in body.q_segment.items()},
        position={name: place + shift for name, place in position.items()},
    )


TIMED = ("time_s", "q", "q_segment", "position", *(f.name for f in fields(LowerBody) if f.name.endswith("_deg")))
"""What a body has moment by moment, besides the headings of its joints."""


def _cut(body: LowerBody, kept: NDArray[np.bool_]) -> LowerBody:
    """Some moments of a body."""
    timed = {name: getattr(body, name) for name in TIMED}
    cut: dict[str, Any] = {
        name: {key: rows[kept] for key, rows in value.items()} if isinstance(value, dict) else value[kept]
        for name, value in timed.items()
    }
    joints = {name: replace(joint, heading_std_deg=joint.heading_std_deg[kept]) for name, joint in body.joints.items()}
    return replace(body, **cut, joints=joints)


def _joined(bodies: list[LowerBody], known: Solved) -> LowerBody:
    """One body of all windows."""
    first = bodies[0]
    timed: dict[str, Any] = {}
    for name in TIMED:
        values = [getattr(body, name) for body in bodies]
        if isinstance(values[0], dict):
            timed[name] = {key: np.concatenate([value[key] for value in values]) for key in values[0]}
        else:
            timed[name] = np.concatenate(values)
    windows = tuple(
        BodyWindow(float(body.time_s[0]), float(body.time_s[-1]), body.status, body.why, body.iterations) for body in bodies
    )
    why = list(known.why)
    # How long bones are, the constants say, so each window alike.
    why += [said for said in first.why if all(said in body.why for body in bodies)]
    joints = {}
    for name in first.joints:
        joints[name], said = _joint(name, [body.joints[name] for body in bodies])
        why += said
    status = worst(BodyStatus(known.fit.status), *(window.status for window in windows))
    failed = [
        n + 1 for n, window in enumerate(windows) if window.status not in (BodyStatus.CONVERGED, BodyStatus.NOT_OBSERVABLE)
    ]
    if failed:
        why.append(f"the search did not converge in {len(failed)} of {len(windows)} windows: see `windows`")
    if status is BodyStatus.CONVERGED and not any(joint.determined for joint in joints.values()):
        status = BodyStatus.NOT_OBSERVABLE
    history = np.concatenate([known.history, *(body.history for body in bodies)])
    return replace(
        first,
        **timed,
        status=status,
        why=tuple(dict.fromkeys(why)),
        joints=joints,
        cost=sum(body.cost for body in bodies),
        iterations=len(history),
        history=history,
        residuals=over_windows([body.residuals for body in bodies], [len(body.time_s) for body in bodies]),
        windows=windows,
    )


def _joint(name: str, seen: list[BodyJoint]) -> tuple[BodyJoint, list[str]]:
    """A joint in all windows, and what is to be said of it."""
    left_open = sum(not joint.determined for joint in seen)
    counts = np.array([len(joint.heading_std_deg) for joint in seen])
    drift_deg = float(np.sqrt((counts * np.square([joint.heading_drift_deg for joint in seen])).sum() / counts.sum()))
    determined = 2 * left_open < len(seen)
    reasons = dict.fromkeys(reason for joint in seen for reason in joint.why)
    body = replace(
        seen[0],
        heading_std_deg=np.concatenate([joint.heading_std_deg for joint in seen]),
        heading_drift_deg=drift_deg,
        determined=determined,
        why=() if determined else tuple(reasons),
    )
    said = [f"{name} is left open in {left_open} of {len(seen)} windows"] if left_open else []
    return body, said
