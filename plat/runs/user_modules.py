"""Modules of users, which register policy classes of their own."""

import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, TypeAlias

import tyro

from plat.bounds import as_names
from plat.errors import ConfigError

__all__ = ["Imports", "import_modules", "imported_code"]

Imports: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(name="import"), tyro.conf.UseAppendAction]
"""Modules to import before a policy is loaded: ``--import NAME`` for each."""

_imported: set[str] = set()


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
        _imported.add(name)


def imported_code() -> list[bytes]:
    """Return the source of all modules of users that were imported, of a package that of every file in it.

    Records of policies that are defined there are theirs for as long as it stays the same.

    >>> import_modules(["json"])
    >>> len(imported_code()) > 3
    True
    """
    files: set[Path] = set()
    for module in filter(None, map(sys.modules.get, _imported)):
        files.update(path for folder in getattr(module, "__path__", ()) for path in Path(folder).rglob("*.py"))
        if file := getattr(module, "__file__", None):
            files.add(Path(file))
    return [file.read_bytes() for file in sorted(files)]
