import signal
import sys
import threading

import pytest

from plat.runs.interrupts import StopSignal
from plat.streams import CLOSED_PIPE, ReaderLeft


def test_the_first_is_noted_and_the_second_does_not_wait(capsys):
    before = signal.getsignal(signal.SIGINT)
    with StopSignal() as stop:
        assert not stop.asked
        signal.raise_signal(signal.SIGTERM)
        assert stop.asked
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert capsys.readouterr().out.count("stopping after this iteration") == 1


def test_other_threads_catch_nothing():
    before, found = signal.getsignal(signal.SIGINT), []

    def enter() -> None:
        with StopSignal() as stop:
            found.append((stop.asked, signal.getsignal(signal.SIGINT)))

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert found == [(False, before)]


class Closed:
    """Stream of a terminal that is gone, or a pipe that nobody reads."""

    def write(self, text: str) -> int:
        raise OSError(5, "Input/output error")

    def flush(self) -> None:
        raise ReaderLeft


def test_a_closed_terminal_asks_to_stop_however_often():
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whoever runs the tests may ignore it
    try:
        with StopSignal() as stop:
            for _ in range(2):
                signal.raise_signal(signal.SIGHUP)
            assert stop.asked
            assert stop.status == 128 + signal.SIGHUP
            signal.raise_signal(signal.SIGTERM)  # as a system that shuts down sends after it
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGHUP, before)


def test_nohup_is_left_to_ignore(monkeypatch):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopSignal() as stop:
            signal.raise_signal(signal.SIGHUP)
        assert not stop.asked
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("name", ["stdout", "stderr"])
def test_lost_output_is_no_error_and_asks_to_stop(monkeypatch, name):
    monkeypatch.setattr(sys, name, Closed())
    lost = getattr(sys, name)
    with StopSignal() as stop:
        print("first", file=getattr(sys, name), flush=True)
        assert stop.asked
        assert stop.status == CLOSED_PIPE
        signal.raise_signal(signal.SIGINT)  # what is printed here is lost as well
        print("last", file=getattr(sys, name), flush=True)
    assert getattr(sys, name) is lost
