"""The peer on GTSAM beside us: the same simulated data, the same noise, and our solution put into the peer's own graph.

    python benches/body/gtsam_peer.py [--duration 30] [--start peer|paper] [--seed 1]
    python benches/body/gtsam_peer.py --markdown [--part beside|paired|soft]

With `--markdown` tables for docs/measured.md, in some 25 minutes: the peer's search runs from its own start only, since
from the paper's it takes minutes (136 iterations over 30 s).
Needs gtsam and the peer's scripts: IMUFAST_PEERS, else ../shared/peers beside the project.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast import _core
from imufast.body import estimate_lower_body
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

FOLDER = Path(os.environ.get("IMUFAST_PEERS", Path(__file__).resolve().parents[3] / "shared" / "peers"))
sys.path.insert(0, str(FOLDER / "lower_body_gtsam"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import gtsam  # noqa: E402
import ourinit  # type: ignore[import-not-found]  # noqa: E402
import peer  # type: ignore[import-not-found]  # noqa: E402
import pylm  # type: ignore[import-not-found]  # noqa: E402
from measuring import one_core, refuse_debug_build, setting, table  # noqa: E402

Array = NDArray[np.float64]
Sim, SEG, JOINTS, NOM = peer.Sim, peer.SEG, peer.JOINTS, peer.NOM


def model(noise: dict[str, Any], tail: float = np.inf, center: float = np.inf) -> tuple[Any, ...]:
    """Joints, bones, angles, differences and noise of the peer's graph, as our core takes them."""
    number = {name: k for k, (name, _, _) in enumerate(JOINTS)}
    joints = [(a, b, list(noise[name[1:]]), noise["hinge"] if name.endswith("knee") else None, None) for name, a, b in JOINTS]
    bones, angles = [], []
    for side in "rl":
        for k, (segment, upper, lower, bone) in enumerate(
            ((f"{side}thigh", f"{side}hip", f"{side}knee", "femur"), (f"{side}shank", f"{side}knee", f"{side}ankle", "tibia"))
        ):
            mean, std, low, high = peer.LEN[bone]
            bones.append(((number[upper], 1), (number[lower], 0), (mean, std), (low, high)))
            mu, sigma = peer.MU[segment]
            angles.append(((number[f"{side}knee"], k), len(bones) - 1, mu, sigma))
    mean, std, low, high = peer.LEN["hip"]
    bones.append(((number["rhip"], 0), (number["lhip"], 0), (mean, std), (low, high)))
    differences = [(0, 2, noise["disc_f"]), (1, 3, noise["disc_t"])]
    values = [noise[k] for k in ("gyr", "acc", "integ", "grw", "arw", "angvel", "bg0", "ba0")]
    return joints, bones, angles, differences, [*values, center, 1e-3, tail]


def as_the_peer_integrates(S: Any, gyr: Array, acc: Array) -> tuple[Array, Array]:
    """Rates and forces (7, N, 3) of which our exact increments are the peer's: then both minimise the same function.

    From one moment to the next the peer adds up rotation vectors, `theta += Jr(theta)^-1 w dt` (GTSAM's tangent preintegration,
    1e-4 rad off over a tenth of a second at 450 deg/s), and turns forces to the beginning of a step, we to its middle."""
    moved, count = gyr.copy(), gyr.shape[1]
    for first in range(0, count - 1, S.kf):
        theta = np.zeros((len(gyr), 3))
        for n in range(first, min(first + S.kf, count)):
            after = theta + np.einsum("sij,sj->si", inverse_right_jacobian(theta), gyr[:, n]) * S.dt
            moved[:, n] = (Rotation.from_rotvec(theta).inv() * Rotation.from_rotvec(after)).as_rotvec() / S.dt
            theta = after
    back = Rotation.from_rotvec((-0.5 * S.dt * moved).reshape(-1, 3))
    return moved, back.apply(acc.reshape(-1, 3)).reshape(acc.shape)


