"""How clearly swapped sensors show: by how much the logarithms of joint misfits sum to more than those of the best assignment.

    python benches/body/placements.py [SEEDS]        default 4

Simulated subjects (soft tissue, biases, 40 s) and the recorded walk (IMUFAST_DATA, else ../shared/data beside the project). An
alarm is raised from `imufast.body.checks.CLEAR` on: the first column should stay below it, the others above. A misfit says
nothing of sensors that do not move (feet in sit-to-stand); swapped legs as a whole are told by the way knees bend instead.
"""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

import imufast
from imufast.body.checks import CLEAR, Assignments
from imufast.body.layout import SEGMENTS, layout
from imufast.imu import Recording
from imufast.simulate import LegTissue, simulate_lower_body

DATA = Path(os.environ.get("IMUFAST_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
SWAPS = {
    "as worn": [],
    "thighs": [("thigh_right", "thigh_left")],
    "shanks": [("shank_right", "shank_left")],
    "feet": [("foot_right", "foot_left")],
    "thigh-shank": [("thigh_right", "shank_right")],
    "shank-foot": [("shank_left", "foot_left")],
    "pelvis-thigh": [("pelvis", "thigh_left")],
}


def row(label: str, recording: Recording, worn: dict[str, str]) -> None:
    margins = []
    for pairs in SWAPS.values():
        place = dict(worn)
        for one, other in pairs:
            place[one], place[other] = place[other], place[one]
        margins.append(Assignments.of(recording, layout(recording, place)).margin)
    print(f"{label:28}" + "".join(f"{margin:13.2f}" for margin in margins), flush=True)


def main() -> None:
    warnings.simplefilter("ignore")
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    print(f"alarm from {CLEAR}".ljust(28) + "".join(f"{name:>13}" for name in SWAPS))
    path = DATA / "lower_body" / "full_body_walk.npz"
    if path.exists():
        walk = imufast.read(path)
        names = [s.replace("pelvis", "hip").replace("thigh", "upper_leg").replace("shank", "lower_leg") for s in SEGMENTS]
        worn = dict(zip(SEGMENTS, names, strict=True))
        for start, stop in ((0.0, 100.0), (60.0, 100.0), (0.0, 20.0)):
            row(f"recorded walk, {start:.0f} to {stop:.0f} s", walk.between(start, stop), worn)
    for motion in ("walking", "sit_to_stand", "profile", "ankles_and_knees", "standing"):
        for seed in range(seeds):
            truth = simulate_lower_body(
                motion, seed=seed, duration_s=40.0, gyr_bias=0.005, acc_bias=0.05, soft_tissue=LegTissue()
            )
            row(f"{motion}, seed {seed}", truth.recording, truth.placement)


if __name__ == "__main__":
    main()
