"""Packages whose names are imported when they are asked for: settings and help texts load no torch."""

import ast
import importlib
import sys
from collections.abc import Callable
from importlib.util import find_spec, resolve_name
from pathlib import Path
from types import ModuleType

__all__ = ["lazy"]


def lazy(package: str, other: Callable[[str], object] | None = None) -> None:
    """Import the public names of a package on first use.

    Where they come from is read off the package's own ``if TYPE_CHECKING`` block, which type checkers and readers see
    as well. Call it below that block, in its ``else``.

    Args:
        package: the package, ``__name__``.
        other: gives what goes by any other name, or raises AttributeError.

    >>> import plat.modules
    >>> plat.modules.ExpertConfig.__name__
    'ExpertConfig'
    """
    module = sys.modules[package]
    homes = _homes(package, Path(str(module.__file__)).read_text(encoding="utf-8"))

    def get(name: str) -> object:
        if name in homes:
            value = getattr(importlib.import_module(homes[name]), name)
            module.__dict__[name] = value
            return value
        if not name.startswith("__") and find_spec(f"{package}.{name}") is not None:
            return importlib.import_module(f"{package}.{name}")
        if other is not None:
            return other(name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    class Package(ModuleType):
        """A package that a submodule cannot take a name from: some are called like the function that they hold."""

        def __setattr__(self, name: str, value: object) -> None:
            if not (name in homes and isinstance(value, ModuleType)):
                super().__setattr__(name, value)

        def __dir__(self) -> list[str]:
            return sorted({*super().__dir__(), *homes})

    module.__dict__["__getattr__"] = get
    module.__class__ = Package


def _homes(package: str, source: str) -> dict[str, str]:
    """Return the module of every name that the ``if TYPE_CHECKING`` blocks of a package import."""
    blocks = (node for node in ast.parse(source).body if isinstance(node, ast.If))
    checked = (block for block in blocks if isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING")
    return {
        alias.asname or alias.name: resolve_name("." * node.level + (node.module or ""), package)
        for block in checked
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
