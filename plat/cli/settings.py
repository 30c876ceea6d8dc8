"""Settings from a command line: parse the dataclass of a command, and run it."""

import argparse
import dataclasses
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import tyro

from plat.cli.compact import registry
from plat.runs.recipe import report_errors

__all__ = ["parse", "run"]


def parse(kind: Any, args: Sequence[str] | None = None, prog: str | None = None) -> Any:
    """Return the settings of a command.

    Args:
        kind: dataclass of the settings, or a union of dataclasses for a command with commands of its own. One with
            ``presets`` takes ``--preset NAME``, wherever it stands; settings beside it override the preset's.
        args: command line behind the command's name, by default the program's own.
        prog: how help and errors call the program.
    """
    args = list(sys.argv[1:] if args is None else args)
    options: dict[str, Any] = {}
    if presets := getattr(kind, "presets", {}):
        names = argparse.ArgumentParser(add_help=False, allow_abbrev=False, prog=prog)
        names.add_argument("--preset", choices=list(presets))
        chosen, args = names.parse_known_args(args)
        options["description"] = f"{kind.__doc__} --preset {{{','.join(presets)}}} chooses the defaults."
        if chosen.preset is not None:
            required = {
                field.name: tyro.MISSING
                for field in dataclasses.fields(kind)
                if field.default is field.default_factory is dataclasses.MISSING
            }
            options["default"] = kind(**required, **presets[chosen.preset])
    with registry(), _plain_help():
        return tyro.cli(kind, args=args, prog=prog, **options)


class _PlainOutput:
    """Stream that leaves out the double backquotes of docstrings and keeps the frames of help texts in place."""

    def __init__(self, stream: Any):
        self._stream = stream

    def write(self, text: str) -> int:
        # padding in the place of the quotes keeps the right edge of a frame straight
        self._stream.write(re.sub(r"[^│\n]*``[^│\n]*", self._plain, text))
        return len(text)

    @staticmethod
    def _plain(cell: re.Match[str]) -> str:
        return cell[0].replace("``", "").ljust(len(cell[0]))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def _plain_help() -> Iterator[None]:
    stream = sys.stdout
    sys.stdout = _PlainOutput(stream)
    try:
        yield
    finally:
        sys.stdout = stream


def run(module: str, kind: Any, args: Sequence[str], prog: str) -> None:
    """Parse the settings of a command, import its module and run it; user errors end the program with one line."""
    settings = parse(kind, args, prog)
    with report_errors():
        import_module(module).main(settings)
