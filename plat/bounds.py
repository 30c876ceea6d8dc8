"""Bounds of settings: declared in the type of a dataclass field, checked when an instance is made."""

from __future__ import annotations

import dataclasses
import math
import numbers
import os
import reprlib
import types
import typing
from collections.abc import Callable, Iterable
from functools import cache
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from plat.errors import ConfigError, RobotError

__all__ = [
    "Ascending",
    "Bounded",
    "Count",
    "Fraction",
    "Layers",
    "Natural",
    "NonNegative",
    "NotEmpty",
    "Positive",
    "Range",
    "Robots",
    "Seed",
    "Within",
    "as_names",
    "check_fields",
    "check_robot",
    "check_value",
    "is_finite",
    "shown",
]


@dataclasses.dataclass(frozen=True)
class Range:
    """Range of a number, both ends included.

    Attributes:
        low: smallest value.
        high: largest value.
        above: whether ``low`` itself is excluded.
        below: whether ``high`` itself is excluded.
        infinite: whether infinity is a value.
    """

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    below: bool = False
    infinite: bool = False

    def holds(self, value: float) -> bool:
        """Return whether a number lies in the range."""
        if not is_finite(value, or_infinite=self.infinite):
            return False
        enough = value > self.low if self.above else value >= self.low
        return enough and (value < self.high if self.below else value <= self.high)

    def __str__(self) -> str:
        low, high = (f"{end:,.12g}" for end in (self.low, self.high))
        if self.low == -math.inf:
            return "" if self.high == math.inf else f"below {high}" if self.below else f"of at most {high}"
        if self.high == math.inf:
            return f"above {low}" if self.above else f"of at least {low}"
        if self.below:
            return f"{'above' if self.above else 'of at least'} {low} and below {high}"
        return f"above {low} and at most {high}" if self.above else f"from {low} to {high}"


@dataclasses.dataclass(frozen=True)
class Ascending:
    """Bound on a tuple of numbers: none is smaller than the one before it."""

    def holds(self, values: tuple[float, ...]) -> bool:
        """Return whether the numbers are in order."""
        return list(values) == sorted(values)

    def __str__(self) -> str:
        return "in ascending order"


@dataclasses.dataclass(frozen=True)
class NotEmpty:
    """Bound on a tuple: it has an item."""

    def holds(self, values: tuple[Any, ...]) -> bool:
        """Return whether there is one."""
        return len(values) > 0

    def __str__(self) -> str:
        return "and at least one"


Positive: TypeAlias = Annotated[float, Range(0, above=True)]
"""Number above 0."""
NonNegative: TypeAlias = Annotated[float, Range(0)]
"""Number that is not negative."""
Fraction: TypeAlias = Annotated[float, Range(0, 1)]
"""Number from 0 to 1."""
Count: TypeAlias = Annotated[int, Range(1)]
"""Whole number above 0."""
Natural: TypeAlias = Annotated[int, Range(0)]
"""Whole number that is not negative."""
Seed: TypeAlias = Annotated[int, Range(0, 2**32 - 1)]
"""Seed of a random number generator; all of them take 32 bits."""
Robots: TypeAlias = Annotated[int, Range(1, 65_536)]
"""Number of robots that are simulated at a time."""
Layers: TypeAlias = tuple[Annotated[int, Range(1, 65_536)], ...]
"""Sizes of hidden layers."""
Within: TypeAlias = Annotated[tuple[Annotated[float, Range(0)], Annotated[float, Range(0)]], Ascending()]
"""Lower and upper end of a range of numbers that are not negative."""

Name = TypeVar("Name")
_Check: TypeAlias = Callable[[Any], bool]


class Bounded:
    """Base class of settings whose fields are checked when an instance is made.

    Types are checked, and the bounds that stand in ``typing.Annotated``. Numbers are finite unless a :class:`Range`
    says otherwise. A subclass with checks of its own calls ``super().__post_init__()`` first.

    Raises:
        ConfigError: naming the field, its value and what would be right.

    >>> @dataclasses.dataclass(frozen=True)
    ... class Discount(Bounded):
    ...     gamma: Fraction = 0.99
    >>> Discount(2.0)
    Traceback (most recent call last):
    ...
    plat.errors.ConfigError: Discount: gamma is 2.0, expected a number from 0 to 1
    """

    def __post_init__(self) -> None:
        """Check the fields."""
        check_fields(self)


def check_fields(settings: Any) -> None:
    """Check every field of a dataclass instance against its type and bounds.

    Raises:
        ConfigError: naming the first field that does not fit.
    """
    for name, (holds, expected) in _checks(settings.__class__).items():
        value = getattr(settings, name)
        if not holds(value):
            raise ConfigError(f"{type(settings).__name__}: {name} is {shown(value)}, expected {expected}".rstrip())


def check_value(what: str, value: Any, hint: Any) -> None:
    """Check one value against a type with bounds.

    Args:
        what: names the value; begins the message.
        value: the value.
        hint: its type, such as :data:`Positive`.

    Raises:
        ConfigError: saying what would be right.

    >>> check_value("noise: init_std", 0.0, Positive)
    Traceback (most recent call last):
    ...
    plat.errors.ConfigError: noise: init_std is 0.0, expected a number above 0
    """
    holds, expected = _check(hint)
    if not holds(value):
        raise ConfigError(f"{what} is {shown(value)}, expected {expected}")


