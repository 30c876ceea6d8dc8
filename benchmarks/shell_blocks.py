"""Commands in the shell blocks of a Markdown page."""

import re
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

__all__ = ["Call", "calls"]

_PARTS = re.compile(
    r"^## (?P<title>[^\n]*)$|^ *```(?:sh|bash|shell|console)\b[^\n]*\n(?P<block>.*?)^ *```", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Call:
    """Call of plat on a page.

    Attributes:
        words: behind ``plat``.
        section: heading of the second level that it stands under; empty above the first.
        comment: behind it.
    """

    words: tuple[str, ...]
    section: str
    comment: str


def calls(text: str) -> list[Call]:
    """Return the calls of plat on a page in its order, with variables filled in and loops unrolled.

    >>> page = '## a\\n```sh\\nX="--seed 1"\\nfor one in c d; do plat average $one $X; done  # b\\n```'
    >>> for call in calls(page):
    ...     print(*call.words, call.section, call.comment)
    average c --seed 1 a b
    average d --seed 1 a b
    """
    found, section, variables = [], "", dict[str, str]()
    for part in _PARTS.finditer(text):
        if part["title"] is not None:
            section = part["title"]
            continue
        for line in part["block"].replace("\\\n", " ").splitlines():
            line, _, comment = line.strip().removeprefix("$ ").partition(" # ")
            for each in _unrolled(line.strip()):
                words = shlex.split(_filled(each, variables), comments=True)
                if len(words) == 1 and re.match(r"[A-Z][A-Z0-9_]*=", words[0]):
                    name, _, variables[name] = words[0].partition("=")
                elif words[:1] == ["plat"]:
                    found.append(Call(tuple(words[1:]), section, comment.strip()))
    return found


def _unrolled(line: str) -> Iterator[str]:
    """Yield a line, or those that a loop on one line stands for."""
    if (loop := re.fullmatch(r"for (\w+) in ([^;]*); do (.*); done", line)) is None:
        yield line
        return
    name, values, inner = loop.groups()
    for value in values.split():
        yield _filled(inner, {name: value})


def _filled(line: str, variables: Mapping[str, str]) -> str:
    return re.sub(r"\$(\w+)", lambda match: variables.get(match[1], match[0]), line)
