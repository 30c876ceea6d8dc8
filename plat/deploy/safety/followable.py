"""Commands that a policy can follow: the others are refused, before anything moves where that is possible."""

from collections.abc import Callable
from dataclasses import replace
from itertools import zip_longest
from typing import Any

from plat.deploy.description import RobotDescription
from plat.deploy.joint_names import plain_joint
from plat.deploy.safety.ending import CommandSource, TimedCommand
from plat.errors import KeyframeError
from plat.json_file import short
from plat.spec.parts import Parts, whole_only
from plat.spec.timing import Timing, timing_of

__all__ = ["FollowableCommands"]

_TOLERANCE = 1e-3  # control steps, for sources that count in seconds


class FollowableCommands:
    """Command source without the commands that a policy cannot follow. They are as if they had not been given.

    What a source says about itself is checked at once: ``robot``, ``timing`` and ``partial``, as keyframe sequences
    have them.

    Args:
        source: of the commands.
        timing: of the policy.
        sees_parts: whether the policy sees which parts of a pose a keyframe commands.
        tell: called with the reason why a command is left out.
        robot: of the policy; None to take keyframes of any.

    Raises:
        KeyframeError: naming a keyframe of the source that the policy cannot follow; for keyframes of another robot.
        PlatError: when source and policy have different control steps, or the source's longest command is longer.
    """

    def __init__(
        self,
        source: CommandSource,
        timing: Timing,
        sees_parts: bool,
        tell: Callable[[str], None],
        robot: RobotDescription | None = None,
    ):
        self._source, self._timing, self._sees_parts, self._tell = source, timing, sees_parts, tell
        if robot is not None:
            _check_robot(getattr(source, "robot", None), robot)
        partial = getattr(source, "partial", None)
        if partial is not None and not sees_parts:
            raise KeyframeError(whole_only(partial))
        theirs = timing_of(source)
        if theirs is None:
            return
        timing.check_control_dt(theirs.control_dt, "keyframes")
        if theirs.max_steps <= timing.max_steps:
            return
        if hasattr(source, "with_timing"):  # a sequence: its keyframes may be near enough
            source.with_timing(replace(theirs, max_steps=timing.max_steps))
        else:
            timing.check_steps(theirs.max_steps, "keyframes: longest command")

    def command(self, time: float) -> Any:
        """Return the :class:`plat.deploy.safety.TimedCommand` at a time (s); None when there is none to follow."""
        command: TimedCommand | None = self._source.command(time)
        if command is None or (reason := self._refusal(command)) is None:
            return command
        self._tell(reason)
        return None

    def _refusal(self, command: TimedCommand) -> str | None:
        """Return why the policy cannot follow a command; None when it can."""
        commands = getattr(command.keyframe, "commands", None)
        if not isinstance(commands, Parts | None):
            return f"commands is {short(commands)}, expected plat.spec.parts.Parts or None"
        if not self._sees_parts and commands is not None and not commands.whole:
            return whole_only(command.keyframe)
        if not 0 < command.steps_left <= self._timing.max_steps + _TOLERANCE:
            longest = self._timing.max_steps
            return f"a command of {command.steps_left:g} control steps, expected more than 0 and at most {longest}"
        return None


def _check_robot(theirs: Any, ours: RobotDescription) -> None:
    """Raise an error for keyframes whose joints are not a policy's, in its order."""
    names = getattr(theirs, "joint_names", None)
    if names is None:  # it does not say
        return
    for index, (name, expected) in enumerate(zip_longest(names, ours.joint_names)):
        if name is None or expected is None or plain_joint(name) != plain_joint(expected):
            raise KeyframeError(
                f"keyframes are of robot {getattr(theirs, 'name', None)!r}, whose joint {index} is {name!r}, expected "
                f"{expected!r} as in the policy's {ours.name!r}"
            )
