"""The studio in a headless Chromium: what a user does with mouse and keys, and what is then to be seen."""

import itertools
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from plat.errors import StudioError
from plat.robots import G1
from plat.rotations_np import quat_to_matrix

pytest.importorskip("viser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mjviser", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("mink", reason="the extra plat-rl[studio] is not installed")
pytest.importorskip("playwright.sync_api", reason="no playwright: pip install playwright")

from playwright.sync_api import Browser, Locator

from plat.studio.app import Studio
from plat.studio.autosave import AUTOSAVE
from plat.studio.panels.pose import _REACH
from plat.studio.scene import CAMERA, FIELD_OF_VIEW, LOOK_AT
from plat.studio.session import Session
from plat.studio.templates import template
from plat.studio.timeline import Timeline

# Errors are shown for 15 s: these are over when a test says so.
_LINGERING = """const later = window.setTimeout; window.lingering = [];
window.setTimeout = (end, time, ...more) => time === 15000 ? lingering.push(end) : later(end, time, ...more);"""
_PATIENCE = 180_000  # ms: a browser that draws in software, on a machine that has other things to do


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("studio")


@pytest.fixture(scope="module")
def studio(policies, folder) -> Iterator[Studio]:
    studio = Studio(
        Session(G1, policies),
        host="127.0.0.1",
        port=free_port(),
        motions="generated:val@8",
        path="keyframes.json",
        folder=folder,
    )
    thread = threading.Thread(target=studio.run)
    thread.start()
    yield studio
    studio.stop()
    thread.join(10)


class User:
    """Somebody with the page open."""

    def __init__(self, studio: Studio, browser: Browser, script: str = ""):
        self.studio, self.session = studio, studio.session
        self.page = browser.new_page(viewport={"width": 1000, "height": 560})
        self.page.set_default_timeout(_PATIENCE)
        self.page.add_init_script(script)
        self._marks = itertools.count()
        self.page.goto(f"http://127.0.0.1:{studio.server.get_port()}")
        self.page.wait_for_function("document.querySelector('#dock-cover').style.display === 'none'")

    def begin(self, name: str | None = None) -> None:
        """Put everything back, with the keyframes of a template."""
        session, done = self.session, threading.Event()

        def reset() -> None:
            session.playback.stop()
            timeline = Timeline.empty(G1, session.timing)
            session.edit(timeline if name is None else template(name, timeline, session.poser))
            session.select(1)

        self.studio._desk.ask(reset)
        self.studio._desk.ask(done.set)
        assert done.wait(30)
        self.settle()
        self.page.evaluate("document.activeElement.blur()")

    def settle(self) -> None:
        """Wait until the page shows all that the session holds by now: news come in order, and this is the last."""
        mark, page = f"mark {next(self._marks)}", self.studio._page
        self.studio._desk.ask(lambda: page.wait(mark))
        self.sees(mark)
        page.wait_no_more(mark)
        self.page.locator(".dock-pill").wait_for(state="hidden")

    def press(self, *buttons: str) -> None:
        for button in buttons:
            self.sent()
            # forced: not after the button has stood still for two frames, which can take seconds to draw
            self.page.get_by_role("button", name=button, exact=True).first.click(force=True)

    def key(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click(force=True)

    def box(self, label: str) -> Locator:
        """The box to type into beside a label."""
        after_label = f'//label[normalize-space()="{label}"]/following::input'
        return self.page.locator(f'xpath=({after_label}[@type="text" or not(@type)])[1]')

    def sent(self) -> None:
        """Wait until the page has sent what was done: of 50 ms it sends the latest message only, of all its inputs."""
        self.page.evaluate("() => new Promise(done => setTimeout(done, 60))")

    def enter(self, label: str, text: str) -> None:
        box = self.box(label)
        self.sent()
        box.fill(text)
        box.press("Enter")

    def sees(self, text: str) -> None:
        self.page.get_by_text(text).first.wait_for()

    def center(self, selector: str) -> tuple[float, float]:
        # in one go: the timeline may be drawn anew at any time
        return tuple(
            self.page.evaluate(
                "name => { const box = document.querySelector(name).getBoundingClientRect();"
                "return [box.x + box.width / 2, box.y + box.height / 2]; }",
                selector,
            )
        )

    def at(self, seconds: float) -> tuple[float, float]:
        """A point of the timeline, above the keyframes."""
        track = self.page.locator("#dock svg.track").bounding_box()
        first, last = (self.center(f'#dock [data-key="{n}"] path')[0] for n in (0, 1))
        return first + (last - first) * seconds / self.session.timeline.keyframes[0].time, track["y"] + 12

    def drag(self, begin: tuple[float, float], end: tuple[float, float], pause: int = 60) -> None:
        mouse = self.page.mouse
        mouse.move(*begin)
        self.page.wait_for_timeout(pause)
        mouse.down()
        for share in np.linspace(0, 1, 6):
            mouse.move(*(np.array(begin) + share * np.subtract(end, begin)))
            self.page.wait_for_timeout(pause)
        mouse.up()

    def drag_until_moved(self, begin: np.ndarray, end: np.ndarray) -> None:
        """Drag what is at a point of the world to another one, and wait for what comes of it."""
        session = self.session
        pose = session.timeline.pose.qpos
        self.settle()
        self.page.wait_for_timeout(1000)  # until the page has found out what is under the mouse
        self.drag(tuple(self.pixel(begin)), tuple(self.pixel(end)), pause=200)
        self.until(lambda: not np.allclose(session.timeline.pose.qpos, pose) and session._grip is None)
        self.settle()

    def pixel(self, point: np.ndarray) -> np.ndarray:
        """Where a point of the world is on the screen, for the camera that the page begins with."""
        box = self.page.locator("canvas").first.bounding_box()
        forward = np.subtract(LOOK_AT, CAMERA) / np.linalg.norm(np.subtract(LOOK_AT, CAMERA))
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        ray = point - np.array(CAMERA)
        scale = 0.5 * box["height"] / np.tan(np.radians(FIELD_OF_VIEW / 2)) / (ray @ forward)
        offset = scale * np.array([ray @ right, -ray @ np.cross(right, forward)])
        return np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]) + offset

    def until(self, done) -> None:
        deadline = time.monotonic() + _PATIENCE / 1000
        while not done():
            assert time.monotonic() < deadline, "nothing happened"
            self.page.wait_for_timeout(50)


