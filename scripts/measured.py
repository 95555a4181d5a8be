"""Run the benches and put the tables they print into README.md, between its two markers.

python scripts/measured.py
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
BENCHES = ("benches/two_imu.py", "benches/speed.py")


def main() -> None:
    """Measure and write; a bench that fails or lacks its peer leaves README as it is."""
    parts = []
    for bench in BENCHES:
        done = subprocess.run([sys.executable, bench, "--markdown"], cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode or "missing" in done.stderr:
            raise SystemExit(f"{bench} has not measured everything:\n{done.stderr}")
        parts.append(f"Printed by `{bench}`:\n\n{done.stdout.strip()}")
    readme = ROOT / "README.md"
    head, _, rest = readme.read_text(encoding="utf-8").partition(BEGIN)
    _, _, tail = rest.partition(END)
    if not tail:
        raise SystemExit(f"{readme} lacks the markers {BEGIN} and {END}")
    readme.write_text("\n\n".join([head + BEGIN, *parts, END + tail]), encoding="utf-8")


if __name__ == "__main__":
    main()
