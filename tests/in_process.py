"""A command line run in this process, which spares the seconds that another one takes for its imports."""

import io
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from plat.cli import main

T = TypeVar("T")
TRAININGS = ["plat.cli", *(f"plat.recipes.{name}" for name in ("distill", "expert_model", "imagine", "refine"))]


@dataclass(frozen=True)
class Ended:
    """What a shell would see of the command."""

    returncode: int
    stdout: str
    stderr: str


def run(*words: object) -> str:
    """Run ``plat`` with these words; return what it printed. It exits as the command does."""
    with redirect_stdout(io.StringIO()) as out:
        main([*map(str, words)])
    return out.getvalue()


def run_plat(*words: object) -> Ended:
    """Run ``plat`` with these words; a fault of plat's own, which would be a traceback there, is raised here."""
    code, out, err = 0, io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main([*map(str, words)])
        except SystemExit as ended:
            code = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
            if isinstance(ended.code, str):
                print(ended.code, file=err)
    return Ended(code, out.getvalue(), err.getvalue())


def kill_plat(ready: Callable[[], bool], output: Path, *words: object) -> None:
    """Run ``plat`` with these words in a process of its own, and kill that as soon as it has done what is asked for.

    The process is forked from one that has imported what trainings need, once for all of them.

    Args:
        ready: says whether it has.
        output: file for what it prints.
        words: of the command.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(TRAININGS)
    process = context.Process(target=_plat, args=([*map(str, words)], output))
    process.start()
    deadline = time.monotonic() + 240
    while not ready():
        assert process.is_alive(), output.read_text()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL, output.read_text()  # it had not ended by itself


def in_time(work: Callable[[], T], seconds: float = 60.0) -> list[T]:
    """Return what some work returns, in a list; that of work which does not end is empty."""
    done: list[T] = []
    thread = threading.Thread(target=lambda: done.append(work()), daemon=True)
    thread.start()
    thread.join(seconds)
    return done


def _plat(words: list[str], output: Path) -> None:
    with output.open("wb") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    main(words)
