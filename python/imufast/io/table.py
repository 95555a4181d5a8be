"""Tables of numbers in text: any delimiter, a header row, empty cells as NaN, and every way such a file can be broken."""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from imufast.io.source import HEAD_BYTES, Source
from imufast.plausibility import warn_user

__all__ = ["Table", "head_lines", "read_header", "read_numbers"]

Array: TypeAlias = NDArray[np.float64]

_LONGEST_LINE = 1 << 20
_CHUNK = 8 << 20
_NUMBER = re.compile(r"[-+]?[0-9.]")
_EMPTY = {"", "nan", "na", "n/a", "null", "none", "-"}


@dataclass(frozen=True)
class Table:
    """Where the numbers are: column names, delimiter (None: white space), the line before the first row, the lines above."""

    columns: tuple[str, ...]
    delimiter: str | None
    header_line: int
    preamble: tuple[str, ...]
    first_row: str

    def cells(self, line: str) -> int:
        """How many cells a line has."""
        return len(line.split()) if self.delimiter is None else line.count(self.delimiter) + 1


def head_lines(head: bytes) -> list[str]:
    """The lines of a file's head; UTF-8, else Latin-1 (then only degree signs and names are at stake)."""
    # Of a long file, the head ends somewhere inside a line.
    whole = head if len(head) < HEAD_BYTES else head[: head.rfind(b"\n") + 1] or head
    try:
        text = whole.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = whole.decode("latin-1")
    # Not splitlines(), which also splits where reading a file line by line does not.
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def read_header(source: Source, comment: str) -> Table:
    """Find the header row: the first line that is neither blank nor starts with `comment` nor ends its text with a colon.

    Raises FileFormatError for binary files, endless lines, and files without a header or without rows.
    """
    _check_text(source)
    lines = head_lines(source.head)
    preamble: list[str] = []
    delimiter: str | None = None
    for line in lines:
        text = line.strip()
        if text[:4].lower() == "sep=":
            delimiter = text[4:5] or None
        elif text and not text.startswith(comment) and not _is_preamble(text):
            break
        preamble.append(line)
    else:
        raise source.error("no header row with column names was found in the first 64 KiB")
    if _NUMBER.match(text) and preamble and preamble[-1].startswith(comment):
        # numpy.savetxt writes the names as a comment.
        line = preamble.pop().removeprefix(comment)
    index = len(preamble)
    if delimiter is None or delimiter not in line:
        delimiter = max("\t;,", key=line.count) if any(d in line for d in "\t;,") else None
    try:
        names = line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter, strict=True))
    except (csv.Error, StopIteration) as error:
        raise source.error(f"line {index + 1}: the header row cannot be split: {error}") from None
    names = [name.strip() for name in names]
    while names and not names[-1]:
        names.pop()
    rows = [row for row in lines[index + 1 :] if row.strip() and not row.startswith(comment)]
    if not rows:
        raise source.error(f"there are no rows after the header in line {index + 1}")
    return Table(tuple(names), delimiter, index + 1, tuple(preamble), rows[0])


def _is_preamble(text: str) -> bool:
    """Lines such as `DeviceTag:,abc` and copyright notices that vendors put above the header."""
    return text.split(",")[0].rstrip().endswith(":") or text.startswith("©")


def _check_text(source: Source) -> None:
    if source.head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise source.error("the text is UTF-16; save it as UTF-8")
    half = _LONGEST_LINE // 2
    with source.path.open("rb") as file:
        while block := file.read(half):
            if b"\0" in block:
                raise source.error("this is a binary file, not text")
            if len(block) == half and b"\n" not in block and b"\r" not in block:
                raise source.error(f"a line is longer than {half} bytes; this is no table of samples")


