"""Rules for settings on the command line: groups of numbers that few change, reward terms, and paths.

--task.reset-noise root_pos_xy=0.3,yaw=0.1
--task.randomization push_interval=2:6,control_delay=0.25
--task.dense.joint-pos 2.0 0.12
"""

import dataclasses
import types
import typing
from pathlib import Path
from typing import Any

from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from plat.envs.settings import ResetNoise
from plat.envs.transforms.settings import (
    NoiseLevels,
    RandomizationRanges,
    TerminationLimits,
    TrackingLimits,
    TrackingTerm,
)
from plat.envs.transforms.tracking_rewards import Regularization
from plat.files import expand_home
from plat.modules.settings import NormalizerConfig, WalkingReach
from plat.tasks.settings import AuthoredCosts, TrackingCosts

__all__ = ["GROUPS", "group_from_text", "group_text", "registry"]

GROUPS: tuple[type, ...] = (
    AuthoredCosts,
    NoiseLevels,
    NormalizerConfig,
    RandomizationRanges,
    Regularization,
    ResetNoise,
    TerminationLimits,
    TrackingCosts,
    TrackingLimits,
    WalkingReach,
)
"""Dataclasses of numbers that are one flag; fields that are not named have the defaults of the class."""


def group_from_text(kind: type, text: str) -> Any:
    """Return a group of settings from ``NAME=NUMBER,NAME=LOW:HIGH``, or ``default``.

    Raises:
        ValueError: saying which name or number is wrong; tyro shows the message.

    >>> group_from_text(RandomizationRanges, "push_interval=2:6,motor_gain=0.2").push_interval
    (2.0, 6.0)
    """
    if text == "default":
        return kind()
    hints = typing.get_type_hints(kind)
    values: dict[str, Any] = {}
    for pair in text.split(","):
        name, equals, value = pair.strip().partition("=")
        name = name.replace("-", "_")
        if not equals or name not in hints:
            raise ValueError(f"{pair!r}: expected 'default', or NAME=NUMBER with a name of: {', '.join(hints)}")
        if name in values:
            raise ValueError(f"{pair.strip()!r}: expected {name} once")
        values[name] = _value(name, hints[name], value)
    return kind(**values)


def _value(name: str, hint: Any, text: str) -> Any:
    args = typing.get_args(hint)
    if type(None) in args and text == "none":
        return None
    pair = next((one for one in (hint, *args) if typing.get_origin(one) is tuple), None)
    count = len(typing.get_args(pair)) if pair else 1
    try:
        numbers = tuple(float(part) for part in text.split(":"))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise ValueError(
            f"{name}={text}: expected {'a number' if count == 1 else f'{count} numbers with : in between'}"
        )
    return numbers if count > 1 else numbers[0]


def group_text(group: Any) -> str:
    """Return the text that :func:`group_from_text` reads.

    >>> group_text(ResetNoise(yaw=0.1))
    'yaw=0.1'
    """
    standard = type(group)()
    values = {field.name: getattr(group, field.name) for field in dataclasses.fields(group)}
    changed = {name: value for name, value in values.items() if value != getattr(standard, name)}
    return ",".join(f"{name}={_text(value)}" for name, value in changed.items()) or "default"


def _text(value: Any) -> str:
    if value is None:
        return "none"
    numbers = value if isinstance(value, tuple) else (value,)
    return ":".join(f"{number:.12g}" for number in numbers)


def registry() -> ConstructorRegistry:
    """Return tyro's rules for these settings."""
    rules = ConstructorRegistry()
    rules.primitive_rule(_group)
    rules.primitive_rule(_term)
    rules.primitive_rule(_path)
    return rules


def _group(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    parts = typing.get_args(info.type) if info.type_origin in (typing.Union, types.UnionType) else (info.type,)
    kinds = [part for part in parts if part is not type(None)]
    if len(kinds) != 1 or kinds[0] not in GROUPS:
        return None
    kind, optional = kinds[0], type(None) in parts
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="none|NAME=NUMBER,..." if optional else "NAME=NUMBER,...",
        instance_from_str=lambda args: (_optional if optional else group_from_text)(kind, args[0]),
        is_instance=lambda value: isinstance(value, kind) or (optional and value is None),
        str_from_instance=lambda value: ["none" if value is None else group_text(value)],
    )


def _optional(kind: type, text: str) -> Any:
    if text in ("none", "None"):
        return None
    try:
        return group_from_text(kind, text)
    except ValueError as error:
        raise ValueError(str(error).replace("expected 'default'", "expected 'none', 'default'")) from None


def _path(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Path] | None:
    if info.type is not Path:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="PATH",
        instance_from_str=lambda args: _path_from_text(args[0]),
        is_instance=lambda value: isinstance(value, Path),
        str_from_instance=lambda path: [str(path)],
    )


def _path_from_text(text: str) -> Path:
    if not text:  # of a shell's variable that is not set; it would be the working directory
        raise ValueError("is empty, expected a path")
    path = Path(text)
    return expand_home(path) if text.startswith("~") else path  # shells leave that of --out=~/runs as it is


def _term(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[TrackingTerm] | None:
    if info.type is not TrackingTerm:
        return None
    return PrimitiveConstructorSpec(
        nargs=2,
        metavar="WEIGHT SCALE",
        instance_from_str=lambda args: TrackingTerm(float(args[0]), float(args[1])),
        is_instance=lambda value: isinstance(value, TrackingTerm),
        str_from_instance=lambda term: [f"{term.weight:.12g}", f"{term.scale:.12g}"],
    )
