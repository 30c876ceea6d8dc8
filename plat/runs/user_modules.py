"""Modules of users, which register policy classes of their own."""

import importlib
import os
import sys
from collections.abc import Sequence

from plat.bounds import as_names
from plat.errors import ConfigError

__all__ = ["import_modules"]


def import_modules(names: Sequence[str]) -> None:
    """Import modules by name, from the working directory as well.

    Args:
        names: dotted names, such as ``"my_package.policies"``.

    Raises:
        ConfigError: naming the module that cannot be imported, and why.

    >>> import_modules(["json"])
    """
    if names and not {"", os.getcwd()} & set(sys.path):
        sys.path.append(os.getcwd())
    for name in as_names(names):
        try:
            importlib.import_module(name)
        except Exception as error:  # the module is a user's: it may raise anything
            what = f"{type(error).__name__}: {error}".splitlines()[0]
            raise ConfigError(
                f"--import {name}: {what}; expected a module that Python finds here or on PYTHONPATH"
            ) from error
