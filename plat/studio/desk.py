"""Single-threaded task queue with a tick."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable
from functools import partial

from plat.errors import PlatError

__all__ = ["Desk"]

_LOGGER = logging.getLogger("plat.studio")

Task = Callable[[], None]


class Desk:
    """Single-threaded task queue with a tick.

    Pages call back on threads of their own. Here their tasks run one after the other.

    Args:
        tick: called again and again, with the seconds since the last time.
        changed: called after tasks were done.
        report: given the message of an error that a task ended in.
        interval: seconds between ticks.
    """

    def __init__(
        self,
        tick: Callable[[float], None],
        changed: Callable[[], None],
        report: Callable[[str], None],
        interval: float,
    ):
        self._tick, self._changed, self._report = tick, changed, report
        self._interval = interval
        self._tasks: deque[tuple[Task, Hashable]] = deque()
        self._wake = threading.Condition()
        self._stopped = False

    def ask(self, task: Task, instead_of: Hashable = None) -> None:
        """Queue a task for the desk's thread; return at once.

        Args:
            task: what is to be done.
            instead_of: names what the task is part of, such as a drag. It takes the place of the task of that name that
                waits last, so that the desk does not fall behind what a user drags; tasks of others stay in order.
        """
        with self._wake:
            if instead_of is not None and self._tasks and self._tasks[-1][1] == instead_of:
                self._tasks.pop()
            self._tasks.append((task, instead_of))
            self._wake.notify()

    def ask_elsewhere(self, work: Callable[[], Task]) -> None:
        """Run slow work on a thread of its own, and pass its result to a task on the desk's thread."""

        def run() -> None:
            task = self._guarded(work)
            if task is not None:
                self.ask(task)

        threading.Thread(target=run, daemon=True).start()

    def stop(self) -> None:
        """End :meth:`run` after the current task."""
        with self._wake:
            self._stopped = True
            self._wake.notify()

    def run(self) -> None:
        """Run tasks until :meth:`stop`."""
        last = time.monotonic()
        while True:
            with self._wake:
                due = last + self._interval
                while not self._tasks and not self._stopped and time.monotonic() < due:
                    self._wake.wait(due - time.monotonic())
                if self._stopped:
                    return
                tasks = [self._tasks.popleft()[0] for _ in range(len(self._tasks))]
            for task in tasks:
                self._guarded(task)
            now = time.monotonic()
            if now >= due:
                self._guarded(partial(self._tick, now - last))
                last = now
            if tasks:
                self._guarded(self._changed)

    def _guarded(self, work: Callable[[], Task | None]) -> Task | None:
        try:
            return work()
        except (PlatError, OSError) as error:
            self._report(str(error))
        except Exception as error:  # the page lives on, and the traceback goes where a developer looks
            _LOGGER.exception("the studio stumbled")
            self._report(f"unexpected {type(error).__name__}: {error}")
        return None
