"""Playback of the keyframes by one policy or two: play, pause, step, slow motion, and looking at it again."""

from collections.abc import Callable, Collection, Mapping
from itertools import pairwise

from tensordict.nn import TensorDictModuleBase

from plat.control import KeyframeScore, PolicyController
from plat.errors import PlatError, StudioError
from plat.keyframes import KeyframeSequence
from plat.robots.robot import Robot
from plat.spec.timing import Timing, timing_of
from plat.studio.player import Player, score
from plat.studio.timeline import Timeline

__all__ = ["SPEEDS", "PolicyPlayback", "common_timing", "nobody"]

SPEEDS = {"1x": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1}
"""Speeds of playback by label: seconds of the robot per second."""


class PolicyPlayback:
    """Playback of the keyframes by the chosen policy, and by another one beside it.

    A chase is simulated once, from the start on. What was simulated can be looked at again at any time, until the
    keyframes are edited.

    Args:
        robot: the robot.
        policies: deterministic policies by name, at least one, all of one control step.
        timeline: returns the keyframes as they are now.

    Raises:
        StudioError: when the policies have different control steps.
    """

    def __init__(self, robot: Robot, policies: Mapping[str, TensorDictModuleBase], timeline: Callable[[], Timeline]):
        self._robot = robot
        self.policies = dict(policies)
        self.timing = common_timing(self.policies)
        """Timing of the keyframes: control step, and the longest command of all policies."""
        self.policy = next(iter(self.policies))
        """Name of the policy that plays."""
        self.beside: str | None = None
        """Name of the policy that plays beside it."""
        self.speed = 1.0
        """Seconds of the robot per second."""
        self.loop = False
        """Whether to begin again at the end."""
        self.cursor = 0.0
        """The time that is shown (s)."""
        self.player: Player | None = None
        """The chase that is on, or was the last one; None before the first and after :meth:`stop`."""
        self.second: Player | None = None
        """That of the policy beside it."""
        self.scores: dict[str, list[KeyframeScore]] = {}
        """By policy, of the keyframes as they are now."""
        self.notes: dict[str, str] = {}
        """By policy, why it did not play them when all were compared, or when and why its simulation ended early."""
        self.refused = ""
        """Why a policy that played ended with an edit of the keyframes; empty when that was told."""
        self.played = self.policy
        """Name of the policy whose chase :attr:`player` is."""
        self._timeline = timeline
        self._paused = False

    @property
    def playing(self) -> bool:
        """Return whether a robot is moving."""
        return not self._over and not self._paused

    @property
    def paused(self) -> bool:
        """Return whether a chase was interrupted and can go on."""
        return not self._over and self._paused

    @property
    def _over(self) -> bool:
        """Return whether no robot is on its way; that of one policy may have ended before the other."""
        return all(player.finished for _, player in self.players)

    @property
    def players(self) -> list[tuple[str, Player]]:
        """Return the policies that play, each with its chase: one, two or none."""
        named = ((self.played, self.player), (self.beside, self.second))
        return [(name, player) for name, player in named if name is not None and player is not None]

    @property
    def simulated(self) -> float:
        """Return the end of what was simulated (s)."""
        return max((player.time for _, player in self.players), default=0.0)

    def play(self) -> None:
        """Start from the start pose.

        Raises:
            KeyframeError: when there is no keyframe, or a policy cannot follow one.
        """
        player = self._player(self.policy)
        self.second = None if self.beside is None else self._player(self.beside)
        self.player, self.played = player, self.policy
        self._paused, self.cursor = False, 0.0

    def toggle(self) -> None:
        """Pause when playing, go on when paused, else play."""
        if self.playing:
            self._paused = True
        elif self.paused:
            self._paused, self.cursor = False, self.simulated
        else:
            self.play()

    def stop(self) -> None:
        """End the chase and forget it; go to the start."""
        self.player = self.second = None
        self._paused, self.cursor = False, 0.0

    def seek(self, time: float) -> None:
        """Show a time (s): of what was simulated, or of the keyframes; a chase that is on is paused."""
        self._paused = not self._over
        self.cursor = min(max(float(time), 0.0), max(self._timeline().duration, self.simulated))

    def step(self, steps: int) -> None:
        """Go some control steps ahead (or back), pausing; simulate those that were not yet."""
        if self.player is None:
            self.play()
        self._paused = True
        control_dt = self.timing.control_dt
        goal = max(round(self.cursor / control_dt) + steps, 0) * control_dt
        while self.simulated + 1e-9 < goal and not self._over:
            for _, player in self.players:
                player.take_step()
        self._take_scores()
        self.cursor = min(goal, self.simulated)

    def choose(self, policy: str) -> None:
        """Select another policy; it takes over while playing.

        Raises:
            KeyframeError: when it cannot follow the keyframes; the one before goes on.
        """
        self._check(policy)
        if self.player is not None and not self.player.finished:
            self.player.hand_over(self.controller(policy), self.sequence(policy))
            self.played = policy
        self.policy = policy

    def set_beside(self, policy: str | None) -> None:
        """Select the policy that plays beside; it does from the next start on."""
        if policy is not None:
            self._check(policy)
        self.beside = policy
        self.second = None

    def tick(self, seconds: float) -> None:
        """Advance in time."""
        if not self.playing:
            return
        for _, player in self.players:
            player.advance(seconds * self.speed)
        self.cursor = self.simulated
        self._take_scores()
        if self._over and self.loop:
            self.play()

    def _take_scores(self) -> None:
        for name, player in self.players:
            if not player.finished:
                continue
            if (scores := player.scores) is not None:
                self.scores[name] = scores
            self.notes.pop(name, None)
            if player.ended:
                self.notes[name] = player.ended

    def changed(self) -> None:
        """Obey edited keyframes: a chase that is on goes on with them, one that is over is forgotten.

        Where a policy that plays cannot follow them the chase is ended, and :attr:`refused` says why.
        """
        self.scores.clear()
        self.notes.clear()
        timeline = self._timeline()
        if self.player is None:
            return
        if self._over or not timeline.keyframes:
            cursor = min(self.cursor, timeline.duration)
            self.stop()
            self.cursor = cursor
        else:
            try:
                for name, player in self.players:
                    player.sequence = self.sequence(name)
            except PlatError as error:
                # half of it would be played with other keyframes, and none of it counts
                self.stop()
                self.refused = str(error)

    def compare(self, timeline: Timeline) -> tuple[dict[str, list[KeyframeScore]], dict[str, str]]:
        """Compute the scores of every policy on some keyframes, at full speed.

        It changes no state, so another thread may call it.

        Returns:
            The scores by policy, and by policy why it did not play, or when and why its simulation ended early.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        timeline.sequence()  # that there is something to play
        scores: dict[str, list[KeyframeScore]] = {}
        notes: dict[str, str] = {}
        for name in self.policies:
            try:
                scores[name], ended = score(self._robot, self.controller(name), self.sequence(name, timeline))
                if ended:
                    notes[name] = ended
            except PlatError as error:
                notes[name] = f"did not play: {error}"
        return scores, notes

    def take_scores(
        self, timeline: Timeline, scores: Mapping[str, list[KeyframeScore]], notes: Mapping[str, str]
    ) -> None:
        """Store what :meth:`compare` returned, if it belongs to the current keyframes."""
        now = self._timeline()
        if timeline.start is now.start and timeline.keyframes is now.keyframes and timeline.holds is now.holds:
            self.scores.update(scores)
            self.notes = dict(notes)

    def sequence(self, policy: str, timeline: Timeline | None = None) -> KeyframeSequence:
        """Return the keyframes as a policy is given them: split where they are farther apart than its commands reach.

        Args:
            policy: its name.
            timeline: by default the keyframes as they are now.

        Raises:
            KeyframeError: when there is no keyframe.
        """
        return (timeline or self._timeline()).sequence(timing_of(self.policies[policy]) or Timing())

    def _player(self, policy: str) -> Player:
        return Player(self._robot, self.controller(policy), self.sequence(policy))

    def controller(self, policy: str) -> PolicyController:
        """Return a controller of a policy."""
        return PolicyController(self.policies[policy], self._robot)

    def _check(self, policy: str) -> None:
        if policy not in self.policies:
            raise StudioError(f"policy {policy!r}, expected one of {', '.join(self.policies)}")


def nobody(policies: Collection[str]) -> str:
    """Return what the page calls no policy: something that none of the policies is called.

    >>> nobody(["plat"]), nobody(["plat", "nobody"])
    ('nobody', 'nobody else')
    """
    name = "nobody"
    while name in policies:
        name += " else"
    return name


def common_timing(policies: Mapping[str, TensorDictModuleBase]) -> Timing:
    """Return the timing for the keyframes of some policies: that with the longest commands.

    Others are given long intervals in parts, see :meth:`PolicyPlayback.sequence`.

    Raises:
        StudioError: when the policies have different control steps.
    """
    timings = {name: timing_of(policy) or Timing() for name, policy in policies.items()}
    for (first, before), (name, timing) in pairwise(timings.items()):
        if timing.control_dt != before.control_dt:
            raise StudioError(
                f"policy {name!r} has a control step of {timing.control_dt:g} s and {first!r} one of "
                f"{before.control_dt:g} s: open them separately"
            )
    return max(timings.values(), key=lambda timing: timing.max_steps)
