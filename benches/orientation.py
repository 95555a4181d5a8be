"""Relative orientation: how fast beside dfjimu. How far off, and how honest, says `orientation_errors.py`.

    python benches/orientation.py [--markdown] [--part speed|linear|update|hour] [--rounds 9]

Speed is that of a real recording (3D_04, 50 Hz), 15 000 samples, beside `dfjimu.mekf_acc` and `dfjimu.map_acc` (10
iterations) on the same arrays in the same rounds; lever arms and biases are known beforehand. Targets, times faster than
`mekf_acc`: the complementary filter 5, 15 with eight recordings side by side, the Kalman filter 2; the smoother at most 10
times as long as `map_acc`. `track` is the call from Python; "core" is what it calls, from arrays to arrays; "core, even" the
same without times. Times are the least CPU times of several rounds of 30 calls in a row,
for the smoother medians of wall times.

One sample moves 96 bytes in (12 numbers; 8 more with times) and 40 out (quaternion and std); the complementary filter
needs about 530 floating-point operations and 7 square roots or divisions, the Kalman filter 840 and 11, counted by hand. The
floors are what numpy's own kernels need for as much on this core with all lanes busy; a chain of samples that wait for each
other stays above. About a minute.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast import Complementary, Imu, JointCalibration, JointCenter, Mekf, SensorNoise, Smoother, _core
from imufast.filters import plan
from imufast.simulate import PairSimulation
from measuring import (
    Array,
    begin,
    data_folder,
    dfjimu_orientation,
    imus,
    interleaved,
    quaternion_errors_deg,
    relative,
    rms,
)
from speed import fastest

Rows = list[list[str | None]]
Method = Complementary | Mekf | Smoother
RATE_HZ, SAMPLES, FILE = 50.0, 15_000, "3D_04"
SETTLED_S = 10.0


@dataclass(frozen=True, eq=False)
class Real:
    """A real recording and its calibration."""

    arrays: tuple[Array, Array, Array, Array]
    time_s: Array
    reference: Array
    valid: Array
    pair: tuple[Imu, Imu]
    calibration: JointCalibration

    @classmethod
    def read(cls) -> Real:
        path = data_folder() / "two_imu_joint" / f"{FILE}.npz"
        with np.load(path) as z:
            g1, a1, g2, a2 = (np.ascontiguousarray(z[k][:SAMPLES], np.float64) for k in ("gyr1", "acc1", "gyr2", "acc2"))
            reference, valid = z["q_12_reference"][:SAMPLES], z["reference_valid"][:SAMPLES].astype(bool)
        pair = imus(RATE_HZ, g1, a1, g2, a2)
        return cls((g1, a1, g2, a2), np.arange(len(g1)) / RATE_HZ, reference, valid, pair, imufast.calibrate_joint(*pair))

    def rmse(self, tracked: imufast.RelativeOrientation) -> str:
        return f"{rms(quaternion_errors_deg(tracked.q_12, self.reference)[self.valid]):.2f}"


CHOICES: tuple[tuple[str, Complementary | Mekf, float | None, float | None], ...] = (
    ("complementary", Complementary(), 5.0, 15.0),
    ("complementary, single precision", Complementary(precision="single"), None, None),
    ("complementary, as published", Complementary.as_published(), None, None),
    ("mekf", Mekf(), 2.0, None),
    ("mekf, single precision", Mekf(precision="single"), None, None),
    ("mekf, as published", Mekf.as_published(), None, None),
)
SPEED_HEADINGS = ("method", "call", "ns a sample", "times faster", "target", "RMSE, °")
EIGHT, REPEATS = 8, 30


def cpu_s(calls: Sequence[Callable[[], object]], rounds: int) -> Array:
    """CPU time of each call, s: the least over rounds in which all take turns."""
    for call in calls:
        call()
    rows = []
    for _ in range(rounds):
        row = []
        for call in calls:
            began = time.process_time()
            for _ in range(REPEATS):
                call()
            row.append((time.process_time() - began) / REPEATS)
        rows.append(row)
    return np.asarray(np.min(rows, axis=0))


def speed(real: Real, rounds: int) -> Rows:
    """All filters and calls in the same rounds."""
    peer, center = dfjimu_orientation(), real.calibration.center
    assert center is not None

    def theirs() -> tuple[Array, Array]:
        assert peer is not None
        return peer.mekf(real.arrays, RATE_HZ, center.in_sensor1, center.in_sensor2)

    g1, a1, g2, a2 = real.arrays
    calls: list[tuple[str, str, float | None, int, str | None, Callable[[], object]]] = []
    for name, method, one, eight in CHOICES:
        asked = plan(method, real.calibration, RATE_HZ, None, 2.0)
        error = real.rmse(imufast.track(*real.pair, real.calibration, method))

        def whole(method: Method = method) -> object:
            return imufast.track(*real.pair, real.calibration, method)

        def many(method: Method = method) -> object:
            return imufast.track_many([real.pair] * EIGHT, [real.calibration] * EIGHT, method)

        def core(asked: dict[str, Any] = asked, time_s: Array | None = real.time_s) -> object:
            return _core.track_filter(g1, a1, g2, a2, time_s, asked, np.empty((SAMPLES, 4)), np.empty(SAMPLES), 20.0)

        def batch(asked: dict[str, Any] = asked) -> object:
            room = np.empty((EIGHT * SAMPLES, 4)), np.empty(EIGHT * SAMPLES)
            return _core.track_filter_batch([(g1, a1, g2, a2, None)] * EIGHT, [asked] * EIGHT, *room, 20.0)

        calls += [
            (name, "track", one, 1, error, whole),
            (name, "core", None, 1, None, core),
            (name, "core, even", None, 1, None, functools.partial(core, time_s=None)),
            (name, f"track_many, {EIGHT}", eight, EIGHT, None, many),
            (name, f"core, {EIGHT}", None, EIGHT, None, batch),
        ]
    functions = [call for *_, call in calls]
    if peer is not None:
        functions.append(theirs)
    times = cpu_s(functions, rounds) / SAMPLES
    rows: Rows = []
    for each, (name, what, target, count, rmse, _) in zip(times, calls, strict=False):
        ratio = f"{times[-1] * count / each:.1f}" if peer is not None else None
        rows.append([name, what, f"{1e9 * each / count:.0f}", ratio, None if target is None else f"≥ {target:g}", rmse])
    if peer is not None:
        off = quaternion_errors_deg(relative(*theirs()), real.reference)[real.valid]
        rows.append(["dfjimu.mekf_acc", "from arrays", f"{1e9 * times[-1]:.0f}", "1", None, f"{rms(off):.2f}"])
    return rows


FLOPS = {"complementary": (530, 7), "mekf": (840, 11)}
"""Operations, and square roots or divisions, of one sample."""
BYTES = 96 + 40


def floors() -> Rows:
    """What a sample costs at least on this core, ns, by numpy's own kernels."""
    side, few, many = 384, 16_384, 8_000_000
    rng = np.random.default_rng(0)
    square, product = rng.random((side, side)), np.empty((side, side))
    x, ones, stream = rng.random(few) + 1.0, np.ones(few), rng.random(many)
    flop = fastest(lambda: np.matmul(square, square, out=product)) / (2.0 * side**3)
    root = fastest(lambda: np.divide(x, ones, out=x)) / few
    byte = fastest(lambda: stream.max(), 5) / (8.0 * many)
    rows: Rows = [[f"{BYTES} bytes from and to memory", f"{1e9 * BYTES * byte:.1f}"]]
    for name, (flops, slow) in FLOPS.items():
        rows.append([f"{name}: {flops} flops, all lanes busy", f"{1e9 * flops * flop:.1f}"])
        rows.append([f"{name}: {slow} roots or divisions, all lanes busy", f"{1e9 * slow * root:.1f}"])
    return rows


