"""Options that say nothing on their own."""

from plat.errors import PlatError

__all__ = ["check_effect"]


def check_effect(flag: str, given: object, needed: str, there: object) -> None:
    """Raise an error for an option that was given without what it belongs to.

    Args:
        flag: name of the option.
        given: whether it is another than its default.
        needed: the option, or what else, that it has its effect with.
        there: whether that is there.

    Raises:
        PlatError: naming both.

    >>> check_effect("--seed", True, "--push", False)
    Traceback (most recent call last):
    plat.errors.PlatError: --seed: takes effect only with --push
    """
    if given and not there:
        raise PlatError(f"{flag}: takes effect only with {needed}")
