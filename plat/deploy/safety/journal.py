"""Log of interventions: which piece stepped in, when, and why."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["Intervention", "Journal"]

_LOGGER = logging.getLogger("plat.deploy.safety")


@dataclass
class Intervention:
    """Reason for which a piece stepped in, from one time to another."""

    piece: str
    """name of the piece: ``"range"``, ``"watchdog"``, ..."""
    reason: str
    """one line, as it was at first"""
    first: float
    """time of the first step (s)"""
    last: float
    """time of the last step (s)"""
    steps: int = 1
    """number of control steps"""


class Journal:
    """Journal of interventions. Steps in a row are one entry, and one line of Python's logging.

    Args:
        gap: seconds after which the same piece makes a new entry.
        size: number of entries that are kept; the oldest go first.

    >>> journal = Journal()
    >>> for time in (0.0, 0.02, 0.04):
    ...     journal.note(time, "rate", "left_knee: 45 rad/s, at most 30")
    >>> [(entry.piece, entry.steps) for entry in journal]
    [('rate', 3)]
    """

    def __init__(self, gap: float = 0.5, size: int = 1000):
        self._gap = gap
        self._entries: deque[Intervention] = deque(maxlen=size)
        self._open: dict[str, Intervention] = {}

    def note(self, time: float, piece: str, reason: str, *, new: bool = False) -> None:
        """Note that a piece stepped in; ``new`` makes an entry of its own in any case."""
        entry = self._open.get(piece)
        if not new and entry is not None and 0 <= time - entry.last <= self._gap:
            entry.last, entry.steps = time, entry.steps + 1
            return
        entry = self._open[piece] = Intervention(piece, reason, time, time)
        self._entries.append(entry)
        _LOGGER.warning("%.2f s: %s: %s", time, piece, reason)

    def __iter__(self) -> Iterator[Intervention]:
        return iter(list(self._entries))  # steps of another thread may add some

    def __len__(self) -> int:
        return len(self._entries)

    def clear(self) -> None:
        """Forget everything."""
        self._entries.clear()
        self._open.clear()
