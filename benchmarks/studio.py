"""CPU time that the studio's page takes for a frame, in a browser that draws in software.

python benchmarks/studio.py         # needs the extra studio, Chromium, and: pip install playwright

A policy plays eight keyframes again and again. The page is measured as it is, and with what makes it cheap left out:
with fine shapes, and with all pixels while the robot moves. CPU time is measured, as machines have other things to do,
all in one run, in turns; compare the ratio to the first line between machines.
"""

import itertools
import os
import shutil
import socket
import statistics
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
import tyro

from plat.errors import StudioError
from plat.robots import G1
from plat.runs import load_policy, report_errors
from plat.studio.app import Studio
from plat.studio.scene import Bodies
from plat.studio.session import Session

_FINE = 0.0004, 0.0008
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_CLICK = 1 / os.sysconf("SC_CLK_TCK")
_COUNT = "window.frames = 0; const count = () => { window.frames += 1; requestAnimationFrame(count); }; count();"


@dataclass(frozen=True)
class Page:
    """Page to measure.

    Args:
        fine: whether shapes have twice the triangles.
        query: end of the page's address.
    """

    fine: bool
    query: str


PAGES = {
    "all pixels, fine shapes": Page(True, "?sharp"),
    "all pixels": Page(False, "?sharp"),
    "as it is": Page(False, ""),
}


@dataclass(kw_only=True)
class StudioBenchmarkConfig:
    """Settings of the studio's benchmark."""

    policy: str = "imagined-g1"
    """The policy that plays."""
    width: int = 1280
    """Pixels of the window across."""
    height: int = 720
    """Pixels of the window down."""
    frames: int = 30
    """Frames in a measurement."""
    rounds: int = 2
    """Measurements of each page, in turns."""


def main(config: StudioBenchmarkConfig) -> None:
    """Print milliseconds of CPU time a frame, and ratios."""
    measured: dict[str, list[tuple[float, float, float]]] = {name: [] for name in PAGES}
    with _browser() as browser:
        for _, (name, page) in itertools.product(range(config.rounds), PAGES.items()):
            measured[name].append(_measure(browser, page, config))
    print(f"{'':24s} browser ms/frame  Python ms/frame  frames/s  ratio")
    first = None
    for name, rows in measured.items():
        spent, python, rate = (statistics.median(column) for column in zip(*rows, strict=True))
        first = first or spent
        print(f"{name:24s} {spent:16.0f} {python:16.0f} {rate:9.1f} {spent / first:6.2f}", flush=True)


def _measure(browser: Any, kind: Page, config: StudioBenchmarkConfig) -> tuple[float, float, float]:
    """Return CPU milliseconds of the browser and of Python a frame, and frames a second."""
    session = Session(G1, {"policy": load_policy(config.policy).deployed()})
    session.begin_with("wave")
    session.select(len(session.timeline.keyframes))
    session.insert_template("bow")
    session.playback.loop = True
    with tempfile.TemporaryDirectory() as folder, _served(session, kind, Path(folder)) as address:
        page = browser.new_page(viewport={"width": config.width, "height": config.height})
        page.set_default_timeout(180_000)
        page.goto(address + kind.query)
        page.wait_for_function("document.querySelector('#dock-cover').style.display === 'none'")
        page.evaluate(_COUNT)
        page.keyboard.press("Space")
        # the page finds out how slow this machine is
        page.wait_for_function("window.platMoving && window.frames > 30")
        clock, frames, before = _now(page)
        page.wait_for_function(f"window.frames > {frames + config.frames}")
        later, seen, after = _now(page)
        page.close()
    count = seen - frames
    spent, python = (1000 * (after[who] - before[who]) / count for who in ("browser", "python"))
    return spent, python, 1000 * count / (later - clock)


def _now(page: Any) -> tuple[float, int, dict[str, float]]:
    clock, frames = page.evaluate("[performance.now(), window.frames]")
    return clock, frames, _spent()


def _spent() -> dict[str, float]:
    """Return the CPU seconds of this process and of the browser's so far."""
    parents, seconds, browsers = {}, {}, set()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            command = (entry / "cmdline").read_bytes()
        except OSError:  # it has ended meanwhile
            continue
        number = int(entry.name)
        parents[number], seconds[number] = int(fields[1]), (int(fields[11]) + int(fields[12])) * _CLICK
        if b"--user-data-dir" in command or b"--type=" in command:
            browsers.add(number)

    def mine(number: int) -> bool:
        while number in parents and number != os.getpid():
            number = parents[number]
        return number == os.getpid()

    return {"python": seconds[os.getpid()], "browser": sum(seconds[number] for number in browsers if mine(number))}


@contextmanager
def _served(session: Session, kind: Page, folder: Path) -> Iterator[str]:
    bodies = Bodies(G1, *_FINE) if kind.fine else None
    studio = Studio(
        session, host="127.0.0.1", port=_free_port(), motions="", path="k.json", folder=folder, bodies=bodies
    )
    thread = threading.Thread(target=studio.run)
    thread.start()
    try:
        yield f"http://127.0.0.1:{studio.server.get_port()}/"
    finally:
        studio.stop()
        thread.join(10)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def _browser() -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise StudioError("this benchmark needs: pip install playwright") from error
    path = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        raise StudioError(f"no browser: none of {', '.join(_BROWSERS)} is installed")
    with sync_playwright() as driver:
        # as a browser is on a machine without a GPU
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox", "--enable-unsafe-swiftshader"])
        yield browser
        browser.close()


if __name__ == "__main__":
    torch.set_num_threads(1)
    with report_errors():
        main(tyro.cli(StudioBenchmarkConfig))
