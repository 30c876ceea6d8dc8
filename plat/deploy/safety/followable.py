"""Commands that a policy can follow: the others are refused, before anything moves where that is possible."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from plat.deploy.safety.ending import CommandSource, TimedCommand
from plat.errors import KeyframeError
from plat.json_file import short
from plat.spec.parts import Parts, whole_only
from plat.spec.timing import Timing, timing_of

__all__ = ["FollowableCommands"]

_TOLERANCE = 1e-3  # control steps, for sources that count in seconds


class FollowableCommands:
    """Command source without the commands that a policy cannot follow. They are as if they had not been given.

    What a source says about itself is checked at once: ``timing`` and ``partial``, as keyframe sequences have them.

    Args:
        source: of the commands.
        timing: of the policy.
        sees_parts: whether the policy sees which parts of a pose a keyframe commands.
        tell: called with the reason why a command is left out.

    Raises:
        KeyframeError: naming a keyframe of the source that the policy cannot follow.
        PlatError: when source and policy have different control steps, or the source's longest command is longer.
    """

    def __init__(self, source: CommandSource, timing: Timing, sees_parts: bool, tell: Callable[[str], None]):
        self._source, self._timing, self._sees_parts, self._tell = source, timing, sees_parts, tell
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
