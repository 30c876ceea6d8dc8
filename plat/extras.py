"""Packages of plat's extras: one line where one is not installed, another where it is and cannot be imported."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from plat.errors import PlatError

__all__ = ["importing", "require"]


@contextmanager
def importing(extra: str, what: str, error: type[Exception] = PlatError) -> Iterator[None]:
    """Raise an error of one line where what is imported within the block cannot be.

    Args:
        extra: name of the extra that has the packages.
        what: who needs them, with its verb: it begins the message.
        error: kind of error.

    Raises:
        PlatError: or ``error``: with the command that installs the extra where a package is missing, and with the
            package's own words where it is installed and broken.

    >>> with importing("figures", "figures need"):
    ...     import no_such_package
    Traceback (most recent call last):
    plat.errors.PlatError: figures need: pip install 'plat-rl[figures]'
    """
    try:
        yield
    except ImportError as failure:
        raise error(_told(extra, what, failure)) from failure


def require(extra: str, what: str, *packages: str, error: type[Exception] = PlatError) -> None:
    """Raise an error of one line where one of several packages is not installed; it imports none of them.

    Args:
        extra: name of the extra that has the packages.
        what: who needs them, with its verb: it begins the message.
        packages: names to import.
        error: kind of error.

    Raises:
        PlatError: or ``error``: with the command that installs the extra.

    >>> require("figures", "figures need", "json", "no_such_package")
    Traceback (most recent call last):
    plat.errors.PlatError: figures need: pip install 'plat-rl[figures]'
    """
    if any(find_spec(package) is None for package in packages):
        raise error(_command(extra, what))


def _command(extra: str, what: str) -> str:
    return f"{what}: pip install 'plat-rl[{extra}]'"


def _told(extra: str, what: str, failure: ImportError) -> str:
    package = (failure.name or "").partition(".")[0]
    if isinstance(failure, ModuleNotFoundError) and package and find_spec(package) is None:
        return _command(extra, what)
    lines = str(failure).strip().splitlines() or [type(failure).__name__]
    return f"{what} packages of 'plat-rl[{extra}]', which are installed and cannot be imported: {lines[0]}"
