"""What every format works with: a file that is safe to read, and what its reader hands back."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.errors import FileFormatError, MissingFileError
from imufast.plausibility import Units

__all__ = ["HEAD_BYTES", "Format", "RawSensor", "Source", "open_source"]

Array: TypeAlias = NDArray[np.float64]

HEAD_BYTES = 1 << 16
"""Formats are told apart by this much, and headers end within it."""
_PACKED = {b"\x1f\x8b": "gzip", b"BZh": "bzip2", b"\xfd7zXZ": "xz", b"7z\xbc\xaf": "7z", b"\x28\xb5\x2f\xfd": "zstd"}


@dataclass(frozen=True)
class Source:
    """A regular file, its first 64 KiB, the column mapping the user gave, and the names of the formats there are."""

    path: Path
    head: bytes
    columns: Mapping[str, Any] | None = None
    formats: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """How messages name the file."""
        return repr(str(self.path))

    def error(self, reason: str) -> FileFormatError:
        """An error that names this file."""
        return FileFormatError(f"{self.label}: {reason}")


@dataclass(frozen=True)
class RawSensor:
    """One sensor as its file holds it. Rows with NaN in gyr or acc may be among them; the joining counts and drops them.

    Of `time_s` (N,) seconds and `counter` (N,) packets, already unwrapped, a format gives the one that sees lost rows, or
    none. `counter_wraps_at` is the modulus that the counter had: counters of several files can differ by whole turns.
    """

    name: str
    gyr: Array
    acc: Array
    time_s: Array | None = None
    counter: NDArray[np.int64] | None = None
    counter_wraps_at: int = 1
    rate_hz: float | None = None
    units: Units = field(default_factory=Units)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Format:
    """A vendor's format: how its first bytes look, and how to read it. `read` raises FileFormatError."""

    name: str
    detect: Callable[[bytes], bool]
    read: Callable[[Source], list[RawSensor]]


def open_source(path: Path, columns: Mapping[str, Any] | None, formats: tuple[str, ...]) -> Source:
    """The file behind a path. Raises FileFormatError for what is no regular file, or packed, or empty."""
    label = repr(str(path))
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise FileFormatError(f"{label} is a folder; give the files in it")
        # Pipes and devices may never end, or never begin.
        if not stat.S_ISREG(mode):
            raise FileFormatError(f"{label} is not a regular file")
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except FileNotFoundError:
        raise MissingFileError(f"{label}: there is no such file (looked from {os.getcwd()!r})") from None  # noqa: PTH109
    except (OSError, ValueError) as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(f"{label} cannot be opened: {error}") from None
    if not head.strip(b"\r\n\t \xef\xbb\xbf"):
        raise FileFormatError(f"{label} is empty")
    for magic, packer in _PACKED.items():
        if head.startswith(magic):
            raise FileFormatError(f"{label} is compressed ({packer}); unpack it first")
    return Source(path, head, columns, formats)
