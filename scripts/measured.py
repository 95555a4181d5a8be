"""Run the benches and put the tables they print into docs/measured.md, between its two markers.

    python scripts/measured.py [BENCH ...]

All benches take about half an hour; with names, only those are run anew and what the others printed before stays.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
BENCHES = (
    "benches/two_imu.py",
    "benches/center.py",
    "benches/orientation.py",
    "benches/orientation_errors.py",
    "benches/angles.py",
    "benches/papers/olsson2017/run.py",
    "benches/papers/olsson2020/run.py",
    "benches/papers/remmerswaal2021/run.py",
    "benches/stream.py",
    "benches/speed.py",
    "benches/body/gtsam_peer.py",
    "benches/body/long.py",
)


def heading(bench: str) -> str:
    """The line above what a bench printed."""
    return f"Printed by `{bench}`:"


def printed(bench: str) -> str:
    """What the bench prints; the script ends where it fails or lacks its peer."""
    done = subprocess.run([sys.executable, bench, "--markdown"], cwd=ROOT, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode or "missing" in done.stderr:
        raise SystemExit(f"{bench} has not measured everything:\n{done.stdout}\n{done.stderr}")
    return done.stdout.strip()


def kept(measured: str, bench: str) -> str | None:
    """What the bench printed before, or None."""
    _, found, after = measured.partition(heading(bench))
    for other in BENCHES:
        after = after.partition(heading(other))[0]
    return after.strip() if found else None


def halves(text: str, where: Path) -> tuple[str, str, str]:
    """What stands before the first marker, between both, and after the second."""
    head, _, rest = text.partition(BEGIN)
    between, _, tail = rest.partition(END)
    if not tail:
        raise SystemExit(f"{where} lacks the markers {BEGIN} and {END}")
    return head, between, tail


def main() -> None:
    """Measure and write; a bench that fails or lacks its peer leaves the page as it is."""
    chosen = sys.argv[1:] or list(BENCHES)
    for bench in chosen:
        if bench not in BENCHES:
            raise SystemExit(f"unknown bench {bench!r}; known are {', '.join(BENCHES)}")
    page = ROOT / "docs" / "measured.md"
    halves(page.read_text(encoding="utf-8"), page)
    new = {bench: printed(bench) for bench in chosen}
    # Read again: others may have edited it while the benches ran.
    head, before, tail = halves(page.read_text(encoding="utf-8"), page)
    parts = {bench: new.get(bench) or kept(before, bench) for bench in BENCHES}
    texts = [f"{heading(bench)}\n\n{part}" for bench, part in parts.items() if part]
    page.write_text("\n\n".join([head + BEGIN, *texts, END + tail]), encoding="utf-8")


if __name__ == "__main__":
    main()
