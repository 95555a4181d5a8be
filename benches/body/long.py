"""Long recordings: time, and peak memory without what goes in and comes out, of ten minutes and of an hour.

    python benches/body/long.py [MINUTES ...]        default 5 10 20 60
    python benches/body/long.py --markdown [MINUTES ...]        default 10 60, without the comparison of the last lines

A simulated subject (seed 1, biases, no soft tissue) alternates between walking, the motion profile, walking and standing, a
minute each with a second unrecorded between them. One process simulates and leaves the samples in files, another maps these and
estimates, so that its peak is the estimate's own. Times are the processor's, not the clock's. The last lines compare windows
with one search over the whole of 5 minutes.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import imufast
import numpy as np
from imufast.body import LowerBody, LowerBodySettings, estimate_lower_body
from imufast.simulate import LowerBodySimulation, simulate_lower_body

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from measuring import setting, table

MOTIONS = ("walking", "profile", "walking", "standing")
KINDS = ("knee", "hip", "ankle")


def simulated(minutes: int) -> LowerBodySimulation:
    motions = [MOTIONS[n % len(MOTIONS)] for n in range(minutes)]
    return simulate_lower_body(motions, duration_s=60.0, seed=1, gyr_bias=0.005, acc_bias=0.05)


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def write(folder: Path, minutes: int) -> None:
    truth = simulated(minutes)
    np.save(folder / "time_s.npy", truth.time_s)
    for name, imu in truth.recording.items():
        np.save(folder / f"{name}.gyr.npy", imu.gyr)
        np.save(folder / f"{name}.acc.npy", imu.acc)
    for side in ("right", "left"):
        np.save(folder / f"knee_{side}.npy", truth.knee_angles_deg[side][:, 0])


def size(value: Any) -> int:
    """Bytes of all arrays in a result."""
    if isinstance(value, np.ndarray):
        return value.nbytes
    if isinstance(value, dict):
        return sum(map(size, value.values()))
    return sum(size(getattr(value, f.name)) for f in fields(value)) if is_dataclass(value) else 0


def run(folder: Path) -> None:
    def load(name: str) -> Any:
        return np.load(folder / f"{name}.npy", mmap_mode="r")

    before = peak_mb()
    time_s = load("time_s")
    names = sorted(path.name.split(".")[0] for path in folder.glob("*.gyr.npy"))
    recording = imufast.Recording({n: imufast.Imu(load(f"{n}.gyr"), load(f"{n}.acc"), time_s=time_s, name=n) for n in names})
    samples = sum(imu.gyr.nbytes + imu.acc.nbytes for imu in recording.values()) + time_s.nbytes
    begun = time.process_time()
    found = estimate_lower_body(recording, {n: n for n in names})
    took, peak = time.process_time() - begun, peak_mb()
    rows = np.searchsorted(time_s, found.time_s - 1e-9)
    knees = {side: found.knee_angles_deg[side][:, 0] - load(f"knee_{side}")[rows] for side in ("right", "left")}
    print(
        json.dumps(
            {
                "s": took,
                "windows": len(found.windows),
                "peak": peak,
                "before": before,
                "in": samples / 2**20,
                "out": size(found) / 2**20,
                "status": str(found.status),
                "knee": [float(np.sqrt(np.mean(off**2))) for off in knees.values()],
                "held": [float((np.abs(off) < 2.0 * found.knee_std_deg[side][:, 0]).mean()) for side, off in knees.items()],
            }
        )
    )


def compare() -> None:
    truth = simulated(5)
    settings = LowerBodySettings(window_s=1e6), LowerBodySettings(window_s=60.0)
    whole, parts = (estimate_lower_body(truth.recording, truth.placement, settings=s) for s in settings)
    rows = np.searchsorted(truth.time_s, whole.time_s - 1e-9)
    print(f"\n5 minutes whole ({whole.status}) and in {len(parts.windows)} windows of 60 s ({parts.status}), three angles:")

    def rmse(found: LowerBody, kind: str, side: str) -> str:
        off = getattr(found, f"{kind}_angles_deg")[side] - getattr(truth, f"{kind}_angles_deg")[side][rows]
        return " ".join(f"{v:5.2f}" for v in np.sqrt((off**2).mean(axis=0)))

    for kind in KINDS:
        for side in ("right", "left"):
            apart = getattr(parts, f"{kind}_angles_deg")[side] - getattr(whole, f"{kind}_angles_deg")[side]
            std = getattr(whole, f"{kind}_std_deg")[side]
            print(
                f"{kind:5} {side:5}: off truth {rmse(whole, kind, side)} whole, {rmse(parts, kind, side)} windows deg rms; "
                f"apart {' '.join(f'{v:5.2f}' for v in np.sqrt((apart**2).mean(axis=0)))}; "
                f"{100 * (np.abs(apart) < 2.0 * std).mean():.1f} % within twice the whole's standard deviation"
            )


def main() -> None:
    if sys.argv[1:2] in (["write"], ["run"]):
        folder = Path(sys.argv[2])
        run(folder) if sys.argv[1] == "run" else write(folder, int(sys.argv[3]))
        return
    markdown = sys.argv[1:2] == ["--markdown"]
    asked = [int(m) for m in sys.argv[1 + markdown :]]
    if markdown:
        print(setting(), end="\n\n")
        tabled(asked or [10, 60])
        return
    for minutes in asked or [5, 10, 20, 60]:
        r = measured(minutes)
        print(
            f"{minutes:3} min: {r['s']:6.1f} s ({r['s'] / minutes:.2f} s a minute), {r['windows']} windows, {r['status']}; "
            f"peak {r['peak']:.0f} MB, of which before {r['before']:.0f}, samples {r['in']:.0f}, result {r['out']:.0f}, rest "
            f"{r['peak'] - r['before'] - r['in'] - r['out']:.0f}; knees {r['knee'][0]:.2f} and {r['knee'][1]:.2f} deg, "
            f"{100 * r['held'][0]:.0f} and {100 * r['held'][1]:.0f} % within two standard deviations",
            flush=True,
        )
    compare()


def measured(minutes: int) -> Any:
    """One recording, in processes of its own."""
    with tempfile.TemporaryDirectory() as place:
        subprocess.run([sys.executable, __file__, "write", place, str(minutes)], check=True)
        said = subprocess.run([sys.executable, "-W", "ignore", __file__, "run", place], check=True, capture_output=True)
        return json.loads(said.stdout)


def tabled(lengths: list[int]) -> None:
    rows = []
    for minutes in lengths:
        r = measured(minutes)
        rest = r["peak"] - r["before"] - r["in"] - r["out"]
        knees = " / ".join(f"{v:.2f}" for v in r["knee"])
        held = " / ".join(f"{100 * v:.0f} %" for v in r["held"])
        cells = [
            r["windows"] or "whole",
            f"{r['s']:.1f}",
            f"{r['s'] / minutes:.2f}",
            f"{r['peak']:.0f}",
            f"{rest:.0f}",
            knees,
            held,
        ]
        rows.append([f"{minutes} min", *cells, r["status"]])
    head = ("recording", "windows", "processor, s", "s a minute", "peak, MB", "without samples, result, imports, MB")
    print(table((*head, "knee flexion RMSE right / left, °", "within two standard deviations", "status"), rows, markdown=True))


if __name__ == "__main__":
    main()
