"""Numbers of things in words, and names in tables, for messages."""

from numbers import Integral

__all__ = ["counted", "in_table"]


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
