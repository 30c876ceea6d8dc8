"""End of a sequence: hold the last keyframe, then stand."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from plat.deploy.description import RobotDescription
from plat.deploy.safety.settings import SafetySettings
from plat.deploy.state import Array, Pose, RobotState
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

    It stands in the default pose, upright, where the last keyframe commands the root and its heading. What that
    keyframe does not command is taken from where the robot is when it begins to stand. A command that was taken back
    before its arrival is not held.

    Args:
        source: that ends.
        robot: its default pose.
        max_steps: longest command of the policy, in control steps.
        settings: times.
        place: root pose to stand at where neither a keyframe nor a state says one; None for the origin.
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
        self._place: Pose = place or _Pose(qpos[:3], qpos[3:7], qpos[7:])
        self._last: Pose | None = None
        self._arrival: float = 0  # of the last keyframe, in control steps since the start
        self._ended: float | None = None
        self._standing: Pose | None = None

    def command(self, time: float, state: RobotState | None = None) -> TimedCommand:
        """Return the command at a time (s); times do not go back.

        Args:
            time: seconds since the start.
            state: of the robot at that time, in the keyframes' world; None where it is not known.
        """
        step = round(time / self._robot.control_dt)
        command: TimedCommand | None = self._source.command(time)
        if command is not None:
            self._last, self._arrival = command.keyframe, step + command.steps_left
            self._ended = self._standing = None
            return command
        if self._ended is None:
            self._ended = time
            if step < self._arrival:  # nobody asks for it any more
                self._last = None
        hold = 0.0 if self._last is None else self._settings.hold
        # a small margin, for times are multiples of the control step up to rounding
        holding = time - self._ended - hold + 1e-9
        if self._last is not None and holding < 0:
            return _Command(self._last, 1)
        if self._standing is None:
            self._standing = self._stand(state)
        left = self._stand_steps - int(holding / self._robot.control_dt)
        return _Command(self._standing, max(left, 1))

    @property
    def ended(self) -> bool:
        """Return whether the source has commanded its last."""
        return self._ended is not None

    def _stand(self, state: RobotState | None) -> Pose:
        """Return the pose to stand in."""
        here = self._place if state is None else _Pose(state.root_pos_w, state.root_quat_w, state.joint_pos)
        last = here if self._last is None else self._last
        commands = getattr(last, "commands", None)
        horizontal = commands is None or commands.root_place[0]
        orientation = commands is None or commands.root[2]
        x_w, y_w, _ = (last if horizontal else here).root_pos
        half = 0.5 * heading_pitch_roll((last if orientation else here).root_quat)[0]
        place = np.array([x_w, y_w, self._robot.root_height])
        return _Pose(place, np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), self._robot.default_joint_pos)
