"""Reads a file under limits, and says what became of it."""

import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from plat.errors import PlatError

__all__ = ["MOST_MEMORY", "MOST_SECONDS", "Outcome", "forbid_programs", "limit_process", "read_under_limits"]

MOST_SECONDS = 10
"""A read that takes more of the processor's time is a hang."""
MOST_MEMORY = 2 << 30
"""A read that takes more is a fault (bytes)."""
_HEADROOM = 6 << 30
_LONGEST_MESSAGE = 2000
_PROGRAMS = frozenset(
    ("os.system", "os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "subprocess.Popen", "pty.spawn")
)
_PROGRAMS |= {"socket.connect", "socket.bind", "ctypes.dlopen", "webbrowser.open", "shutil.rmtree"}
_ran: list[str] = []


class _Hang(BaseException):
    """Raised by the alarm; no reader catches it."""


@dataclass(frozen=True)
class Outcome:
    """What became of a read.

    Attributes:
        fault: empty for a file that was read or refused in one line, else what was wrong.
        where: of the fault: the innermost line of plat, and its message.
        refused: whether the file was refused.
        seconds: of the processor that the read took.
        memory: bytes that the read took at its most.
    """

    fault: str
    where: str
    refused: bool
    seconds: float
    memory: int


def limit_process() -> None:
    """Keep a fault of this process from eating the machine; call it in a process of its own."""
    size = _status("VmSize") + _HEADROOM
    resource.setrlimit(resource.RLIMIT_AS, (size, size))
    signal.signal(signal.SIGPROF, _alarm)


def forbid_programs() -> None:
    """Note every program that is started and every connection that is opened, for :func:`read_under_limits`."""
    sys.addaudithook(lambda event, _: _ran.append(event) if event in _PROGRAMS else None)


def read_under_limits(read: Callable[[Path], object], path: Path) -> Outcome:
    """Read a file.

    Args:
        read: reads it and raises a PlatError for one that it refuses.
        path: the file.
    """
    seconds = MOST_SECONDS
    Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
    before, started, fault, where, refused = _status("VmRSS"), time.process_time(), "", "", False
    _ran.clear()
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        read(path)
    except PlatError as error:
        refused = True
        message = str(error)
        if "\n" in message or len(message) > _LONGEST_MESSAGE or not _is_printable(message):
            fault, where = "message is not one printable line", f"{_line_of(error)}: {message[:300]!r}"
    except _Hang as error:
        fault, where = f"longer than {seconds:g} s", _line_of(error)
    except Exception as error:
        fault, where = f"raw {type(error).__name__}", f"{_line_of(error)}: {str(error)[:200]!r}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    memory = _status("VmHWM") - before
    if _ran:
        fault, where = "ran a program", ", ".join(_ran)
    elif not fault and memory > MOST_MEMORY:
        fault, where = f"more than {MOST_MEMORY / 2**30:.2g} GB", f"{memory / 1e9:.1f} GB"
    return Outcome(fault, where, refused, time.process_time() - started, memory)


def _alarm(*_: object) -> None:
    raise _Hang


def _status(field: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) << 10
    raise KeyError(field)


def _is_printable(message: str) -> bool:
    try:
        message.encode()
    except UnicodeEncodeError:
        return False
    return True


def _line_of(error: BaseException) -> str:
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "/plat/" in frame.filename]
    if not frames:
        return "outside of plat"
    return f"{frames[-1].filename.rpartition('/plat/')[2]}:{frames[-1].lineno}"
