"""What imufast raises: one root, few branches, and messages that name the argument, what arrived and what to do."""

from __future__ import annotations

__all__ = ["FileFormatError", "ImufastError", "ImufastWarning", "InputError", "MissingFileError", "SettingsError", "UnitError"]


class ImufastError(Exception):
    """Root of all exceptions that imufast raises on purpose."""


class InputError(ImufastError, ValueError):
    """An argument has the wrong shape, type or values (NaN, time going back, unequal lengths...)."""


class UnitError(InputError):
    """The numbers are plainly in another unit than stated; the message names the likely one."""


class SettingsError(ImufastError, ValueError):
    """A setting is unknown or out of its range."""


class FileFormatError(ImufastError, ValueError):
    """A file cannot be read as a recording; the message names the file, the place and the reason."""


class MissingFileError(FileFormatError, FileNotFoundError):
    """There is no such file; also a FileNotFoundError, for those who catch that."""


class ImufastWarning(UserWarning):
    """Something about the data deserves a look; results are still computed."""
