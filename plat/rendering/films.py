"""Videos of a policy during training."""

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
    """Periodic videos of a policy. Where rendering fails, for lack of OpenGL say, it prints one line and stops.

    Args:
        folder: the videos go here, named by the step.
        robot: the robot that is drawn.
        play: returns a playback of the policy as it is now.
        every: seconds between videos, and to the first one; 0 for none.
        seconds: longest motion that a video shows.
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
        """Write ``FOLDER/STEP.mp4`` if a video is due; return its path, or None."""
        if time.monotonic() < self._due:
            return None
        path = self._folder / f"{step}.mp4"
        try:
            with Stage(self._robot, width=320, height=240) as stage:
                write_video(path, islice(film(stage, self._play(), self._fps), self._pictures), self._fps)
        except PlatError as error:
            print(f"no videos: {error}", flush=True)
            self._due = float("inf")
            return None
        self._due = time.monotonic() + self._every
        return path
