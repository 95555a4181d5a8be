"""What streaming costs: pruning beside the paper's literal loop, an hour of recording, ingest, a week, one sample from Python.

    python benches/stream.py [--markdown] [--part pruning|hour|ingest|week|sample] [--whole]

All on simulated recordings, default settings but where said. `--whole` runs the literal loop of Algorithm 3 to its end (about
a minute) instead of timing some of its removals at several sizes and adding up. The rest takes two to four minutes. Times are
CPU times of the one thread that does it all, but for `push` of one sample, which is wall time.
"""

from __future__ import annotations

import argparse
import resource
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import imufast
import numpy as np
from imufast import _core
from measuring import Array, one_core, refuse_debug_build, setting, table
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent / "papers" / "olsson2020"))

import literal

RATE_HZ = 100.0
CHUNK = int(RATE_HZ)
EVERYTHING = 1e9
"""Energy threshold that passes over no sample, rad²/s²: all rows go into pruning."""
Rows = list[list[str | None]]
Blocks = tuple[Array, Array, Array, Array]


def recording(duration_s: float, kind: str = "mixed", dof: int = 1, rate_hz: float = RATE_HZ) -> Blocks:
    """gyr1, acc1, gyr2, acc2 of a simulated joint; long ones repeat ten minutes of motion with fresh noise."""
    part_s = min(duration_s, 600.0)
    motion = imufast.simulate_hinge(
        kind,
        duration_s=part_s,
        rate_hz=rate_hz,
        seed=1,
        dof=3 if dof == 3 else 1,
        gyr_noise=0.0,
        acc_noise=0.0,
        **imufast.random_biases(1, gyr_rad_s=0.005, acc_m_s2=0.1),
    )
    rng, times = np.random.default_rng(1), round(duration_s / part_s)
    signals = [np.tile(a, (times, 1)) for a in (motion.gyr1, motion.acc1, motion.gyr2, motion.acc2)]
    noisy = [a + std * rng.standard_normal(a.shape) for a, std in zip(signals, (0.005, 0.05, 0.005, 0.05), strict=True)]
    return noisy[0], noisy[1], noisy[2], noisy[3]


def imus(blocks: Blocks, rate_hz: float = RATE_HZ) -> tuple[imufast.Imu, imufast.Imu]:
    return (
        imufast.Imu(blocks[0], blocks[1], rate_hz=rate_hz, name="1"),
        imufast.Imu(blocks[2], blocks[3], rate_hz=rate_hz, name="2"),
    )


def spent(call: Callable[[], object]) -> float:
    """CPU time of a call, s: all runs in one thread, and other work on the machine disturbs it less than wall time."""
    started = time.process_time()
    call()
    return time.process_time() - started


def medians(call: Callable[[], object], rounds: int) -> float:
    return statistics.median(spent(call) for _ in range(rounds))


def svd_loop_s(rows: Array, score: Array, left: int) -> float:
    """What the literal loop takes from all rows down to `left`, s: 5 removals timed at each of 24 sizes, integrated."""
    sizes = np.linspace(left + 5, len(rows), 24).astype(int)
    each = [spent(lambda size=size: literal.prune_by_svd(rows[:size], score[:size], size - 5)) / 5 for size in sizes]  # type: ignore[misc]
    return float(np.sum(np.diff(sizes) * 0.5 * np.add(each[1:], each[:-1])))