@pytest.fixture(scope="module")
def user(studio, browser) -> Iterator[User]:
    user = User(studio, browser)
    yield user
    user.page.close()


def test_the_page_has_its_name_and_the_timeline_covers_nothing(user):
    user.begin("wave")
    user.until(lambda: "plat keyframe studio" in user.page.title())
    assert user.page.locator('link[rel="icon"]').get_attribute("href").endswith("icon.svg")
    canvas, dock = (user.page.locator(name).first.bounding_box() for name in ("canvas", "#dock"))
    assert canvas["y"] + canvas["height"] <= dock["y"] + 1


def test_keyframes_are_selected_dragged_and_held_with_the_mouse(user):
    session = user.session
    user.begin("bow")
    user.page.mouse.click(*user.center('#dock [data-key="2"] path'))
    user.until(lambda: session.timeline.selected == 2)
    begin = user.center('#dock [data-key="2"] path')
    step = user.at(1.0)[0] - user.at(0.0)[0]
    user.drag(begin, (begin[0] - 0.4 * step, begin[1]))
    user.until(lambda: session.timeline.keyframes[1].time == pytest.approx(1.8, abs=0.03))
    assert session.timeline.keyframes[0].time == 0.8, "the others stay"
    edge = user.center('#dock [data-edge="1"]')
    user.page.mouse.move(*edge)
    user.page.mouse.down()
    for share in (0.1, 0.2):
        user.page.mouse.move(edge[0] + share * step, edge[1])
        user.until(lambda share=share: session.timeline.holds[0] == pytest.approx(0.6 + share, abs=0.04))
        user.studio._desk.ask(session.rest)  # a pause within the drag
    user.page.mouse.up()
    user.until(lambda: not session._dragging)
    user.key("Control+z", "Control+z")
    user.until(lambda: [frame.time for frame in session.timeline.keyframes] == [0.8, 2.2])


