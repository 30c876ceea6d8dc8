"""Autosave: a copy of unsaved keyframes, for the case that the studio or the browser ends."""

import time
from pathlib import Path

from plat.errors import PlatError
from plat.studio.session import Session

__all__ = ["AUTOSAVE", "Autosave"]

AUTOSAVE = "keyframes.autosave.json"
"""Name of the file."""
_AFTER = 2.0
"""Seconds without an edit after which the copy is written."""


class Autosave:
    """Copy of the keyframes in a file of its own, written some seconds after an edit.

    Args:
        session: whose keyframes they are.
        folder: of the file.
    """

    def __init__(self, session: Session, folder: Path):
        self._session = session
        self.path = folder / AUTOSAVE
        """The file."""
        self.words = ""
        """When it was written, or why it could not be."""
        self.former: bytes | None = self._read()
        """Content of the file that a former studio left; this one may write over it."""
        self._edited_at: float | None = None
        self._last = session.timeline

    def _read(self) -> bytes | None:
        try:
            return self.path.read_bytes()
        except OSError:
            return None

    def tick(self, at_once: bool = False) -> bool:
        """Write the copy when it is due, or at once; return whether something was written."""
        now = self._session.timeline
        if (now.start, now.keyframes, now.holds) != (self._last.start, self._last.keyframes, self._last.holds):
            self._last, self._edited_at = now, time.monotonic()
        if self._edited_at is None or (time.monotonic() - self._edited_at < _AFTER and not at_once):
            return False
        self._edited_at = None
        if not self._session.unsaved:
            return False
        try:
            self._session.write(self.path)
            self.words = f"autosaved {time.strftime('%H:%M:%S')}"
        except (PlatError, OSError) as error:
            self.words = f"not autosaved: {error}"
        return True
