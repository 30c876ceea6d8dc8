"""Lock on a run directory, so that one process at a time trains into it; folders of scores have one as well."""

import contextlib
import errno
import os
from pathlib import Path

from plat.errors import CheckpointError
from plat.files import lock_file, refuse_null

__all__ = ["LOCK_FILE", "RunLock"]

LOCK_FILE = ".lock"
_BUSY = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)


class RunLock:
    """Lock on a run directory; the operating system frees it when its process ends, however it ends.

    Several locks of one process share it. File systems without locks are used without.

    Args:
        folder: the directory, which is made if it is missing.

    Raises:
        CheckpointError: when another process holds the lock, or the directory cannot be written.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lock = RunLock(Path(folder))
    ...     lock.release()
    """

    _held: dict[Path, "_Holding"] = {}  # one for the process

    def __init__(self, folder: Path):
        self._key: Path | None = None
        self._path = folder / LOCK_FILE
        try:
            refuse_null(folder)
            folder.mkdir(parents=True, exist_ok=True)
            key = folder.resolve()
            if key not in self._held:
                self._held[key] = _Holding(folder)
        except OSError as error:
            raise CheckpointError(f"{str(folder)!r} cannot be written ({error}); choose another --out") from error
        self._held[key].count += 1
        self._key = key

    def is_there(self) -> bool:
        """Return whether the directory is where it was: it was not moved, removed, or replaced by another."""
        if self._key is None:
            return False
        try:
            found, own = self._path.stat(), os.fstat(self._held[self._key].file.fileno())
        except FileNotFoundError:
            return False
        except OSError:  # a file system that does not answer at the moment
            return True
        return (found.st_dev, found.st_ino) == (own.st_dev, own.st_ino)

    def release(self) -> None:
        """Free the lock; again has no effect."""
        key, self._key = self._key, None
        if key is None:
            return
        holding = self._held[key]
        holding.count -= 1
        if holding.count == 0:
            del self._held[key]
            holding.file.close()

    def __del__(self) -> None:
        self.release()


class _Holding:
    """The open file whose lock this process holds, and how many share it."""

    def __init__(self, folder: Path):
        self.count = 0
        self.file = (folder / LOCK_FILE).open("a+")
        try:
            lock_file(self.file)
        except OSError as error:
            if error.errno not in _BUSY:
                return  # a file system without locks
            self.file.seek(0)
            process = self.file.read(20).strip()
            self.file.close()
            raise CheckpointError(
                f"{str(folder)!r}: process {process or 'unknown'} is writing into it; wait until it ends, or choose "
                "another --out"
            ) from None
        with contextlib.suppress(OSError):  # a full disk: the number is for messages only
            self.file.truncate(0)
            os.write(self.file.fileno(), f"{os.getpid()}\n".encode())  # past the buffer, which closing would flush
