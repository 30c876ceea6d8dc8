"""Processes that belong together: one line where one of them is gone, and none that outlives the first."""

import math
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from pathlib import Path
from types import TracebackType
from typing import Any

from plat.errors import ConfigError, WorkerError
from plat.scratch import Scratch

__all__ = [
    "HelperPool",
    "available_cpus",
    "begin_helper",
    "deaf_to_interrupts",
    "may_start_processes",
    "told_if_killed",
]


def available_cpus() -> int:
    """Return the number of CPUs that this process may use: at most ``PLAT_CPUS``, where that is set.

    It is that of its affinity mask, or less where a container gives it a share of their time.

    Raises:
        ConfigError: when ``PLAT_CPUS`` is no number.

    >>> available_cpus() >= 1
    True
    """
    # macOS and Windows have no affinity masks
    there = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    there = math.ceil(min(there, _quota()))
    share = os.environ.get("PLAT_CPUS", "")
    if share and not (share.isdecimal() and int(share)):
        raise ConfigError(f"PLAT_CPUS is {share!r}, expected a whole number from 1")
    return min(there, int(share)) if share else there


def _quota(process: Path = Path("/proc/self/cgroup"), groups: Path = Path("/sys/fs/cgroup")) -> float:
    """Return how many CPUs' time the control groups of this process give it, as of containers; infinity for all.

    Args:
        process: file of its groups: ``ID:CONTROLLERS:PATH`` on each line.
        groups: folder of all groups.
    """
    least = math.inf
    try:
        lines = process.read_text().splitlines()
    except (OSError, ValueError):  # no Linux
        return least
    for line in lines:
        _, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if controllers and "cpu" not in controllers.split(","):
            continue
        first_version = bool(controllers)
        root = groups / "cpu" if first_version else groups
        group = root / path.strip("/")
        # in a container the path may be one of the machine, which is not there
        for folder in (group, *(above for above in group.parents if above.is_relative_to(root))):
            with suppress(OSError, ValueError, ZeroDivisionError):
                if first_version:
                    time, period = ((folder / f"cpu.cfs_{word}_us").read_text() for word in ("quota", "period"))
                else:
                    time, period = (folder / "cpu.max").read_text().split()
                if float(time) > 0:  # "max" is no number, and -1 means the same
                    least = min(least, float(time) / float(period))
    return least


def may_start_processes() -> bool:
    """Return whether this process may start others: a daemon of :mod:`multiprocessing` may not.

    >>> may_start_processes()
    True
    """
    return not multiprocessing.current_process().daemon


@contextmanager
def told_if_killed(kept: str = "") -> Iterator[None]:
    """Raise an error of plat where a process of a pool was killed, as Linux does when memory runs out.

    Args:
        kept: what is said of the work that is done.

    Raises:
        WorkerError: in the place of :class:`~concurrent.futures.process.BrokenProcessPool`.

    >>> with told_if_killed():
    ...     raise BrokenProcessPool
    Traceback (most recent call last):
    plat.errors.WorkerError: a worker process was killed, perhaps for want of memory: try fewer --workers
    """
    try:
        yield
    except BrokenProcessPool:
        told = "a worker process was killed, perhaps for want of memory: try fewer --workers"
        raise WorkerError(f"{told}; {kept}" if kept else told) from None


@contextmanager
def deaf_to_interrupts() -> Iterator[None]:
    """Let processes that are started in this context leave Ctrl-C to this one from their first moment.

    Python imports for seconds before a process can say so itself, as :func:`begin_helper` does.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # its start takes Ctrl-C off the mask again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class HelperPool(ProcessPoolExecutor):
    """Pool of spawned processes that leave Ctrl-C to this one, and are gone when this one is, however it ends.

    Use it as a context. Where that is left by an error or a key, what waits is not begun and what runs is stopped: it
    would only be thrown away.

    Args:
        workers: number of processes.
        begin: is called in each process first.
        arguments: of ``begin``.
    """

    def __init__(self, workers: int, begin: Callable[..., object], *arguments: object):
        # not by the pipe of a spawned process: more than it takes at a time is waited for until Python has imported
        # what it is made of there, and for ever where the process is killed meanwhile
        self._scratch = Scratch("plat-pool-")
        path = self._scratch.path / "begin.pickle"
        path.write_bytes(pickle.dumps((begin, arguments)))
        # forked children inherit torch's thread pool in a state that can hang them
        spawn = multiprocessing.get_context("spawn")
        super().__init__(workers, spawn, initializer=_begin, initargs=(path,))

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Submit a call, as the pool of Python does; it starts its processes here."""
        with deaf_to_interrupts():
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            processes = list((self._processes or {}).values())
            self.shutdown(wait=False, cancel_futures=True)
            for process in processes:
                process.terminate()
        self.shutdown()
        self._scratch.remove()


def _begin(path: Path) -> None:
    begin_helper()  # a pool's processes would wait for ever
    begin, arguments = pickle.loads(path.read_bytes())
    begin(*arguments)


def begin_helper() -> None:
    """Let this process, which another one started, end with that one however it ends, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)