def test_the_playhead_is_scrubbed_and_the_view_zoomed(user):
    session = user.session
    user.begin("bow")
    user.drag(user.at(0.1), user.at(0.4))
    user.until(lambda: session.playback.cursor == pytest.approx(0.4, abs=0.03))
    assert not session.shows_selected, "the pose between keyframes is shown"
    user.drag(user.at(0.4), (user.at(0.8)[0] + 3, user.at(0.8)[1]))
    user.until(lambda: session.playback.cursor == 0.8)
    user.settle()
    assert session.timeline.selected == 1, "it snaps to keyframes"
    before = user.at(1.0)[0] - user.at(0.0)[0]
    user.page.mouse.wheel(0, -200)
    user.until(lambda: user.at(1.0)[0] - user.at(0.0)[0] > 1.5 * before)
    user.key("0")
    user.until(lambda: user.at(1.0)[0] - user.at(0.0)[0] == pytest.approx(before))


def test_keys_add_mirror_copy_paste_and_delete(user):
    session = user.session
    user.begin("reach")
    user.key("Control+c", "End", "Control+v")
    user.until(lambda: session.timeline.labels == ("start", "1 reach", "2 back", "3 reach"))
    pose = session.timeline.pose.qpos
    user.key("m")
    user.until(lambda: not np.allclose(session.timeline.pose.qpos, pose, atol=0.1))
    user.key("Control+z", "Delete", "a")
    user.until(lambda: session.timeline.labels == ("start", "1 reach", "2 back", "3"))
    user.key("Home", "ArrowRight")
    user.until(lambda: session.timeline.selected == 1)
    user.page.get_by_label("Name", exact=True).fill("am")
    user.key("Enter")
    user.until(lambda: session.timeline.labels[1] == "1 am")
    assert len(session.timeline.keyframes) == 3, "keys that are typed into a box do nothing else"
    takes = user.page.get_by_label("Takes (s)", exact=True)
    for text in ("soon", "30.5", "0", ""):
        takes.fill(text)
        user.key("Enter")
    for text in ("soon", "30.5", "0"):
        user.sees(f'Takes (s) is "{text}", expected a number from 0.02 to 30.')
    user.sees("Takes (s) is empty")
    user.until(lambda: takes.input_value() == "0.8")
    takes.fill("0,5")
    user.key("Enter")
    user.until(lambda: session.timeline.interval == 0.5)
    # the third level of other keyboards: AltGr in Linux, in Windows, Option
    for held in ({}, {"ctrlKey": True, "altKey": True}, {"altKey": True}):
        user.page.evaluate(
            "held => document.body.dispatchEvent(new KeyboardEvent('keydown', { key: '[', bubbles: true, ...held }))",
            held,
        )
    user.until(lambda: session.timeline.interval == 0.44)
    user.key("?")
    user.sees("Keys and mouse")
    user.key("Escape")
    user.page.get_by_text("Keys and mouse").wait_for(state="hidden")


def test_buttons_are_pressed_with_the_keyboard(user):
    user.begin("wave")
    user.page.get_by_role("button", name="Mirror left and right").focus()
    user.key("Tab", "Shift+Tab")  # as somebody comes who has no mouse
    pose = user.session.timeline.pose.qpos
    user.key("Space")
    user.until(lambda: not np.allclose(user.session.timeline.pose.qpos, pose))
    assert not user.session.playback.playing, "the key was the button's"
    assert user.page.evaluate("document.activeElement.ariaLabel") == "Mirror left and right"


def test_keyframes_are_gone_through_with_the_keyboard(user):
    page, active = user.page, "document.activeElement.getAttribute"
    user.begin("wave")
    page.get_by_role("button", name="Help").focus()
    user.key("Tab")
    assert page.evaluate(f"{active}('role')") == "listbox"
    for name in ("2 out 1, 1.10 s", "3 in 1, 1.50 s"):
        user.key("ArrowRight")
        page.get_by_role("option", name=name, selected=True).wait_for()
        chosen = page.evaluate(f"document.getElementById({active}('aria-activedescendant')).getAttribute('aria-label')")
        assert chosen == name
    page.evaluate("document.activeElement.blur()")


