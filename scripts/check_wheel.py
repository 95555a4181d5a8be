"""Install a wheel into a clean environment of every CPython from 3.10 on that this machine has, and run the demo there.

    python scripts/check_wheel.py dist/imufast-*.whl

Interpreters: python3.10, python3.11 ... on PATH and in ~/.pyenv/versions/*/bin; one of each minor version.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FIRST_MINOR, LAST_MINOR = 10, 30
# The stable ABI that the wheel is built for does not reach free-threaded builds.
ASK = (
    "import sys, sysconfig; print(sys.implementation.name, *sys.version_info[:2], sysconfig.get_config_var('Py_GIL_DISABLED'))"
)


def outcome(command: list[str | Path], folder: Path) -> tuple[int, str]:
    """Exit code and everything printed, with nothing of this environment or folder in the way."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    try:
        done = subprocess.run(command, cwd=folder, env=clean, capture_output=True, text=True, timeout=600, check=False)  # noqa: S603
    except (OSError, subprocess.TimeoutExpired) as error:
        return 1, str(error)
    return done.returncode, done.stdout + done.stderr


def interpreters(folder: Path) -> dict[tuple[int, int], Path]:
    """By minor version: the CPython found first."""
    places = [Path(p) for p in os.environ.get("PATH", "").split(os.pathsep) if p]
    named = [place / f"python3.{minor}" for minor in range(FIRST_MINOR, LAST_MINOR) for place in places]
    installed = sorted((Path.home() / ".pyenv" / "versions").glob("*/bin/python3"))
    found: dict[tuple[int, int], Path] = {}
    for python in [*installed, *named]:
        if not python.is_file():
            continue
        code, said = outcome([python, "-c", ASK], folder)
        words = said.split()
        if code or len(words) != 4 or words[0] != "cpython" or words[3] == "1":
            continue
        version = int(words[1]), int(words[2])
        if version >= (3, FIRST_MINOR):
            found.setdefault(version, python)
    return dict(sorted(found.items()))


def check(python: Path, wheel: Path, folder: Path) -> str | None:
    """What went wrong with the wheel under this interpreter, or None."""
    binaries = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    install: list[str | Path] = [binaries / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    base = "import imufast, sys; sys.exit(bool({'click', 'rich'} & set(sys.modules)))"
    steps: list[tuple[str, list[str | Path]]] = [
        ("venv", [python, "-m", "venv", folder / "venv"]),
        ("install of the base", [*install, wheel]),
        ("import with numpy alone", [binaries / "python", "-W", "error", "-c", base]),
        ("install with the extra cli", [*install, f"{wheel}[cli]"]),
        ("demo", [binaries / "imufast", "demo"]),
    ]
    for name, command in steps:
        code, said = outcome(command, folder)
        if code:
            return f"{name} ended with {code}:\n{said}"
    return None if "Beside the truth" in said else f"the demo did not come to its end:\n{said}"


def main() -> int:
    """Check all; 0 if every interpreter was content and there was one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("wheel", type=Path)
    wheel = parser.parse_args().wheel.resolve()
    if not wheel.is_file():
        parser.error(f"there is no wheel {wheel}")
    failed = []
    with tempfile.TemporaryDirectory() as name:
        found = interpreters(Path(name))
        for (major, minor), python in found.items():
            folder = Path(name) / f"{major}.{minor}"
            folder.mkdir()
            started = time.monotonic()
            problem = check(python, wheel, folder)
            print(f"CPython {major}.{minor}: {'FAILED' if problem else 'ok'} ({time.monotonic() - started:.0f} s)", flush=True)
            if problem:
                print(problem)
                failed.append(minor)
    if not found:
        print("no CPython from 3.10 on was found")
    return int(bool(failed) or not found)


if __name__ == "__main__":
    sys.exit(main())
