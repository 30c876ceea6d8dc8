"""Tables of numbers in whatever dialect they were written."""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from plat.errors import MotionError
from plat.files import decoded
from plat.motions.formats.spellings import is_time
from plat.words import counted

__all__ = ["Table", "read_table"]

_SEPARATORS = (",", ";", "\t", "|", None)  # None: any white space
_COMMENTS = ("#", "//", "%")
_BEFORE_COMMENTS = " \t\"'"  # Excel puts cells with a separator into quotes
_SEPARATING = ' \t,;|"'
_MISSING = ("", "-")
# Rows of names before the numbers, at most: a title, names in two rows, units.
_HEADER_ROWS = 4
# What is said before a table in so few cells is no row of it: a title, or a frame rate.
_FEW_CELLS = 4
_WHOLE = re.compile(r"[+-]?\d*(?:e[+-]?\d+)?", re.IGNORECASE)
# hours, minutes, seconds and frames
_TIMECODE = re.compile(r"(\d+):(\d\d):(\d\d)[:;](\d\d)")
# a number and a unit of time; and a date, hours, minutes and seconds, of which the first two may be missing
_WITH_UNIT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*(seconds?|secs?|s|ms|us|µs|ns)", re.IGNORECASE)
_UNITS_OF_TIME = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9} | dict.fromkeys(
    ("s", "sec", "secs", "second", "seconds"), 1.0
)
_CLOCK = re.compile(r"(?:(\S+)[ T]+(?=\d+:\d+:))?(?:(\d{1,2}):)?(\d{1,2}):(\d\d(?:[.,]\d+)?)")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
# the line with which Excel is told what separates cells
_EXCEL = re.compile(r"sep=(.)\W*$", re.IGNORECASE)
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
        empty: columns with an empty cell, each with the row of the file that has the first; NaN stands in ``values``.
        texts: columns of texts that are left out, each with its name and its first text.
    """

    header: list[str]
    values: np.ndarray
    comments: list[str]
    empty: Mapping[int, int] = field(default_factory=dict)
    texts: Mapping[int, tuple[str, str]] = field(default_factory=dict)


def read_table(path: Path) -> Table:
    """Read a table of numbers separated by commas, semicolons, tabs, bars or spaces.

    A header, comments, lines before the table, an empty last column and decimal commas are understood. A row of
    numbers that count the columns, as pandas writes them, is a header. Dates with times, times of a day and numbers
    with a unit of time become seconds. A named column in which all rows have the same text is left out, and so is one
    of times that are none of these.

    Raises:
        MotionError: naming row and column, when there are no numbers or a cell is none.
    """
    lines, comments = [], []
    for number, line in enumerate(decoded(path.read_bytes()).splitlines(), start=1):
        text = line.lstrip(_BEFORE_COMMENTS)
        mark = next((mark for mark in _COMMENTS if text.startswith(mark)), None)
        if mark is not None:
            comments.append(text.removeprefix(mark).strip(" \t#"))
        elif line.strip(_SEPARATING):  # Excel leaves rows of separators alone
            lines.append((number, line))
    if not lines:
        raise MotionError("no rows of numbers, expected one a frame")
    if len(lines) > 1 and (told := _EXCEL.match(lines[0][1].strip())):
        separator: str | None = told[1]
        del lines[0]
    else:
        separator = _separator([line for _, line in lines])
    rows = [(number, _cells(line, separator)) for number, line in lines]
    comments += _take_lines_before(rows)
    if separator != "," and _DECIMAL_COMMA.search(lines[-1][1]):
        comments = [_DECIMAL_COMMA.sub(".", comment) for comment in comments]
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
        raise MotionError(f"the header has {counted(len(header), 'column')}, the rows have {width}")
    for number, row in rows:
        if len(row) != width and separator == "," and all(map(_WHOLE.fullmatch, (*row, *rows[0][1]))):
            raise MotionError("decimal commas between commas cannot be told apart: separate columns by semicolons")
        if len(row) != width:
            raise MotionError(f"row {number} has {counted(len(row), 'column')}, row {rows[0][0]} has {width}")
    header, rows, left_out = _without_texts(header, rows)
    empty: dict[int, int] = {}
    return Table(header, _numbers(header, rows, empty), comments, empty, left_out)


def _separator(lines: list[str]) -> str | None:
    """Return what splits one of the last two lines into the most cells, numbers all; the very last may be cut off."""

    def count(line: str, separator: str | None) -> int:
        cells = _cells(line, separator)
        while cells and cells[-1] in _MISSING:
            cells.pop()
        good = sum(map(_is_number, cells))
        return good if good > len(cells) / 2 else 0

    def score(separator: str | None) -> tuple[int, int]:
        return (max(count(line, separator) for line in lines[-2:]), -_SEPARATORS.index(separator))

    return max(_SEPARATORS, key=score)


def _cells(line: str, separator: str | None) -> list[str]:
    line = line.strip(" \r\n")
    if line[:1] in ("[", "("):  # a row as Python prints it
        line = line.strip("[](), ")
    split = line.split(separator)
    if separator is not None and '"' in line:
        split = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    cells = [cell.strip(" \t\"'") for cell in split]
    if separator != "," or '"' in line:
        cells = [re.sub(r"^([+-]?\d+),(\d*)", r"\1.\2", cell) for cell in cells]
    return cells


def _take_lines_before(rows: list[tuple[int, list[str]]]) -> list[str]:
    """Take away lines of few cells before a table of many more, and return them as comments."""
    count = 0
    width = len(rows[-1][1])
    while count < min(_HEADER_ROWS, len(rows) - 1):
        row = _without_padding(rows[count][1])
        if len(row) > min(_FEW_CELLS, width // 4) or all(map(_is_number, row)):
            break
        count += 1
    told = [" ".join(_without_padding(row)) for _, row in rows[:count]]
    del rows[:count]
    return told


def _without_padding(row: list[str]) -> list[str]:
    """Return the cells of a row up to the last that is not empty: Excel makes all rows of one width."""
    return row[: max((n for n, cell in enumerate(row, start=1) if cell), default=0)]


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
        header = _joined(header, row)
    return header


def _joined(header: list[str], row: list[str]) -> list[str]:
    """Return names with those of the next row behind them, in brackets where these are units."""
    units = _are_units(row)
    return [
        f"{name} [{cell.strip('()[]')}]" if units and cell else f"{name} {cell}".strip()
        for name, cell in zip(header, row, strict=True)
    ]


def _are_units(row: list[str]) -> bool:
    return all(cell.strip("()[]").lower() in _UNITS for cell in row)


def _header_in_comments(comments: list[str], separator: str | None, width: int) -> list[str]:
    """Return the header that ``np.savetxt`` writes as a comment, with the units of a row behind it, or none."""
    units = [""] * width
    for comment in reversed(comments):
        for split in (separator, ","):
            cells = _cells(comment, split)
            if len(cells) != width or width <= 3 or any(map(_is_number, cells)):
                continue
            if not _are_units(cells):
                return _joined(cells, units)
            units = cells
    return []


def _counts(row: list[str]) -> bool:
    """Return whether a row is 0, 1, 2, ... or 1, 2, 3, ..."""
    numbers = [float(cell) if _is_number(cell) else math.nan for cell in row]
    return (
        len(row) > 3
        and all(number == numbers[0] + step for step, number in enumerate(numbers))
        and numbers[0] in (0, 1)
    )


def _without_texts(
    header: list[str], rows: list[tuple[int, list[str]]]
) -> tuple[list[str], list[tuple[int, list[str]]], dict[int, tuple[str, str]]]:
    """Return the table with seconds for times, and without named columns of one text or one a row; and these columns.

    Raises:
        MotionError: for a named column of several texts that may be motions.
    """
    texts = [column for column, cell in enumerate(rows[0][1]) if cell not in _MISSING and not _is_number(cell)]
    for column in texts:
        cells = [row[column] for _, row in rows]
        if (seconds := _seconds(cells)) is not None:
            for (_, row), second in zip(rows, seconds, strict=True):
                row[column] = repr(second)
    left_out: dict[int, tuple[str, str]] = {}
    for column in texts if header and len(texts) < len(header) / 2 else ():
        cells = [row[column] for _, row in rows]
        if any(map(_is_number, cells)):
            continue
        other = next((cell for cell in cells if cell != cells[0]), None)
        if other is not None and len(set(cells)) < len(cells) and not is_time(header[column]):
            raise MotionError(
                f"column {column + 1} ({header[column]!r:.40}) holds texts, {cells[0]!r:.40} and {other!r:.40}: are "
                "these several motions? Write a file for each, or leave the column out"
            )
        left_out[column] = (header[column], cells[0])

    def kept(row: list[str]) -> list[str]:
        return [cell for column, cell in enumerate(row) if column not in left_out]

    return kept(header), [(number, kept(row)) for number, row in rows], left_out


def _seconds(cells: list[str]) -> list[float] | None:
    """Return the seconds of times since the first, or None for what is none.

    Times are numbers with a unit, of a day, or of a clock that counts hours and minutes, or minutes alone; with a date
    before them of any form, if that is the same in all rows.
    """
    codes = [_TIMECODE.fullmatch(cell) for cell in cells]
    if all(codes):
        return _seconds_of_timecodes([tuple(map(int, code.groups())) for code in codes if code])
    with_units = [_WITH_UNIT.fullmatch(cell) for cell in cells]
    if all(with_units):
        seconds = [float(match[1]) * _UNITS_OF_TIME[match[2].lower()] for match in with_units if match]
        return [second - seconds[0] for second in seconds]
    clocks = [_CLOCK.fullmatch(cell) for cell in cells]
    if all(clocks) and len({clock[1] for clock in clocks if clock}) == 1:
        seconds = [3600 * int(c[2] or 0) + 60 * int(c[3]) + float(c[4].replace(",", ".")) for c in clocks if c]
        return [second - seconds[0] for second in seconds]
    for day in ("", "2000-01-01 "):
        try:
            times = [datetime.fromisoformat(f"{day}{cell}") for cell in cells]
            return [(time - times[0]).total_seconds() for time in times]
        except (TypeError, ValueError):
            continue
    return None


def _seconds_of_timecodes(codes: Sequence[tuple[int, ...]]) -> list[float]:
    """Return the seconds since the first of hours, minutes, seconds and frames; the frames alone within one second."""
    seconds = [3600 * hours + 60 * minutes + second for hours, minutes, second, _ in codes]
    frames = [code[-1] for code in codes]
    if len(set(seconds)) == 1:
        return [float(frame - frames[0]) for frame in frames]
    rate = 1 + max(frames)
    return [second - seconds[0] + (frame - frames[0]) / rate for second, frame in zip(seconds, frames, strict=True)]


def _numbers(header: list[str], rows: list[tuple[int, list[str]]], empty: dict[int, int]) -> np.ndarray:
    """Return the numbers of rows; ``empty`` is given the named columns with empty cells, which become NaN."""
    try:
        return np.array([row for _, row in rows], dtype=np.float64)
    except ValueError:
        pass
    for number, row in rows:
        for column, cell in enumerate(row, start=1):
            if header and cell in _MISSING:
                row[column - 1] = "nan"
                empty.setdefault(column - 1, number)
            elif not _is_number(cell):
                told = f": {cell!r:.40} is not a number" if cell else " is empty, expected a number"
                raise MotionError(f"row {number}, column {column}{told}")
    if header:
        return np.array([row for _, row in rows], dtype=np.float64)
    raise MotionError("a cell is not a number")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
