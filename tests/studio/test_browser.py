"""The studio in a headless Chromium: what a user does with the mouse, and what is then to be seen."""

import shutil
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from plat.errors import StudioError
from plat.robots import G1
from plat.rotations import quat_rotate

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mjviser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("playwright.sync_api", reason="playwright is not installed (pip install playwright)")

from playwright.sync_api import Browser, Locator, sync_playwright

from plat.studio.app import Studio
from plat.studio.scene import CAMERA, LOOK_AT
from plat.studio.session import Session

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_PATIENCE = 180_000  # ms: a browser that draws in software, on a machine that has other things to do


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def studio(policies, tmp_path) -> Iterator[Studio]:
    studio = Studio(
        Session(G1, policies),
        host="127.0.0.1",
        port=free_port(),
        motions="generated:val@8",
        path="keyframes.json",
        folder=tmp_path,
    )
    thread = threading.Thread(target=studio.run)
    thread.start()
    yield studio
    studio.stop()
    thread.join(10)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    path = next((path for name in _BROWSERS if (path := shutil.which(name))), None)
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(_BROWSERS)} is installed")
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=flags)
        yield browser
        browser.close()


class User:
    """Somebody with the page open."""

    def __init__(self, studio: Studio, browser: Browser):
        self.session = studio.session
        self.page = browser.new_page(viewport={"width": 960, "height": 640})
        self.page.set_default_timeout(_PATIENCE)
        self.open(studio)

    def open(self, studio: Studio) -> None:
        self.page.goto(f"http://127.0.0.1:{studio.server.get_port()}")
        self.page.get_by_role("button", name="Add", exact=True).wait_for()

    def press(self, *buttons: str) -> None:
        for button in buttons:
            # forced: not after the button has stood still for two frames, which can take seconds to draw
            self.page.get_by_role("button", name=button, exact=True).first.click(force=True)

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click(force=True)

    def box(self, label: str) -> Locator:
        """The box to type into beside a label."""
        after_label = f'//label[normalize-space()="{label}"]/following::input'
        return self.page.locator(f'xpath=({after_label}[@type="text" or not(@type)])[1]')

    def enter(self, label: str, text: str) -> None:
        box = self.box(label)
        box.fill(text)
        box.press("Enter")

    def sees(self, text: str) -> None:
        self.page.get_by_text(text).first.wait_for()

    def pixel(self, point: np.ndarray) -> np.ndarray:
        """Where a point of the world is on the screen, for the camera that the page begins with."""
        box = self.page.locator("canvas").first.bounding_box()
        forward = np.subtract(LOOK_AT, CAMERA) / np.linalg.norm(np.subtract(LOOK_AT, CAMERA))
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        ray = point - np.array(CAMERA)
        scale = 0.5 * box["height"] / np.tan(np.radians(75 / 2)) / (ray @ forward)  # viser's field of view
        offset = scale * np.array([ray @ right, -ray @ np.cross(right, forward)])
        return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]) + offset

    def table(self) -> list[str]:
        """The rows of the keyframes' scores."""
        return self.page.locator("table", has_text="keyframe").locator("tr").all_inner_texts()

    def until(self, done) -> None:
        deadline = time.monotonic() + _PATIENCE / 1000
        while not done():
            assert time.monotonic() < deadline, "nothing happened"
            self.page.wait_for_timeout(50)


@pytest.fixture
def user(studio, browser) -> Iterator[User]:
    user = User(studio, browser)
    yield user
    user.page.close()