def check_robot(robot: object) -> None:
    """Raise where something else stands in a robot's place, such as its name.

    Raises:
        RobotError: naming what it is.

    >>> check_robot("g1")
    Traceback (most recent call last):
    plat.errors.RobotError: robot is 'g1', expected a Robot, as plat.robots.get_robot('g1') returns it
    """
    if not hasattr(robot, "joint_names"):
        made = f", as plat.robots.get_robot({shown(robot)}) returns it" if isinstance(robot, str) else ""
        raise RobotError(f"robot is {shown(robot)}, expected a Robot{made}")


def as_names(names: Iterable[Name]) -> tuple[Name, ...]:
    """Return names as a tuple; a single text is one name, and not one for each letter.

    >>> as_names("parts"), as_names(["parts", "clock"])
    (('parts',), ('parts', 'clock'))
    """
    return (names,) if isinstance(names, str) else tuple(names)  # type: ignore[return-value]


def is_finite(value: Any, *, or_infinite: bool = False) -> bool:
    """Return whether a value is a finite number that a float can hold; truth values and arrays are none.

    Args:
        value: anything.
        or_infinite: take infinity as well.

    >>> is_finite(1), is_finite(float("inf")), is_finite(10**400), is_finite("1"), is_finite(True)
    (True, False, False, False, False)
    """
    # a single number of NumPy or torch has a type as well
    if isinstance(value, bool) or getattr(value, "ndim", 0) != 0 or str(getattr(value, "dtype", "")).endswith("bool"):
        return False
    try:
        return math.isfinite(value) or (or_infinite and math.isinf(value))
    except (OverflowError, TypeError, ValueError):  # a whole number of hundreds of digits; no number
        return False


def shown(value: Any, brief: Callable[[Any], str] = reprlib.repr) -> str:
    """Return a value as ``brief`` shows it, for messages.

    >>> shown([1, 2])
    '[1, 2]'
    """
    try:
        return brief(value)
    except ValueError:  # Python shows no whole number of thousands of digits
        return "a number of thousands of digits"


@cache
def _checks(kind: type) -> dict[str, tuple[_Check, str]]:
    """Return the check of each field, and what it expects in words."""
    try:
        hints = typing.get_type_hints(kind, include_extras=True)
    except NameError:  # a class of the user's own, whose types are imported for a type checker only
        return {}
    return {field.name: _check(hints[field.name]) for field in dataclasses.fields(kind)}


def _check(hint: Any) -> tuple[_Check, str]:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin is Annotated:
        return _bounded(args[0], [bound for bound in args[1:] if isinstance(bound, Range | Ascending | NotEmpty)])
    if origin in (typing.Union, types.UnionType):
        parts = [_check(arg) for arg in args]
        return (lambda value: any(holds(value) for holds, _ in parts)), " or ".join(text for _, text in parts if text)
    if origin is Literal:
        return (lambda value: isinstance(value, str) and value in args), f"one of {', '.join(map(str, args))}"
    if origin is tuple:
        return _tuple(args)
    if hint is type(None):
        return (lambda value: value is None), "None"
    if hint is float:
        return (lambda value: _is(numbers.Real, value) and is_finite(value)), "a number"
    if hint is int:
        return (lambda value: _is(numbers.Integral, value)), "a whole number"
    if hint is bool:
        return (lambda value: isinstance(value, bool)), "True or False"
    if hint is str:
        return (lambda value: isinstance(value, str)), "a text"
    if isinstance(hint, type) and issubclass(hint, os.PathLike):
        return (lambda value: isinstance(value, os.PathLike)), "a path"
    if isinstance(hint, type) and hint is not object and not getattr(hint, "_is_protocol", False):
        article = "an" if hint.__name__[0] in "AEIOU" else "a"
        return (lambda value: isinstance(value, hint)), f"{article} {hint.__name__}"
    return (lambda value: True), ""


def _bounded(hint: Any, bounds: list[Any]) -> tuple[_Check, str]:
    holds, expected = _check(hint)
    if hint is float and any(isinstance(bound, Range) and bound.infinite for bound in bounds):
        holds = lambda value: _is(numbers.Real, value) and is_finite(value, or_infinite=True)  # noqa: E731
    text = " ".join([expected, *filter(None, map(str, bounds))])
    return (lambda value: holds(value) and all(bound.holds(value) for bound in bounds)), text


def _tuple(args: tuple[Any, ...]) -> tuple[_Check, str]:
    if len(args) == 2 and args[1] is Ellipsis:
        holds, expected = _check(args[0])
        return (lambda value: isinstance(value, tuple | list) and all(map(holds, value))), f"a tuple, each {expected}"
    parts = [_check(arg) for arg in args]
    texts = list(dict.fromkeys(text for _, text in parts))
    expected = f"{len(parts)} values, {'each ' if len(texts) == 1 else ''}{', '.join(texts)}"

    def fits(value: Any) -> bool:
        return (
            isinstance(value, tuple | list)
            and len(value) == len(parts)
            and all(holds(item) for (holds, _), item in zip(parts, value, strict=True))
        )

    return fits, expected


def _is(kind: type, value: Any) -> bool:
    """Return whether a value is a number of a kind; truth values are none."""
    return isinstance(value, kind) and not isinstance(value, bool)