def test_playing_is_paused_stepped_slowed_and_scored(user):
    session, playback = user.session, user.session.playback
    user.begin("bow")
    user.page.get_by_label("Speed").select_option("1/10")
    user.until(lambda: playback.speed == 0.1)
    user.page.evaluate("document.activeElement.blur()")
    user.key("Space")
    user.until(lambda: playback.playing)
    user.key("Space")
    user.until(lambda: playback.paused)
    before = playback.cursor
    user.key(".", ".", ".")
    user.until(lambda: playback.cursor == pytest.approx(before + 0.06))
    user.key(",")
    user.until(lambda: playback.cursor == pytest.approx(before + 0.04))
    user.page.get_by_label("Speed").select_option("1x")
    user.page.evaluate("document.activeElement.blur()")
    user.key("Space")
    user.until(lambda: "plat" in playback.scores)
    user.until(lambda: user.page.locator('#dock [data-key="1"][data-status="reached"]').count() == 1)
    user.until(lambda: user.page.locator("#dock [data-distance]").count() == 1)
    user.tab("Play")
    user.sees("reached")
    user.drag(user.at(0.1), user.at(0.5))
    user.until(lambda: playback.cursor == pytest.approx(0.5, abs=0.03))
    assert playback.player is not None, "what was played can be looked at again"
    user.press("Compare all policies")
    user.until(lambda: set(playback.scores) == {"plat", "expert"})
    user.sees("2 of 2 reached")
    user.tab("Pose")
    assert session.timeline.labels == ("start", "1 bow", "2 rise")


def test_in_software_the_scene_has_fewer_pixels_while_it_moves(user):
    playback, pixels = user.session.playback, "document.querySelector('#root canvas[data-engine]').{}"
    user.begin("bow")
    width = user.page.evaluate(pixels.format("clientWidth"))
    drawn = pixels.format("getContext('webgl2').drawingBufferWidth")
    user.until(lambda: user.page.evaluate(drawn) == width)
    user.page.get_by_label("Speed").select_option("1/10")
    user.page.evaluate("document.activeElement.blur()")
    user.key("Space")
    user.until(lambda: playback.playing and user.page.evaluate(drawn) < 0.8 * width)
    assert user.page.evaluate(pixels.format("width")) == width, "what the page itself is told"
    user.key("Escape")
    user.until(lambda: user.page.evaluate(drawn) == width)
    user.page.get_by_label("Speed").select_option("1x")
    user.until(lambda: playback.speed == 1)


def test_a_robot_that_has_walked_away_is_seen_when_it_stops(user):
    session, playback, world = user.session, user.session.playback, user.studio._world
    user.begin()
    ahead = G1.default_qpos + 0.6 * np.eye(36)[0]
    user.studio._desk.ask(lambda: session.edit(session.timeline.inserted(ahead, 1.0)))
    user.key("Home")
    user.until(lambda: playback.cursor == 0.0)  # the keyframe that was added is at 1 s
    user.key("Space")
    user.until(lambda: playback.cursor > 0.8)
    user.key("Space")
    user.until(lambda: playback.paused)
    user.settle()
    robot = playback.player.pose_at(playback.cursor)[:2]
    assert robot[0] > 0.2
    np.testing.assert_allclose(world.position[:2], -robot, atol=1e-6)
    user.key("f")
    user.settle()
    (client,) = user.studio.server.get_clients().values()
    np.testing.assert_allclose(client.camera.look_at[:2], [0.0, 0.0], atol=1e-3)
    user.key("Home")  # poses are edited where they are
    user.until(lambda: np.allclose(world.position, 0.0))
    user.key("Escape")


def test_two_policies_play_side_by_side(user):
    playback = user.session.playback
    user.begin("bow")
    playback.set_beside("expert")
    user.key("Space")
    user.until(lambda: dict(playback.players).keys() == {"plat", "expert"} and playback.cursor > 0.1)
    user.key("Escape")
    user.until(lambda: not playback.players)
    playback.set_beside(None)


