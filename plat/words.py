"""Numbers of things in words, and names in tables, for messages."""

from collections.abc import Iterable
from difflib import get_close_matches
from numbers import Integral

__all__ = ["beyond", "counted", "in_cell", "in_table", "no_command", "percent", "perhaps"]


def beyond(value: float, limit: float, digits: int = 2) -> str:
    """Return a number that is beyond a limit, with as many digits as show it.

    >>> beyond(0.3456, 0.2), beyond(0.2013, 0.2)
    ('0.35', '0.201')
    """
    while float(shown := f"{value:.{digits}f}") <= limit < value:
        digits += 1
    return shown


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


def in_table(name: str | None) -> str:
    r"""Return a name as it stands in a row of a table, where a line break or a terminal's command would be another.

    >>> in_table("wave\n1"), in_table("\x1b[31mred"), in_table("hält"), in_table(None)
    ('wave\\n1', '\\x1b[31mred', 'hält', '')
    """
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in name or "")


def in_cell(text: str) -> str:
    r"""Return a text as it stands in a cell of a Markdown table, where a bar would begin another one.

    >>> in_cell("run|walk\n1")
    'run\\|walk\\n1'
    """
    return in_table(text).replace("|", r"\|")


def percent(value: float, digits: int = 1) -> str:
    """Return a percentage for a table; only what is 0 is rounded to 0, and only what is 100 to 100.

    One of 10,000 commands that was missed would otherwise stand there as none.

    Args:
        value: in percent.
        digits: behind the point.

    >>> percent(99.99), percent(100.0), percent(0.003), percent(0.0), percent(12.34)
    ('99.9', '100.0', '0.1', '0.0', '12.3')
    """
    shown, least = f"{value:.{digits}f}", 10.0**-digits
    if value < 100 <= float(shown):
        return f"{100 - least:.{digits}f}"
    return f"{least:.{digits}f}" if value > 0 and float(shown) == 0 else shown


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


def no_command(name: str, program: str, known: Iterable[str]) -> str:
    """Return in words that a program has no such command, with those that it has and the nearest of them.

    >>> no_command("evalute", "plat", ["evaluate", "play"])
    "'evalute' is no command of plat, expected one of evaluate, play, perhaps 'evaluate'; see plat --help"
    """
    names = list(known)
    expected = f"{', '.join(names)}{perhaps(name, names)}"
    return f"{name!r} is no command of {program}, expected one of {expected}; see {program} --help"
