"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from imufast.errors import InputError

__all__ = ["check_target", "replacing", "write_text"]


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


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """A file beside the target to write into, which then takes its place; not if anything goes wrong.

    Raises:
        InputError: as `check_target`, or the system does not allow it; what was there before is then still there.
    """
    target = check_target(path)
    beside = target.with_name(f".{target.name[:100]}.{secrets.token_hex(6)}.part")
    try:
        try:
            with beside.open("xb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"path {str(path)!r} cannot be written: {error.strerror or error}") from None


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text as UTF-8, whole or not at all. Returns the file that `path` means, links followed.

    Raises:
        InputError: as `replacing`.
    """
    with replacing(path) as file:
        file.write(text.encode("utf-8", errors="backslashreplace"))
    return check_target(path)