def test_a_hand_is_dragged_by_its_arrow(user):
    session = user.session
    user.begin("reach")
    user.key("End", "a")
    user.until(lambda: len(session.timeline.keyframes) == 3)
    pose = session.timeline.pose.qpos
    hand, foot = (session.poser.frames(pose)[name] for name in ("left hand", "left foot"))
    user.key("w")  # the arrow that points up in the world
    up = np.array([0.0, 0.0, 1.0])
    user.until(lambda: np.allclose(user.studio._pose._gizmo.wxyz, [1, 0, 0, 0]))
    user.drag_until_moved(hand.pos + 0.95 * _REACH * up, hand.pos + (0.95 * _REACH + 0.15) * up)
    after = session.poser.frames(session.timeline.pose.qpos)
    np.testing.assert_allclose(after["left hand"].pos, hand.pos + 0.15 * up, atol=0.05)
    np.testing.assert_allclose(after["left foot"].pos, foot.pos, atol=0.01)
    user.key("Control+z")
    user.until(lambda: np.allclose(session.timeline.pose.qpos, pose))
    user.key("w")


def test_a_ball_is_dragged_and_the_drag_undone(user):
    session = user.session
    user.begin("bow")
    pose = session.timeline.pose.qpos
    hand = session.poser.frames(pose)["right hand"]
    ball = user.studio._pose._balls["right hand"].position
    user.drag_until_moved(ball, np.add(ball, [0.0, 0.0, 0.12]))
    assert user.studio._pose._handle.value == "right hand", "it needs no click before"
    after = session.poser.frames(session.timeline.pose.qpos)["right hand"]
    np.testing.assert_allclose(after.pos[2], hand.pos[2] + 0.12, atol=0.05)
    user.key("Control+z")
    user.until(lambda: np.allclose(session.timeline.pose.qpos, pose))


def _hides(qpos: np.ndarray, point: np.ndarray) -> bool:
    """Whether the robot is between the camera and a point."""
    model, data, geom = G1.shared_model, mujoco.MjData(G1.shared_model), np.zeros(1, dtype=np.int32)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    ray = point - np.array(CAMERA)
    return 0 <= mujoco.mj_ray(model, data, np.array(CAMERA), ray, None, 0, -1, geom) < 0.9


def test_a_ball_behind_the_body_is_seen_and_dragged(user):
    session, panel = user.session, user.studio._pose
    user.begin("bow")
    joint = G1.joint_names.index("left_shoulder_pitch")
    for angle in np.arange(0.0, 1.5, 0.1):  # the arm goes back until the robot is in front of it
        user.studio._desk.ask(lambda angle=angle: session.set_joint(joint, float(angle)))
        user.settle()
        ball = np.array(panel._balls["left hand"].position)
        if _hides(session.timeline.pose.qpos, ball):
            break
    assert _hides(session.timeline.pose.qpos, ball)
    shapes = "window.__viserMutable.nodeRefFromName['/world/handles/left_hand'].children.find((child) => child.isMesh)"
    user.page.wait_for_function(f"{shapes}.children.some((child) => child.material?.opacity < 0.6)")
    user.drag_until_moved(ball, np.add(ball, [0.0, 0.0, 0.1]))
    assert panel._handle.value == "left hand"


def test_a_joint_is_turned_by_its_ring(user):
    session, panel = user.session, user.studio._pose
    user.begin("bow")
    pose, joint = session.timeline.pose.qpos, G1.joint_names.index("left_knee")
    user.studio._clicked("left_knee_link")
    user.until(lambda: panel._ring.visible)
    frame = session.poser.joint_frame(pose, joint)
    arc = 0.65 * _REACH * np.array([[np.cos(angle), np.sin(angle), 0.0] for angle in (0.8, 1.2)])  # around its z
    begin, end = frame.pos + arc @ quat_to_matrix(frame.quat).T
    user.drag_until_moved(begin, end)
    change = session.timeline.pose.qpos - pose
    # the ring is as thick as a finger: where on it the mouse has it is only known to some tenths
    assert 0.1 < change[7 + joint] < 0.9
    assert np.count_nonzero(np.abs(change) > 1e-6) == 1, "nothing else moves"
    user.key("Control+z")
    user.until(lambda: np.allclose(session.timeline.pose.qpos, pose))


def test_negative_angles_are_typed(user):
    user.begin("bow")
    folder = user.page.get_by_text("Left arm", exact=True)
    folder.click(force=True)
    box = user.box("shoulder_pitch")
    box.click(force=True)
    user.key("Control+a")
    for letter in "-0.75":
        user.key(letter)
        user.sent()
    joint = G1.joint_names.index("left_shoulder_pitch")
    user.until(lambda: user.session.timeline.pose.joint_pos[joint] == pytest.approx(-0.75))
    assert box.input_value() == "-0.75"
    user.key("Enter")
    folder.click(force=True)


