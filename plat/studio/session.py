"""Studio session without its page: keyframes with undo, posing, playing, scores and files."""

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
        """Return the current keyframes."""
        return self.history.state

    def edit(self, timeline: Timeline, gesture: Hashable = None) -> None:
        """Replace the keyframes by edited ones; see :meth:`plat.studio.history.History.do`."""
        self.history.do(timeline, gesture)
        self._keyframes_changed()

    def rest(self) -> None:
        """End the current undo step after a pause, except within a drag."""
        if self._grip is None:
            self.history.end_gesture()

    def select(self, number: int) -> None:
        """Select another pose; this is no undo step."""
        self.history.end_gesture()
        self.history.state = self.timeline.select(number)

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
        """Add a keyframe after the selected pose, in the same pose."""
        self.edit(self.timeline.inserted(self.timeline.pose.qpos))

    def copy(self) -> None:
        """Copy the selected pose for :meth:`paste`."""
        self._clipboard = self.timeline.pose

    def paste(self) -> None:
        """Add a keyframe with the copied pose after the selected one.

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
        """Set the selected pose to ``[7 + J]``."""
        self.edit(self.timeline.posed(qpos), gesture)

    def set_joint(self, joint: int, angle: float) -> None:
        """Set a joint of the selected pose to an angle (rad)."""
        qpos = self.timeline.pose.qpos
        qpos[7 + joint] = angle
        self.pose(qpos, gesture=("joint", joint))

    def set_root(self, root: np.ndarray, gesture: Hashable) -> None:
        """Set position and orientation of the selected pose's root ``[7]`` (m, ``wxyz``)."""
        qpos = self.timeline.pose.qpos
        qpos[:7] = root
        self.pose(qpos, gesture)

    def change_pose(self, change: Callable[[np.ndarray], np.ndarray]) -> None:
        """Replace the selected pose by a function of it."""
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
        """Reset the selected pose to the default pose, in place."""
        self.change_pose(lambda qpos: placed(self.robot.default_qpos, self.robot.default_qpos, qpos))

    def grab(self, handle: str, held: Collection[str]) -> None:
        """Start dragging a handle of the selected pose, with others held."""
        self.history.end_gesture()
        qpos = self.timeline.pose.qpos
        frames = self.poser.frames(qpos)
        self._grip = handle, qpos, {name: frames[name] for name in held}

    def drag(self, target: Frame) -> None:
        """Move the grabbed handle to a target, or as near as it comes."""
        if self._grip is not None:
            handle, rest, held = self._grip
            qpos = self.poser.dragged(self.timeline.pose.qpos, handle, target, held, rest)
            self.pose(qpos, gesture=("drag", handle))

    def release(self) -> None:
        """End the drag."""
        self._grip = None
        self.history.end_gesture()

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
        sequence = KeyframeSequence.from_motion(clip, times.tolist(), self.robot, begin=begin, timing=self.timing)
        there = [
            Keyframe.from_qpos(frame.time, placed(frame.qpos, sequence.start.qpos, self.timeline.start.qpos))
            for frame in (sequence.start, *sequence.keyframes)
        ]
        self.edit(Timeline.of(KeyframeSequence(self.robot, there[0], tuple(there[1:]), self.timing)))

    def _within_limits(self, clip: MotionClip) -> MotionClip:
        # recorded motions are sometimes slightly beyond the joint limits; keyframes must not be
        qpos = np.array(clip.qpos)
        qpos[:, 7:] = np.clip(qpos[:, 7:], *self.robot.joint_range.numpy().T)
        return MotionClip(clip.name, qpos, clip.fps)

    # playing

    @property
    def playing(self) -> bool:
        """Return whether a robot is playing."""
        return self.player is not None and not self.player.finished

    def play(self) -> None:
        """Start playing from the start pose.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        self.player = Player(self.robot, self._controller(self.policy), self.timeline.sequence())

    def stop(self) -> None:
        """Stop playing and remove the robot."""
        self.player = None

    def choose(self, policy: str) -> None:
        """Select another policy; it takes over while playing."""
        self.policy = policy
        if self.player is not None and self.playing:
            self.player.hand_over(self._controller(policy))

    def tick(self, seconds: float) -> None:
        """Advance a playing robot in time."""
        if self.player is None or self.player.finished:
            return
        self.player.advance(seconds)
        if self.player.finished and (scores := self.player.scores) is not None:
            self.scores[self.policy] = scores

    def compare(self, timeline: Timeline) -> dict[str, list[KeyframeScore]]:
        """Compute the scores of every policy on some keyframes, at full speed.

        It changes no state, so another thread may call it.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        sequence = timeline.sequence()
        return {name: score(self.robot, self._controller(name), sequence) for name in self.policies}

    def take_scores(self, timeline: Timeline, scores: Mapping[str, list[KeyframeScore]]) -> None:
        """Store scores, if they belong to the current keyframes."""
        now = self.timeline
        if timeline.start is now.start and timeline.keyframes is now.keyframes:
            self.scores.update(scores)

    def record(self, timeline: Timeline, policy: str, path: str | Path) -> None:
        """Write a video of a policy that chases some keyframes.

        It changes no state, so another thread may call it.

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
            write_video(path, film(stage, record(((step, scorer.add(step)) for step in chase), scorer)))
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
        """Load the keyframes of a file; this can be undone.

        Returns:
            Number of keyframes added because others were too far apart.

        Raises:
            KeyframeError: naming file, keyframe and field.
        """
        path = Path(path).expanduser()
        sequence = KeyframeSequence.load(path, self.robot, split=True, timing=self.timing)
        self.edit(Timeline.of(sequence))
        return len(sequence) - len(read_keyframes(path, self.robot)[1])

    def to_json(self) -> bytes:
        """Return the content of the file that :meth:`save` writes."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            self.save(path)
            return path.read_bytes()

    def from_json(self, name: str, content: bytes) -> int:
        """Load keyframes from a file's content; ``name`` stands for the file in messages."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / "keyframes.json"
            path.write_bytes(content)
            try:
                return self.load(path)
            except KeyframeError as error:
                raise KeyframeError(str(error).replace(str(path), name)) from None


def common_timing(policies: Mapping[str, TensorDictModuleBase]) -> Timing:
    """Return the timing whose keyframes all of some policies can chase: that with the shortest commands.

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
