"""Pools of processes that say in one line that one of them is gone."""

from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from plat.errors import WorkerError

__all__ = ["told_if_killed"]


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
