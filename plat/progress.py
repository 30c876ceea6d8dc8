"""Progress of long work on standard error: a bar on a terminal, a line from time to time elsewhere."""

import os
import sys
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import suppress
from typing import TextIO, TypeVar

__all__ = ["Progress", "clock", "percent", "tracked"]

T = TypeVar("T")
_WIDTH = 24
_LEAST_WIDTH = 6
# of a terminal that does not say how wide it is
_COLUMNS = 80


class Progress:
    """Progress bar of counted work.

    On a terminal it is a bar on one line, which is gone when the work is done. Elsewhere it is a plain line every
    ``every`` seconds, so that short work prints nothing and a log shows that long work goes on. A stream that is
    closed, full or gone shows nothing, and is no reason to stop the work.

    Args:
        what: name of the work, first on the line.
        total: number of units; None where nobody knows.
        unit: what is counted.
        every: seconds between lines where there is no terminal.
        stream: where it goes; by default standard error.

    >>> with Progress("evaluation", total=4, unit="commands", every=0, stream=sys.stdout) as progress:
    ...     progress.update(2)
    evaluation: 2 of 4 commands, 50 %, ... to go
    """

    def __init__(
        self, what: str, total: int | None = None, unit: str = "", every: float = 5.0, stream: TextIO | None = None
    ):
        self.what, self.total, self.unit = what, total, unit
        self.done = 0
        """Units so far."""
        self._stream = sys.stderr if stream is None else stream  # none in programs without a console
        self._bar = self._stream is not None and not self._stream.closed and self._stream.isatty()
        self._every = 0.1 if self._bar else every
        self._began = self._shown = time.monotonic()
        self._drawn = 0

    def update(self, done: int) -> None:
        """Set the number of units that are done, and show it when it is due."""
        self.done = done
        now = time.monotonic()
        if now - self._shown >= self._every:
            self._shown = now
            self._draw(now - self._began)

    def add(self, units: int = 1) -> None:
        """Count further units."""
        self.update(self.done + units)

    def close(self) -> None:
        """Remove the bar."""
        if self._drawn:
            self._show("\r" + " " * min(self._drawn, self._room()) + "\r")
            self._drawn = 0

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _draw(self, seconds: float) -> None:
        line = f"{self.what}: {self.done:,}"
        share = None
        if self.total:
            share = min(1.0, self.done / self.total)
            left = clock(seconds * (1 - share) / share) if share else "?"
            line += f" of {self.total:,} {self.unit}".rstrip() + f", {percent(share)}, {left} to go"
        else:
            line += f" {self.unit}".rstrip() + f", {clock(seconds)}"
        if not self._bar:
            self._show(line + "\n")
            return
        room = self._room()
        width = min(_WIDTH, room - len(line) - len("[] "))
        if share is not None and width >= _LEAST_WIDTH:
            full = round(width * share)
            line = f"[{'#' * full}{'.' * (width - full)}] {line}"
        line = line[:room]
        self._show("\r" + line.ljust(min(self._drawn, room)))
        self._drawn = len(line)

    def _room(self) -> int:
        """Return how many letters a line of the terminal takes: the next row is not overwritten by what follows."""
        try:
            columns = os.get_terminal_size(self._stream.fileno()).columns
        except (OSError, ValueError):
            columns = 0
        return (columns or _COLUMNS) - 1

    def _show(self, text: str) -> None:
        if self._stream is not None:
            with suppress(OSError, ValueError):
                self._stream.write(text)
                self._stream.flush()


def tracked(items: Iterable[T], what: str, total: int | None = None, unit: str = "") -> Iterator[T]:
    """Yield items and show how many there were, see :class:`Progress`.

    Args:
        items: anything that is iterated over once.
        what: name of the work.
        total: number of items; by default their length where they have one.
        unit: what the items are.

    >>> list(tracked([1, 2, 3], "video", unit="pictures"))
    [1, 2, 3]
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    with Progress(what, total, unit) as progress:
        for item in items:
            yield item
            progress.add()


def clock(seconds: float) -> str:
    """Return a duration as minutes and seconds; ``?`` where it is not known.

    >>> clock(75.2), clock(float("inf"))
    ('1:15', '?')
    """
    if seconds == float("inf"):
        return "?"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"


def percent(share: float) -> str:
    """Return a fraction of work as a whole percentage, rounded down: 100 % is for work that is done.

    >>> percent(0.996), percent(1.0), percent(1.2)
    ('99 %', '100 %', '100 %')
    """
    return f"{int(100 * min(1.0, share) + 1e-9)} %"