def pruning(whole: bool) -> Rows:
    """Algorithm 3 from 35 000 samples to 1 000 (and from 4 000, where the literal loop always runs to its end)."""
    table_rows: Rows = []
    for total, full in ((4_000, True), (35_000, whole)):
        part_s = total / 50.0 / 14  # the paper's 14 motions
        scene = imufast.simulate_hinge(range(1, 15), duration_s=part_s, transition_s=0.0, rate_hz=50.0, seed=1)
        gyr1, acc1, gyr2, acc2 = scene.gyr1, scene.acc1, scene.gyr2, scene.acc2
        grid = np.arange(len(gyr1)) / 50.0

        def ours(
            a: Blocks = (gyr1, acc1, gyr2, acc2), t: Array = grid
        ) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
            return _core.select_samples(*a, t, 50.0, 1000, 0.42, EVERYTHING)

        ours_s = medians(ours, 5)
        _, chosen, _, score = ours()
        known = np.flatnonzero(np.isfinite(score))
        rows = np.hstack([acc1, -acc2])[known]
        if full:
            started = time.process_time()
            kept = literal.prune_by_svd(rows, score[known], 1000)
            literal_s, how = time.process_time() - started, "one SVD a removal, run to the end"
        else:
            kept = literal.prune(rows, score[known], 1000)
            literal_s, how = svd_loop_s(rows, score[known], 1000), "added up; choice checked by plain downdates"
        same = "identical" if np.array_equal(known[kept], chosen) else "DIFFERENT"
        ratio = f"{literal_s / ours_s:.0f}"
        table_rows.append(
            [f"pruning {total} → 1000 ({how})", f"{1e3 * ours_s:.1f} ms", f"{literal_s:.1f} s", ratio, same, "≥ 100 times"]
        )
    return table_rows


def hour() -> Rows:
    """calibrate_hinge on an hour at 100 Hz."""
    rows: Rows = []
    for what, dof, target in (("hinge, accepted early", 1, "≤ 0.3 s"), ("3 degrees of freedom, never accepted", 3, "≤ 1.5 s")):
        pair = imus(recording(3600.0, dof=dof))
        result = imufast.calibrate_hinge(*pair)
        took = medians(lambda pair=pair: imufast.calibrate_hinge(*pair), 3)  # type: ignore[misc]
        said = f"{result.verdict}, accepted at {result.accepted_at_s} s" if result.accepted else str(result.verdict)
        rows.append(
            [f"an hour at 100 Hz: {what}", f"{took:.2f} s", f"{1e9 * took / len(pair[0]):.0f} ns a sample", said, target]
        )
    return rows


def chunks(blocks: Blocks, size: int) -> Iterator[Blocks]:
    a, b, c, d = blocks
    for start in range(0, len(a), size):
        part = slice(start, start + size)
        yield a[part], b[part], c[part], d[part]


def ingest() -> Rows:
    """One-second chunks with no estimate in between, and what the hardware could do."""
    rows: Rows = []
    for what, kind in (("mixed motion", "mixed"), ("at rest", "stationary")):
        pieces = list(chunks(recording(1800.0, kind), CHUNK))

        def feed(pieces: list[Blocks] = pieces) -> None:
            stream = imufast.HingeCalibrator(RATE_HZ, step_s=1e6)
            for piece in pieces:
                stream.push(*piece)

        took = medians(feed, 5)
        samples = sum(len(piece[0]) for piece in pieces)
        rows.append(
            [
                f"ingest, {what}",
                f"{samples / took / 1e6:.1f} million/s",
                f"{1e9 * took / samples:.0f} ns a sample",
                None,
                "≥ 5 million/s",
            ]
        )
    stream_of = np.random.default_rng(0).random(8_000_000)
    byte_ns = 1e9 * min(spent(stream_of.max) for _ in range(5)) / (8.0 * len(stream_of))
    side = 384
    square, product = np.ones((side, side)), np.empty((side, side))
    flop_ns = 1e9 * min(spent(lambda: np.matmul(square, square, out=product)) for _ in range(20)) / (2.0 * side**3)
    taps = 2 * round(RATE_HZ / 4.0) + 1
    flops = 12 * 2 * taps + 250
    rows.append(
        [
            f"its floor: 96 bytes; {flops} flops (12 channels × {taps} taps, and 250 for scores, Gram matrix, rest)",
            None,
            f"{96 * byte_ns:.1f} and {flops * flop_ns:.1f} ns",
            None,
            None,
        ]
    )
    return rows


