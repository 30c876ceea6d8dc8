"""JSON objects of a run directory."""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plat import json_file
from plat.errors import CheckpointError
from plat.files import replace_file

__all__ = ["entry", "plain", "read_json", "write_json"]

_HALVES = re.compile("[\ud800-\udfff]")


def read_json(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file.

    Raises:
        CheckpointError: when the file is missing, broken, or holds something else.
    """
    if path.parent.is_file():
        raise CheckpointError(f"{str(path.parent)!r}: is a file, expected a run directory with config.json")
    if not path.exists():
        bundle = (path.parent / "bundle.json").is_file()
        told = "; this is a bundle: give the run that it was exported from" if bundle else ""
        raise CheckpointError(f"{str(path)!r}: no such file, expected a run directory with config.json{told}")
    content = json_file.read_json(path, CheckpointError, repr(str(path)))
    if not isinstance(content, dict):
        raise CheckpointError(f"{str(path)!r}: holds a {type(content).__name__}, expected an object")
    return content


def entry(content: Mapping[str, Any], name: str, kind: Any, path: Path) -> Any:
    """Return an entry of a JSON object; None where there is none.

    Args:
        content: of the file.
        name: of the entry.
        kind: type that it has to have.
        path: the file, for messages.

    Raises:
        CheckpointError: naming file and field, when it has another type.

    >>> entry({"steps": 3}, "steps", int, Path("config.json"))
    3
    """
    from pydantic import TypeAdapter, ValidationError  # not at the top: help texts do without it

    if name not in content:
        return None
    try:
        return TypeAdapter(kind).validate_python(content[name])
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(map(str, (name, *first["loc"])))
        if first["type"] == "missing":
            raise CheckpointError(f"{str(path)!r}: {field} is missing") from None
        told = first["msg"].removeprefix("Input should be ")
        expected = "an object" if first["type"] in ("dataclass_type", "dict_type") else told
        raise CheckpointError(
            f"{str(path)!r}: {field} is {json_file.short(first['input'])}, expected {expected}"
        ) from None


def plain(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return values as they come back from a JSON file: lists for tuples, and names that are no text made readable.

    >>> plain({"out": "K\\udcf6ln", "hidden": (8, 8)})
    {'out': 'K\\\\udcf6ln', 'hidden': [8, 8]}
    """
    text = json.dumps(content, ensure_ascii=False)
    return json.loads(_HALVES.sub(lambda half: f"\\\\u{ord(half[0]):04x}", text))


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a JSON object; the file is replaced atomically or not at all.

    Raises:
        CheckpointError: when the disk does not take it; what was there before is intact.
    """
    text = json.dumps(plain(content), indent=2) + "\n"
    try:
        replace_file(path, lambda part: part.write_text(text))
    except OSError as error:
        reason = error.strerror or error
        raise CheckpointError(f"{str(path)!r} could not be written ({reason}); the file before it is intact") from error
