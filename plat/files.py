"""Files that are written whole or not at all, and places that are checked before the work."""

import codecs
import csv
import errno
import functools
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from plat.errors import OutputError, PlatError

__all__ = [
    "FILES",
    "TABLES",
    "as_path",
    "check_file",
    "check_folder",
    "clear_parts",
    "copy_file",
    "decoded",
    "expand_home",
    "is_full",
    "keep_sources",
    "lock_file",
    "readable",
    "refuse_null",
    "replace_file",
    "replace_table",
    "write_file",
]

# of a text, from which its encoding is known
_BYTES_SEEN = 1000
# of a name and an ending, in the name of the file beside it: disks take names of 255 bytes
_MOST_LETTERS, _LONGEST_ENDING = 40, 16
# what a process of another machine was writing is taken for given up (s)
_GIVEN_UP = 86400.0
# where Windows locks a byte: beyond what is written, which others could not read otherwise
_LOCKED_BYTE = 4096


def replace_file(path: Path, write: Callable[[Path], object]) -> None:
    """Replace the file at ``path`` in one step by what ``write`` puts into a file beside it.

    The file beside it ends in the same suffix. Folders that are missing are made. Whatever ``write`` raises goes
    through, and the file that was there is intact. Its permissions are kept; a new one has those of any new file.

    Raises:
        OutputError: for a folder or a device.
        OSError: naming ``path``, when the disk does not take it.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     replace_file(Path(folder) / "new" / "a.txt", lambda part: part.write_text("whole"))
    ...     (Path(folder) / "new" / "a.txt").read_text()
    'whole'
    """
    if path.exists() and not path.is_file():  # a device that root may replace, say
        raise OutputError(f"{str(path)!r}: is a {'folder' if path.is_dir() else 'device'}, expected a file")
    part: Path | None = None
    try:
        refuse_null(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = _made_beside(path)
        mode = stat.S_IMODE((path if path.exists() else part).stat().st_mode)
        write(part)
        with suppress(OSError):  # file systems without permissions
            part.chmod(mode)
        part.replace(path)
    except OSError as error:
        # that of a full disk names no file, and others name the file beside it
        if error.errno is None or (part is not None and error.filename not in (None, str(part))):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if part is not None:
            part.unlink(missing_ok=True)


def _made_beside(path: Path) -> Path:
    """Make an empty file with a name of its own beside one; the name says by which process of which machine."""
    ending = path.suffix if len(path.suffix) <= _LONGEST_ENDING else ""
    while True:
        name = f".{path.name[:_MOST_LETTERS]}-{os.getpid()}-{secrets.token_hex(4)}.{_machine()}.part{ending}"
        part = path.with_name(name)
        with suppress(FileExistsError):
            # not by tempfile: its files are the user's alone
            os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            return part


@functools.cache
def _machine() -> str:
    """Return a mark of this machine, or container: numbers of processes are of one."""
    return hashlib.blake2b(socket.gethostname().encode(), digest_size=4).hexdigest()


def refuse_null(path: Path) -> None:
    """Raise what a disk says of names that it does not take; Python raises a bare ValueError for this one.

    Raises:
        OSError: for a path with a null byte.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "its name holds a null byte", str(path))


def write_file(path: Path, write: Callable[[Path], object], what: str) -> None:
    """Write a file as :func:`replace_file` does, for callers who are told in one line what went wrong.

    Args:
        path: the file.
        write: is given the file beside it.
        what: begins the message.

    Raises:
        OutputError: when the disk does not take it, or its name.
    """
    try:
        replace_file(path, write)
    except OSError as error:
        raise OutputError(f"{what} {str(path)!r}: cannot be written: {error.strerror or error}") from error


def copy_file(source: Path, path: Path, what: str) -> None:
    """Copy a file as :func:`write_file` writes one.

    Raises:
        OSError: naming ``source``, when it cannot be read.
        OutputError: naming ``path``, when the disk does not take it; :func:`shutil.copy` names ``source``.
    """
    content = source.read_bytes()
    write_file(path, lambda part: part.write_bytes(content), what)


def clear_parts(folder: Path) -> None:
    """Remove from a folder what killed processes were writing with :func:`replace_file`; those that live go on.

    Of processes on other machines that share the folder nobody knows: theirs are removed after a day.

    >>> clear_parts(Path("/nowhere"))
    """
    for part in folder.glob(".*-*-*.part*"):
        # what stands last: the name of the file may hold the like
        if found := re.match(r".*-(\d+)-\w+(?:\.([0-9a-f]{8}))?\.part", part.name, re.DOTALL):
            with suppress(OSError):
                ours = found[2] in (None, _machine())
                if not _is_alive(int(found[1])) if ours else time.time() - part.stat().st_mtime > _GIVEN_UP:
                    part.unlink()


def _is_alive(process: int) -> bool:
    if os.name != "posix":  # elsewhere the question would end it
        return True
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # of another user
        return True
    return True


def replace_table(path: Path, head: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a table whole or not at all, as :func:`replace_file` does; numbers with a fraction have six digits.

    Cells are separated by commas, and by tabs where the file ends in ``.tsv``.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "table.csv"
    ...     replace_table(path, ("step", "error"), [(1, 0.1234567)])
    ...     path.read_text()
    'step,error\\n1,0.123457\\n'
    """
    delimiter = "\t" if path.suffix.lower() == ".tsv" else ","
    lines = [[f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows]

    def write(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, delimiter=delimiter, lineterminator="\n").writerows([head, *lines])

    replace_file(path, write)


def lock_file(file: IO[Any]) -> None:
    """Lock an open file without waiting; the operating system frees it when the process ends, however it ends.

    Raises:
        OSError: when another process, or another open file of this one, holds the lock; or there are no locks.

    >>> import tempfile
    >>> with tempfile.TemporaryFile() as file:
    ...     lock_file(file)
    """
    if sys.platform == "win32":
        import msvcrt

        file.seek(_LOCKED_BYTE)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        file.seek(0)
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def is_full(folder: Path) -> bool:
    """Return whether a folder is on a disk that takes no more: less than 64 KB are free.

    Libraries tell this in words of their own, or not at all.

    >>> import tempfile
    >>> is_full(Path(tempfile.gettempdir()))
    False
    """
    try:
        return shutil.disk_usage(folder).free < 1 << 16
    except OSError:
        return False


def readable(name: str) -> str:
    r"""Return the name of a file as text, which every file can hold: bytes that are no UTF-8 become ``\udcNN``.

    Python stands for such bytes, as in names from archives of other systems, by halves of surrogate pairs.

    >>> readable(b"K\xf6ln".decode(errors="surrogateescape")), readable("Köln")
    ('K\\udcf6ln', 'Köln')
    """
    return name.encode(errors="backslashreplace").decode()


def decoded(data: bytes) -> str:
    r"""Return the text of a file: UTF-16 where its mark is there, as Windows writes it, else UTF-8, else Latin-1.

    Without its mark UTF-16 is known by its letters: one byte of nearly each is null, and no other text has any.

    >>> decoded("Köln".encode("utf-16")), decoded(b"K\xf6ln"), decoded(b"\xef\xbb\xbfKoeln")
    ('Köln', 'Köln', 'Koeln')
    >>> decoded("Köln".encode("utf-16-le")), decoded("Köln".encode("utf-16-be"))
    ('Köln', 'Köln')
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    start = data[:_BYTES_SEEN]
    first, second = start[::2].count(0), start[1::2].count(0)
    if first + second > len(start) / 3 and 0 in (first, second):
        return data.decode("utf-16-be" if first else "utf-16-le", "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def as_path(path: object, what: str, error: type[PlatError]) -> Path:
    """Return a path that a user gives.

    Args:
        path: whatever was given.
        what: begins the message.
        error: class of what is raised.

    Raises:
        PlatError: of the class ``error``, for what is no path, or an empty text.

    >>> as_path(5, "motion file", OutputError)
    Traceback (most recent call last):
    plat.errors.OutputError: motion file 5: expected a path
    """
    if not isinstance(path, (str, os.PathLike)):
        raise error(f"{what} {path!r:.60}: expected a path")
    if path == "":  # it would be the working directory
        raise error(f"{what} '': is empty, expected a path")
    return Path(path)


def expand_home(path: Path) -> Path:
    """Return a path with the home folder in the place of ``~``; as it is where nobody's home is known.

    >>> expand_home(Path("~nobody-of-this-name/a.txt")).as_posix()
    '~nobody-of-this-name/a.txt'
    """
    try:
        return path.expanduser()
    except RuntimeError:
        return path


TABLES = (".csv", ".tsv", ".txt")
"""Endings of tables that commands write: no motion and no keyframe file, which a slip would replace."""


_INPUTS = (".amc", ".asf", ".bvh", ".joblib", ".json", ".npy", ".npz", ".pickle", ".pkl", ".xml", ".yaml", ".yml")
FILES = frozenset((*TABLES, *_INPUTS, ".md", ".mp4", ".onnx", ".png", ".safetensors", ".svg"))
"""Endings of files that plat reads and writes: a new folder that ends so is a slip."""


def check_file(path: Path, what: str = "--out", suffixes: Sequence[str] = ()) -> None:
    """Raise an error for a file that could not be written; folders that are missing would be made.

    Args:
        path: the file.
        what: begins the message.
        suffixes: endings that the file may have; any if there are none.

    Raises:
        OutputError: when it is a folder or a device, ends otherwise, or its folder takes no files.
    """
    try:
        refuse_null(path)
        if path.is_dir():
            raise OutputError(f"{what} {str(path)!r}: is a folder, expected a file")
        if path.exists() and not path.is_file():
            raise OutputError(f"{what} {str(path)!r}: is a device, expected a file")
    except OSError as error:
        raise OutputError(f"{what} {str(path)!r}: {error.strerror}") from None
    if suffixes and path.suffix.lower() not in suffixes:
        raise OutputError(f"{what} {str(path)!r}: expected a file that ends in {' or '.join(suffixes)}")
    check_folder(path.parent, what)


def keep_sources(sources: Iterable[Path], written: Iterable[Path], what: str = "--out") -> None:
    """Raise an error where a file that is read would be replaced.

    Args:
        sources: files that are read.
        written: files to write.
        what: begins the message.

    Raises:
        OutputError: naming it.
    """
    kept = {source.resolve() for source in sources}
    for path in written:
        if path.resolve() in kept:
            raise OutputError(f"{what}: would replace {str(path)!r}, which is read: give another folder or name")


def check_folder(path: Path, what: str = "--out", expected: str = "a folder") -> None:
    """Raise an error for a folder that could not be made or takes no files. It is tried, and nothing stays behind.

    What killed processes left there is removed, see :func:`clear_parts`.

    Args:
        path: the folder.
        what: begins the message.
        expected: ends the message about a file.

    Raises:
        OutputError: when it is a file, is not there and ends like one, or cannot be written to.
    """
    try:
        refuse_null(path)
        if path.exists() and not path.is_dir():
            raise OutputError(f"{what} {str(path)!r}: is a file, expected {expected}")
        if path.suffix.lower() in FILES and not path.exists():
            raise OutputError(f"{what} {str(path)!r}: ends like a file, expected {expected}")
        missing = [folder for folder in (path, *path.parents) if not folder.exists()]
        try:
            path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=path):
                pass
            clear_parts(path)
        finally:
            for folder in missing:
                with suppress(OSError):
                    folder.rmdir()
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{what} {str(path)!r}: cannot be written to: {reason}") from None