def test_keys_are_the_studios_again_after_a_choice_in_a_list(user):
    session = user.session
    user.begin("bow")
    user.box("Commands").click(force=True)
    user.page.get_by_role("option", name="hands", exact=True).click(force=True)
    user.until(lambda: not session.timeline.pose.whole)
    user.page.wait_for_function("document.activeElement === document.body")
    user.key("a")
    user.until(lambda: len(session.timeline.keyframes) == 3)


def test_the_impossible_is_explained(user):
    session = user.session
    user.begin("bow")
    user.studio._desk.ask(lambda: session.set_root(session.timeline.pose.qpos[:7] + 3 * np.eye(7)[0], "far"))
    user.page.locator("#dock .status", has_text="m in 0.80 s takes 7.").wait_for()
    assert user.page.locator('#dock [data-key="1"]', has_text="▲!").count() == 1


def test_tables_and_buttons_are_within_the_page(user):
    session = user.session
    user.begin("bow")
    user.studio._desk.ask(lambda: session.set_root(session.timeline.pose.qpos[:7] + 3 * np.eye(7)[0], "far"))
    user.tab("Play")
    user.press("Compare all policies")
    user.until(lambda: set(session.playback.scores) == {"plat", "expert"})
    user.settle()
    right = "Math.max(...[...document.querySelectorAll('#root td')].map((cell) => cell.getBoundingClientRect().right))"
    user.until(lambda: user.page.evaluate(f"{right} <= innerWidth"))
    bar = user.page.locator("#dock .bar")
    assert bar.evaluate("(bar) => bar.scrollWidth <= bar.clientWidth || getComputedStyle(bar).overflowX === 'auto'")
    user.tab("Pose")


def test_poses_and_clips_are_found_and_taken(user):
    session = user.session
    user.begin("bow")
    user.tab("Motion")
    user.press("As new")
    user.sees("press Load motions first")
    motions, load = user.studio._motion._motions, user.page.get_by_role("button", name="Load motions", exact=True)
    for text, said in (("", "Motions is empty"), ("generated:val@8", "2 clips")):
        user.enter("Motions", text)
        user.until(lambda text=text: motions.value == text and load.is_enabled())
        user.press("Load motions")
        user.sees(said)
    user.sees("2 clips")
    user.press("Play clip")
    user.until(lambda: user.studio._motion._time.value > 0.1 and user.studio._motion.clip_playing)
    user.press("Pause clip")
    user.until(lambda: not user.studio._motion.clip_playing)
    time_of_clip = user.studio._motion._time
    user.studio._desk.ask(lambda: setattr(time_of_clip, "value", 0.0))  # so that all of it is left to be taken
    user.until(lambda: time_of_clip.value == 0.0)
    user.box("Search").fill("hand")
    user.until(lambda: "found" in user.studio._motion._pose.options[0] and user.studio._motion._found)
    user.press("As new")
    user.until(lambda: len(session.timeline.keyframes) == 3)
    user.press("Replace all keyframes")
    user.until(lambda: len(session.timeline.keyframes) >= 8)
    user.tab("Pose")


