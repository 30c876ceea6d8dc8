"""A process that answers orders."""

import functools
import os
import pickle
import signal
import time
from collections.abc import Iterator
from typing import Any

import pytest
import torch

from plat.errors import ObservationError
from plat.objectives.helper import Helper, half_the_threads
from tests.in_process import in_time


class Counting:
    """Adds up what it is told; does as it is told otherwise."""

    def __init__(self) -> None:
        self.total = 0

    def answer(self, order: Any) -> Any:
        if order == "threads":
            return torch.get_num_threads(), os.getpid()
        if order == "fail":
            raise ObservationError("no such thing")
        if order == "sleep":
            time.sleep(60)
        if order == "end":
            os._exit(3)
        self.total += order
        return self.total


def ask(helper: Helper, order: Any) -> Any:
    return helper.ask(pickle.dumps(order))


@pytest.fixture
def helper() -> Iterator[Helper]:
    helper = Helper(Counting, "plat-test")
    yield helper
    helper.close()


def test_it_remembers_and_its_errors_are_the_callers(helper: Helper) -> None:
    assert [ask(helper, number) for number in (1, 2)] == [1, 3]
    threads, process = ask(helper, "threads")
    assert threads == 1
    assert process != os.getpid()
    with pytest.raises(ObservationError, match="no such thing"):
        ask(helper, "fail")
    assert ask(helper, 5) == 8
    with pytest.raises((EOFError, OSError)):
        ask(helper, "end")
    helper.close()
    assert helper.exit_code == 3
    with pytest.raises((EOFError, OSError)):
        ask(helper, 1)


def test_an_interrupt_while_it_imports_is_not_for_it() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    helper = Helper(Counting, "plat-test")
    try:
        os.kill(helper._process.pid, signal.SIGINT)  # as Ctrl-C does, to all processes of a terminal
        assert ask(helper, 1) == 1
    finally:
        helper.close()
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


def counting_with(content: bytes) -> Counting:
    return Counting()


def test_one_that_is_killed_while_it_begins_is_told_of(killed_at_birth) -> None:
    """Its start waited for ever until what is larger than a pipe had been read."""
    (helper,) = in_time(lambda: Helper(functools.partial(counting_with, bytes(1 << 22)), "plat-test"))
    with pytest.raises((EOFError, OSError)):
        ask(helper, 1)
    helper.close()


def test_it_ends_in_the_middle_of_an_answer(helper: Helper, monkeypatch: pytest.MonkeyPatch) -> None:
    ask(helper, 1)
    helper._connection.send_bytes(pickle.dumps("sleep"))
    join = helper._process.join
    monkeypatch.setattr(helper._process, "join", lambda timeout=None: join(0.1 if timeout else None))
    helper.close()
    assert helper.exit_code == -signal.SIGKILL


def test_half_of_the_threads_are_left_to_others() -> None:
    before = torch.get_num_threads()
    try:
        for threads, fewer in ((1, 1), (2, 1), (7, 3)):
            torch.set_num_threads(threads)
            with half_the_threads():
                assert torch.get_num_threads() == fewer
            assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