def test_keyframes_are_made_played_saved_and_loaded(user, studio, tmp_path):
    session, joint = user.session, G1.joint_names.index("left_shoulder_pitch")
    user.page.get_by_text("Left arm").click(force=True)
    for count, angle in enumerate((-0.5, -1.0, -1.5), 1):
        user.press("Add")
        user.until(lambda count=count: len(session.timeline.keyframes) == count)
        user.enter("shoulder_pitch", str(angle))
        user.until(lambda angle=angle: np.isclose(session.timeline.pose.joint_pos[joint], angle))

    user.box("Name").press_sequentially("arm up")
    user.until(lambda: session.timeline.labels[3] == "3 arm up")

    user.tab("Play")
    user.press("Play")
    user.until(lambda: "plat" in session.scores)
    user.sees("held")
    assert session.player.qpos[7 + joint] < -1.0, "the arm is raised"
    user.until(lambda: len(user.table()) == 4)
    first = user.table()
    assert all("yes" in row for row in first[1:]), first

    user.tab("Files")
    user.press("Save")
    user.sees("Saved")
    assert (tmp_path / "keyframes.json").exists()
    user.press("New")
    user.until(lambda: not session.timeline.keyframes)
    user.open(studio)  # as after a reload of the page
    user.tab("Files")
    user.press("Load")
    user.until(lambda: len(session.timeline.keyframes) == 3)
    user.tab("Play")
    user.press("Play")
    user.until(lambda: "plat" in session.scores)
    user.until(lambda: len(user.table()) == 4)
    assert user.table() == first

    user.press("Compare all policies")
    user.sees("3 of 3")
    user.until(lambda: set(session.scores) == {"plat", "expert"})


def test_a_hand_is_dragged_and_the_drag_undone(user):
    session = user.session
    user.press("Add")
    user.until(lambda: session.timeline.keyframes)
    before = session.poser.frames(session.timeline.pose.qpos)
    hand = before["left hand"]
    # the arrow that points away from the hand's upper side
    up = quat_rotate(torch.from_numpy(hand.quat), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)).numpy()
    begin, end = user.pixel(hand.pos + 0.16 * up), user.pixel(hand.pos + 0.36 * up)
    mouse = user.page.mouse
    mouse.move(*begin)
    user.page.wait_for_timeout(1500)  # until the page has found out what is under the mouse
    mouse.down()
    for share in np.linspace(0, 1, 8):
        mouse.move(*(begin + share * (end - begin)))
        user.page.wait_for_timeout(150)
    mouse.up()
    user.until(lambda: not np.allclose(session.timeline.pose.qpos, G1.default_qpos, atol=0.1))
    user.page.wait_for_timeout(1000)
    after = session.poser.frames(session.timeline.pose.qpos)
    np.testing.assert_allclose(after["left hand"].pos, hand.pos + 0.2 * up, atol=0.04)
    np.testing.assert_allclose(after["left foot"].pos, before["left foot"].pos, atol=0.01)
    user.page.keyboard.press("Control+z")
    user.until(lambda: np.allclose(session.timeline.pose.qpos, G1.default_qpos))
    user.press("Redo")
    user.until(lambda: not np.allclose(session.timeline.pose.qpos, G1.default_qpos, atol=0.1))


def test_poses_come_out_of_motions(user):
    session = user.session
    user.tab("Motion")
    user.press("Load motions")
    user.sees("2 clips")
    user.press("Replace all keyframes")
    user.until(lambda: len(session.timeline.keyframes) >= 8)
    user.press("As new")
    user.until(lambda: len(session.timeline.keyframes) >= 9)


def test_what_goes_wrong_is_said_on_the_page(user):
    user.press("Play")
    user.sees("expected at least one")
    user.tab("Files")
    user.enter("File", "nowhere.json")
    user.press("Load")
    user.sees("no such file")
    user.tab("Motion")
    user.enter("Motions", "nothing.npz")
    user.press("Load motions")
    user.sees("no such file, folder")


def test_a_port_that_is_taken(studio, policies):
    with pytest.raises(StudioError, match="cannot be opened"):
        Studio(
            Session(G1, policies),
            host="127.0.0.1",
            port=studio.server.get_port(),
            motions="",
            path="",
            folder=Path(),
        )


def test_downloads_and_uploads(user, tmp_path):
    session = user.session
    user.press("Add", "Add")
    user.until(lambda: len(session.timeline.keyframes) == 2)
    user.tab("Files")
    user.press("Download")
    with user.page.expect_download() as download:
        user.page.get_by_text("keyframes.json").last.click()
    path = Path(tmp_path) / "mine.json"
    download.value.save_as(path)
    user.press("New")
    user.until(lambda: not session.timeline.keyframes)
    with user.page.expect_file_chooser() as chooser:
        user.press("Upload")
    chooser.value.set_files(path)
    user.until(lambda: len(session.timeline.keyframes) == 2)