def there_and_back(s: PairSimulation, samples: int) -> tuple[list[Array], Array]:
    """gyr1, acc1, gyr2, acc2 and q_12 of a motion that is made forwards and backwards again and again: without a jump, and as
    rigid as before, for rates change their sign and accelerations do not."""
    count = len(s.time_s)
    lap = np.concatenate([np.arange(count), np.arange(count - 2, 0, -1)])
    sign = np.where(np.arange(len(lap)) < count, 1.0, -1.0)[:, None]
    laps = -(-samples // len(lap))
    arrays = [
        np.tile(a[lap] * by, (laps, 1))[:samples] for a, by in ((s.gyr1, sign), (s.acc1, 1.0), (s.gyr2, sign), (s.acc2, 1.0))
    ]
    return [np.ascontiguousarray(a) for a in arrays], np.tile(s.q_12[lap], (laps, 1))[:samples]


def truly(s: PairSimulation, gyr_std: float = 0.005, acc_std: float = 0.05) -> JointCalibration:
    """The calibration that somebody who knows the truth would give."""
    center = JointCenter(s.joint_in_sensor1, s.joint_in_sensor2, 1e-8 * np.eye(6), np.zeros((0, 6)))
    rate_hz = 1.0 / float(np.median(np.diff(s.time_s)))
    return JointCalibration(
        center=center,
        gyr_bias1=s.gyr_bias1,
        gyr_bias2=s.gyr_bias2,
        acc_bias1=s.acc_bias1,
        acc_bias2=s.acc_bias2,
        gyr_bias_std=1e-4,
        acc_bias_covariance=1e-6 * np.eye(6),
        noise=SensorNoise(gyr_std, gyr_std, acc_std, acc_std, rate_hz),
    )


LINEAR_HEADINGS = (
    "recording",
    "samples",
    "iterations",
    "smoother, s",
    "self-calibrating, s",
    "map_acc, s",
    "smoother over map_acc",
    "target",
    "RMSE, °",
    "map_acc, °",
)


def linear(real: Real, rounds: int) -> Rows:
    """The smoother beside dfjimu's, and over the length of the recording."""
    peer, rows = dfjimu_orientation(), []
    cases: list[tuple[str, tuple[Imu, Imu], JointCalibration, Sequence[Array], Array]] = [
        (FILE, real.pair, real.calibration, real.arrays, real.reference)
    ]
    s = imufast.simulate_ball_joint(duration_s=600.0, rate_hz=RATE_HZ, seed=1)
    for samples in (15_000, 60_000, 240_000):
        arrays, truth = there_and_back(s, samples)
        cases.append(("simulated", imus(RATE_HZ, *arrays), truly(s), arrays, truth))
    for name, pair, calibration, signals, truth in cases:
        center = calibration.center
        assert center is not None
        result = imufast.track(*pair, calibration, Smoother())
        calls: list[Callable[[], object]] = [
            functools.partial(imufast.track, *pair, calibration, Smoother()),
            functools.partial(imufast.track, *pair, None, Smoother()),
        ]
        if peer is not None:
            calls.append(functools.partial(peer.map, signals, RATE_HZ, center.in_sensor1, center.in_sensor2))
        times = np.array(interleaved(calls, rounds if len(truth) <= SAMPLES else 1))
        ours, alone, *theirs = np.median(times, axis=0).tolist()
        valid = real.valid if name == FILE else np.ones(len(truth), bool)
        errors = [rms(quaternion_errors_deg(result.q_12, truth)[valid])]
        if peer is not None:
            errors.append(
                rms(
                    quaternion_errors_deg(relative(*peer.map(signals, RATE_HZ, center.in_sensor1, center.in_sensor2)), truth)[
                        valid
                    ]
                )
            )
        beside = [f"{theirs[0]:.3f}", f"{np.median(times[:, 0] / times[:, 2]):.2f}"] if theirs else [None, None]
        rows.append(
            [
                name,
                str(len(truth)),
                str(result.iterations),
                f"{ours:.3f}",
                f"{alone:.3f}",
                *beside,
                "≤ 10",
                *(f"{e:.2f}" for e in errors),
            ]
        )
    return rows


UPDATE_HEADINGS = ("one sample from Python", "median, µs", "99.9 %, µs", "most, µs", "block of 100, µs a sample", "target")


def update(real: Real) -> Rows:
    """Cost of each call of `update` in turn; the clock's own time is taken off."""
    samples = [tuple(a[k].copy() for a in real.arrays) for k in range(len(real.time_s))]
    clock = time.perf_counter_ns
    own = float(np.median([-(clock() - clock()) for _ in range(10_000)]))
    rows: Rows = []
    for name, method, *_ in CHOICES:
        if "published" in name:
            continue
        tracker, spent = method.start(real.calibration, rate_hz=RATE_HZ), []
        for sample in samples:
            began = clock()
            tracker.update(*sample)
            spent.append(clock() - began)
        us = 1e-3 * (np.array(spent) - own)
        again, began = method.start(real.calibration, rate_hz=RATE_HZ), clock()
        for k in range(0, SAMPLES, 100):
            again.update(*(a[k : k + 100] for a in real.arrays))
        block = 1e-3 * (clock() - began) / SAMPLES
        values = (np.median(us), np.quantile(us, 0.999), us.max(), block)
        rows.append([name, *(f"{x:.2f}" for x in values), "median ≤ 2 µs"])
    return rows


HOUR_HEADINGS = (
    "an hour at 1 kHz",
    "track, s",
    "core, s",
    "target",
    "memory: more than the arrays, MB",
    "RMSE, °",
    "RMS of std, °",
)


def hour() -> Rows:
    """Each filter in a process of its own, whose memory is then that of one call."""
    rows: Rows = []
    for name, method, *_ in CHOICES:
        if "published" not in name:
            with get_context("spawn").Pool(1) as pool:
                rows.append([name, *pool.apply(one_hour, (method,))])
    return rows


def one_hour(method: Complementary | Mekf) -> list[str | None]:
    rate_hz, samples = 1000.0, 3_600_000
    s = imufast.simulate_ball_joint(duration_s=30.0, rate_hz=rate_hz, seed=1)
    arrays, truth = there_and_back(s, samples)
    pair, calibration = imus(rate_hz, *arrays), truly(s)
    before = resident_mb()
    began = time.process_time()
    tracked = imufast.track(*pair, calibration, method)
    took = time.process_time() - began
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - before
    asked = plan(method, calibration, rate_hz, None, 2.0)
    began = time.process_time()
    gyr1, acc1, gyr2, acc2 = arrays
    gyr1, acc1, gyr2, acc2 = arrays
    _core.track_filter(gyr1, acc1, gyr2, acc2, None, asked, np.empty((samples, 4)), np.empty(samples), 20.0)
    core = time.process_time() - began
    errors = quaternion_errors_deg(tracked.q_12, truth)
    return [f"{took:.2f}", f"{core:.2f}", "≤ 1", f"{most:.0f}", f"{rms(errors):.2f}", f"{rms(tracked.angle_std_deg):.2f}"]


def resident_mb() -> float:
    """Memory that the process holds now; where the system does not say, the most that it ever held."""
    with contextlib.suppress(OSError):
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parts = ("speed", "linear", "update", "hour")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="print the tables for docs/measured.md")
    parser.add_argument("--part", choices=parts, help="one part only")
    parser.add_argument("--rounds", type=int, default=9, help="interleaved rounds of timed runs; default 9")
    chosen = parser.parse_args()
    show = begin(markdown=chosen.markdown)

    def wanted(*names: str) -> bool:
        return chosen.part in (None, *names)

    rounds = max(1, chosen.rounds)
    if wanted("speed", "linear", "update"):
        real = Real.read()
        if wanted("speed"):
            title = f"{SAMPLES} samples of {FILE}, lever arms and biases known; beside dfjimu.mekf_acc in the same rounds."
            show(title, SPEED_HEADINGS, speed(real, rounds))
            show("The floors of one sample.", ("work", "ns"), floors())
        if wanted("linear"):
            show("The smoother beside dfjimu.map_acc with 10 iterations.", LINEAR_HEADINGS, linear(real, min(rounds, 5)))
        if wanted("update"):
            show(f"`update` sample by sample over {FILE}.", UPDATE_HEADINGS, update(real))
    if wanted("hour"):
        show("A long recording, simulated.", HOUR_HEADINGS, hour())


if __name__ == "__main__":
    main()
