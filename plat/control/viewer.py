"""Live view of a robot that chases keyframes."""

import sys
import threading
import time
import warnings
from typing import Any

import mujoco
import numpy as np

from plat.control.chase import ChaseStep
from plat.control.simulator import Simulator
from plat.errors import RenderingError
from plat.rendering.pictures import add_ghost, show_visible

__all__ = ["Viewer"]

_BAR = np.array([0.16, 0.75, 0.5, 1.0])
# half sizes (m) of the bar of a command that has the longest time left, and its height over the root (m)
_BAR_SIZE, _BAR_HEIGHT = np.array([0.01, 0.3, 0.01]), 0.8


class Viewer:
    """MuJoCo's viewer with the commanded keyframe as a ghost, and over the robot a bar that shrinks until its arrival.

    It runs in real time, or slower where the computer is slower.

    Args:
        simulator: the robot; :func:`plat.rendering.stage_model` makes a model that is good to look at.

    Raises:
        RenderingError: where no window can be opened.
    """

    def __init__(self, simulator: Simulator):
        self._model, self._ghost = simulator.model, mujoco.MjData(simulator.model)
        before = threading.enumerate()
        self._window = _open(simulator)
        self._threads = [thread for thread in threading.enumerate() if thread not in before]
        with self._window.lock():
            show_visible(self._window.opt, self._model)
            camera = self._window.cam
            camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, 1
            camera.distance, camera.azimuth, camera.elevation = 2.6, 125.0, -10.0
        self._name = ""
        self._due = time.monotonic()

    @property
    def running(self) -> bool:
        """Return whether the window is open."""
        return bool(self._window.is_running())

    def show(self, step: ChaseStep) -> None:
        """Show the robot as a step left it, and wait until it is time for the next one."""
        command, scene = step.command, self._window.user_scn
        with self._window.lock():
            scene.ngeom = 0
            add_ghost(scene, self._model, self._ghost, self._window.opt, command.keyframe.qpos)
            time_left = 0.0 if step.holding else (command.steps_left - 1) / step.timing.max_steps
            _add_bar(scene, step.after.root_pos_w, time_left)
        name = command.keyframe.name or f"keyframe {command.index}"
        if name != self._name:  # a text waits for the next picture
            self._window.set_texts((None, None, name, None))
            self._name = name
        self._window.sync()
        # a step that came late is not made up for: that would be a jerk
        self._due = max(self._due + step.timing.control_dt, time.monotonic())
        time.sleep(max(0.0, self._due - time.monotonic()))

    def close(self) -> None:
        """Close the window."""
        self._window.close()
        for thread in self._threads:  # Python must not end while it draws
            thread.join(timeout=10.0)


def _add_bar(scene: mujoco.MjvScene, root_pos_w: np.ndarray, time_left: float) -> None:
    size = _BAR_SIZE * np.array([1.0, time_left, 1.0])
    position = root_pos_w + np.array([0.0, 0.0, _BAR_HEIGHT])
    box = mujoco.mjtGeom.mjGEOM_BOX
    mujoco.mjv_initGeom(scene.geoms[scene.ngeom], box, size, position, np.eye(3).ravel(), _BAR.astype(np.float32))
    scene.ngeom += 1


def _open(simulator: Simulator) -> Any:
    try:
        import glfw
        import mujoco.viewer

        # the viewer opens its window in a thread of its own and would wait for ever for one that cannot be
        with warnings.catch_warnings(record=True) as complaints:
            warnings.simplefilter("always")
            if sys.platform != "darwin" and not glfw.init():
                raise RuntimeError(str(complaints[-1].message) if complaints else "GLFW does not start")
        return mujoco.viewer.launch_passive(simulator.model, simulator.data, show_left_ui=False, show_right_ui=False)
    except (ImportError, RuntimeError, mujoco.FatalError) as error:
        raise RenderingError(
            f"no window for the viewer ({error}); it needs a display (on macOS start Python as mjpython); "
            "without one record a video"
        ) from error
