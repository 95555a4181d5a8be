"""Which low-pass should be on by default: mechanical hinges and a walking person, the same cut-off for both.

python benches/lowpass.py [--markdown]

For each cut-off: error of the calibrated axis on every hinge recording (whole file), verdict and misfit; and for both knees of
the walking person whether the axes repeat between the two halves of the walk, and how far the thigh's axis lies off the limb
(the strap wobbles about the limb, so a small angle means that the strap was found, not the knee).
"""

from __future__ import annotations

import argparse

import imufast
import numpy as np
from measuring import Array, data_folder, pair_error_deg, refuse_debug_build, setting, table

CUTOFFS_HZ = (None, 8.0, 6.0, 5.0, 4.5, 4.0, 3.5, 3.0, 2.5)
HALVES_S = ((56.0, 74.0), (77.0, 95.0))
STANDING_S = 4.0


def line_angle_deg(a: Array, b: Array) -> float:
    """Angle between two lines, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(a @ b))))


def rigs(cutoff_hz: float | None) -> list[str]:
    """A cell for each hinge recording: error, verdict's first letter."""
    cells = []
    for path in sorted((data_folder() / "two_imu_joint").glob("1D_*.npz")):
        pair = imufast.read(path).pair()
        found = imufast.calibrate_hinge(*pair, lowpass_hz=cutoff_hz)
        with np.load(path) as z:
            truth = z["hinge_axis1_reference"], z["hinge_axis2_reference"]
        if found.axis1 is None or found.axis2 is None:
            cells.append("–")
            continue
        error = pair_error_deg(found.axis1, found.axis2, *truth)
        cells.append(f"{error:.2f} {'yes' if found.accepted else 'no'}")
    return cells


def knee(cutoff_hz: float | None, side: str) -> list[str]:
    """Cells for one knee: half to half, off the limb, misfits, accepted."""
    names = (f"upper_leg_{side}", f"lower_leg_{side}")
    recording = imufast.read(data_folder() / "lower_body" / "full_body_walk.npz")
    whole = recording.pair(*names)
    limb = whole[0].between(0.0, STANDING_S).acc.mean(axis=0)
    halves = [imufast.calibrate_hinge(*(imu.between(*half) for imu in whole), lowpass_hz=cutoff_hz) for half in HALVES_S]
    first, second = halves
    if first.axis1 is None or first.axis2 is None or second.axis1 is None or second.axis2 is None:
        return ["–", "–", "–", "no"]
    apart = pair_error_deg(first.axis1, first.axis2, second.axis1, second.axis2)
    off = min(line_angle_deg(half.axis1, limb) for half in halves if half.axis1 is not None)
    misfit = " ".join("–" if half.misfit is None else f"{half.misfit:.2f}" for half in halves)
    accepted = " ".join("yes" if half.accepted else "no" for half in halves)
    return [f"{apart:.1f}", f"{off:.0f}", misfit, accepted]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--markdown", action="store_true", help="only the table")
    arguments = parser.parse_args()
    refuse_debug_build()
    hinges = [path.stem for path in sorted((data_folder() / "two_imu_joint").glob("1D_*.npz"))]
    head = ["cut-off, Hz", *(f"{name}: error, °; accepted" for name in hinges)]
    head += [
        f"{side} knee: {what}" for side in ("left", "right") for what in ("halves, °", "off limb, °", "misfit", "accepted")
    ]
    rows = [[str(cutoff or "none"), *rigs(cutoff), *knee(cutoff, "left"), *knee(cutoff, "right")] for cutoff in CUTOFFS_HZ]
    print(table(head, rows, markdown=arguments.markdown))
    if not arguments.markdown:
        print(f"\n{setting()}")


if __name__ == "__main__":
    main()
