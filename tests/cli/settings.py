"""Settings of every command, as its dataclasses say them."""

import dataclasses
import types
import typing
from collections.abc import Iterator

from tyro._docstrings import get_field_docstring

from plat.cli import COMMANDS
from plat.cli.compact import GROUPS
from plat.envs.transforms import TrackingTerm


def dataclasses_in(kind: typing.Any) -> list[type]:
    """Return the dataclasses that a type is made of."""
    if dataclasses.is_dataclass(kind):
        return [kind]
    if typing.get_origin(kind) is typing.Annotated:
        return dataclasses_in(typing.get_args(kind)[0])
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return [found for part in typing.get_args(kind) for found in dataclasses_in(part)]
    return []


def leaves(kind: type, path: str = "") -> Iterator[tuple[str, str | None]]:
    """Yield the dotted name and the help of every setting in a dataclass."""
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        name = f"{path}{field.name}"
        if nested := [kind for kind in dataclasses_in(hints[field.name]) if kind not in (*GROUPS, TrackingTerm)]:
            for part in nested:
                yield from leaves(part, f"{name}.")
        else:
            yield name, get_field_docstring(kind, field.name, ())


def settings_of(command: str) -> list[tuple[str, str | None]]:
    """Return name and help of every setting of a command."""
    return [leaf for kind in dataclasses_in(COMMANDS[command].kind()) for leaf in leaves(kind)]
