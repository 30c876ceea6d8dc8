import signal
import threading

import pytest

from plat.runs.interrupts import StopSignal


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
