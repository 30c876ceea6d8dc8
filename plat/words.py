"""Numbers of things in words, for messages."""

from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Integral

__all__ = ["counted", "perhaps"]


def counted(number: float, what: str, many: str = "") -> str:
    """Return a number of things in words.

    Args:
        number: how many there are.
        what: one of them.
        many: several of them; by default with an ``s``.

    >>> counted(1, "pose"), counted(2000, "pose"), counted(0.5, "minute"), counted(2, "policy", "policies")
    ('1 pose', '2,000 poses', '0.5 minutes', '2 policies')
    """
    shown = f"{number:,}" if isinstance(number, Integral) else f"{number:g}"
    return f"{shown} {what if number == 1 else many or what + 's'}"


def perhaps(name: object, known: Iterable[str]) -> str:
    """Return the end of a message about a name that is none of some: the nearest of them, if one is near.

    Args:
        name: what was given.
        known: names that there are.

    >>> perhaps("root_heigth", ["asset", "root_height"]), perhaps("x", ["asset"])
    (", perhaps 'root_height'", '')
    """
    near = get_close_matches(str(name), list(known), n=1)
    return f", perhaps {near[0]!r}" if near else ""
