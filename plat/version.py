"""Installed version of plat."""

from importlib.metadata import PackageNotFoundError, version

__all__ = ["__version__"]

try:
    __version__ = version("plat-rl")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0.0.0"
