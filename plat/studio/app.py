"""Studio application: server, session, scene and panels."""

import socket
import time
from pathlib import Path

import numpy as np
import viser

from plat.errors import StudioError
from plat.motions import MotionLibrary
from plat.studio.access import Access, guarded_server
from plat.studio.desk import Desk
from plat.studio.folder import Folder
from plat.studio.page import Page
from plat.studio.panels import FilePanel, MotionPanel, PlayPanel, PosePanel, TimelinePanel
from plat.studio.scene import Ghosts, RobotView, set_the_stage
from plat.studio.session import Session

__all__ = ["Studio"]

_WORLD = "/world"
# Texts and plots are for reading: redrawing them at every step would only load browsers.
_READING_INTERVAL = 0.12
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
        folder: the only folder for reading and writing files.

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
    ):
        _check_port(host, port)
        self.access = Access(host, port)
        self.session, robot = session, session.robot
        with guarded_server(self.access):
            self.server = server = viser.ViserServer(host=host, port=port, verbose=False)
        self._desk = Desk(self._tick, self._show, self._report, interval=session.timing.control_dt)
        self._page = page = Page(server, session, self._desk)
        set_the_stage(server, _WORLD)
        self._world = server.scene.add_frame(_WORLD, show_axes=False)
        self._robot = RobotView(server, robot, f"{_WORLD}/robot")
        self._ghost = Ghosts(server, robot, f"{_WORLD}/selected", (18, 183, 106), 0.5)
        self._others = Ghosts(server, robot, f"{_WORLD}/keyframes", (60, 110, 220), 0.12)
        self._taken = Ghosts(server, robot, f"{_WORLD}/motion", (240, 140, 0), 0.4)
        self._next_reading = 0.0
        self._build(page, motions, path, Folder(folder))
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
            self._files = FilePanel(page, path, folder)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        bottom = gui.add_panel()
        with bottom.add_tab("Timeline"):
            self._timeline = TimelinePanel(page)
        bottom.float(x=12, y=-12, width=720)
        page.key("Look at the selected pose", "F", self._look)

    def run(self) -> None:
        """Serve until :meth:`stop`."""
        self._desk.run()

    def stop(self) -> None:
        """End :meth:`run` and close the page."""
        self._desk.stop()
        self.server.stop()

    def _tick(self, seconds: float) -> None:
        session = self.session
        if time.monotonic() >= self._rest_at:
            session.rest()
        if not session.playing:
            return
        session.tick(seconds)
        if not session.playing:
            if self._play.loop.value:
                session.play()
            self._show()
            return
        self._show_robots()
        if time.monotonic() >= self._next_reading:
            self._next_reading = time.monotonic() + _READING_INTERVAL
            self._timeline.show_time()
            self._play.show_time()

    def _show(self) -> None:
        self._rest_at = time.monotonic() + _PAUSE
        for panel in (self._timeline, self._pose, self._play):
            panel.show()
        shown = self._pose.all_keyframes.value and not self.session.playing
        self._others.show([pose.qpos for pose in self.session.timeline.keyframes] if shown else [])
        self._taken.show(self._motion.preview())
        self._show_robots()

    def _show_robots(self) -> None:
        """Draw the moving parts: the robot, its commanded keyframe, and their surroundings."""
        session, start = self.session, self.session.timeline.start
        player = session.player
        if player is None or player.step is None:
            # the robot itself stands in the start
            qpos, target = start.qpos, session.timeline.pose.qpos if session.timeline.selected else None
        else:
            qpos = player.qpos
            target = player.step.command.keyframe.qpos if session.playing else session.timeline.pose.qpos
        with self.server.atomic():
            self._robot.show(qpos)
            self._ghost.show([] if target is None else [target])
            followed = session.playing and self._play.follow.value
            away = qpos[:2] - start.root_pos[:2] if followed else np.zeros(2)
            self._world.position = (-away[0], -away[1], 0.0)

    def _look(self) -> None:
        """Move every camera to the selected pose."""
        for client in self.server.get_clients().values():
            camera = client.camera
            away = self.session.timeline.pose.root_pos[:2] - camera.look_at[:2]
            shift = np.array([*away, 0.0])
            with client.atomic():
                # to set the position moves the point that is looked at along
                camera.position = camera.position + shift

    def _report(self, message: str) -> None:
        self._page.notify("That did not work", message, "red")


def _check_port(host: str, port: int) -> None:
    # viser itself would silently take the next one that is free
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise StudioError(
                f"port {port} of {host!r} cannot be opened ({error}): choose another --port (or --host)"
            ) from error
