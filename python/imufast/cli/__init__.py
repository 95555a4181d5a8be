"""The command line: `imufast demo | info | calibrate | track | body`. Needs the extra `cli`; importing imufast does not."""

from __future__ import annotations

import os
import sys

__all__ = ["main"]


def main() -> None:
    """Entry point of the command `imufast`."""
    try:
        from imufast.cli.app import app
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] not in ("click", "rich"):
            raise
        print(f"imufast: the command line needs {missing.name}: pip install 'imufast[cli]'", file=sys.stderr)
        raise SystemExit(2) from None
    try:
        app(prog_name="imufast")
    except OSError as error:
        # Files that cannot be written are told by name, and a pipe that broke ends in click: what is left is stdout.
        print(f"imufast: stdout cannot be written: {error.strerror or error}", file=sys.stderr)
        # What is still in its buffer would fail once more on the way out.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        raise SystemExit(1) from None
