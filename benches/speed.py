"""How fast the hinge axis and the joint centre are found: beside peers on the same arrays in one run, and against what the
hardware could do.

    python benches/speed.py [--markdown] [--rounds 15] [--part axis|center]

Simulated recordings, 50 Hz; for the centre a real one, too. Targets of the axis: 100 times faster than qmt at 1 000 samples, 60
times at 15 000. Targets of the centre: SS as published 5 times faster than dfjimu, the default no more than 3 times its time.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

import imufast
import numpy as np
from imufast import _core
from measuring import (
    Array,
    data_folder,
    dfjimu_center,
    imus,
    interleaved,
    one_core,
    qmt_hinge,
    refuse_debug_build,
    seconds,
    setting,
    table,
)

RATE_HZ = 50.0
TARGETS = {1_000: 100, 15_000: 60}
# One sample in one Gauss-Newton iteration, gyroscope part of eqs 24 and 36-39: six numbers come in; two cross products
# and their lengths, four Jacobian entries, and the sums of the gradient and of the ten entries of JᵀJ are made.
FLOPS, ROOTS, DIVISIONS, BYTES = 80, 2, 2, 48

CENTER_SAMPLES, CENTER_FILE = 15_000, "3D_04"


def fastest(call: Callable[[], object], tries: int = 15) -> float:
    """Least time of one call, s: what the hardware can do, without what disturbs it."""
    return min(seconds(call, 0.002) for _ in range(tries))


def floor_ns() -> dict[str, float]:
    """What one sample and iteration costs at least on this core, ns, by kind of work, as numpy's own kernels measure it."""
    side, few, many = 384, 16_384, 8_000_000
    rng = np.random.default_rng(0)
    square, product = rng.random((side, side)), np.empty((side, side))
    x, ones = rng.random(few) + 1.0, np.ones(few)
    stream = rng.random(many)
    flop = fastest(lambda: np.matmul(square, square, out=product)) / (2.0 * side**3)
    root = fastest(lambda: np.sqrt(x, out=x)) / few
    division = fastest(lambda: np.divide(x, ones, out=x)) / few
    byte = fastest(lambda: stream.max(), 5) / (8.0 * many)
    return {
        f"{FLOPS} flops": 1e9 * FLOPS * flop,
        f"{ROOTS} square roots and {DIVISIONS} divisions": 1e9 * (ROOTS * root + DIVISIONS * division),
        f"{BYTES} bytes from memory": 1e9 * BYTES * byte,
    }


def arrays_of(samples: int) -> list[Array]:
    """gyr1, acc1, gyr2, acc2 of a simulated recording of a hinge."""
    s = imufast.simulate_hinge(duration_s=samples / RATE_HZ, rate_hz=RATE_HZ, seed=1, **imufast.random_biases(1))
    return [np.ascontiguousarray(a[:samples]) for a in (s.gyr1, s.acc1, s.gyr2, s.acc2)]


def measure(samples: int, rounds: int, floor: float) -> tuple[list[str | None], list[str]]:
    """The rows of one recording in both tables."""
    arrays, qmt = arrays_of(samples), qmt_hinge()
    gyr1, acc1, gyr2, acc2 = arrays
    time_s = np.arange(samples) / RATE_HZ
    pair = imus(RATE_HZ, *arrays)
    axis = imufast.estimate_hinge_axis(*pair)
    calls: list[Callable[[], object]] = [
        lambda: imufast.estimate_hinge_axis(*pair),
        lambda: imufast.estimate_hinge_axis(*imus(RATE_HZ, *arrays)),
        lambda: _core.hinge_axis(gyr1, acc1, gyr2, acc2, time_s, None, None, 50.0, None, 100),
    ]
    if qmt is not None:
        calls.append(lambda: qmt(*arrays))
    times = np.array(interleaved(calls, rounds))
    call_s, checked_s, core_s, *peer_s = np.median(times, axis=0).tolist()
    each_ns = 1e9 * core_s / (samples * axis.iterations)
    beside: list[str | None] = [str(samples), f"{1e3 * call_s:.3f}", f"{1e3 * checked_s:.3f}"]
    if peer_s:
        ratio, with_checks = (np.median(times[:, 3] / times[:, k]) for k in (0, 1))
        beside += [f"{1e3 * peer_s[0]:.1f}", f"{ratio:.0f}", f"{with_checks:.0f}"]
    else:
        beside += [None, None, None]
    beside.append(f"≥ {TARGETS[samples]}")
    against = [str(samples), f"{1e6 * core_s:.0f}", str(axis.iterations)]
    return beside, [*against, f"{each_ns:.1f}", f"{floor:.1f}", f"{each_ns / floor:.1f}"]


CENTER_HEADINGS = ("recording", "samples", "method", "iterations", "imufast, ms", "dfjimu, ms", "times faster", "target")


