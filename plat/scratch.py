"""Temporary folders that do not outlive their process for long, however it ends."""

import glob
import os
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from plat.files import lock_file

__all__ = ["Scratch"]

_LOCK = ".lock"
# Between the making of a folder and its lock (s), with much to spare.
_NEW = 60.0


class Scratch:
    """Temporary folder with a lock. What a killed process left is removed by the next one that makes such a folder.

    Use it as a context, or call :meth:`remove`.

    Args:
        prefix: of its name; only folders with the same are looked at.
        parent: where it is made; by default where temporary files belong.

    Attributes:
        path: the folder.

    >>> with Scratch("plat-example-") as folder:
    ...     folder.is_dir()
    True
    >>> folder.exists()
    False
    """

    def __init__(self, prefix: str, parent: Path | None = None):
        parent = Path(tempfile.gettempdir()) if parent is None else parent
        _clear(parent, prefix)
        self.path = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        self._file = (self.path / _LOCK).open("a")
        with suppress(OSError):  # a file system without locks: nobody else gets one either
            lock_file(self._file)

    def remove(self) -> None:
        """Remove the folder; again has no effect."""
        self._file.close()
        shutil.rmtree(self.path, ignore_errors=True)

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.remove()


def _clear(parent: Path, prefix: str) -> None:
    """Remove the folders whose processes have ended."""
    for folder in parent.glob(f"{glob.escape(prefix)}*"):
        with suppress(OSError):  # no folder of ours, in use, or removed by another process at this moment
            if folder.is_symlink() or time.time() - (folder / _LOCK).stat().st_mtime < _NEW:
                continue
            if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():
                continue
            with (folder / _LOCK).open("a") as file:
                lock_file(file)
                shutil.rmtree(folder, ignore_errors=True)
