"""Which sensor is on which segment, and the subject's measures, from a `placement.toml`."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from imufast.body.layout import SEGMENTS
from imufast.body.settings import Anthropometry
from imufast.errors import FileFormatError, ImufastError, InputError, MissingFileError, SettingsError
from imufast.imu import Recording
from imufast.settings import check_number

__all__ = ["MEASURED_STD_M", "Placement", "read_placement"]

SUBJECT = ("height_m", "femur_m", "tibia_m", "hips_m")
MEASURED_STD_M = 0.015
"""How well a length that is told without a standard deviation is taken to be known, m: a tape over skin."""
LARGEST_BYTES = 1_000_000


@dataclass(frozen=True)
class Worn:
    """A sensor by name, by file, or by both."""

    sensor: str | None
    file: Path | None


@dataclass(frozen=True, eq=False)
class Placement:
    """What a `placement.toml` says. Made by `read_placement`.

    Attributes:
        path: of the file.
        worn: segment to its sensor.
        subject: what is told of "height_m" (m) and of the lengths "femur_m", "tibia_m" and "hips_m" ((mean, std), m).
    """

    path: Path
    worn: dict[str, Worn]
    subject: dict[str, Any]

    @property
    def files(self) -> list[Path]:
        """The recording files it names, each once."""
        return list(dict.fromkeys(worn.file for worn in self.worn.values() if worn.file is not None))

    def sensors(self, recording: Recording) -> dict[str, str]:
        """Segment to the name of its sensor in a recording, as `estimate_lower_body` wants it.

        Raises:
            InputError: a sensor or file that the recording does not have; the message names the key and the value.
        """
        return {segment: self._name(f"[placement] {segment}", worn, recording) for segment, worn in self.worn.items()}

    def _name(self, key: str, worn: Worn, recording: Recording) -> str:
        names = list(recording)
        if worn.file is not None:
            asked = worn.file.resolve()
            names = [name for name, info in recording.info.items() if Path(info.file).resolve() == asked]
            if not names:
                read = sorted({Path(info.file).name for info in recording.info.values()})
                raise InputError(
                    f"{self.path.name}: {key} is in file {str(worn.file)!r}, which was not read; read: {', '.join(read)}"
                )
        there = f"there {'is' if len(names) == 1 else 'are'} {', '.join(map(repr, names))}"
        if worn.sensor is None:
            if len(names) != 1:
                raise InputError(f"{self.path.name}: {key} needs sensor = too, for its file holds several: {there}")
            return names[0]
        # Names that clash between files have the file's name in front.
        longer = worn.file is not None
        found = [name for name in names if name == worn.sensor or (longer and name.endswith(f".{worn.sensor}"))]
        if not found:
            of = "" if worn.file is None else f" of {str(worn.file)!r}"
            raise InputError(f"{self.path.name}: {key} = {worn.sensor!r} names no sensor{of}; {there}")
        return found[0]

    def anthropometry(self, height_m: float | None = None) -> Anthropometry | None:
        """Measures of the subject; None where nothing is told of them.

        Args:
            height_m: told elsewhere, m. Default None: as the file says.

        Raises:
            InputError: two heights that differ.
            SettingsError: a value out of range.
        """
        told = self.subject.get("height_m")
        if None not in (height_m, told) and height_m != told:
            raise InputError(f"height {height_m:g} m contradicts [subject] height_m = {told:g} of {self.path.name}; give one")
        height = told if height_m is None else height_m
        lengths = {name: value for name, value in self.subject.items() if name != "height_m"}
        if height is None and not lengths:
            return None
        return Anthropometry(**lengths) if height is None else replace(Anthropometry.of_height(height), **lengths)


def read_placement(path: str | os.PathLike[str]) -> Placement:
    """Read a `placement.toml`:

    ```toml
    [placement]                      # segment = "sensor", as `imufast info` names it
    pelvis = "hip"
    thigh_right = { file = "right.csv" }                   # the one sensor of a file, beside this one
    shank_right = { file = "right.npz", sensor = "shank" } # one of several

    [subject]                        # optional
    height_m = 1.78
    femur_m = 0.42                   # a tape's; or [mean, standard deviation], m
    ```

    Args:
        path: the file.

    Raises:
        MissingFileError: there is no such file.
        FileFormatError: it is no TOML.
        InputError: a key or value that means nothing; the message names both.
        SettingsError: a measure out of range.
        ImufastError: before Python 3.11, where the package tomli is not installed.
    """
    where = Path(path)
    tables = _parsed(where)
    unknown = [name for name in tables if name not in ("placement", "subject")]
    if unknown:
        raise InputError(f"{where.name}: {unknown[0]!r} means nothing here; there are the tables [placement] and [subject]")
    for name in ("placement", "subject"):
        if not isinstance(tables.get(name, {}), dict):
            raise InputError(f"{where.name}: {name} must be a table, [{name}], got {tables[name]!r}")
    placed = tables.get("placement", {})
    if not placed:
        raise InputError(f'{where.name}: [placement] must say which sensor is on which segment, such as pelvis = "sensor name"')
    worn = {}
    for segment, value in placed.items():
        if segment not in SEGMENTS:
            raise InputError(
                f"{where.name}: [placement] {segment} = {value!r} is no segment; segments are {', '.join(SEGMENTS)}"
            )
        worn[segment] = _worn(where, segment, value)
    return Placement(where, worn, _subject(where, tables.get("subject", {})))


def _parsed(path: Path) -> dict[str, Any]:
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        try:
            import tomli as tomllib
        except ImportError:
            raise ImufastError("a placement.toml needs tomli before Python 3.11: pip install 'imufast[cli]'") from None
    if not path.is_file():
        raise MissingFileError(f"placement {str(path)!r}: there is no such file")
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise FileFormatError(f"placement {str(path)!r} is no placement: it is larger than {LARGEST_BYTES} bytes")
        tables: dict[str, Any] = tomllib.loads(path.read_text("utf-8-sig"))
        return tables
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FileFormatError(f"placement {str(path)!r} is no TOML: {error}") from None
    except OSError as error:
        raise InputError(f"placement {str(path)!r} cannot be read: {error.strerror or error}") from None


def _worn(path: Path, segment: str, value: object) -> Worn:
    said = f"{path.name}: [placement] {segment} = {value!r}"
    if isinstance(value, str) and value.strip():
        return Worn(value, None)
    if not isinstance(value, dict) or not value:
        raise InputError(f'{said} must be a sensor\'s name, or {{ file = "...", sensor = "..." }}')
    for key, inner in value.items():
        if key not in ("file", "sensor"):
            raise InputError(f"{said}: {key!r} means nothing here; there are file and sensor")
        if not isinstance(inner, str) or not inner.strip() or "\0" in inner:
            raise InputError(f"{said}: {key} must be a text, got {inner!r}")
    file = value.get("file")
    return Worn(value.get("sensor"), None if file is None else path.parent / file)


def _subject(path: Path, table: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in table.items():
        said = f"{path.name}: [subject] {key}"
        if key not in SUBJECT:
            raise InputError(f"{said} = {value!r} means nothing here; there are {', '.join(SUBJECT)}")
        if key == "height_m":
            found[key] = check_number(said, value, 0.8, 2.5)
            continue
        pair = value if isinstance(value, list) else [value, MEASURED_STD_M]
        if len(pair) != 2:
            raise SettingsError(f"{said} must be a length or [mean, standard deviation], m, got {value!r}")
        found[key] = (check_number(said, pair[0], 0.02, 2.0), check_number(f"{said}, standard deviation,", pair[1], 1e-4, 1.0))
    return found
