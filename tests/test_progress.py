import io
import os
import sys

import pytest

from plat.progress import Progress, percent, tracked


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_lines_where_there_is_no_terminal():
    out = io.StringIO()
    with Progress("evaluation", 4, "commands", every=0, stream=out) as progress:
        progress.add()
        progress.update(4)
    first, last = out.getvalue().splitlines()
    assert first.startswith("evaluation: 1 of 4 commands, 25 %, 0:00 to go")
    assert last.startswith("evaluation: 4 of 4 commands, 100 %")


def test_all_is_said_of_what_is_done_alone():
    out = io.StringIO()
    with Progress("evaluation", 1000, every=0, stream=out) as progress:
        progress.update(999)
    assert "999 of 1,000, 99 %" in out.getvalue()
    assert percent(0.29) == "29 %"  # 28.999... in floating point


def test_short_work_prints_no_lines():
    out = io.StringIO()
    with Progress("evaluation", 4, stream=out) as progress:
        progress.update(4)
    assert out.getvalue() == ""


def test_a_bar_on_a_terminal_that_is_gone_at_the_end(monkeypatch):
    out, now = Terminal(), [0.0]
    monkeypatch.setattr("plat.progress.time.monotonic", lambda: now[0])
    with Progress("video", 10, "pictures", stream=out) as progress:
        now[0] = 5.0
        progress.update(5)
    line = out.getvalue().split("\r")[1]
    assert line == "[############............] video: 5 of 10 pictures, 50 %, 0:05 to go"
    assert out.getvalue().endswith("\r" + " " * len(line) + "\r")


def test_without_a_total_the_time_is_shown(monkeypatch):
    out, now = io.StringIO(), [0.0]
    monkeypatch.setattr("plat.progress.time.monotonic", lambda: now[0])
    progress = Progress("steps", unit="steps", stream=out)
    now[0] = 65.0
    progress.add(1200)
    assert out.getvalue() == "steps: 1,200 steps, 1:05\n"


def test_tracked_items_come_through():
    assert list(tracked(iter("abc"), "letters")) == ["a", "b", "c"]


@pytest.mark.parametrize("columns", [120, 80, 40, 20])
def test_a_bar_stays_on_one_row_of_the_terminal(columns, monkeypatch):
    # a longer line goes on in the next row, and "\r" goes back to the beginning of that row alone
    monkeypatch.setattr(Terminal, "fileno", lambda self: 0)
    monkeypatch.setattr("plat.progress.os.get_terminal_size", lambda _: os.terminal_size((columns, 24)))
    out, now = Terminal(), [0.0]
    monkeypatch.setattr("plat.progress.time.monotonic", lambda: now[0])
    with Progress("evaluation", 12_345_678, "control steps", stream=out) as progress:
        for now[0] in (1.0, 300.0, 600.0):
            progress.update(int(10_000 * now[0]))
    rows = out.getvalue().split("\r")
    assert max(map(len, rows)) < columns
    assert rows[1].startswith(("[", "evaluation: 10,000"))
    assert ("#" in rows[3]) == (columns > 70)


def test_streams_that_show_nothing_do_not_end_the_work(monkeypatch):
    class Gone(io.StringIO):
        def write(self, text):
            raise OSError(5, "Input/output error")

    closed = io.StringIO()
    closed.close()
    for stream in (Gone(), closed):
        with Progress("evaluation", 4, every=0, stream=stream) as progress:
            progress.update(4)
        assert progress.done == 4
    monkeypatch.setattr(sys, "stderr", None)  # as of a program without a console
    assert list(tracked([1, 2], "letters")) == [1, 2]
    with Progress("evaluation", 4, every=0) as progress:
        progress.update(4)
