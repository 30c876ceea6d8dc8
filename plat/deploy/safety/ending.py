"""End of a sequence: hold the last keyframe, then stand."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from plat.deploy.description import RobotDescription
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, Pose
from plat.rotations_np import heading_pitch_roll

__all__ = ["CommandSource", "EndOfSequence", "TimedCommand"]


class TimedCommand(Protocol):
    """Protocol of a command: :class:`plat.keyframes.Command` is one."""

    @property
    def keyframe(self) -> Pose:
        """Return the commanded pose."""

    @property
    def steps_left(self) -> int:
        """Return the control steps to its arrival, at least 1."""


class CommandSource(Protocol):
    """Protocol of what commands a robot: :class:`plat.keyframes.KeyframeSequence` is one."""

    def command(self, time: float) -> Any:
        """Return the :class:`TimedCommand` at a time (s) since the start; None after the last."""


@dataclass(frozen=True)
class _Pose:
    root_pos: Array
    root_quat: Array
    joint_pos: Array


@dataclass(frozen=True)
class _Command:
    keyframe: Pose
    steps_left: int


class EndOfSequence:
    """Command source that never ends: after the last keyframe of another one it holds, then stands.

    It stands in the default pose, upright, where the last keyframe has its root and its heading.

    Args:
        source: that ends.
        robot: its default pose.
        max_steps: longest command of the policy, in control steps.
        settings: times.
        place: root pose to stand at when the source commands nothing at all; None for the origin.
    """

    def __init__(
        self,
        source: CommandSource,
        robot: RobotDescription,
        max_steps: int,
        settings: SafetySettings = SafetySettings(),
        place: Pose | None = None,
    ):
        self._source, self._robot, self._settings = source, robot, settings
        self._stand_steps = max(1, min(round(settings.stand / robot.control_dt), max_steps))
        qpos = robot.default_qpos
        self._last: Pose = place or _Pose(qpos[:3], qpos[3:7], qpos[7:])
        self._ended: float | None = None

    def command(self, time: float) -> TimedCommand:
        """Return the command at a time (s); times do not go back."""
        command: TimedCommand | None = self._source.command(time)
        if command is not None:
            self._last, self._ended = command.keyframe, None
            return command
        if self._ended is None:
            self._ended = time
        # a small margin, for times are multiples of the control step up to rounding
        holding = time - self._ended - self._settings.hold + 1e-9
        if holding < 0:
            return _Command(self._last, 1)
        left = self._stand_steps - int(holding / self._robot.control_dt)
        return _Command(self._standing(), max(left, 1))

    @property
    def ended(self) -> bool:
        """Return whether the source has commanded its last."""
        return self._ended is not None

    def _standing(self) -> _Pose:
        half = 0.5 * heading_pitch_roll(self._last.root_quat)[0]
        x_w, y_w, _ = self._last.root_pos
        place = np.array([x_w, y_w, self._robot.root_height])
        return _Pose(place, np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), self._robot.default_joint_pos)
