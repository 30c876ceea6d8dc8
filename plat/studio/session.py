"""What the studio does, without its page: keyframes with undo, posing, playing, scores and files."""

from collections.abc import Callable, Collection, Hashable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tensordict.nn import TensorDictModuleBase

from plat.control import Chase, KeyframeScore, KeyframeScorer, PolicyController, record
from plat.errors import KeyframeError, StudioError
from plat.keyframes import Keyframe, KeyframeSequence
from plat.keyframes.files import read_keyframes
from plat.motions import MotionClip
from plat.rendering import Stage, check_video, film, write_video
from plat.robots.robot import Robot
from plat.spec.timing import Timing, timing_of
from plat.studio.history import History
from plat.studio.player import HOLD, Player, score, simulator
from plat.studio.poser import Frame, Poser
from plat.studio.poses import Floor, mirrored, placed
from plat.studio.timeline import Timeline

__all__ = ["Session", "common_timing"]


class Session:
    """One robot, the keyframes that are being made for it, and the policies that can chase them.

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
        self.policies = dict(policies)
        self.timing = common_timing(self.policies)
        """Timing of the keyframes: what every policy can chase."""
        self.policy = next(iter(self.policies))
        """Name of the policy that plays."""
        self.history = History(Timeline.empty(robot, self.timing))
        self.player: Player | None = None
        """The chase that is on, or was the last one; None before the first and after :meth:`stop`."""
        self.scores: dict[str, list[KeyframeScore]] = {}
        """By policy, of the keyframes as they are now."""
        self.poser = Poser(robot)
        self._floor = Floor(robot)
        self._clipboard: Keyframe | None = None
        self._grip: tuple[str, np.ndarray, dict[str, Frame]] | None = None

    # keyframes

    @property
    def timeline(self) -> Timeline:
        """The keyframes as they are now."""
        return self.history.state

    def edit(self, timeline: Timeline, gesture: Hashable = None) -> None:
        """Go to edited keyframes; see :meth:`plat.studio.history.History.do`."""
        self.history.do(timeline, gesture)
        self._keyframes_changed()

    def rest(self) -> None:
        """Nothing was done for a while: what is done next is a step of its own to undo, except within a drag."""
        if self._grip is None:
            self.history.end_gesture()

    def select(self, number: int) -> None:
        """Select another pose, which is no step to undo."""
        self.history.end_gesture()
        self.history.state = self.timeline.select(number)

    def undo(self) -> None:
        """Take the last edit back."""
        self.history.undo()
        self._keyframes_changed()

    def redo(self) -> None:
        """Make an edit again that was taken back."""
        self.history.redo()
        self._keyframes_changed()

    def new(self) -> None:
        """No keyframes; what was there can be had back by :meth:`undo`."""
        self.edit(Timeline.empty(self.robot, self.timing))

    def add(self) -> None:
        """A keyframe after the selected pose, in the same pose."""
        self.edit(self.timeline.inserted(self.timeline.pose.qpos))

    def copy(self) -> None:
        """Remember the selected pose for :meth:`paste`."""
        self._clipboard = self.timeline.pose

    def paste(self) -> None:
        """A keyframe after the selected pose, as it was copied.

        Raises:
            KeyframeError: when nothing was copied.
        """
        if self._clipboard is None:
            raise KeyframeError("nothing to paste: copy a keyframe first")
        self.edit(self.timeline.inserted(self._clipboard.qpos, name=self._clipboard.name))

    def _keyframes_changed(self) -> None:
        self.scores.clear()
        if self.player is None:
            return
        if self.player.finished or not self.timeline.keyframes:
            self.stop()
        else:
            self.player.sequence = self.timeline.sequence()

    # the selected pose

    def pose(self, qpos: np.ndarray, gesture: Hashable = None) -> None:
        """Put the selected pose at ``[7 + J]``."""
        self.edit(self.timeline.posed(qpos), gesture)

    def set_joint(self, joint: int, angle: float) -> None:
        """Turn a joint of the selected pose to an angle (rad)."""
        qpos = self.timeline.pose.qpos
        qpos[7 + joint] = angle
        self.pose(qpos, gesture=("joint", joint))

    def set_root(self, root: np.ndarray, gesture: Hashable) -> None:
        """Put the root of the selected pose at a position and orientation ``[7]`` (m, ``wxyz``)."""
        qpos = self.timeline.pose.qpos
        qpos[:7] = root
        self.pose(qpos, gesture)

    def change_pose(self, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Put the selected pose where a function of it says."""
        self.pose(change(self.timeline.pose.qpos))

    def mirror(self) -> None:
        """Exchange left and right of the selected pose, in place."""
        self.change_pose(lambda qpos: mirrored(qpos, self.robot))

    def drop(self) -> None:
        """Put the lowest point of the selected pose on the floor."""
        self.change_pose(self._floor.dropped)

    def flatten_feet(self) -> None:
        """Put both feet of the selected pose flat on the floor."""
        self.change_pose(self.poser.flat)

    def stand(self) -> None:
        """Bring the selected pose to the default pose, where it is."""
        self.change_pose(lambda qpos: placed(self.robot.default_qpos, self.robot.default_qpos, qpos))

    def grab(self, handle: str, held: Collection[str]) -> None:
        """Begin to drag a handle of the selected pose, others being held."""
        self.history.end_gesture()
        qpos = self.timeline.pose.qpos
        frames = self.poser.frames(qpos)
        self._grip = handle, qpos, {name: frames[name] for name in held}

    def drag(self, target: Frame) -> None:
        """Take the handle that was grabbed to a target, or as near as it comes."""
        if self._grip is not None:
            handle, rest, held = self._grip
            qpos = self.poser.dragged(self.timeline.pose.qpos, handle, target, held, rest)
            self.pose(qpos, gesture=("drag", handle))

    def release(self) -> None:
        """Let the handle go."""
        self._grip = None
        self.history.end_gesture()

    # motions

    def take_pose(self, clip: MotionClip, time: float, insert: bool) -> None:
        """A pose out of a clip, put where the selected pose stands: in place of it, or as a keyframe after it."""
        taken = Keyframe.from_motion(self._within_limits(clip), time, self.robot).qpos
        qpos = placed(taken, taken, self.timeline.pose.qpos)
        self.edit(self.timeline.inserted(qpos) if insert else self.timeline.posed(qpos))

    def take_stretch(self, clip: MotionClip, begin: float, seconds: float, interval: float) -> None:
        """A stretch of a clip in place of all keyframes: one every ``interval`` seconds, from where the start stands.

        Raises:
            KeyframeError: when the stretch is shorter than the interval, or the interval is none for a command.
        """
        clip = self._within_limits(clip)
        times = np.arange(begin + interval, min(begin + seconds, clip.duration) + 1e-6, interval)
        sequence = KeyframeSequence.from_motion(clip, times.tolist(), self.robot, begin=begin, timing=self.timing)
        there = [
            Keyframe.from_qpos(frame.time, placed(frame.qpos, sequence.start.qpos, self.timeline.start.qpos))
            for frame in (sequence.start, *sequence.keyframes)
        ]
        self.edit(Timeline.of(KeyframeSequence(self.robot, there[0], tuple(there[1:]), self.timing)))

    def _within_limits(self, clip: MotionClip) -> MotionClip:
        # recorded motions are now and then a little beyond the joints' limits; keyframes must not be
        qpos = np.array(clip.qpos)
        qpos[:, 7:] = np.clip(qpos[:, 7:], *self.robot.joint_range.numpy().T)
        return MotionClip(clip.name, qpos, clip.fps)

    # playing

    @property
    def playing(self) -> bool:
        """Whether a robot is under way."""
        return self.player is not None and not self.player.finished

    def play(self) -> None:
        """Begin at the start.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        self.player = Player(self.robot, self._controller(self.policy), self.timeline.sequence())

    def stop(self) -> None:
        """Put the robot away."""
        self.player = None

    def choose(self, policy: str) -> None:
        """Play with another policy; it takes over from one that is playing."""
        self.policy = policy
        if self.player is not None and self.playing:
            self.player.hand_over(self._controller(policy))

    def tick(self, seconds: float) -> None:
        """Let time pass for a robot that is under way."""
        if self.player is None or self.player.finished:
            return
        self.player.advance(seconds)
        if self.player.finished and (scores := self.player.scores) is not None:
            self.scores[self.policy] = scores

    def compare(self, timeline: Timeline) -> dict[str, list[KeyframeScore]]:
        """Scores of every policy on some keyframes, at full speed; for another thread, as nothing here changes.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        sequence = timeline.sequence()
        return {name: score(self.robot, self._controller(name), sequence) for name in self.policies}

    def take_scores(self, timeline: Timeline, scores: Mapping[str, list[KeyframeScore]]) -> None:
        """Keep scores, if they are of the keyframes as they are now."""
        now = self.timeline
        if timeline.start is now.start and timeline.keyframes is now.keyframes:
            self.scores.update(scores)

    def record(self, timeline: Timeline, policy: str, path: str | Path) -> None:
        """Write a video of a policy that chases some keyframes; for another thread, as nothing here changes.

        Raises:
            KeyframeError: when there is no keyframe.
            RenderingError: where there is no OpenGL, the extra ``plat-rl[video]`` is not installed, or the file is no
                ``.mp4`` or cannot be written.
        """
        path = Path(path).expanduser()
        check_video(path)
        sequence = timeline.sequence()
        controller = self._controller(policy)
        chase = Chase(controller, sequence, simulator(self.robot, controller), hold=HOLD)
        scorer = KeyframeScorer(self.robot)
        stage = Stage(self.robot, distance=2.6)
        try:
            write_video(path, film(stage, record((step, scorer.add(step)) for step in chase)))
        finally:
            stage.close()

    def _controller(self, policy: str) -> PolicyController:
        return PolicyController(self.policies[policy], self.robot)

    # files

    def save(self, path: str | Path) -> None:
        """Write the keyframes to a file.

        Raises:
            KeyframeError: when there is no keyframe, or the disk does not take it.
        """
        self.timeline.sequence().save(Path(path).expanduser())

    def load(self, path: str | Path) -> int:
        """Take the keyframes of a file; it can be undone.

        Returns:
            How many keyframes were added because others were too far apart.

        Raises:
            KeyframeError: naming file, keyframe and field.
        """
        path = Path(path).expanduser()
        sequence = KeyframeSequence.load(path, self.robot, split=True, timing=self.timing)
        self.edit(Timeline.of(sequence))
        return len(sequence) - len(read_keyframes(path, self.robot)[1])

    def to_json(self) -> bytes:
        """The content of the file that :meth:`save` writes."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            self.save(path)
            return path.read_bytes()

    def from_json(self, name: str, content: bytes) -> int:
        """:meth:`load` of a file's content, ``name`` standing for it in messages."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            path.write_bytes(content)
            try:
                return self.load(path)
            except KeyframeError as error:
                raise KeyframeError(str(error).replace(str(path), name)) from None


def common_timing(policies: Mapping[str, TensorDictModuleBase]) -> Timing:
    """Return the timing of keyframes that every one of some policies can chase: that with the shortest commands.

    Raises:
        StudioError: when the policies have different control steps.
    """
    timings = {name: timing_of(policy) or Timing() for name, policy in policies.items()}
    (first, shortest), *others = timings.items()
    for name, timing in others:
        if timing.control_dt != shortest.control_dt:
            raise StudioError(
                f"policy {name!r} has a control step of {timing.control_dt:g} s and {first!r} one of "
                f"{shortest.control_dt:g} s: open them apart"
            )
    return min(timings.values(), key=lambda timing: timing.max_steps)
