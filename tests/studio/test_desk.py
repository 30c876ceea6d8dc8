import threading
import time

from plat.errors import MotionError
from plat.studio.desk import Desk


class Office:
    """A desk at work on its own thread, and what it did."""

    def __init__(self, interval: float = 10.0):
        self.done: list[str] = []
        self.reports: list[str] = []
        self.ticks: list[float] = []
        self.desk = Desk(self.ticks.append, lambda: self.done.append("changed"), self.reports.append, interval)
        self.thread = threading.Thread(target=self.desk.run)

    def work(self, seconds: float = 0.0) -> None:
        """Let it do what it was asked for, and stop."""
        self.thread.start()
        idle = threading.Event()
        time.sleep(seconds)
        self.desk.ask(idle.set)
        assert idle.wait(5)
        self.desk.stop()
        self.thread.join(5)
        assert not self.thread.is_alive()

    def task(self, name: str):
        return lambda: self.done.append(name)


def test_tasks_are_done_in_order_and_then_shown():
    office = Office()
    for name in "abc":
        office.desk.ask(office.task(name))
    office.work()
    assert office.done[:4] == ["a", "b", "c", "changed"]


def test_a_task_takes_the_place_of_one_of_its_name_that_waits_last():
    office = Office()
    for name in ("slide 1", "slide 2", "other 3", "slide 4", "slide 5"):
        office.desk.ask(office.task(name), name.split()[0])
    office.desk.ask(office.task("end"))
    office.desk.ask(office.task("end"))
    office.work()
    assert office.done[:5] == ["slide 2", "other 3", "slide 5", "end", "end"]


def test_time_passes_between_tasks():
    office = Office(interval=0.01)
    office.work(seconds=0.3)
    assert len(office.ticks) > 5
    assert 0.1 < sum(office.ticks) < 1.0


def test_bad_input_is_reported_and_work_goes_on():
    office = Office()

    def fail() -> None:
        raise MotionError("no such motion")

    office.desk.ask(fail)
    office.desk.ask(office.task("a"))
    office.work()
    assert office.reports == ["no such motion"]
    assert office.done[0] == "a"


def test_a_bug_is_reported_and_logged(caplog):
    office = Office()
    office.desk.ask(lambda: {}["missing"])
    office.work()
    assert office.reports == ["unexpected KeyError: 'missing'"]
    assert "Traceback" in caplog.text


def test_slow_work_is_done_elsewhere_and_its_result_here():
    office = Office()
    threads = []
    finished = threading.Event()

    def slow():
        threads.append(threading.current_thread())

        def result() -> None:
            threads.append(threading.current_thread())
            finished.set()

        return result

    office.thread.start()
    office.desk.ask_elsewhere(slow)
    assert finished.wait(5)
    office.desk.stop()
    office.thread.join(5)
    assert threads[0] is not office.thread
    assert threads[1] is office.thread


def test_bad_input_elsewhere_is_reported():
    office = Office()
    reported = threading.Event()
    desk = Desk(lambda _: None, lambda: None, lambda text: (office.reports.append(text), reported.set()), 10.0)

    def slow():
        raise OSError("disk full")

    desk.ask_elsewhere(slow)
    assert reported.wait(5)
    assert office.reports == ["disk full"]
