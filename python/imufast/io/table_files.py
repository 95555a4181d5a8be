"""Columns over time as files: CSV for eyes and spreadsheets, Parquet for programs, OpenSim storage for its tools."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imufast.errors import ImufastError, InputError
from imufast.files import check_target, replacing

__all__ = ["Column", "check_names", "check_suffix", "opensim_storage", "write_csv", "write_parquet", "write_rows"]

Array = NDArray[np.float64]

ROWS = 65_536
"""Written at a time."""


@dataclass(frozen=True)
class Column:
    """One column: its name, unit and meaning, (N,) values, and how they are written as text ("" for all digits)."""

    name: str
    unit: str
    what: str
    values: NDArray[Any]
    form: str = ""


def check_suffix(path: str | os.PathLike[str], formats: Sequence[str], name: str = "path") -> str:
    """The format that the name of a file asks for.

    Raises:
        InputError: another end of the name, or a path that cannot be written.
        ImufastError: the extra `io` is not installed, and `.parquet` is asked for.
    """
    check_target(path, name)
    suffix = Path(path).suffix.lower()
    if suffix not in formats:
        *first, last = formats
        raise InputError(f"{name} {str(path)!r} must end in {', '.join(first)} or {last}: that says what to write")
    if suffix == ".parquet":
        try:
            import pyarrow.parquet  # noqa: F401
        except ImportError:
            raise ImufastError("a Parquet file needs pyarrow: pip install 'imufast[io]'") from None
    return suffix


def check_names(argument: str, names: object, count: int) -> tuple[str, ...]:
    """Names of columns: as many as there are columns, different, without blanks at their ends, tabs or line ends.

    Raises:
        InputError: they are not.
    """
    if isinstance(names, str) or not isinstance(names, Sequence) or len(names) != count:
        raise InputError(f"{argument} must be {count} name{'s' * (count != 1)}, got {names!r}")
    for name in names:
        if not isinstance(name, str) or not name.lstrip("-") or not name.isprintable() or set(name) & set(' ,;"#='):
            raise InputError(f"{argument}: {name!r} is no name of a column; letters, digits, '_', '/' and '.' will do")
    if len({name.lstrip("-") for name in names}) != count:
        raise InputError(f"{argument} must be different names, got {names!r}")
    return tuple(names)


def write_csv(path: str | os.PathLike[str], first: str, columns: Sequence[Column]) -> None:
    """A first line after "#", the names, and one row a sample."""
    head = [f"# {first}\n", ",".join(column.name for column in columns) + "\n"]
    write_rows(path, head, [(column.values, column.form) for column in columns], ",")


def write_rows(
    path: str | os.PathLike[str], head: Sequence[str], columns: Sequence[tuple[NDArray[Any], str]], between: str
) -> None:
    """Lines of text, then one row a sample: (N,) values and how each is formatted; the first to its last digit, for it may be a
    clock's time. Whole or not at all."""
    with replacing(path) as file:
        for text in (*head, *_rows(columns, between)):
            file.write(text.encode())


def _rows(columns: Sequence[tuple[NDArray[Any], str]], between: str) -> Iterator[str]:
    line = between.join(f"{{:{form}}}" if form else "{!r}" for _, form in columns) + "\n"
    for start in range(0, len(columns[0][0]), ROWS):
        values = [column[start : start + ROWS].tolist() for column, _ in columns]
        yield "".join(line.format(*row) for row in zip(*values, strict=True))


def write_parquet(path: str | os.PathLike[str], schema: str, about: Mapping[str, Any], columns: Sequence[Column]) -> None:
    """Parquet whose schema holds `about` as JSON under the name `schema`, and unit and meaning of each column."""
    import pyarrow
    import pyarrow.parquet

    told = {"schema": schema, **about, "units": {column.name: column.unit for column in columns}}
    arrays = [pyarrow.array(np.ascontiguousarray(column.values)) for column in columns]
    fields = [
        pyarrow.field(column.name, array.type, nullable=False, metadata={"unit": column.unit, "description": column.what})
        for column, array in zip(columns, arrays, strict=True)
    ]
    table = pyarrow.table(arrays, schema=pyarrow.schema(fields, metadata={schema: json.dumps(told)}))
    with replacing(path) as file:
        pyarrow.parquet.write_table(table, file)


def opensim_storage(
    path: str | os.PathLike[str], said: Sequence[str], time_s: Array, names: Sequence[str], values: Sequence[Array]
) -> None:
    """Angles as an OpenSim storage file, version 1: `.mot` or `.sto`, tab-separated, in degrees.

    Args:
        path: the file.
        said: lines for the header, for people; OpenSim skips them.
        time_s: (N,) s.
        names: of the columns.
        values: (N,) each, degrees.
    """
    head = [
        f"{Path(path).stem}\n",
        "version=1\n",
        f"nRows={len(time_s)}\n",
        f"nColumns={1 + len(names)}\n",
        "inDegrees=yes\n",
        *(f"{line}\n" for line in said),
        "endheader\n",
        "\t".join(("time", *names)) + "\n",
    ]
    write_rows(path, head, [(time_s, ""), *((column, ".8f") for column in values)], "\t")
