"""Videos of a policy while it is trained."""

import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from plat.errors import PlatError
from plat.rendering.pictures import Stage, film, write_video
from plat.rendering.playback import Playback
from plat.robots.robot import Robot

__all__ = ["Films"]


class Films:
    """Films a policy now and then; where that cannot be done (no OpenGL, say), it says so once.

    Args:
        folder: the videos go here, named by the step.
        robot: who is seen.
        play: lets the policy as it is now chase keyframes.
        every: seconds from film to film, and to the first; 0 for none.
        seconds: of motion that a film shows at most.
        fps: pictures a second.
    """

    def __init__(
        self,
        folder: Path,
        robot: Robot,
        play: Callable[[], Playback],
        every: float,
        seconds: float = 6.0,
        fps: float = 12.5,
    ):
        self._folder = folder
        self._robot = robot
        self._play = play
        self._every = every
        self._pictures = round(seconds * fps)
        self._fps = fps
        self._due = time.monotonic() + (every or float("inf"))

    def take(self, step: int) -> Path | None:
        """The next film, when it is due: ``FOLDER/STEP.mp4``."""
        if time.monotonic() < self._due:
            return None
        path = self._folder / f"{step}.mp4"
        try:
            stage = Stage(self._robot, width=320, height=240)
            write_video(path, islice(film(stage, self._play(), self._fps), self._pictures), self._fps)
            stage.close()
        except PlatError as error:
            print(f"no videos: {error}", flush=True)
            self._due = float("inf")
            return None
        self._due = time.monotonic() + self._every
        return path