def inverse_right_jacobian(theta: Array) -> Array:
    """(S, 3, 3) of rotation vectors (S, 3)."""
    angle = np.linalg.norm(theta, axis=1)[:, None, None]
    x, y, z = theta.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    safe = np.maximum(angle, 1e-4)
    second = np.where(angle > 1e-4, 1.0 / safe**2 - (1.0 + np.cos(safe)) / (2.0 * safe * np.sin(safe)), 1.0 / 12.0)
    return np.asarray(np.eye(3) + 0.5 * cross + second * (cross @ cross))


def problem(S: Any, noise: dict[str, Any], count: int, **more: float) -> Any:
    """Ours, of the peer's increments."""
    n = (count - 1) * S.kf + 1
    gyr, acc = as_the_peer_integrates(S, *(np.stack([x[g][:n] for g in SEG]) for x in (S.gyr, S.acc)))
    time_s = np.arange(n) * S.dt
    joints, bones, angles, differences, values = model(noise, **more)
    return _core.BodyProblem(
        time_s,
        np.ascontiguousarray(gyr),
        np.ascontiguousarray(acc),
        S.rate,
        True,
        (S.kf, 1, 0.1),
        np.zeros((7, 2, 3)),
        joints,
        bones,
        angles,
        differences,
        values,
        9.81,
        [],
    )


def solve(S: Any, body: Any, start: dict[str, Any], descent: tuple[int, float, float]) -> Any:
    """From a start in the peer's terms."""
    count = len(body.samples)
    q = np.stack([Rotation.from_matrix(np.asarray(R)[:count]).as_quat(scalar_first=True) for R in start["R"]], axis=1)
    zeros = np.zeros((count, 7, 3))
    velocity = zeros if start.get("v") is None else np.stack([v[:count] for v in start["v"]], axis=1)
    position = zeros if start.get("p") is None else np.stack([p[:count] for p in start["p"]], axis=1)
    gyr_bias = zeros if start.get("bg") is None else np.tile(np.stack(start["bg"]), (count, 1, 1))
    centers = np.stack([[start["s"][SEG[a], name], start["s"][SEG[b], name]] for name, a, b in JOINTS])
    unused = np.array([1.0, 0.0, 0.0])
    axes = np.stack([[start["r"].get(SEG[a], unused), start["r"].get(SEG[b], unused)] for name, a, b in JOINTS])
    arrays = [np.ascontiguousarray(x, dtype=np.float64) for x in (q, velocity, position, gyr_bias, zeros, centers, axes)]
    return body.minimise(*arrays, np.zeros((0, 2, 3)), np.zeros((count, 0, 1)), descent, False)


