"""Command lines that messages of plat advise are valid ones."""

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from plat.cli import COMMANDS
from plat.cli.settings import parse
from tests.cli.settings import dataclasses_in, settings_of

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for folder in ("plat", "recipes") for path in (ROOT / folder).rglob("*.py"))
COMMAND = rf"plat (?P<name>{'|'.join(sorted(COMMANDS, key=len, reverse=True))})\b"
OPTION_OF = re.compile(rf"(--[a-z][\w.-]*) of\s({COMMAND.replace('?P<name>', '?:')}[^();]*)")
FILLED_IN = "1"
"""Stands for what a message fills in: it may be a file, a name and a number."""


def texts(path: Path) -> Iterator[str]:
    """Yield the texts of a source that are no docstrings, with what f-strings fill in."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else FILLED_IN for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not {id(node)} & (inside | alone):
            yield node.value


def advised(text: str) -> Iterator[list[str]]:
    """Yield the command lines in a text: a command, what follows it up to the next word of prose, without ``plat``."""
    for match in re.finditer(COMMAND, text):
        line = re.split(r"[;:,()`]|\. |\.$", text[match.end() :])[0]
        words, rest = [match["name"]], line.split() if line[:1] == " " else []
        if own := subcommands(match["name"]):
            if not rest or rest[0] not in own:
                continue  # no more than its name
            words.append(rest.pop(0))
        for before, word in zip([words[-1], *rest], rest, strict=False):
            if not (before.startswith("--") or word.startswith("--") or re.search(r"[A-Z\d./]", word)):
                break
            words.append(word)
        yield words


def subcommands(command: str) -> list[str]:
    """Return the names of the commands of a command; none where it is alone."""
    kinds = dataclasses_in(COMMANDS[command].kind())
    names = [re.sub(r"(?<=.)([A-Z])", r"-\1", kind.__name__).lower().removesuffix("-keyframes") for kind in kinds]
    return names if len(names) > 1 else []


LINES = [(path, words) for path in SOURCES for text in texts(path) for words in advised(text) if len(words) > 1]


def test_there_are_some():
    assert len(LINES) > 8
    assert list(advised("do it: plat keyframes around a.json --out b.json puts one between")) == [
        ["keyframes", "around", "a.json", "--out", "b.json"]
    ]


@pytest.mark.parametrize(("path", "words"), LINES, ids=[shlex.join(words) for _, words in LINES])
def test_what_is_advised_can_be_run(path, words):
    known = {f"--{name.replace('_', '-')}" for name, _ in settings_of(words[0])}
    for word in words:
        assert not word.startswith("--") or word in known, f"{path}: plat {words[0]} has no {word}"
    behind = words[2 if subcommands(words[0]) else 1 :]
    if behind and not behind[0].startswith("--"):  # it begins with its files: to be copied as it is
        assert parse(COMMANDS[words[0]].kind(), words[1:]) is not None


def test_options_of_named_commands_exist():
    for path in SOURCES:
        for text in texts(path):
            for option, named in OPTION_OF.findall(text):
                for command in re.findall(COMMAND, named):
                    known = {f"--{name.replace('_', '-')}" for name, _ in settings_of(command)}
                    assert option in known, f"{path}: plat {command} has no {option}"


def test_what_reads_motions_names_the_command_of_an_option():
    """Every command that takes motions reads them, and most have no options that say how."""
    own = {
        "validation.py",  # the verdicts of plat motions inspect
        "clock.py: --fps",  # the source of a rate
        "capture_axes.py: --map",  # beside --up, of plat motions retarget
    }
    bare = {
        f"{path.name}: {option}"
        for path in (ROOT / "plat" / "motions").rglob("*.py")
        for text in texts(path)
        for option in re.findall(r"(?<![\w-])--[a-z][\w.-]+", text)
        if not re.search(rf"{COMMAND}[^;]* {option}", text)
    }
    assert {one for one in bare if not {one, one.partition(":")[0]} & own} == set()