def read_numbers(source: Source, table: Table, use: Sequence[int], comment: str) -> tuple[Array, tuple[str, ...]]:
    """The columns with the indices `use` as (rows, len(use)), empty cells NaN, and notes on what was left out.

    A last line that is cut off is left out with an ImufastWarning. Raises FileFormatError naming the line for rows with
    too few or too many cells and for cells that are no numbers.
    """
    parts: list[Array] = []
    short: tuple[int, int] | None = None
    # Data are ASCII: Latin-1 decodes anything, and what is no number is reported as such, with its line.
    with source.path.open(encoding="latin-1") as file:
        for _ in range(table.header_line):
            file.readline()
        number = table.header_line + 1
        while lines := file.readlines(_CHUNK):
            rows, numbers, cut = _complete_rows(source, table, lines, number, comment)
            if short is not None and (rows or cut):
                raise _too_short(source, table, *short)
            if cut is not None:
                if numbers and numbers[-1] > cut[0]:
                    raise _too_short(source, table, *cut)
                short = cut
            if rows:
                parts.append(_parse(source, table, rows, numbers, use))
            number += len(lines)
    notes: tuple[str, ...] = ()
    if short is not None:
        notes = (f"the last line ({short[0]}) is cut off: {short[1]} of {len(table.columns)} cells; it was left out",)
        warn_user(f"{source.label}: {notes[0]}")
    if not parts:
        raise source.error("there is no complete row")
    return np.concatenate(parts), notes


def _too_short(source: Source, table: Table, line: int, cells: int) -> Exception:
    return source.error(f"line {line} has {cells} cells where the header has {len(table.columns)}")


def _complete_rows(
    source: Source, table: Table, lines: list[str], first: int, comment: str
) -> tuple[list[str], Sequence[int], tuple[int, int] | None]:
    """The lines that hold a row, their line numbers, and a line with too few cells (number, cells) if there is one."""
    expected = len(table.columns)
    if {table.cells(line) for line in lines} == {expected}:
        return lines, range(first, first + len(lines)), None
    rows: list[str] = []
    numbers: list[int] = []
    cut: tuple[int, int] | None = None
    for number, line in enumerate(lines, first):
        row = line.rstrip("\r\n")
        cells = table.cells(row)
        if not row.strip(f" \t{table.delimiter or ''}") or row.startswith(comment):
            continue
        while cells > expected and table.delimiter and row.endswith(table.delimiter):
            row, cells = row[: -len(table.delimiter)], cells - 1
        if cells > expected:
            hint = " (decimal commas in a comma-separated file?)" if table.delimiter == "," else ""
            raise source.error(f"line {number} has {cells} cells where the header has {expected}{hint}")
        if cut is not None:
            raise _too_short(source, table, *cut)
        if cells < expected:
            cut = (number, cells)
        else:
            rows.append(row)
            numbers.append(number)
    return rows, numbers, cut


def _parse(source: Source, table: Table, rows: list[str], numbers: Sequence[int], use: Sequence[int]) -> Array:
    if table.delimiter != "," and "," in rows[0]:
        rows = [row.replace(",", ".") for row in rows]
    quote = '"' if '"' in rows[0] else None
    try:
        return np.loadtxt(rows, delimiter=table.delimiter, usecols=use, comments=None, quotechar=quote, ndmin=2)
    except ValueError:
        # An empty or wrong cell somewhere: cell by cell, to take the one and to name the other.
        values = [_parse_row(source, table, row, number, use) for row, number in zip(rows, numbers, strict=True)]
        return np.array(values, dtype=np.float64)


def _parse_row(source: Source, table: Table, row: str, number: int, use: Sequence[int]) -> list[float]:
    cells = row.split(table.delimiter)
    values = []
    for column in use:
        cell = cells[column].strip().strip('"').strip()
        try:
            # float() takes underscores, tables of numbers do not.
            value = math.nan if cell.lower() in _EMPTY else float(cell.replace(",", ".").replace("_", "?"))
        except ValueError:
            raise source.error(f"line {number}, column {table.columns[column]!r}: {cell[:40]!r} is not a number") from None
        values.append(value)
    return values
