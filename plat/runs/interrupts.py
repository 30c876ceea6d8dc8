"""Ends of training from outside: Ctrl-C, signals, and a screen or a reader that goes away."""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, TextIO

from plat.streams import CLOSED_PIPE

__all__ = ["ENDING", "StopSignal"]

ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a process: TERM, and HUP when its terminal is closed, which not every system has."""
_SIGNALS = (signal.SIGINT, *ENDING)
_HANGUP = getattr(signal, "SIGHUP", None)


class StopSignal:
    """Request to stop, made while the context is open: by Ctrl-C, by the signals TERM and HUP, or by lost output.

    The first one is noted, for a state in the middle of an iteration cannot be saved. A second Ctrl-C or TERM raises
    :class:`KeyboardInterrupt` at once. HUP comes when a terminal is closed, often twice, and is left to ``nohup`` where
    that ignores it. Outside the main thread no signal is caught.

    A terminal that is gone takes no output, and neither does a pipe whose reader has left: Ctrl-C ends ``tee`` before
    the program that it reads from. Nothing is shown from then on, and training stops as if it had been asked to.

    Attributes:
        asked: whether someone has asked.
        status: exit status of a program that stops for it.

    >>> with StopSignal() as stop:
    ...     signal.raise_signal(signal.SIGINT)
    ...     stop.asked
    stopping after this iteration, with a checkpoint; once more to stop at once
    True
    """

    def __init__(self) -> None:
        self.asked = False
        self.status = 130
        self._pressed = False
        self._before: dict[int, Any] = {}
        self._streams: dict[str, tuple[Any, _Shown]] = {}

    def __enter__(self) -> "StopSignal":
        for name in ("stdout", "stderr"):
            stream = getattr(sys, name)
            if stream is not None:  # as in programs without a console
                shown = _Shown(stream, self._unheard)
                self._streams[name] = (stream, shown)
                setattr(sys, name, shown)
        if threading.current_thread() is threading.main_thread():
            caught = [number for number in _SIGNALS if number != _HANGUP or signal.getsignal(number) != signal.SIG_IGN]
            self._before = {number: signal.signal(number, self._note) for number in caught}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        self._before = {}
        for name, (stream, shown) in self._streams.items():
            if getattr(sys, name) is shown:
                setattr(sys, name, stream)
        self._streams = {}

    def _note(self, number: int, frame: FrameType | None) -> None:
        if number == _HANGUP:
            self._stop(128 + number)
            return
        if self._pressed:
            raise KeyboardInterrupt
        self._pressed = True
        self._stop(130)
        with contextlib.suppress(RuntimeError):  # a signal in the midst of another line
            print("stopping after this iteration, with a checkpoint; once more to stop at once", flush=True)

    def _unheard(self) -> None:
        self._stop(CLOSED_PIPE)

    def _stop(self, status: int) -> None:
        if not self.asked:
            self.asked, self.status = True, status


class _Shown:
    """Stream that shows nothing any more once it fails, and says so once."""

    def __init__(self, stream: TextIO, failed: Callable[[], None]):
        self.stream = stream
        self._failed = failed
        self._works = True

    def write(self, text: str) -> int:
        self._try(lambda: self.stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._try(self.stream.flush)

    def _try(self, work: Callable[[], object]) -> None:
        if not self._works:
            return
        try:
            work()
        except (OSError, SystemExit):  # plat's own streams end the program when their reader leaves
            self._works = False
            self._failed()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)
