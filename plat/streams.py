"""Standard streams of a program: closed pipes, full disks, other character sets, and no streams at all."""

import io
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

__all__ = ["CLOSED_PIPE", "ReaderLeft", "standard_streams"]

CLOSED_PIPE = 141
"""Exit status of a program whose reader has left, as shells report it: 128 and the number of SIGPIPE."""


class ReaderLeft(SystemExit):
    """End of a program that nobody reads any more.

    It is no ``OSError``: code that handles those of its own files would take it for one of them.
    """

    def __init__(self) -> None:
        super().__init__(CLOSED_PIPE)


@contextmanager
def standard_streams() -> Iterator[None]:
    """Open the standard streams so that no work ends in a traceback for their sake.

    - A reader that has left, as ``head`` does, ends the program quietly with the status 141.
    - What a full disk does not take is left out. The work is done, and ends with one line and the status 1.
    - Characters that the screen does not have are shown as ``?``.
    - Streams that were closed before the start show nothing.
    - Standard error shows what it can, and is never a reason to stop.

    Streams that a program has put in the place of its own are left alone.
    """
    for name in ("stdin", "stdout", "stderr"):  # in the order of their numbers, which the next open files would get
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("r" if name == "stdin" else "w", encoding="utf-8"))  # noqa: SIM115
    before = sys.stdout, sys.stderr
    out = _opened(sys.stdout, sys.__stdout__, _Output)
    error = _opened(sys.stderr, sys.__stderr__, _Kept)
    sys.stdout, sys.stderr = out or sys.stdout, error or sys.stderr
    ended: SystemExit | None = None
    try:
        yield
        sys.stdout.flush()
    except SystemExit as end:
        ended = end
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError, SystemExit):
                stream.flush()
        sys.stdout, sys.stderr = before
    if out is not None and (fault := _raw(out).fault) and (ended is None or not ended.code):
        sys.exit(f"error: standard output: {fault}")
    if ended is not None:
        raise ended


class _Kept(io.FileIO):
    """File whose faults are kept in ``fault``: writing goes on and shows nothing."""

    fault = ""

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            done = 0
            while done < len(view):
                taken = super().write(view[done:])
                if taken is None:  # a pipe that does not wait for its reader
                    time.sleep(0.01)
                done += taken or 0
        except OSError as error:
            self._failed(error)
        return len(view)

    def _failed(self, error: OSError) -> None:
        self.fault = error.strerror or str(error)


class _Output(_Kept):
    """File of standard output, whose closed pipe ends the program."""

    _gone = False

    def _failed(self, error: OSError) -> None:
        if self._gone:
            return
        if isinstance(error, BrokenPipeError):
            self._gone = True
            raise ReaderLeft
        super()._failed(error)


def _opened(stream: Any, own: Any, kind: type[_Kept]) -> Any:
    """Return the stream anew over a file of a kind; None where it is not the program's own, or a console of Windows."""
    if stream is not own or not isinstance(stream, io.TextIOWrapper):
        return None
    errors = "replace" if stream.errors in ("strict", "surrogateescape") else stream.errors
    try:
        stream.flush()
        if stream.isatty() and os.name == "nt":
            stream.reconfigure(errors=errors)
            return None
        raw = kind(stream.fileno(), "wb", closefd=False)
    except (OSError, ValueError):
        return None
    return io.TextIOWrapper(
        raw if stream.write_through else io.BufferedWriter(raw),
        encoding=stream.encoding,
        errors=errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def _raw(stream: io.TextIOWrapper) -> Any:
    return getattr(stream.buffer, "raw", stream.buffer)
