"""The command line: `imufast demo | info | calibrate | track | body`. Needs the extra `cli`; importing imufast does not."""

from __future__ import annotations

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
    app(prog_name="imufast")
