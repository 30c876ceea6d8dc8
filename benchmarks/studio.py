"""CPU time that the studio's page takes for a frame: all of it in a browser that draws in software, and its own part.

python benchmarks/studio.py         # needs the extra studio, Chromium, and: pip install playwright

A policy plays eight keyframes again and again. The page is measured as it is, and with what makes it cheap left out:
with fine shapes, and with all pixels while the robot moves. CPU time is measured, as machines have other things to do,
all in one run, in turns; compare the ratio to the first line between machines.

Then the page's own part: what is left for the CPU where a GPU fills the pixels. The browser is told not to say that it
draws in software, so that the page has shadows and smooth edges as on a GPU, and not to carry out what is to be drawn.
Counted are the CPU time of its main thread and of its other ones, draw calls, triangles and bytes of messages for each
new pose, while a policy plays and while a hand is dragged.
"""

import itertools
import math
import os
import shutil
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

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
# Chromium carries out no drawing: all that a page does for a frame remains, and no pixel.
_NO_DRAWING = "--disable-gl-drawing-for-tests"
_FRAME = 1000 / 30  # ms: 30 frames a second
_POSE = 1000  # bytes: messages with poses of bodies are longer, those of the timeline are shorter
_COUNT = "window.frames = 0; const count = () => { window.frames += 1; requestAnimationFrame(count); }; count();"

# Before the page: it does not learn that it is drawn in software, and what it draws is counted.
_AS_ON_A_GPU = """
const { prototype } = WebGL2RenderingContext, { getExtension } = prototype;
prototype.getExtension = function (name) { return /debug_renderer/.test(name) ? null : getExtension.call(this, name); };
window.counted = { frames: 0, draws: 0, triangles: 0 };
let last = null;
const corners = {
  drawArrays: (first, count) => count, drawElements: (count) => count,
  drawArraysInstanced: (first, count, copies) => count * copies,
  drawElementsInstanced: (count, type, offset, copies) => count * copies,
};
for (const [name, count] of Object.entries(corners)) {
  const draw = prototype[name];
  prototype[name] = function (mode, ...rest) {
    if (document.timeline.currentTime !== last) counted.frames += 1;
    last = document.timeline.currentTime;
    counted.draws += 1;
    if (mode === this.TRIANGLES) counted.triangles += count(...rest) / 3;
    draw.call(this, mode, ...rest);
  };
}
"""


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
    print(
        f"\n{'alone, without pixels':24s}  main thread ms  to draw ms  others ms  Python ms   bytes  draws  triangles"
    )
    with _browser(_NO_DRAWING) as browser:
        for name, what in {"a policy plays": _play, "a hand is dragged": _drag}.items():
            own = _measure_own(browser, what, config)
            print(
                f"{name:25s} {own.main:14.1f} {own.again:11.1f} {own.others:10.1f} {own.python:10.1f} "
                f"{own.sent:7.0f} {own.draws:6.0f} {own.triangles:10.0f}"
            )
            print(f"{'':25s} main thread: {own.main / _FRAME:.2f} of a frame at 30 a second", flush=True)


def _session(policy: str) -> Session:
    """Return a session with eight keyframes."""
    session = Session(G1, {"policy": load_policy(policy).deployed()})
    session.begin_with("wave")
    session.select(len(session.timeline.keyframes))
    session.insert_template("bow")
    session.playback.loop = True
    return session


def _measure(browser: Any, kind: Page, config: StudioBenchmarkConfig) -> tuple[float, float, float]:
    """Return CPU milliseconds of the browser and of Python a frame, and frames a second."""
    session = _session(config.policy)
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


@dataclass(frozen=True)
class Own:
    """The page's own work for each new pose.

    The page draws more often than there are new poses. What it takes to draw a picture again is measured at rest and
    taken off, so that one picture a pose is left.

    Args:
        main: CPU time of the page's main thread, with one picture (ms).
        again: of that, to draw the picture (ms).
        others: CPU time of its other threads, with all pictures (ms).
        python: of the studio itself (ms).
        sent: bytes of the studio's messages.
        draws: draw calls of a picture.
        triangles: in them.
    """

    main: float
    again: float
    others: float
    python: float
    sent: float
    draws: float
    triangles: float


def _measure_own(browser: Any, what: Callable[[Any, int], None], config: StudioBenchmarkConfig) -> Own:
    """Return the page's own work while it does something."""
    session, kind = _session(config.policy), Page(False, "")
    with tempfile.TemporaryDirectory() as folder, _served(session, kind, Path(folder)) as address, _sent() as sent:
        page = browser.new_page(viewport={"width": config.width, "height": config.height})
        page.set_default_timeout(180_000)
        page.add_init_script(_AS_ON_A_GPU)
        page.goto(address)
        page.wait_for_function("document.querySelector('#dock-cover').style.display === 'none'")
        page.wait_for_timeout(2000)  # the shapes have arrived

        def spent(what: Callable[[Any, int], None], frames: int) -> dict[str, float]:
            before = {**page.evaluate("counted"), **_threads(), **sent}
            what(page, frames)
            after = {**page.evaluate("counted"), **_threads(), **sent}
            return {name: after[name] - before[name] for name in after}

        what(page, config.frames)
        did = spent(what, 4 * config.frames)
        if page.evaluate("window.platMoving"):
            page.keyboard.press("Space")
        page.wait_for_timeout(1000)
        rest = spent(_again, 2 * config.frames)
        page.close()
    poses, pictures = max(did["poses"], 1), max(did["frames"], 1)
    again = rest["main"] / max(rest["frames"], 1)
    return Own(
        main=max(did["main"] - again * pictures, 0.0) / poses + again,
        again=again,
        others=did["others"] / poses,
        python=did["python"] / poses,
        sent=did["bytes"] / poses,
        draws=did["draws"] / pictures,
        triangles=did["triangles"] / pictures,
    )