def into_graph(P: Any, S: Any, body: Any, fit: Any) -> Any:
    """Our solution as the peer's values: turned and moved to the peer's gauge, with the best angular rates."""
    nz = P.nz
    R = Rotation.from_quat(fit.q.reshape(-1, 4), scalar_first=True).as_matrix().reshape(*fit.q.shape[:2], 3, 3)
    ahead = R[0, 0] @ (NOM["pelvis"].T @ np.array([0.0, 1.0, 0.0]))
    turn = np.pi / 2 - np.arctan2(ahead[1], ahead[0])
    Z = np.array([[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    t = np.arange(len(R))[:, None, None] * S.kf * S.dt
    R = Z @ R
    # A constant velocity is as free as a place.
    v0 = fit.velocity[0, 0]
    v = (fit.velocity - v0) @ Z.T
    p = (fit.position - fit.position[0, 0] - v0 * t) @ Z.T
    w = np.stack([P.wmeas[i] for i in range(7)], axis=1)[: len(R)] - fit.gyr_bias
    for j, (name, a, b) in enumerate(JOINTS):
        if name.endswith("knee"):
            w[:, [a, b]] = best_rates(R[:, a], R[:, b], w[:, a], w[:, b], fit.axes[j], nz["angvel"], nz["hinge"])
    val = gtsam.Values()
    for i in range(7):
        for k in range(len(R)):
            val.insert(peer.X(i, k), gtsam.Pose3(gtsam.Rot3(R[k, i]), p[k, i]))
            val.insert(peer.V(i, k), v[k, i])
            val.insert(peer.B(i, k), gtsam.imuBias.ConstantBias(fit.acc_bias[k, i], fit.gyr_bias[k, i]))
            val.insert(peer.W(i, k), w[k, i])
    for j, (name, a, b) in enumerate(JOINTS):
        for side, i in enumerate((a, b)):
            val.insert(peer.SV(SEG[i], name), fit.centers[j, side])
            if name.endswith("knee"):
                val.insert(peer.RV(SEG[i]), gtsam.Unit3(fit.axes[j, side]))
    return val


def best_rates(Ra: Array, Rb: Array, wa: Array, wb: Array, axes: Array, rate_std: float, hinge_std: float) -> Array:
    """The angular rates that eqs 4 and 9 like best: a linear least-squares problem of six unknowns a moment."""
    out = np.empty((len(Ra), 2, 3))
    Pa, Pb = (np.eye(3) - np.outer(r, r) for r in axes)
    for k in range(len(Ra)):
        ab = Ra[k].T @ Rb[k]
        J = np.block([[-Pa, Pa @ ab], [Pb @ ab.T, -Pb]]) / hinge_std
        A = np.vstack([J, np.eye(6) / rate_std])
        y = np.concatenate([np.zeros(6), wa[k] / rate_std, wb[k] / rate_std])
        out[k] = np.linalg.lstsq(A, y, rcond=None)[0].reshape(2, 3)
    return out


def starts(S: Any, kind: str) -> tuple[dict[str, Any], float]:
    """The peer's fullest start, or the paper's (R = I and zeros), and the time it takes."""
    t = time.perf_counter()
    s, r = peer.nominal()
    if kind == "paper":
        eye = np.tile(np.eye(3), (S.K, 1, 1))
        return {"R": [eye] * 7, "s": s, "r": r, "bg": None}, 0.0
    R, bg = ourinit.orient(S)
    R = ourinit.head_nominal(R)
    r = ourinit.knee_axis(S, bg, r)
    R = ourinit.head_knee(R, r)
    s = ourinit.lever(S, bg, s)
    R, _ = ourinit.head_joint(S, R, s, bg, joints=("rhip", "lhip", "rankle", "lankle"))
    R = ourinit.head_knee(R, r)
    p, v = ourinit.positions(S, R, s)
    pp, vv = ourinit.pelvis_pos(S, R, bg)
    start = {"R": R, "p": [x + pp for x in p], "v": [x + vv for x in v], "s": s, "r": r, "bg": bg}
    return start, time.perf_counter() - t


NAMES = {"pelvis": "pelvis"} | {
    f"{segment}_{side}": f"{side[0]}{segment}" for side in ("right", "left") for segment in ("thigh", "shank", "foot")
}


def estimated(S: Any) -> tuple[Any, float, float]:
    """`estimate_lower_body` on the same data, from raw samples, with our own defaults; and its time, wall and processor."""
    time_s = (np.arange(S.N) + 0.5) * S.dt
    recording = imufast.Recording({g: imufast.Imu(S.gyr[g], S.acc[g], time_s=time_s, name=g) for g in SEG})
    t, cpu = time.perf_counter(), time.process_time()
    body = estimate_lower_body(recording, NAMES)
    return body, time.perf_counter() - t, time.process_time() - cpu


def knee_errors(S: Any, body: Any) -> dict[str, Array]:
    """Flexion minus truth, degrees."""
    _, R, _, _, _ = S.fk(body.time_s)
    truth = {side: peer.grood_suntay(R[f"{side[0]}thigh"], R[f"{side[0]}shank"])[0] for side in ("right", "left")}
    return {side: -body.knee_angles_deg[side][:, 0] - np.degrees(angle) for side, angle in truth.items()}


def whole(S: Any) -> None:
    """Our own defaults, in words."""
    body, took, cpu = estimated(S)
    print(f"ours whole, own defaults: {body.status} in {body.iterations} iterations, {took:.2f} s ({cpu:.2f} s of processor)")
    for side, off in knee_errors(S, body).items():
        inside = np.mean(np.abs(off) < 1.645 * body.knee_std_deg[side][:, 0])
        drift = body.joints[f"hip_{side}"].heading_std_deg
        print(
            f"   knee {side}: flexion RMSE {np.sqrt(np.mean(off**2)):.2f} deg, without offset {off.std():.2f}, stated "
            f"{np.median(body.knee_std_deg[side][:, 0]):.2f}, 90 % band holds {100 * inside:.0f} %; hip heading std "
            f"{np.median(drift):.2f}"
        )
    for segment, axis in body.knee_axis.items():
        print(f"   axis {segment}: {np.degrees(np.arccos(np.clip(axis @ S.r_true[NAMES[segment]], -1, 1))):.2f} deg off")


def scores(P: Any, val: Any) -> list[str]:
    """As the peer scores: knees, joint vectors, axes, heading of one sensor of a joint against the other."""
    m = peer.evaluate(P, P.read(val), verbose=False)
    drift = max(abs(mean) + std for mean, std in m["rel_head"].values())
    return [
        " / ".join(f"{m['knee_robust'][side]:.2f}" for side in "rl"),
        f"{max(m['s_err'].values()):.2f}",
        f"{max(m['axis_signless'].values()):.2f}",
        f"{drift:.2f}",
    ]


def searched(S: Any, peer_seconds: float) -> tuple[Any, Any, Any, float, float]:
    """The peer's search from its own start: problem, end, loop, and the time of the search and of all, s."""
    began = time.perf_counter()
    start, _ = starts(S, "peer")
    P = peer.Problem(S, peer.MATCHED)
    values = P.values(R=start["R"], p=start["p"], v=start["v"], bg=start["bg"], s=start["s"], r=start["r"])
    t = time.perf_counter()
    loop = pylm.PyLM(P.graph, values)
    found = loop.run(values, rel=1e-4, tmax=peer_seconds, verbose=False)
    return P, found, loop, time.perf_counter() - t, time.perf_counter() - began


def to_its_end(P: Any, values: Any, seconds: float) -> tuple[Any, Any]:
    """The peer's own loop from some values on, until it no longer falls by a part in 1e8: where it ends, and the loop."""
    loop = pylm.PyLM(P.graph, values)
    return loop.run(values, rel=1e-8, tmax=seconds, verbose=False), loop


PAIRED_S = 200.0
"""On some seeds the peer's search creeps for longer than this, s, and is stopped."""


WHO = ("peer", "imufast", "peer, from our solution to its end")


def paired(peer_seconds: float) -> None:
    """Both searches with the peer's noise from the peer's start, over five seeds, and where the peer's own minimum is."""
    rows: list[list[Any]] = []
    numbers = []
    most_s = min(peer_seconds, PAIRED_S)
    for seed in range(1, 6):
        S = Sim(90.0, seed=seed)
        P, found, _, took, _ = searched(S, most_s)
        body = problem(S, peer.MATCHED, S.K)
        val = into_graph(P, S, body, solve(S, body, starts(S, "peer")[0], (200, 1e-3, 1e-3)))
        least, _ = to_its_end(P, val, most_s)
        ours, theirs = P.graph.error(val), P.graph.error(found)
        ended = "" if took < most_s else " (not ended)"
        for who, end, cost in (
            (WHO[0], found, f"{theirs:.2f}{ended}"),
            (WHO[1], val, f"{100.0 * (ours / theirs - 1.0):+.2f} %"),
            (WHO[2], least, f"{100.0 * (P.graph.error(least) / theirs - 1.0):+.2f} %"),
        ):
            cells = scores(P, end)
            rows.append([f"seed {seed}, {who}", cost, *cells])
            numbers.append([float(x) for cell in cells for x in cell.split(" / ")])
    both = np.array(numbers).reshape(5, len(WHO), -1)
    for k, who in enumerate(WHO):
        mean, off = both[:, k].mean(axis=0), both[:, k].std(axis=0, ddof=1) / np.sqrt(5.0)
        cells = [f"{m:.2f} ± {o:.2f}" for m, o in zip(mean, off, strict=True)]
        rows.append([f"mean, {who}", None, " / ".join(cells[:2]), *cells[2:]])
    print(
        f"Both over five seeds, 90 s, from the peer's start, {most_s:.0f} s at most; the means with their standard errors. "
        "By its rule (a step that gains less than one part in ten thousand of the cost) the peer stops short of its minimum; "
        "where that is, its own loop shows from our solution on: by that row the peer's model is judged\n"
    )
    heads = ("90 s", "cost, and against the peer's", "knees, °", "joint vectors, cm", "axes, °", "heading, °")
    print(table(heads, rows, markdown=True), flush=True)


def farther(P: Any, values: Any, loop: Any, name: str, theirs: float) -> list[Any]:
    """A row on where the peer's loop came to, beside where its search ended."""
    cost, seconds = P.graph.error(values), loop.st["wall"]
    row = [name, loop.st["iters"], f"{seconds:.1f}", None, f"{cost:.2f}", f"{100.0 * (cost / theirs - 1.0):+.2f} %"]
    return [*row, *scores(P, values)]


def beside(peer_seconds: float) -> None:
    """Both searches beside each other, then our own defaults."""
    rows = []
    for duration in (30.0, 90.0):
        S = Sim(duration, seed=1)
        P, found, loop, took, every = searched(S, peer_seconds)
        theirs = P.graph.error(found)
        theirs_row = [
            f"{duration:.0f} s, peer",
            loop.st["iters"],
            f"{took:.1f}",
            f"{every:.1f}",
            f"{theirs:.2f}",
        ]
        rows.append([*theirs_row, None, *scores(P, found)])
        on, loop = to_its_end(P, found, min(peer_seconds, PAIRED_S))
        rows.append(farther(P, on, loop, f"{duration:.0f} s, peer, on from there", theirs))
        for kind in ("peer", "paper"):
            begin, seconds = starts(S, kind)
            t = time.perf_counter()
            body = problem(S, peer.MATCHED, S.K)
            made = time.perf_counter() - t
            t = time.perf_counter()
            fit = solve(S, body, begin, (200, 1e-3, 1.0 if kind == "paper" else 1e-3))
            took = time.perf_counter() - t
            val = into_graph(P, S, body, fit)
            cost = P.graph.error(val)
            name = f"{duration:.0f} s, imufast from the {kind}'s start"
            ours = [name, len(fit.trials), f"{took:.2f}", f"{seconds + made + took:.1f}", f"{cost:.2f}"]
            rows.append([*ours, f"{100.0 * (cost / theirs - 1.0):+.2f} %", *scores(P, val)])
            if kind == "peer":
                least, loop = to_its_end(P, val, min(peer_seconds, PAIRED_S))
                rows.append(farther(P, least, loop, f"{duration:.0f} s, {WHO[2]}", theirs))
        whole_body, wall, _ = estimated(S)
        off = " / ".join(f"{np.sqrt(np.mean(e**2)):.2f}" for e in knee_errors(S, whole_body).values())
        axes = [np.degrees(np.arccos(np.clip(a @ S.r_true[NAMES[k]], -1, 1))) for k, a in whole_body.knee_axis.items()]
        own = [f"{duration:.0f} s, imufast, own defaults", whole_body.iterations, None, f"{wall:.1f}", None, None, off, None]
        rows.append([*own, f"{max(axes):.2f}", None])
    head = ("seed 1", "iterations", "search, s", "all, s", "cost in the peer's graph", "against the peer's")
    scored = ("knees, °", "joint vectors, cm", "axes, °", "heading, °")
    print("Simulated with the peer's noise; errors: knee flexion RMSE right / left, the largest of the others\n")
    print(table((*head, *scored), rows, markdown=True), flush=True)


def soft(_: float) -> None:
    """Our own defaults under soft tissue."""
    print("Soft tissue, 3°/rad and 1 cm/rad, 90 s (`--sta 1`), own defaults; a knee tracked without any error scores 0.5°\n")
    rows = []
    for seed in range(1, 6):
        S = Sim(90.0, seed=seed, sta=1.0)
        found, wall, _ = estimated(S)
        for side, error in knee_errors(S, found).items():
            std = found.knee_std_deg[side][:, 0]
            held = 100 * np.mean(np.abs(error) < 1.645 * std)
            rmse, spread = np.sqrt(np.mean(error**2)), error.std()
            cells = [f"{rmse:.2f}", f"{spread:.2f}", f"{np.median(std):.2f}", f"{held:.0f} %", found.iterations, f"{wall:.1f}"]
            rows.append([f"seed {seed}, {side}", *cells])
    heads = ("knee", "flexion RMSE, °", "without offset, °", "stated, °", "90 % band holds", "iterations", "s")
    print(table(heads, rows, markdown=True), flush=True)


PARTS = {"beside": beside, "paired": paired, "soft": soft}
"""What `--markdown` prints, one after the other."""


def main() -> None:
    ask = argparse.ArgumentParser()
    ask.add_argument("--duration", type=float, default=30.0)
    ask.add_argument("--start", choices=("peer", "paper"), default="peer")
    ask.add_argument("--seed", type=int, default=1)
    ask.add_argument("--sta", type=float, default=0.0)
    ask.add_argument("--ours-only", action="store_true")
    ask.add_argument("--peer-seconds", type=float, default=400.0)
    ask.add_argument("--tail", type=float, default=np.inf)
    ask.add_argument("--markdown", action="store_true", help="print tables for docs/measured.md")
    ask.add_argument("--part", choices=PARTS, help="one of these tables only")
    asked = ask.parse_args()
    refuse_debug_build()
    print(setting(), end="\n\n" if asked.markdown else "\n")
    if asked.markdown:
        for name in PARTS if asked.part is None else (asked.part,):
            PARTS[name](asked.peer_seconds)
            print(flush=True)
        return
    S = Sim(asked.duration, seed=asked.seed, sta=asked.sta)
    whole(S)
    start, seconds = starts(S, asked.start)
    print(f"start {asked.start}: {seconds:.2f} s")
    t = time.perf_counter()
    body = problem(S, peer.MATCHED, S.K, tail=asked.tail)
    made = time.perf_counter() - t
    t = time.perf_counter()
    # From far away steps are held to their usual size; from near they need no holding.
    fit = solve(S, body, start, (200, 1e-3, 1.0 if asked.start == "paper" else 1e-3))
    took = time.perf_counter() - t
    trials = fit.trials
    print(
        f"ours: {fit.status} cost {fit.cost:.6g} in {len(trials)} iterations ({int(trials[:, 4].sum())} taken), "
        f"{made:.2f} s preintegration as the peer does it, {took:.2f} s search, {took / len(trials):.3f} s an iteration"
    )
    for row in trials[:60]:
        cost, tried, promised, damping, taken = row
        print(f"   cost {cost:.7g} tried {tried:.7g} promised {promised:.3g} damping {damping:.1e} taken {taken:.0f}")
    t = time.perf_counter()
    # Increments made without bias, as ours are: one graph for both starts.
    P = peer.Problem(S, peer.MATCHED)
    built = time.perf_counter() - t
    val = into_graph(P, S, body, fit)
    print(f"our solution in the peer's graph: {P.graph.error(val):.6g}")
    # What is left between both minima is of second order in the biases: 1e-5 rad over a tenth of a second at 2 deg/s.
    step = pylm.PyLM(P.graph, val).run(val, maxit=1, verbose=False)
    print(f"   ...after one step of the peer's loop: {P.graph.error(step):.6g}")
    peer.evaluate(P, P.read(val), "ours")
    if asked.ours_only:
        return
    values = P.values(R=start["R"], p=start.get("p"), v=start.get("v"), bg=start["bg"], s=start["s"], r=start["r"])
    t = time.perf_counter()
    loop = pylm.PyLM(P.graph, values)
    found = loop.run(values, rel=1e-4, tmax=asked.peer_seconds)
    print(f"peer: {P.graph.error(found):.6g}, build {built:.1f} s, search {time.perf_counter() - t:.1f} s")
    ours, theirs = P.graph.error(val), P.graph.error(found)
    print(f"our solution costs {100.0 * (ours / theirs - 1.0):+.2f} % of the peer's, both in the peer's graph")
    peer.evaluate(P, P.read(found), "peer")


if __name__ == "__main__":
    one_core()
    main()
