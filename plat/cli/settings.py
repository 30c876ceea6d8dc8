"""Settings from a command line: parse the dataclass of a command, and run it."""

import argparse
import dataclasses
import io
import itertools
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, suppress
from importlib import import_module
from typing import Any

import tyro

import plat.headless  # noqa: F401 - before MuJoCo
from plat.cli.compact import registry
from plat.errors import PlatError
from plat.runs.recipe import report_errors
from plat.streams import ReaderLeft
from plat.words import no_command

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
        names.add_argument("--preset", nargs="?", default=None, const="")
        chosen, args = names.parse_known_args(args)
        if chosen.preset not in (None, *presets):
            sys.exit(f"error: --preset {chosen.preset!r}: expected one of {', '.join(presets)}")
        options["description"] = f"{kind.__doc__} --preset {{{','.join(presets)}}} chooses the defaults."
        if chosen.preset is not None:
            required = {
                field.name: tyro.MISSING
                for field in dataclasses.fields(kind)
                if field.default is field.default_factory is dataclasses.MISSING
            }
            options["default"] = _unchecked(kind, {**required, **presets[chosen.preset]})
    try:
        with registry(), _plain_help(), redirect_stderr(io.StringIO()):
            return tyro.cli(kind, args=args, prog=prog, **options)
    except ReaderLeft:
        raise
    except SystemExit as end:
        if not end.code:  # a help text
            raise
    except PlatError as error:
        sys.exit(f"error: {in_flags(str(error))}; see {prog or 'plat'} --help")
    told = _complaint(kind, args, prog, options)
    if args and not args[0].startswith("-") and not dataclasses.is_dataclass(kind):
        known = re.findall(r"[\w-]+", _complaint(kind, [], prog, options).partition("{")[2].partition("}")[0])
        if args[0] not in known:
            told = no_command(args[0], prog or "plat", known)
    sys.exit(f"error: {in_flags(told)}")


def _complaint(kind: Any, args: Sequence[str], prog: str | None, options: Mapping[str, Any]) -> str:
    with registry(), _wide(), redirect_stderr(io.StringIO()) as told, suppress(SystemExit):
        tyro.cli(kind, args=args, prog=prog, **options)
    return one_line(told.getvalue())


def one_line(box: str) -> str:
    """Return the message in a framed text of tyro.

    >>> one_line("╭─ Value error ─╮\\n│ Error parsing --seed: no │\\n│ ──── │\\n│ plat demo --help │\\n╰────╯")
    '--seed: no; see plat demo --help'
    """
    # the frame is of spaces where the screen has no lines to draw with
    lines = [line.replace("│", " ").rstrip("╮╯ ") for line in box.splitlines()][1:]
    inside = list(itertools.takewhile(lambda line: not _is_rule(line), itertools.dropwhile(_is_rule, lines)))
    if inside and inside[0].strip().startswith("Missing from"):
        inside = ["missing: " + ", ".join(line.strip() for line in inside if re.match(r" {6}\S", line))]
    text = " ".join(line.strip() for line in inside).removeprefix("Error parsing ")
    similar = re.split("Perhaps you meant|Arguments similar", "\n".join(lines), maxsplit=1)[1:]
    if meant := re.findall(r"^ +(--[a-z][\w.-]+)", "".join(similar), re.MULTILINE):
        text += f"; perhaps you meant {' or '.join(dict.fromkeys(meant))}"
    # of what may be left out: only what was wrong with it as a value
    text = re.sub(r"no type matching .* - [^:]*: (?=\S)", "", text)
    text = text.replace("invalid literal for int() with base 10:", "expected a whole number, not")
    # of several values tyro does not say which is wrong, and why
    several = r"Could not (?:find valid parse for arguments: |parse arguments )(\[.*?\])(?: into .*)?$"
    kind = re.search(r"^ +--[\w.-]+ \[?(INT|FLOAT)\b", "\n".join(lines), re.MULTILINE)
    told = {"INT": "whole numbers, not", "FLOAT": "numbers, not"}[kind[1]] if kind else "other values than"
    text = re.sub(several, rf"expected {told} \1", text)
    text = text.replace("could not convert string to float:", "expected a number, not")
    helped = re.search(r"plat [\w -]+ --help", box)
    return text.rstrip(".") + (f"; see {helped[0]}" if helped else "")


def _is_rule(line: str) -> bool:
    return bool(line.strip()) and not set(line.strip()) - {"─", "-"}


def in_flags(message: str) -> str:
    """Return a message about a field of a dataclass with the flag in its place.

    >>> in_flags("ppo: PPOConfig: min_lr is 2, expected less"), in_flags("DemoRecipe: num_envs is 0")
    ('--ppo.min-lr is 2, expected less', '--num-envs is 0')
    """
    found = re.match(r"(?:-*([a-z][\w.-]+): )?(?:[A-Z]\w+: |timing: )+([\w.]+) is (.*)", message, re.DOTALL)
    if found is None:
        return message
    group, field, rest = found.groups()
    return f"--{f'{group}.' if group else ''}{field} is ".replace("_", "-") + rest


def _unchecked(kind: Any, values: Mapping[str, Any]) -> Any:
    """Return settings of which some are missing yet, so that their bounds cannot be checked."""
    settings = object.__new__(kind)
    for field in dataclasses.fields(kind):
        made = field.default_factory() if field.default_factory is not dataclasses.MISSING else field.default
        setattr(settings, field.name, values.get(field.name, made))
    return settings


@contextmanager
def _wide() -> Iterator[None]:
    """Keep tyro from breaking lines in the middle of a word."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "4000"
    try:
        yield
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before


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
        command = import_module(module)
        command.main(settings)
        if hasattr(command, "after"):  # not in main: a recipe that runs several stages says what is next itself
            print(command.after(settings))