def center_arrays() -> list[tuple[str, list[Array]]]:
    """gyr1, acc1, gyr2, acc2 at 50 Hz: simulated, and of a real joint."""
    s = imufast.simulate_ball_joint(
        duration_s=CENTER_SAMPLES / RATE_HZ, rate_hz=RATE_HZ, seed=1, **imufast.random_biases(1, gyr_rad_s=0.005, acc_m_s2=0.1)
    )
    found = [("simulated", [np.ascontiguousarray(a[:CENTER_SAMPLES]) for a in (s.gyr1, s.acc1, s.gyr2, s.acc2)])]
    try:
        path = data_folder() / "two_imu_joint" / f"{CENTER_FILE}.npz"
        with np.load(path) as z:
            arrays = [np.ascontiguousarray(z[name], np.float64) for name in ("gyr1", "acc1", "gyr2", "acc2")]
    except (SystemExit, FileNotFoundError) as error:
        print(f"The real recording is missing, its rows too: {error}", file=sys.stderr)
        return found
    times = -(-CENTER_SAMPLES // len(arrays[0]))  # again from the start where it is too short
    return [*found, (CENTER_FILE, [np.ascontiguousarray(np.tile(a, (times, 1))[:CENTER_SAMPLES]) for a in arrays])]


def center_rows(rounds: int) -> list[list[str | None]]:
    """SS and SA, as published and by default, beside dfjimu in the same rounds; ours from two Imus, no checks."""
    peer = dfjimu_center()
    published = imufast.CenterSettings.as_published()
    choices: list[tuple[str, str, dict[str, Any], str | None]] = [
        ("SS as published", "ss", {"settings": published}, "≥ 5 times faster"),
        ("SA as published", "sa", {"settings": published}, None),
        ("SS default", "ss", {}, None),
        ("SA default", "sa", {}, "≥ 0.33 times"),
    ]
    rows: list[list[str | None]] = []
    for name, arrays in center_arrays():
        pair = imus(RATE_HZ, *arrays)
        calls: list[Callable[[], object]] = [
            lambda method=method, keywords=keywords, pair=pair: imufast.estimate_joint_center(*pair, method, **keywords)  # type: ignore[misc]
            for _, method, keywords, _ in choices
        ]
        iterations = [
            str(imufast.estimate_joint_center(*pair, method, **keywords).iterations) for _, method, keywords, _ in choices
        ]
        if peer is not None:
            gyr1, acc1, gyr2, acc2 = arrays
            calls.append(lambda a=gyr1, b=acc1, c=gyr2, d=acc2: peer(a, b, c, d, RATE_HZ))  # type: ignore[misc]
        times = np.array(interleaved(calls, rounds))
        for k, (title, _, _, target) in enumerate(choices):
            ours_ms = f"{1e3 * np.median(times[:, k]):.2f}"
            beside: list[str | None] = [None, None]
            if peer is not None:
                beside = [f"{1e3 * np.median(times[:, -1]):.2f}", f"{np.median(times[:, -1] / times[:, k]):.2f}"]
            rows.append([name, str(CENTER_SAMPLES), title, iterations[k], ours_ms, *beside, target])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs/measured.md")
    parser.add_argument("--rounds", type=int, default=15, help="interleaved rounds of timed runs; default 15")
    parser.add_argument("--part", choices=("axis", "center"), help="one part only")
    chosen = parser.parse_args()
    refuse_debug_build()
    one_core()
    rounds, gap = max(1, chosen.rounds), "\n\n" if chosen.markdown else "\n"
    print(setting(), end="\n\n")
    if chosen.part in (None, "axis"):
        axis(rounds, gap, markdown=chosen.markdown)
    if chosen.part in (None, "center"):
        print("Joint centre from all samples: ours from two Imus, dfjimu's from arrays; both with derivatives", end=gap)
        print(table(CENTER_HEADINGS, center_rows(rounds), markdown=chosen.markdown))


def axis(rounds: int, gap: str, *, markdown: bool) -> None:
    """The tables of the hinge axis."""
    work = floor_ns()
    # Different units of the core do these at the same time: the slowest counts.
    least = max(work.values())
    beside, against = zip(*(measure(samples, rounds, least) for samples in TARGETS), strict=True)
    print("Hinge axis from all samples; ours from two Imus, and from arrays with all checks of the input", end=gap)
    headings = ("samples", "imufast, ms", "with checks, ms", "qmt, ms", "times faster", "with checks", "target")
    print(table(headings, beside, markdown=markdown), end="\n\n")
    print("The floor of one sample in one Gauss-Newton iteration on this core: the largest of these", end=gap)
    print(table(("work", "ns"), [[k, f"{v:.2f}"] for k, v in work.items()], markdown=markdown), end="\n\n")
    print("The core alone, all that it does (starts, Gram matrix, descents, covariance), against that floor", end=gap)
    floor_headings = ("samples", "µs", "iterations", "ns a sample and iteration", "floor, ns", "times the floor")
    print(table(floor_headings, against, markdown=markdown), end="\n\n")


if __name__ == "__main__":
    main()
