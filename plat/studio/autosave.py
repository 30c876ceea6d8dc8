"""Autosave: a copy of unsaved keyframes, for the case that the studio or the browser ends."""

import time
from itertools import count
from pathlib import Path

from plat.errors import PlatError
from plat.studio.folder import mark_of
from plat.studio.session import Session
from plat.studio.timeline import Timeline

__all__ = ["AUTOSAVE", "Autosave"]

AUTOSAVE = "keyframes.autosave.json"
"""Name of the file; where it is taken, ``keyframes.autosave.1.json`` and so on."""
_AFTER = 2.0
"""Seconds without an edit after which the copy is written."""
_AT_LATEST = 15.0
"""Seconds after which it is written although the edits go on."""


class Autosave:
    """Copy of the keyframes in a file of its own, written some seconds after an edit.

    It overwrites and deletes only the file that it wrote or that was restored, and only if that is unchanged since:
    another studio may use the same folder.

    Args:
        session: whose keyframes they are.
        folder: of the file.
    """

    def __init__(self, session: Session, folder: Path):
        self._session = session
        self._folder = folder
        self.words = ""
        """When it was written, or why it could not be."""
        self.path: Path | None = None
        """The file, once there is one."""
        self._left: tuple[int, ...] | None = None
        first = Path(AUTOSAVE)
        found = [(mark, path) for path in folder.glob(f"{first.stem}*{first.suffix}") if (mark := mark_of(path))]
        self._former = max(found, default=None)
        self.former = self._read()
        """Content of the newest file that a former studio left."""
        self._edited_at: float | None = None
        self._unwritten_since: float | None = None
        self._last = session.timeline
        self._saved: Timeline | None = None

    def _read(self) -> bytes | None:
        try:
            return None if self._former is None else self._former[1].read_bytes()
        except OSError:
            return None

    def take_over(self) -> None:
        """Take the former file over as this studio's own: its keyframes are those of the session now."""
        if self._former is not None:
            self.discard()  # a copy of what was edited before
            self._left, self.path = self._former
            self._saved = None

    def discard(self) -> None:
        """Delete the copy, which is of no use any more: the keyframes were saved."""
        if self.path is not None and self._untouched:
            self.path.unlink(missing_ok=True)
        self.path, self.words = None, ""

    @property
    def _untouched(self) -> bool:
        return self.path is not None and self._left is not None and mark_of(self.path) == self._left

    def tick(self, at_once: bool = False) -> bool:
        """Write the copy when it is due, or at once; return whether there is news of it.

        It is deleted where its keyframes were brought back to what was saved.
        """
        now, moment = self._session.timeline, time.monotonic()
        if (now.start, now.keyframes, now.holds) != (self._last.start, self._last.keyframes, self._last.holds):
            self._last, self._edited_at = now, moment
            if self._unwritten_since is None:
                self._unwritten_since = moment
        if self._edited_at is None or self._unwritten_since is None:
            return False
        if not (at_once or moment - self._edited_at >= _AFTER or moment - self._unwritten_since >= _AT_LATEST):
            return False
        undone = self.path is not None and self._session.as_saved and self._session.saved is self._saved
        unsaved = self._session.unsaved
        if unsaved:
            self._write()
        elif undone:
            self.discard()
        self._edited_at = self._unwritten_since = None  # not before, for Ctrl-C may come between
        return unsaved or undone

    def _write(self) -> None:
        try:
            path = self._free_path()
            self._session.write(path)
            self.path, self._left, self._saved = path, mark_of(path), self._session.saved
            self.words = f"autosaved {time.strftime('%H:%M:%S')}"
        except (PlatError, OSError) as error:
            self.words = f"not autosaved: {error}"

    def _free_path(self) -> Path:
        """Return the file to write: this studio's own, or one that is not there yet."""
        if self.path is not None and self._untouched:
            return self.path
        first = self._folder / AUTOSAVE
        others = (first.with_suffix(f".{number}{first.suffix}") for number in count(1))
        return first if not _is_there(first) else next(path for path in others if not _is_there(path))


def _is_there(path: Path) -> bool:
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    return True
