"""Studio session without its page: keyframes with undo, posing, playing, scores and files."""

from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tensordict.nn import TensorDictModuleBase

from plat.control import keyframe_around, record
from plat.errors import ActionError, KeyframeError
from plat.files import expand_home
from plat.keyframes import Keyframe, KeyframeSequence, standing
from plat.keyframes.files import read_keyframes, write_keyframes
from plat.motions import MotionClip
from plat.rendering import Stage, check_video, film, write_video
from plat.robots.robot import Robot
from plat.studio.history import History
from plat.studio.pins import mirrored_parts, toggled
from plat.studio.player import chased
from plat.studio.policy_playback import PolicyPlayback
from plat.studio.poser import Frame, Poser
from plat.studio.poses import Floor, mirrored, placed, symmetric
from plat.studio.templates import template
from plat.studio.timeline import LONGEST_INTERVAL, NEW_INTERVAL, Timeline

__all__ = ["Session"]


class Session:
    """Editing session: one robot, its keyframes, and the policies that can chase them.

    Args:
        robot: the robot.
        policies: deterministic policies by name, at least one, all of one control step.

    Raises:
        StudioError: when the policies have different control steps.

    >>> from plat.robots import G1
    >>> from plat.modules import LatentPolicy
    >>> session = Session(G1, {"untrained": LatentPolicy(G1).deployed()})
    >>> session.add()
    >>> session.edit(session.timeline.renamed("stand"))
    >>> session.timeline.labels
    ('start', '1 stand')
    >>> session.undo(); session.timeline.labels
    ('start', '1')
    """

    def __init__(self, robot: Robot, policies: Mapping[str, TensorDictModuleBase]):
        self.robot = robot
        self.playback = PolicyPlayback(robot, policies, lambda: self.timeline)
        """Plays the keyframes."""
        self.timing = self.playback.timing
        """Timing of the keyframes: control step, and the longest command of all policies."""
        self.history = History(Timeline.empty(robot, self.timing))
        self.poser = Poser(robot)
        self.limb_only = False
        """Whether a dragged handle moves nothing but its limb."""
        self.symmetric = False
        """Whether what one side does is done by the other, too."""
        self._floor = Floor(robot)
        self.saved = self.timeline
        """The keyframes as they were when they were last saved or loaded."""
        self.opened: Path | None = None
        """The file that was opened to begin with."""
        self._clipboard: tuple[Keyframe, float] | None = None  # with the seconds that it is held
        self._grip: tuple[str, np.ndarray, dict[str, Frame], int] | None = None
        self._dragging = False
        self._refused = False

    # keyframes

    @property
    def timeline(self) -> Timeline:
        """Return the current keyframes."""
        return self.history.state

    def edit(self, timeline: Timeline, gesture: Hashable = None) -> None:
        """Replace the keyframes by edited ones; see :meth:`plat.studio.history.History.do`.

        Raises:
            KeyframeError: for a pose that no file may hold, such as a root 6 m above the floor.
        """
        for pose in {*timeline.poses} - {*self.timeline.poses}:
            pose.checked(self.robot)
        self.history.do(timeline, gesture)
        self._keyframes_changed()

    def rest(self) -> None:
        """End the current undo step after a pause, except within a drag."""
        if not self._dragging:
            self.history.end_gesture()

    def select(self, number: int) -> None:
        """Select another pose; this is no undo step."""
        self.history.end_gesture()
        self.history.state = self.timeline.select(number)
        self._follow()

    def seek(self, time: float) -> None:
        """Show a time (s); a pose that is arrived at at this time is selected."""
        self.playback.seek(time)
        number = self.timeline.at(self.playback.cursor)
        if number is not None and number != self.timeline.selected:
            self.history.end_gesture()
            self.history.state = self.timeline.select(number)

    @property
    def shows_selected(self) -> bool:
        """Return whether the cursor is on the selected pose, or in its hold."""
        time = self.timeline.pose.time
        return time - 1e-6 <= self.playback.cursor <= time + self.timeline.hold + 1e-6

    def undo(self) -> None:
        """Undo the last edit."""
        self.history.undo()
        self._keyframes_changed()

    def redo(self) -> None:
        """Redo an undone edit."""
        self.history.redo()
        self._keyframes_changed()

    def new(self) -> None:
        """Remove all keyframes; :meth:`undo` restores them."""
        self.edit(Timeline.empty(self.robot, self.timing))

    def add(self) -> None:
        """Add a keyframe: at the cursor where it is between poses, else after the selected pose, in the same pose."""
        if self.shows_selected:
            self.edit(self.timeline.inserted(replace(self.timeline.pose, name=None)))
        elif self.playback.cursor < self.timeline.duration:
            self.add_at(self.playback.cursor)
        else:
            self.add_at(self.timeline.duration + NEW_INTERVAL)

    def add_at(self, time: float) -> None:
        """Add a keyframe at a time (s): interpolated, or after the end in the last pose.

        Where a keyframe is already, or is held, it is selected.

        Raises:
            KeyframeError: for a time that is too long after the end.
        """
        timeline = self.timeline
        if time > timeline.duration + 1e-6:
            if time - timeline.duration > LONGEST_INTERVAL + 1e-6:
                raise KeyframeError(
                    f"a keyframe at {time:.2f} s would be {time - timeline.duration:.2f} s after the end, "
                    f"expected at most {LONGEST_INTERVAL:g} s"
                )
            last = timeline.select(len(timeline.keyframes))
            self.edit(last.inserted(replace(last.pose, name=None), time - timeline.duration))
            return
        added = timeline.inserted_at(time)
        if added.keyframes is timeline.keyframes:
            self.select(added.selected)
        else:
            self.edit(added)

    def cut(self) -> None:
        """Remove the selected keyframe, to be pasted."""
        removed = self.timeline.removed()
        self.copy()
        self.edit(removed)

    @property
    def can_paste(self) -> bool:
        """Return whether something was copied."""
        return self._clipboard is not None

    def copy(self) -> None:
        """Copy the selected pose, and how long it is held, for :meth:`paste`."""
        self._clipboard = self.timeline.pose, self.timeline.hold

    def paste(self) -> None:
        """Add a keyframe with the copied pose, held as long, after the selected one.

        Raises:
            KeyframeError: when nothing was copied.
        """
        if self._clipboard is None:
            raise KeyframeError("nothing to paste: copy a keyframe first")
        pose, hold = self._clipboard
        self.edit(self.timeline.inserted(pose, hold=hold))

    def _keyframes_changed(self) -> None:
        self.playback.changed()
        self._follow()

    def _follow(self) -> None:
        """Move the cursor to the selected pose, unless a robot is playing."""
        if not self.playback.playing:
            self.playback.cursor = self.timeline.pose.time

    # the selected pose

    def pose(self, qpos: np.ndarray, gesture: Hashable = None) -> None:
        """Set the selected pose to ``[7 + J]``."""
        self.edit(self.timeline.posed(qpos), gesture)

    def set_joint(self, joint: int, angle: float) -> None:
        """Set a joint of the selected pose to an angle (rad)."""
        qpos = self.timeline.pose.qpos
        low, high = self.robot.joint_range[joint].tolist()
        qpos[7 + joint] = min(max(angle, low), high)
        self.pose(self._both_sides(qpos, self.robot.joint_names[joint]), gesture=("joint", joint))

    def set_root(self, root: np.ndarray, gesture: Hashable) -> None:
        """Set position and orientation of the selected pose's root ``[7]`` (m, ``wxyz``)."""
        qpos = self.timeline.pose.qpos
        qpos[:7] = root
        self.pose(qpos, gesture)

    def pin(self, handle: str) -> None:
        """Command a handle of the selected keyframe, or leave it to the policy; see :func:`plat.studio.pins.toggled`.

        Raises:
            KeyframeError: for the start.
        """
        self.edit(self.timeline.commanding(toggled(self.timeline.pose, handle, self.robot)))

    def lead_around(self) -> None:
        """Put a keyframe on the way to the selected one, where the straight way leads through the robot itself.

        Raises:
            KeyframeError: for the start, where the way is clear, and where no way around is found.
        """
        middle = keyframe_around(*self.timeline.way, self.robot, self.timing)
        if middle is None:
            raise KeyframeError("the straight way to this keyframe is clear: there is nothing to lead around")
        self.edit(self.timeline.parted(middle))

    def insert_template(self, name: str) -> None:
        """Add the keyframes of a template after the selected pose.

        Raises:
            StudioError: for a name that is none of :data:`plat.studio.templates.TEMPLATES`.
        """
        self.edit(template(name, self.timeline, self.poser))

    def open(self, path: str | Path) -> None:
        """Open a keyframe file to begin with, which cannot be undone.

        Raises:
            KeyframeError: naming file, keyframe and field.
        """
        self.load(path)
        self.history = History(self.timeline)
        self.opened = expand_home(Path(path)).resolve()

    def begin_with(self, name: str) -> None:
        """Open a template as an example, which counts as saved and cannot be undone.

        Raises:
            StudioError: for a name that is none of :data:`plat.studio.templates.TEMPLATES`.
        """
        self.history = History(template(name, Timeline.empty(self.robot, self.timing), self.poser))
        self.saved = self.timeline
        self._follow()

    def change_pose(self, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Replace the selected pose by a function of it."""
        self.pose(change(self.timeline.pose.qpos))

    def mirror(self) -> None:
        """Exchange left and right of the selected pose, in place, and of what it commands."""
        pose = self.timeline.pose
        timeline = self.timeline.posed(mirrored(pose.qpos, self.robot))
        if pose.commands is not None:
            timeline = timeline.commanding(mirrored_parts(pose.commands, self.robot))
        self.edit(timeline)

    def drop(self) -> None:
        """Put the lowest point of the selected pose on the floor."""
        self.change_pose(self._floor.dropped)

    def flatten_feet(self) -> None:
        """Put both feet of the selected pose flat on the floor."""
        self.change_pose(self.poser.flat)

    def stand(self) -> None:
        """Reset the selected pose to the default pose, in place."""
        self.change_pose(lambda qpos: placed(self.robot.default_qpos, self.robot.default_qpos, qpos))

    def begin_drag(self) -> None:
        """Start dragging something: all until :meth:`end_drag` is one step to undo, with any pauses in it."""
        self.history.end_gesture()
        self._dragging = True

    def grab(self, handle: str, held: Collection[str]) -> None:
        """Start dragging a handle of the selected pose, with others held."""
        self.begin_drag()
        qpos = self.timeline.pose.qpos
        frames = self.poser.frames(qpos)
        self._grip = handle, qpos, {name: frames[name] for name in held}, self.timeline.selected
        self._refused = False

    def drag(self, target: Frame) -> None:
        """Move the grabbed handle to a target, or as near as it comes.

        Where another pose was selected meanwhile, by a key or in another browser, it stays as it is.

        Raises:
            KeyframeError: as :meth:`edit`, but once in a drag, which has many targets.
        """
        if self._grip is not None and self._grip[-1] == self.timeline.selected:
            handle, rest, held, _ = self._grip
            qpos = self.poser.dragged(
                self.timeline.pose.qpos, handle, target, held, rest, self.limb_only or self.symmetric
            )
            try:
                self.pose(self._both_sides(qpos, handle), gesture=("drag", handle))
            except KeyframeError:
                if not self._refused:
                    self._refused = True
                    raise

    def _both_sides(self, qpos: np.ndarray, moved: str) -> np.ndarray:
        side = moved.partition("_")[0].partition(" ")[0]
        return symmetric(qpos, side, self.robot) if self.symmetric and side in ("left", "right") else qpos

    def end_drag(self) -> None:
        """End what :meth:`begin_drag` started: the next edit is a step of its own."""
        self._dragging = False
        self.history.end_gesture()

    def release(self) -> None:
        """Let go of the handle, and end the drag."""
        self._grip = None
        self.end_drag()

    # motions

    def take_pose(self, clip: MotionClip, time: float, insert: bool) -> None:
        """Take a pose from a clip to the selected pose's place: as its replacement, or as a keyframe after it."""
        taken = Keyframe.from_motion(self._within_limits(clip), time, self.robot).qpos
        qpos = placed(taken, taken, self.timeline.pose.qpos)
        self.edit(self.timeline.inserted(qpos) if insert else self.timeline.posed(qpos))

    def take_stretch(self, clip: MotionClip, begin: float, seconds: float, interval: float) -> None:
        """Replace all keyframes by a stretch of a clip: one every ``interval`` seconds, from the start pose's place.

        Raises:
            KeyframeError: when the stretch is shorter than the interval, or the interval is no valid command length.
        """
        clip = self._within_limits(clip)
        times = np.arange(begin + interval, min(begin + seconds, clip.duration) + 1e-6, interval)
        if not len(times):
            raise KeyframeError(f"less than {interval:g} s of the clip are left: begin earlier, or choose less")
        sequence = KeyframeSequence.from_motion(clip, times.tolist(), self.robot, begin=begin, timing=self.timing)
        there = [
            Keyframe.from_qpos(frame.time, placed(frame.qpos, sequence.start.qpos, self.timeline.start.qpos))
            for frame in (sequence.start, *sequence.keyframes)
        ]
        self.edit(Timeline.of(there[0], there[1:], self.robot, self.timing))

    def _within_limits(self, clip: MotionClip) -> MotionClip:
        # recorded motions are sometimes slightly beyond the joint limits; keyframes must not be
        qpos = np.array(clip.qpos)
        qpos[:, 7:] = np.clip(qpos[:, 7:], *self.robot.joint_range.numpy().T)
        return MotionClip(clip.name, qpos, clip.fps)

    # playing

    def record(self, timeline: Timeline, policy: str, path: str | Path) -> str:
        """Write a video of a policy that chases some keyframes.

        It changes no state, so another thread may call it.

        Returns:
            When and why the simulation ended early, up to which the video is; empty where it did not.

        Raises:
            KeyframeError: when there is no keyframe.
            ActionError: when the simulation ended with the first step.
            RenderingError: where there is no OpenGL, the extra ``plat-rl[video]`` is not installed, or the file is no
                ``.mp4`` or cannot be written.
        """
        path = expand_home(Path(path))
        check_video(path)
        sequence = self.playback.sequence(policy, timeline)
        with Stage(self.robot, distance=2.6) as stage:
            steps, scorer = chased(self.robot, self.playback.controller(policy), sequence)
            if not steps:
                raise ActionError(scorer.ended)
            write_video(path, film(stage, record(steps, scorer)))
        return scorer.ended

    # files

    def save(self, path: str | Path) -> None:
        """Write the keyframes to a file.

        Raises:
            KeyframeError: when there is no keyframe, or the disk does not take it.
        """
        self.write(path)
        self.saved = self.timeline

    def write(self, path: str | Path) -> None:
        """Write the keyframes to a file as :meth:`save` does, as a copy that does not count as saved."""
        timeline = self.timeline
        timeline.sequence()  # for its checks
        write_keyframes(expand_home(Path(path)), self.robot, timeline.start, timeline.to_keyframes())

    def load(self, path: str | Path) -> None:
        """Load the keyframes of a file; this can be undone.

        Raises:
            KeyframeError: naming file, keyframe and field.
        """
        path = expand_home(Path(path))
        start, keyframes = read_keyframes(path, self.robot)
        try:
            timeline = Timeline.of(start or standing(self.robot), keyframes, self.robot, self.timing)
        except KeyframeError as error:
            raise KeyframeError(f"keyframe file {str(path)!r}: {error}") from None
        self.edit(timeline)
        self.saved = timeline

    @property
    def as_saved(self) -> bool:
        """Return whether the keyframes are those that were last saved or loaded."""
        now, saved = self.timeline, self.saved
        return now.start is saved.start and now.keyframes is saved.keyframes and now.holds is saved.holds

    @property
    def unsaved(self) -> bool:
        """Return whether there is anything that no file holds."""
        return bool(self.timeline.keyframes) and not self.as_saved

    def to_json(self) -> bytes:
        """Return the content of the file that :meth:`save` writes."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            self.write(path)
            return path.read_bytes()

    def from_json(self, name: str, content: bytes) -> None:
        """Load keyframes from a file's content; ``name`` stands for the file in messages."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            path.write_bytes(content)
            try:
                self.load(path)
            except KeyframeError as error:
                raise KeyframeError(str(error).replace(str(path), name)) from None
