"""A process beside the one that learns, which answers its orders."""

import multiprocessing
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any, Protocol

import torch

from plat import errors
from plat.errors import PlatError
from plat.pools import begin_helper, deaf_to_interrupts

__all__ = ["Answering", "Helper", "half_the_threads"]


class Answering(Protocol):
    """Protocol of what a helper has."""

    def answer(self, order: Any) -> Any:
        """Return the answer to an order."""


class Helper:
    """Another process, of one thread. It ends with the one that began it.

    Args:
        make: returns, in that process, what answers; it can be pickled.
        name: of the process.
    """

    def __init__(self, make: Callable[[], Answering], name: str):
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        # given with the first order: a start waits until what is larger than a pipe has been read, for ever where the
        # process is killed meanwhile
        self._make: bytes | None = pickle.dumps(make)
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True, name=name)
        with deaf_to_interrupts():
            self._process.start()
        theirs.close()

    @property
    def exit_code(self) -> int | None:
        """Return what the process ended with."""
        return self._process.exitcode

    def ask(self, order: bytes) -> Any:
        """Return the answer to a pickled order.

        Raises:
            EOFError, OSError: when the process is gone.
            PlatError: what was raised there.
        """
        if self._make is not None:
            self._connection.send_bytes(self._make)
            self._make = None
        self._connection.send_bytes(order)
        answer, failure = pickle.loads(self._connection.recv_bytes())
        if failure is not None:
            kind, message = failure
            raise getattr(errors, kind, PlatError)(message)
        return answer

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._connection.close()
        self._process.join(5)
        if self._process.is_alive():  # in the middle of an answer
            self._process.kill()
            self._process.join()


@contextmanager
def half_the_threads() -> Iterator[None]:
    """Leave half of the CPUs, as a context, to processes beside this one: PyTorch's threads spin while they wait.

    >>> before = torch.get_num_threads()
    >>> with half_the_threads():
    ...     torch.get_num_threads() == max(1, before // 2)
    True
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(max(1, threads // 2))
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _serve(connection: Connection) -> None:
    """Answer orders until the other process is gone."""
    begin_helper()
    torch.set_num_threads(1)
    try:
        make = pickle.loads(connection.recv_bytes())
    except (EOFError, OSError):
        return
    answering = make()
    with suppress(EOFError, OSError):
        while True:
            order = pickle.loads(connection.recv_bytes())
            answer, failure = None, None
            try:
                answer = answering.answer(order)
            except PlatError as error:
                failure = type(error).__name__, str(error)
            # not send(): tensors would go by files there, one each
            connection.send_bytes(pickle.dumps((answer, failure)))
