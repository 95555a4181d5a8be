"""The formats, in the order in which they are tried. A new vendor is one small module and one line here."""

from __future__ import annotations

from imufast.errors import InputError
from imufast.io.delimited import DELIMITED
from imufast.io.movella_dot import MOVELLA_DOT
from imufast.io.npz import NPZ
from imufast.io.source import Format, Source
from imufast.io.xsens_mt_manager import XSENS_MT_MANAGER

__all__ = ["FORMATS", "find_format", "format_names"]

FORMATS: tuple[Format, ...] = (
    NPZ,
    MOVELLA_DOT,
    XSENS_MT_MANAGER,
    DELIMITED,  # takes any text with a header, so it comes last
)


def format_names() -> tuple[str, ...]:
    """The names that `read(format=...)` accepts."""
    return tuple(known.name for known in FORMATS)


def find_format(source: Source, name: str | None) -> Format:
    """The format with this name, or without one, the first that recognises the file.

    Raises InputError for an unknown name, FileFormatError when no format recognises the file.
    """
    if name is not None:
        for known in FORMATS:
            if known.name == name:
                return known
        raise InputError(f"format must be one of {', '.join(format_names())} or None to detect it, got {name!r}")
    for known in FORMATS:
        if known.detect(source.head):
            return known
    raise source.error(f"the format is not recognised; known are {', '.join(format_names())}")
