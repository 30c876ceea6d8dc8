"""Studio application: server, session, scene and panels."""

import socket
import time
from pathlib import Path

import numpy as np
import viser

from plat.errors import StudioError
from plat.motions import MotionLibrary
from plat.studio.access import Access, guarded_server
from plat.studio.autosave import Autosave
from plat.studio.checker import Checker
from plat.studio.desk import Desk
from plat.studio.dock import Dock, Message
from plat.studio.folder import Folder
from plat.studio.page import Page
from plat.studio.panels import FilePanel, MotionPanel, PlayPanel, PosePanel, TimelinePanel
from plat.studio.pins import faint_bodies
from plat.studio.player import Player
from plat.studio.scene import Backdrop, Bodies, Figure, RobotView, StanceView
from plat.studio.session import Session
from plat.studio.timeline import Timeline
from plat.studio.wakeup import threaded_buffers

__all__ = ["Studio"]

_WORLD, _BESIDE = "/world", "/world/beside"
_GREEN, _BETWEEN = (18, 183, 106), (150, 170, 160)
# Where a second robot is, seen from the first (m): to its left.
_SIDE = (0.0, 1.0, 0.0)
# Texts and plots are for reading: redrawing them at every step would only load browsers.
_READING_INTERVAL = 0.12
# Browsers are sent the playing robot so many times a second (Hz), and less often when they draw slowly.
_FASTEST, _SLOWEST = 30.0, 5.0
# Pause (s) after which a touched slider starts another undo step.
_PAUSE = 1.0


