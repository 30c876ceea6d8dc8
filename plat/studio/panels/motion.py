"""Panel that takes keyframes from motion clips."""

from collections.abc import Callable

import numpy as np

from plat.keyframes import Keyframe
from plat.motions import MotionClip, MotionLibrary
from plat.studio.desk import Task
from plat.studio.page import Page
from plat.studio.poses import placed

__all__ = ["MotionPanel"]

_NONE = "no motions loaded"


class MotionPanel:
    """Panel that browses the clips of a motion library and takes poses from them.

    Args:
        page: the page.
        motions: initial text of the box for motion files.
        load: reads a motion library.
    """

    def __init__(self, page: Page, motions: str, load: Callable[[str], MotionLibrary]):
        self._page, self._load, gui = page, load, page.gui
        timing = page.session.timing
        self._library: MotionLibrary | None = None
        self._clip: MotionClip | None = None
        self._motions = gui.add_text(
            "Motions", motions, hint="Files, folders or globs, or generated:val for motions that plat makes itself."
        )
        read = gui.add_button("Load motions")
        self._names = gui.add_dropdown("Clip", (_NONE,))
        self._time = gui.add_slider("Time (s)", min=0.0, max=1.0, step=timing.control_dt, initial_value=0.0)
        self._preview = gui.add_checkbox("Show it", initial_value=True)
        page.buttons("Take the pose", {"As selected": lambda: self._take(False), "As new": lambda: self._take(True)})
        with gui.add_folder("A stretch of the clip", expand_by_default=True):
            self._seconds = gui.add_number("Seconds from here", 4.0, min=0.1, max=60.0, step=0.1)
            self._interval = gui.add_number(
                "A keyframe every (s)",
                min(0.5, timing.longest),
                min=timing.control_dt,
                max=timing.longest,
                step=timing.control_dt,
            )
            stretch = gui.add_button("Replace all keyframes")

        async def read_clicked(_: object) -> None:
            page.desk.ask_elsewhere(self._read)

        async def stretch_clicked(_: object) -> None:
            page.desk.ask(self._take_stretch)

        read.on_click(read_clicked)
        stretch.on_click(stretch_clicked)
        page.when_changed(self._names, self._choose)
        for handle in (self._time, self._preview):
            page.when_changed(handle)

    def _read(self) -> Task:
        self._page.notify("Motions", f"reading {self._motions.value}")
        library = self._load(self._motions.value)
        return lambda: self._take_library(library)

    def _take_library(self, library: MotionLibrary) -> None:
        self._library = library
        self._names.options = [f"{number} {name}" for number, name in enumerate(library.clip_names, 1)]
        self._names.value = self._names.options[0]
        self._choose()
        self._page.notify("Motions", f"{library.num_clips} clips, {library.duration:.0f} s", "green")

    def _choose(self) -> None:
        if self._library is not None:
            self._clip = self._library.clip(self._names.options.index(self._names.value))
            self._time.max = round(self._clip.duration, 2)
            self._time.value = min(self._time.value, self._time.max)

    def _take(self, insert: bool) -> None:
        if self._clip is not None:
            self._page.session.take_pose(self._clip, self._time.value, insert)

    def _take_stretch(self) -> None:
        if self._clip is not None:
            self._page.session.take_stretch(self._clip, self._time.value, self._seconds.value, self._interval.value)

    def preview(self) -> list[np.ndarray]:
        """Return the pose that would be taken, where it would be placed; None when there is nothing to show."""
        session = self._page.session
        if self._clip is None or not self._preview.value or session.playing:
            return []
        taken = Keyframe.from_motion(self._clip, self._time.value, session.robot).qpos
        return [placed(taken, taken, session.timeline.pose.qpos)]