def _play(page: Any, frames: int) -> None:
    if not page.evaluate("window.platMoving"):
        page.keyboard.press("Space")
    page.wait_for_function(f"counted.frames > {page.evaluate('counted.frames') + frames}")


def _drag(page: Any, frames: int) -> None:
    """Drag the ball of the right hand to and fro."""
    x, y = page.evaluate(_BALL)
    page.mouse.move(x, y)
    page.wait_for_timeout(300)
    page.mouse.down()
    for step in range(frames):
        page.mouse.move(x + 30 * math.sin(step / 8), y - 20 * math.sin(step / 8))
        page.evaluate("() => new Promise(requestAnimationFrame)")
    page.mouse.move(x, y)
    page.wait_for_timeout(200)
    page.mouse.up()


def _again(page: Any, frames: int) -> None:
    """Draw what is there, again and again."""
    page.evaluate(
        """async (frames) => {
          for (let count = 0; count < frames; count++) {
            window.__viserMutable.requestRender();
            await new Promise(requestAnimationFrame);
          }
        }""",
        frames,
    )


# The pixel of a handle: viser keeps its objects there for tests.
_BALL = """() => {
  const { nodeRefFromName, camera, canvas } = window.__viserMutable;
  const ball = nodeRefFromName["/world/handles/right_hand"];
  const place = ball.getWorldPosition(camera.position.clone()).project(camera), box = canvas.getBoundingClientRect();
  return [box.x + ((place.x + 1) / 2) * box.width, box.y + ((1 - place.y) / 2) * box.height];
}"""


@contextmanager
def _sent() -> Iterator[dict[str, int]]:
    """Count the bytes of the messages to browsers, and the messages with new poses."""
    from websockets.asyncio.server import ServerConnection

    count, send = {"bytes": 0, "poses": 0}, ServerConnection.send

    async def counting(connection: Any, message: Any, *args: Any, **kwargs: Any) -> None:
        count["bytes"] += len(message)
        count["poses"] += len(message) > _POSE
        await send(connection, message, *args, **kwargs)

    with mock.patch.object(ServerConnection, "send", counting):
        yield count


def _threads() -> dict[str, float]:
    """Return the CPU milliseconds of the main threads of pages, of their other threads, and of this process."""
    main = others = 0.0
    for number in _family():
        folder = Path("/proc") / str(number)
        try:
            if b"--type=renderer" not in (folder / "cmdline").read_bytes():
                continue
            for thread in (folder / "task").iterdir():
                spent = int((thread / "schedstat").read_text().split()[0]) / 1e6
                if thread.name == folder.name:
                    main += spent
                else:
                    others += spent
        except OSError:  # it has ended meanwhile
            continue
    return {"main": main, "others": others, "python": 1000 * time.process_time()}


def _family() -> set[int]:
    """Return the processes that this one has started, and theirs."""
    parents = {}
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue

    def mine(number: int) -> bool:
        while number in parents and number != os.getpid():
            number = parents[number]
        return number == os.getpid()

    return {number for number in parents if mine(number)}


def _now(page: Any) -> tuple[float, int, dict[str, float]]:
    clock, frames = page.evaluate("[performance.now(), window.frames]")
    return clock, frames, _spent()


def _spent() -> dict[str, float]:
    """Return the CPU seconds of this process and of the browser's so far."""
    seconds = {"python": 0.0, "browser": 0.0}
    for number in _family():
        try:
            fields = (Path("/proc") / str(number) / "stat").read_text().rpartition(")")[2].split()
            command = (Path("/proc") / str(number) / "cmdline").read_bytes()
        except OSError:  # it has ended meanwhile
            continue
        spent = (int(fields[11]) + int(fields[12])) * _CLICK
        if number == os.getpid():
            seconds["python"] += spent
        elif b"--user-data-dir" in command or b"--type=" in command:
            seconds["browser"] += spent
    return seconds


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
def _browser(*flags: str) -> Iterator[Any]:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError as error:
        raise StudioError("this benchmark needs: pip install playwright") from error
    path = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        raise StudioError(f"no browser: none of {', '.join(_BROWSERS)} is installed")
    with sync_playwright() as driver:
        # as a browser is on a machine without a GPU
        given = ["--no-sandbox", "--enable-unsafe-swiftshader", *flags]
        browser = driver.chromium.launch(executable_path=path, args=given)
        yield browser
        browser.close()


if __name__ == "__main__":
    torch.set_num_threads(1)
    with report_errors():
        main(tyro.cli(StudioBenchmarkConfig))
