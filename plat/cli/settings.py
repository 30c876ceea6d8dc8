"""Settings from a command line: parse the dataclass of a command, and run it."""

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import tyro

__all__ = ["parse", "run"]


def parse(kind: Any, args: Sequence[str] | None = None, prog: str | None = None) -> Any:
    """Return the settings of a command.

    Args:
        kind: dataclass of the settings, or a union of dataclasses for a command with commands of its own.
        args: command line behind the command's name, by default the program's own.
        prog: how help and errors call the program.
    """
    # what is behind a subcommand, as of --task.noise, may be followed by other settings
    return tyro.cli(kind, args=args, prog=prog, config=(tyro.conf.CascadeSubcommandArgs,))


def run(module: str, args: Sequence[str], prog: str) -> None:
    """Import the module of a command, parse its settings, and run it; user errors end the program with one line."""
    command = import_module(module)
    settings = parse(command.COMMAND, args, prog)
    from plat.runs.recipe import report_errors  # torch: not for a help text

    with report_errors():
        command.main(settings)
