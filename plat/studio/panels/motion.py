"""Panel that takes poses and keyframes from motion clips."""

from collections.abc import Callable

import numpy as np
import viser

from plat.errors import StudioError
from plat.keyframes import Keyframe
from plat.motions import MotionClip, MotionLibrary
from plat.studio.desk import Task
from plat.studio.page import Page
from plat.studio.pose_library import LibraryPose, PoseLibrary
from plat.studio.poses import placed
from plat.words import counted

__all__ = ["MotionPanel"]

_NONE = "no motions loaded"
_MOST_SHOWN = 60


class MotionPanel:
    """Panel that searches the poses of a motion library, plays its clips, and takes keyframes from them.

    Args:
        page: the page.
        motions: initial text of the box for motion files.
        load: reads a motion library.
    """

    def __init__(self, page: Page, motions: str, load: Callable[[str], MotionLibrary]):
        self._page, self._load, gui = page, load, page.gui
        timing = page.session.timing
        self._library: MotionLibrary | None = None
        self._poses: PoseLibrary | None = None
        self._found: dict[str, LibraryPose] = {}
        self._clip: MotionClip | None = None
        self.clip_playing = False
        """Whether the clip is being played."""
        self._motions = gui.add_text(
            "Motions", motions, hint="Files, folders or globs, or generated:val for motions that plat makes itself."
        )
        page.slow_button("Load motions", self._read, "Reading motions …", icon=viser.Icon.BOOKS)
        with gui.add_folder("Poses"):
            self._search = gui.add_text("Search", "", hint="Such as: left hand up, crouched, bent, stride, walk.")
            self._pose = gui.add_dropdown("Pose", (_NONE,))
            page.when_changed(self._search, lambda _: self._find())
            page.when_changed(self._pose, lambda _: self._choose_pose())
        with gui.add_folder("Clips"):
            self._names = gui.add_dropdown("Clip", (_NONE,))
            self._time = gui.add_slider("Time (s)", min=0.0, max=1.0, step=timing.control_dt, initial_value=0.0)
            page.buttons("Clip", {"Play clip": self._play_clip, "Pause clip": self._pause_clip})
        self._preview = gui.add_checkbox("Show it", initial_value=True, hint="In orange, where it would be put.")
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
            page.button("Replace all keyframes", self._take_stretch)
        page.when_changed(self._names, lambda _: self._choose())
        for handle in (self._time, self._preview):
            page.when_changed(handle)

    def _read(self) -> Task:
        if not self._motions.value.strip():
            raise StudioError("Motions is empty, expected files, folders or globs of motions, or generated:val")
        library = self._load(self._motions.value)
        poses = PoseLibrary.of(library, self._page.session.robot)
        return lambda: self._take_library(library, poses)

    def _take_library(self, library: MotionLibrary, poses: PoseLibrary) -> None:
        self._library, self._poses = library, poses
        self._names.options = [f"{number} {name}" for number, name in enumerate(library.clip_names, 1)]
        self._names.value = self._names.options[0]
        self._choose()
        self._find()
        clips, found = counted(library.num_clips, "clip"), counted(len(poses.poses), "pose")
        self._page.notify("Motions", f"{clips}, {library.duration:.0f} s, {found}", "good")

    def _find(self) -> None:
        if self._poses is None:
            return
        found = self._poses.search(self._search.value)
        shown = found[:_MOST_SHOWN]
        first = f"{len(found)} found" + (f", the first {len(shown)}" if len(shown) < len(found) else "")
        self._found = {f"{number} {pose.label}": pose for number, pose in enumerate(shown, 1)}
        self._pose.options = (first, *self._found)
        self._pose.value = first

    def _choose_pose(self) -> None:
        pose = self._found.get(self._pose.value)
        if pose is not None:
            self.clip_playing = False
            self._names.value = self._names.options[pose.clip]
            self._choose()
            self._time.value = min(round(pose.time, 2), self._time.max)

    def _choose(self) -> None:
        if self._library is not None:
            self._clip = self._library.clip(self._names.options.index(self._names.value))
            self._time.max = round(self._clip.duration, 2)
            self._time.value = min(self._time.value, self._time.max)

    def _play_clip(self) -> None:
        if self._checked() and self._time.value >= self._time.max:
            self._time.value = 0.0
        self.clip_playing = True

    def _pause_clip(self) -> None:
        self.clip_playing = False

    def tick(self, seconds: float) -> None:
        """Advance a playing clip in time (s)."""
        self._time.value = min(round(self._time.value + seconds, 4), self._time.max)
        self.clip_playing = self._time.value < self._time.max

    def _checked(self) -> MotionClip:
        if self._clip is None:
            raise StudioError("no motions loaded: press Load motions first")
        return self._clip

    def _take(self, insert: bool) -> None:
        self._page.session.take_pose(self._checked(), self._time.value, insert)

    def _take_stretch(self) -> None:
        self._page.session.take_stretch(self._checked(), self._time.value, self._seconds.value, self._interval.value)

    def preview(self) -> np.ndarray | None:
        """Return the pose that would be taken, where it would be placed; None when there is nothing to show."""
        session = self._page.session
        if self._clip is None or not self._preview.value or session.playback.playing:
            return None
        time = min(self._time.value, self._clip.duration)
        taken = Keyframe.from_motion(self._clip, time, session.robot).qpos
        return placed(taken, taken, session.timeline.pose.qpos)