def test_files_are_saved_asked_about_and_kept(user, folder):
    session = user.session
    user.begin("bow")
    user.until(lambda: (folder / AUTOSAVE).exists())
    user.key("Control+s")
    user.until(lambda: (folder / "keyframes.json").exists())
    user.sees("Saved")
    assert not (folder / AUTOSAVE).exists(), "it is of no use any more"
    user.key("Control+s")
    user.until(lambda: not session.unsaved)
    user.tab("Files")
    user.enter("File", "nowhere.json")
    user.press("Load")
    user.sees("no such file")
    (folder / "other.json").write_bytes((folder / "keyframes.json").read_bytes())
    user.enter("File", "other.json")
    user.press("Save")
    user.press("Cancel")
    user.page.get_by_role("dialog").wait_for(state="hidden")
    user.until(lambda: not user.studio._page.dock.state["question"])
    user.press("New")
    user.until(lambda: not session.timeline.keyframes)
    user.press("Load")
    user.until(lambda: session.timeline.labels == ("start", "1 bow", "2 rise"))
    with user.page.expect_file_chooser() as chooser:
        user.press("Upload")
    chooser.value.set_files(folder / "other.json")
    user.until(lambda: len(session.timeline.keyframes) == 2)
    user.press("Download")
    user.page.locator('a[download="other.json"]').wait_for()
    for name in ("Load", "New", "Upload"):
        if name == "Upload":
            with user.page.expect_file_chooser() as chooser:
                user.press(name)
            chooser.value.set_files(folder / "keyframes.json")
        else:
            user.press(name)
        user.until(lambda name=name: len(session.timeline.keyframes) == (0 if name == "New" else 2))
        if name != "Load":
            user.key("Control+s")  # these keyframes are not the ones of the file in the box
            user.page.get_by_role("dialog").get_by_text("other.json is there already").wait_for()
            user.press("Cancel")
            user.until(lambda: not user.studio._page.dock.state["question"])
    user.tab("Pose")


def test_a_click_at_once_after_typing_is_for_what_was_typed(user, folder):
    user.begin("bow")
    user.tab("Files")
    user.enter("File", "before.json")
    user.sent()
    box, load, save = (
        element.element_handle()
        for element in (
            user.box("File"),
            *(user.page.get_by_role("button", name=n, exact=True).first for n in ("Load", "Save")),
        )
    )
    # as by a user whose page was busy for a while: all in one go, while the answer to the first is not yet sent
    user.page.evaluate(
        "([box, load, save]) => { load.click();"
        "Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set.call(box, 'after.json');"
        "box.dispatchEvent(new Event('input', { bubbles: true })); save.click(); }",
        [box, load, save],
    )
    user.until(lambda: (folder / "after.json").exists())
    assert not (folder / "before.json").exists()
    user.tab("Pose")


def test_the_page_is_dark_where_the_system_is(user):
    floor = user.studio._backdrop._floor
    assert min(floor.plane_color) > 150
    user.page.emulate_media(color_scheme="dark")
    user.page.reload()
    user.until(lambda: max(floor.plane_color) < 100)
    paper = "getComputedStyle(document.querySelector('#dock')).backgroundColor"
    user.until(lambda: user.page.evaluate(paper) == "rgb(29, 35, 41)")


def test_a_page_whose_studio_is_started_again_comes_back(policies, browser, tmp_path):
    port = free_port()

    def started() -> tuple[Studio, threading.Thread]:
        studio = Studio(
            Session(G1, policies), host="127.0.0.1", port=port, motions="", path="keyframes.json", folder=tmp_path
        )
        thread = threading.Thread(target=studio.run)
        thread.start()
        return studio, thread

    studio, thread = started()
    try:
        user = User(studio, browser, _LINGERING)
        user.key("Delete", "Delete")
        user.page.wait_for_function("document.querySelectorAll('#dock-notes .error').length === 2")
        studio._desk.ask(studio.session.add)
        user.until(lambda: studio.session.timeline.keyframes)
        studio._page.wait("Recording plat …")
        studio._page.ask("Replace the file?", "a.json is there already.", "Replace", lambda: None)
        user.sees("Recording plat …")
        user.sees("Replace the file?")
        studio.stop()
        thread.join(10)
        assert (tmp_path / AUTOSAVE).exists(), "the last edit is kept, however fresh"
        user.sees("The studio has stopped.")
        studio, thread = started()
        user.sees("Restore autosave.")
        user.page.locator(".dock-pill.shown").wait_for(state="detached")
        user.page.locator("dialog[open]").wait_for(state="detached")
        user.page.evaluate("lingering.splice(0).forEach((end) => end())")
        user.page.locator("#dock-notes .error").last.wait_for(state="detached")
        user.key("Delete")
        user.page.locator("#dock-notes .error").wait_for()
        user.page.close()
    finally:
        studio.stop()
        thread.join(10)


def test_a_browser_that_cannot_draw_is_told(studio, browser):
    page = browser.new_page()
    page.set_default_timeout(_PATIENCE)
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page.goto(f"http://127.0.0.1:{studio.server.get_port()}")
    page.get_by_text("WebGL is not available: turn on").wait_for()
    page.close()


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