class Studio:
    """Web page on which keyframes are made and played.

    Args:
        session: what the page shows.
        host: address to listen on.
        port: port to listen on.
        motions: motion files that the page proposes to load.
        path: keyframe file that the page proposes to save to.
        folder: the only folder for keyframe files and videos.
        bodies: shapes to draw; by default those of the session's robot.

    Raises:
        StudioError: when the port cannot be opened.
    """

    def __init__(
        self,
        session: Session,
        *,
        host: str,
        port: int,
        motions: str,
        path: str,
        folder: Path,
        bodies: Bodies | None = None,
    ):
        _check_port(host, port)
        self.access = Access(host, port)
        self.session, robot = session, session.robot
        files = Folder(folder)
        dock = Dock(self._receive)
        with guarded_server(self.access, dock), threaded_buffers():
            self.server = server = viser.ViserServer(host=host, port=port, verbose=False)
        self._desk = Desk(self._tick, self._show, self._report, interval=session.timing.control_dt)
        self._page = page = Page(server, session, self._desk, dock)
        self._checker = Checker(robot)
        self._autosave = Autosave(session, files.root)
        self._backdrop = Backdrop(server, _WORLD)
        self._world = server.scene.add_frame(_WORLD, show_axes=False)
        server.scene.add_frame(_BESIDE, show_axes=False, position=_SIDE)
        bodies = bodies or Bodies(robot)
        self._robot = RobotView(server, bodies, f"{_WORLD}/robot")
        self._second = RobotView(server, bodies, f"{_BESIDE}/robot")
        self._posed = Figure(server, bodies, f"{_WORLD}/pose", _GREEN, 1.0, self._clicked)
        self._goals = tuple(Figure(server, bodies, f"{at}/goal", _GREEN, 0.4) for at in (_WORLD, _BESIDE))
        self._before = Figure(server, bodies, f"{_WORLD}/before", (60, 110, 220), 0.2)
        self._after = Figure(server, bodies, f"{_WORLD}/after", (240, 140, 0), 0.2)
        self._taken = Figure(server, bodies, f"{_WORLD}/motion", (240, 140, 0), 0.6)
        self._stance = StanceView(server, f"{_WORLD}/stance")
        self._names = [server.scene.add_label(f"{at}/name", "", visible=False) for at in (_WORLD, _BESIDE)]
        self._next_reading = self._next_drawing = 0.0
        self._frames = _FASTEST
        self._build(page, motions, path, files)
        self._show()

    def _build(self, page: Page, motions: str, path: str, folder: Folder) -> None:
        gui, robot = page.gui, self.session.robot
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label("plat keyframe studio")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Pose"):
            self._pose = PosePanel(page, _WORLD)
        with tabs.add_tab("Play"):
            self._play = PlayPanel(page)
        with tabs.add_tab("Motion"):
            self._motion = MotionPanel(page, motions, lambda names: MotionLibrary.load(names.split(), robot))
        with tabs.add_tab("Files"):
            self._files = FilePanel(page, path, folder, self._autosave)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        self._timeline = TimelinePanel(
            page,
            self._checker,
            {
                "save": self._files.save,
                "look": self._look,
                "hide": lambda: _flip(self._pose.robot_hidden),
                "onion": lambda: _flip(self._pose.onion),
                "axes": self._pose.toggle_axes,
                "pin": self._pose.pin,
            },
        )

    def _receive(self, message: Message) -> None:
        if message["do"] == "browser":
            self._desk.ask(lambda: self._suit(message))
        elif message["do"] == "answer":
            self._desk.ask(lambda: self._page.answer(message))
        else:
            self._timeline.receive(message)

    def _suit(self, message: Message) -> None:
        """Suit a browser that says how it draws: without shadows in software, dark, and only as often as it can."""
        if message.get("software") is True:
            self._backdrop.sun.cast_shadow = False
        if isinstance(dark := message.get("dark"), bool):
            self._backdrop.paint(dark)
        frames = message.get("frames")
        if isinstance(frames, (int, float)) and not isinstance(frames, bool) and frames > 0:  # NaN is not
            self._frames = float(min(max(frames, _SLOWEST), _FASTEST))

    def _clicked(self, body: str) -> None:
        self._desk.ask(lambda: self._pose.click_body(body))

    def run(self) -> None:
        """Serve until :meth:`stop`."""
        self._desk.run()

    def end(self) -> None:
        """End :meth:`run` after what it does just now, also from a signal handler."""
        self._desk.stop()

    def stop(self) -> None:
        """End :meth:`run`, keep unsaved keyframes, and close the page."""
        self.end()
        self._autosave.tick(at_once=True)
        self.server.stop()

    def _tick(self, seconds: float) -> None:
        session, playback = self.session, self.session.playback
        if time.monotonic() >= self._rest_at:
            session.rest()
        if self._autosave.tick():
            self._files.show()
        if self._motion.clip_playing:
            self._motion.tick(seconds)
            self._taken.show(self._motion.preview())
        if not playback.playing:
            return
        playback.tick(seconds)
        if not playback.playing:
            self._show()
            return
        if time.monotonic() >= self._next_drawing:
            self._next_drawing = time.monotonic() + 0.9 / self._frames
            self._show_robots()
        if time.monotonic() >= self._next_reading:
            self._next_reading = time.monotonic() + max(_READING_INTERVAL, 2 / self._frames)
            self._timeline.show_time()
            self._play.show_time()

    def _show(self) -> None:
        self._rest_at = time.monotonic() + _PAUSE
        if refused := self.session.playback.refused:
            self.session.playback.refused = ""
            self._page.notify("The policy stopped", refused, "error")
        for panel in (self._timeline, self._pose, self._play, self._files):
            panel.show()
        self._taken.show(self._motion.preview())
        self._show_robots()

    def _show_robots(self) -> None:
        """Draw robots and poses at the time of the cursor."""
        session, playback = self.session, self.session.playback
        timeline, cursor = session.timeline, playback.cursor
        player, second = playback.player, playback.second
        # an edited pose, a pose between keyframes, or what is commanded to a playing robot
        posing = not playback.playing and session.shows_selected
        between = not playback.playing and not posing and player is None
        with self.server.atomic():
            self._robot.show(self._shown(player))
            self._second.show(self._shown(second))
            for name, view, goal in zip((playback.played, playback.beside), (player, second), self._goals, strict=True):
                step = None if view is None or posing else view.step_at(cursor)
                goal.show(None if step is None else step.command.keyframe.qpos)
                self._name(goal is self._goals[1], name, view if second is not None else None)
            shown = timeline.pose.qpos if posing else timeline.sample(cursor).qpos if between else None
            stance = None if shown is None else self._checker.stance(shown)
            faint = faint_bodies(timeline.pose, session.robot) if posing else frozenset()
            self._posed.show(shown, _BETWEEN if between else None, faint, () if stance is None else stance.inside)
            self._stance.show(stance)
            neighbors = _neighbors(timeline) if posing and self._pose.onion.value else (None, None)
            for figure, neighbor in zip((self._before, self._after), neighbors, strict=True):
                figure.show(neighbor, beside=timeline.pose.qpos)
            self._place(None if posing else player)

    def _shown(self, player: Player | None) -> np.ndarray | None:
        playback = self.session.playback
        if player is None or (self._pose.robot_hidden.value and not playback.playing):
            return None
        return player.pose_at(playback.cursor)

    def _name(self, beside: bool, name: str | None, player: Player | None) -> None:
        label = self._names[beside]
        if label.visible != (player is not None):
            label.visible = player is not None
        if player is not None:
            if label.text != (name or ""):
                label.text = name or ""
            label.position = player.pose_at(self.session.playback.cursor)[:3] + np.array([0.0, 0.0, 0.75])

    def _place(self, player: Player | None) -> None:
        """Move the world under a robot that is followed, and back where none is."""
        away = np.zeros(2)
        if player is not None and self._play.follow.value:
            away = player.pose_at(self.session.playback.cursor)[:2] - self.session.timeline.start.root_pos[:2]
        self._world.position = (-away[0], -away[1], 0.0)

    def _look(self) -> None:
        """Move every camera to the selected pose, or to the robot, where the world that moves under it shows it."""
        there = self._look_at()[:2] + self._world.position[:2]
        for client in self.server.get_clients().values():
            camera = client.camera
            away = there - camera.look_at[:2]
            shift = np.array([*away, 0.0])
            with client.atomic():
                # to set the position moves the point that is looked at along
                camera.position = camera.position + shift

    def _look_at(self) -> np.ndarray:
        playback = self.session.playback
        if playback.player is not None and not self.session.shows_selected:
            return playback.player.pose_at(playback.cursor)[:3]
        return self.session.timeline.sample(playback.cursor).root_pos

    def _report(self, message: str) -> None:
        self._page.notify("That did not work", message, "error")


def _neighbors(timeline: Timeline) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the poses before and after the selected one; None where there is none, or it is the same pose."""
    here, poses = timeline.selected, timeline.poses
    before = poses[here - 1] if here > 0 else None
    after = poses[here + 1] if here + 1 < len(poses) else None
    seen = [timeline.pose.qpos]
    result: list[np.ndarray | None] = []
    for pose in (before, after):
        new = pose is not None and not any(np.allclose(pose.qpos, qpos, atol=1e-6) for qpos in seen)
        result.append(pose.qpos if pose is not None and new else None)
        if pose is not None:
            seen.append(pose.qpos)
    return result[0], result[1]


def _flip(box: viser.GuiCheckboxHandle) -> None:
    box.value = not box.value


def _check_port(host: str, port: int) -> None:
    # viser itself would silently take the next one that is free
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            if ":" in host:
                raise StudioError(f"--host {host!r} is of IPv6, expected an address of IPv4, or a name") from error
            raise StudioError(
                f"port {port} of {host!r} cannot be opened ({error}): choose another --port (or --host)"
            ) from error
