"""JSON files of unknown origin, read with limits and one-line errors."""

import json
import reprlib
from collections import Counter
from pathlib import Path
from typing import Any

from plat.bounds import shown
from plat.errors import PlatError

__all__ = ["parse_json", "read_json", "short", "version_fault"]

MAX_BYTES = 32 << 20
"""Largest file that is read: an hour of keyframes takes a fifth of it."""

_MOST_OBJECTS = 1_000_000
"""Objects and lists of a file: an hour of keyframes, one every 20 ms, has 720,000."""
_MOST_LETTERS = 400

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 60
_SHORT.maxlevel = 2


def read_json(path: Path, error: type[PlatError], label: str, *, constants: bool = False) -> Any:
    """Return the content of a JSON file.

    Args:
        path: the file.
        error: class of what is raised.
        label: how messages begin, such as ``"keyframe file 'bow.json'"``.
        constants: let NaN and Infinity through, for readers that name the field that holds them.

    Raises:
        PlatError: of the class ``error``, in one line: a file that is missing, unreadable, too large, or not the JSON
            that :func:`parse_json` accepts.
    """
    try:
        if not path.is_file():
            what = "not a regular file" if path.exists() else "no such file"
            raise error(f"{label}: {what}")
        if path.stat().st_size > MAX_BYTES:
            raise error(f"{label}: {path.stat().st_size / 1e6:.0f} MB, expected at most {MAX_BYTES / 1e6:.0f} MB")
        content = path.read_bytes()
    except OSError as cause:
        raise error(f"{label}: cannot be read ({cause.strerror or cause})") from cause
    return parse_json(content, error, label, constants=constants)


def parse_json(content: bytes, error: type[PlatError], label: str, *, constants: bool = False) -> Any:
    """Return the value of a JSON text.

    Python's own reader takes the last of two equal names and lets NaN, Infinity and lone surrogates through. Here they
    are errors, as are deep nesting and numbers of thousands of digits.

    Args:
        content: UTF-8, or UTF-16 or UTF-32, as Windows writes it.
        error: class of what is raised.
        label: how messages begin.
        constants: let NaN and Infinity through.

    Raises:
        PlatError: of the class ``error``.

    >>> parse_json(b'{"a": [1, 2.5]}', PlatError, "example")
    {'a': [1, 2.5]}
    """

    def constant(name: str) -> None:
        raise error(f"{label}: holds {name}, expected finite numbers")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        values = dict(pairs)
        if len(values) != len(pairs):
            name = Counter(name for name, _ in pairs).most_common(1)[0][0]
            raise error(f"{label}: field {short(name)} comes twice in one object")
        return values

    # each takes a hundred bytes of memory, and three of the file
    if content.count(b"{") + content.count(b"[") > _MOST_OBJECTS:
        raise error(f"{label}: more than {_MOST_OBJECTS:,} objects and lists, expected fewer")
    try:
        text = content.decode(json.detect_encoding(content))
        values = json.loads(text, parse_constant=float if constants else constant, object_pairs_hook=unique)
        if "\\u" in text:
            json.dumps(values, ensure_ascii=False).encode()
    except error:
        raise
    except UnicodeEncodeError:
        raise error(f"{label}: half of a surrogate pair in a text, expected whole characters") from None
    except UnicodeDecodeError as cause:
        raise error(f"{label}: not a readable JSON file (byte {cause.start} is no {cause.encoding.upper()})") from None
    except json.JSONDecodeError as cause:
        where = f"line {cause.lineno}, column {cause.colno}"
        raise error(f"{label}: not a readable JSON file ({where}: {cause.msg}{_advice(text, cause.pos)})") from None
    except RecursionError:
        raise error(f"{label}: not a readable JSON file (nested too deeply)") from None
    except ValueError:
        raise error(f"{label}: not a readable JSON file (a number of thousands of digits)") from None
    return values


def _advice(text: str, place: int) -> str:
    """Return what JSON has not, of what people write by hand, where it is that a text cannot be read on from."""
    if text.startswith(("//", "/*", "#"), place):
        return "; JSON has no comments"
    if text.startswith(("]", "}"), place) and text[:place].rstrip().endswith(","):
        return "; JSON has no comma before a closing bracket"
    return ""


def version_fault(version: object, latest: int) -> str:
    """Return in words why a version of a file's format is none that is read; empty for one that is.

    Args:
        version: what the file says.
        latest: newest version that is read; the first one is 1.

    >>> version_fault(1, 2), version_fault(3, 2), version_fault("1", 2)
    ('', 'is 3, this plat reads up to 2: update plat', "is '1', expected 1 or 2")
    """
    if isinstance(version, int | float) and not isinstance(version, bool):
        if version in range(1, latest + 1):
            return ""
        if version > latest and version == version // 1:
            return f"is {short(version)}, this plat reads up to {latest}: update plat"
    return f"is {short(version)}, expected {' or '.join(map(str, range(1, latest + 1)))}"


def short(value: object) -> str:
    """Return ``repr(value)``, cut where it is long, for messages of one line.

    >>> short([1, 2]), len(short("x" * 1000)) < 80
    ('[1, 2]', True)
    """
    # arrays are written over several lines
    text = " ".join(shown(value, _SHORT.repr).encode("utf-8", "backslashreplace").decode().split())
    return text if len(text) <= _MOST_LETTERS else f"{text[:_MOST_LETTERS]} ..."