def week(hours: int) -> Rows:
    """A hinge for a week in one-second chunks, with estimates and decisions every second: eight hours of motion, no two of
    them alike, again and again (the same hour all week would fill the selection with copies of its most violent second)."""
    mounts = np.array([[1.0, 0.2, -0.3, 0.1], [0.5, -0.4, 0.2, 0.6]])
    mounts /= np.linalg.norm(mounts, axis=1, keepdims=True)
    biases = imufast.random_biases(1, gyr_rad_s=0.005, acc_m_s2=0.1)
    library = []
    for seed in range(min(8, hours)):
        s = imufast.simulate_hinge(duration_s=3600.0, rate_hz=RATE_HZ, seed=seed, mount1=mounts[0], mount2=mounts[1], **biases)
        library.append((s.gyr1, s.acc1, s.gyr2, s.acc2))
    stream = imufast.HingeCalibrator(RATE_HZ)
    marks, rows = {1, 2, 6, 12, 24, 48, 96, hours}, list[list[str | None]]()
    minute = list(chunks(library[0], CHUNK))[:60]
    minute_s = spent(lambda: [stream.push(*piece) for piece in minute])
    rows.append(["the first minute", f"{1e9 * minute_s / (60 * CHUNK):.0f} ns a sample", *memory(stream), None])
    costs = []
    for done in range(1, hours + 1):
        pieces = list(chunks(library[(done - 1) % len(library)], CHUNK))
        costs.append(1e9 * spent(lambda pieces=pieces: [stream.push(*piece) for piece in pieces]) / (3600 * CHUNK))  # type: ignore[misc]
        if done in marks:
            recent = statistics.median(costs[-12:])
            rows.append([f"hour {done} (median of the last 12)", f"{recent:.0f} ns a sample", *memory(stream), None])
    rows[-1][-1] = "constant, flat"
    result = stream.result()
    rows.append(["at the end", f"{result.verdict}, {'accepted' if result.accepted else 'not accepted'}", None, None, None])
    return rows


def memory(stream: imufast.HingeCalibrator) -> tuple[str, str]:
    """Most memory that the process ever had, and the length of the state."""
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return f"peak {peak_kb / 1024:.1f} MB", f"state {len(stream.state()) / 1024:.0f} kB"


def sample() -> Rows:
    """`push` of single samples, every call timed."""
    gyr1, acc1, gyr2, acc2 = recording(600.0)
    stream, clock = imufast.HingeCalibrator(RATE_HZ), time.perf_counter_ns
    rows = [(gyr1[k], acc1[k], gyr2[k], acc2[k]) for k in range(len(gyr1))]
    took = np.empty(len(rows))
    for k, (a, b, c, d) in enumerate(rows):
        started = clock()
        stream.push(a, b, c, d)
        took[k] = clock() - started
    bare = np.median([-clock() + clock() for _ in range(10_000)])
    late = took[len(took) // 2 :] - bare
    median, most, worst = (1e-3 * float(np.quantile(late, q)) for q in (0.5, 0.999, 1.0))
    return [
        ["push of one sample", f"{median:.2f} µs median", f"{most:.0f} µs 99.9 %", f"{worst:.0f} µs worst", "≤ 3 µs median"]
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print tables for docs/measured.md")
    parser.add_argument("--part", choices=("pruning", "hour", "ingest", "week", "sample"), help="one part only")
    parser.add_argument("--whole", action="store_true", help="run the literal pruning loop to its end")
    parser.add_argument("--hours", type=int, default=168, help="length of the simulated week; default 168")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    print(setting(), end="\n\n")
    parts: dict[str, tuple[tuple[str, ...], Callable[[], Rows]]] = {
        "pruning": (
            ("Algorithm 3", "imufast", "literal loop", "times faster", "choice", "target"),
            lambda: pruning(chosen.whole),
        ),
        "hour": (("calibrate_hinge", "time", "", "end", "target"), hour),
        "ingest": (("HingeCalibrator.push", "", "", "", "target"), ingest),
        "week": (
            ("a week at 100 Hz, an estimate a second", "cost", "memory", "", "target"),
            lambda: week(max(2, chosen.hours)),
        ),
        "sample": (("HingeCalibrator.push", "", "", "", "target"), sample),
    }
    failed = False
    for name, (headings, make) in parts.items():
        if chosen.part in (None, name):
            rows = make()
            print(table(headings, rows, markdown=chosen.markdown), end="\n\n", flush=True)
            failed = failed or any("DIFFERENT" in row for row in rows)
    if failed:
        raise SystemExit("pruning does not choose what the literal loop chooses")


if __name__ == "__main__":
    main()
