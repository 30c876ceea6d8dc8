"""Numbers of things in words, for messages."""

from numbers import Integral

__all__ = ["counted"]


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
