"""Griffe extension: docstrings of plat as Markdown for the reference.

Examples become code blocks, and roles such as ``:class:`plat.runs.Run``` become code.
"""

import re
from typing import Any

import griffe

_ROLE = re.compile(r":(?:class|func|meth|attr|data|mod|exc):`~?([^`]+)`")


def as_markdown(text: str) -> str:
    """Return a docstring with its doctests in code fences and its roles as code."""
    lines: list[str] = []
    fenced = False
    for line in _ROLE.sub(r"`\1`", text).splitlines():
        if line.lstrip().startswith(">>>") and not fenced:
            indent = line[: len(line) - len(line.lstrip())]
            lines.append(f"{indent}```pycon")
            fenced = True
        elif fenced and not line.strip():
            lines.append(f"{indent}```")
            fenced = False
        lines.append(line)
    if fenced:
        lines.append(f"{indent}```")
    return "\n".join(lines)


class Docstrings(griffe.Extension):
    """Rewrites the docstring of every object that is loaded."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite an object's docstring, if it has one."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)
