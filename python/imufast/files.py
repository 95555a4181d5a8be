"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from imufast.errors import InputError

__all__ = ["check_target", "write_text"]


def check_target(path: str | os.PathLike[str], name: str = "path") -> Path:
    """The file that `path` means, links followed.

    Raises:
        InputError: not a path, a folder, or in a folder that does not exist.
    """
    try:
        given = Path(path)
        target = given.resolve()
        if target.is_dir():
            raise InputError(f"{name} {str(given)!r} is a folder; give a file to write")
        if not target.parent.is_dir():
            raise InputError(f"{name} {str(given)!r} cannot be written: there is no folder {str(target.parent)!r}")
    except (TypeError, ValueError, OSError, RuntimeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{name} must be the path of a file to write, got {path!r} ({error})") from None
    return target


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text as UTF-8: into a file beside the target, which then takes its place. Returns the target.

    Raises:
        InputError: as `check_target`, or the system does not allow it; what was there before is then still there.
    """
    target = check_target(path)
    beside = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
    try:
        try:
            with beside.open("x", encoding="utf-8", errors="backslashreplace", newline="\n") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"path {str(path)!r} cannot be written: {error.strerror or error}") from None
    return target
