"""Ctrl-C during training: stop after the iteration, with a checkpoint."""

import contextlib
import signal
import threading
from types import FrameType
from typing import Any

__all__ = ["StopSignal"]

_SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM") if hasattr(signal, name))


class StopSignal:
    """Request to stop, made by Ctrl-C or by the signal TERM while the context is open.

    The first one is noted, for a state in the middle of an iteration cannot be saved. The second one raises
    :class:`KeyboardInterrupt` at once. Outside the main thread nothing is caught.

    Attributes:
        asked: whether someone has asked.

    >>> with StopSignal() as stop:
    ...     signal.raise_signal(signal.SIGINT)
    ...     stop.asked
    stopping after this iteration, with a checkpoint; once more to stop at once
    True
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "StopSignal":
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)
        self._before = {}

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
        with contextlib.suppress(RuntimeError):  # a signal in the midst of another line
            print("stopping after this iteration, with a checkpoint; once more to stop at once", flush=True)
