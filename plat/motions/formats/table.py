"""Tables of numbers in whatever dialect they were written."""

import codecs
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plat.errors import MotionError

__all__ = ["Table", "read_table"]

_SEPARATORS = (",", ";", "\t", None)  # None: any white space
_COMMENTS = ("#", "//", "%")
_MISSING = ("", "-")
# Rows of names before the numbers, at most: a title, names in two rows, units.
_HEADER_ROWS = 4
_UNITS = frozenset(
    ("", "-", "1", "m", "cm", "mm", "in", "ft", "rad", "radian", "radians", "deg", "degree", "degrees", "s")
)


@dataclass(frozen=True)
class Table:
    """Numbers of a file, and what it says about them.

    Attributes:
        header: a name a column, or none at all.
        values: ``[T, columns]``.
        comments: lines that the file marks as such, without the mark.
    """

    header: list[str]
    values: np.ndarray
    comments: list[str]


def read_table(path: Path) -> Table:
    """Read a table of numbers separated by commas, semicolons, tabs or spaces.

    A header, comments, an empty last column and decimal commas are understood. A row of numbers
    that count the columns, as pandas writes them, is a header.

    Raises:
        MotionError: naming row and column, when there are no numbers or a cell is none.
    """
    lines, comments = [], []
    for number, line in enumerate(_text(path.read_bytes()).splitlines(), start=1):
        mark = next((mark for mark in _COMMENTS if line.lstrip().startswith(mark)), None)
        if mark is not None:
            comments.append(line.lstrip().removeprefix(mark).strip(" \t#"))
        elif line.strip():
            lines.append((number, line))
    if not lines:
        raise MotionError("no rows of numbers, expected one a frame")
    separator = _separator([line for _, line in lines])
    rows = [(number, _cells(line, separator)) for number, line in lines]
    header = _take_header(rows)
    if not rows:
        raise MotionError("no rows of numbers, expected one a frame")
    width = len(rows[0][1])
    header = header or _header_in_comments(comments, separator, width)
    if not header and len(rows) > 2 and _counts(rows[0][1]):
        header = rows.pop(0)[1]
        width = len(rows[0][1])
    last_is_empty = all(len(row) == width and row[-1] in _MISSING for _, row in rows)
    if last_is_empty or (len(header) == width + 1 and header[-1] == ""):
        rows = [(number, row[: width - last_is_empty]) for number, row in rows]
        width -= last_is_empty
        header = header[:-1] if len(header) == width + 1 and header[-1] == "" else header
    if len(header) == width - 1 and header:
        header = ["", *header]  # the column of row names has none
    if header and len(header) != width:
        raise MotionError(f"the header has {len(header)} columns, the rows have {width}")
    for number, row in rows:
        if len(row) != width:
            raise MotionError(f"row {number} has {len(row)} columns, row {rows[0][0]} has {width}")
    return Table(header, _numbers(rows), comments)


def _text(data: bytes) -> str:
    for mark, encoding in ((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")):
        if data.startswith(mark):
            return data.decode(encoding)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _separator(lines: list[str]) -> str | None:
    """Return what splits the last line into the most cells, numbers all of them."""

    def score(separator: str | None) -> tuple[int, int]:
        cells = _cells(lines[-1], separator)
        while cells and cells[-1] in _MISSING:
            cells.pop()
        good = sum(map(_is_number, cells))
        return (good if good > len(cells) / 2 else 0, -_SEPARATORS.index(separator))

    return max(_SEPARATORS, key=score)


def _cells(line: str, separator: str | None) -> list[str]:
    line = line.strip(" \r\n")
    if line[:1] in ("[", "("):  # a row as Python prints it
        line = line.strip("[](), ")
    cells = [cell.strip(" \t\"'") for cell in line.split(separator)]
    if separator != ",":
        cells = [re.sub(r"^([+-]?\d+),(\d*)", r"\1.\2", cell) for cell in cells]
    return cells


def _take_header(rows: list[tuple[int, list[str]]]) -> list[str]:
    """Take the rows before the numbers away, and return the names of the columns.

    A title is left out, names in two rows are joined, and a row of units is put behind the names.
    """
    count = next((n for n, (_, row) in enumerate(rows[: _HEADER_ROWS + 1]) if any(map(_is_number, row))), 1)
    taken = [row for _, row in rows[:count] if count == 1 or sum(cell not in _MISSING for cell in row) > 1]
    del rows[:count]
    if not taken:
        return []
    header = taken[0]
    for row in taken[1:]:
        if len(row) != len(header):
            raise MotionError(f"the header has rows of {len(header)} and {len(row)} columns")
        units = all(cell.strip("()[]").lower() in _UNITS for cell in row)
        header = [
            f"{name} [{cell}]" if units and cell else f"{name} {cell}".strip()
            for name, cell in zip(header, row, strict=True)
        ]
    return header


def _header_in_comments(comments: list[str], separator: str | None, width: int) -> list[str]:
    """Return the header that ``np.savetxt`` writes as a comment, or none."""
    for comment in reversed(comments):
        for split in (separator, ","):
            cells = _cells(comment, split)
            if len(cells) == width > 3 and not any(map(_is_number, cells)):
                return cells
    return []


def _counts(row: list[str]) -> bool:
    """Return whether a row is 0, 1, 2, ... or 1, 2, 3, ..."""
    numbers = [float(cell) if _is_number(cell) else math.nan for cell in row]
    return (
        len(row) > 3
        and all(number == numbers[0] + step for step, number in enumerate(numbers))
        and numbers[0] in (0, 1)
    )


def _numbers(rows: list[tuple[int, list[str]]]) -> np.ndarray:
    try:
        return np.array([row for _, row in rows], dtype=np.float64)
    except ValueError:
        pass
    for number, row in rows:
        for column, cell in enumerate(row, start=1):
            if not _is_number(cell):
                raise MotionError(f"row {number}, column {column}: {cell!r:.40} is not a number")
    raise MotionError("a cell is not a number")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
