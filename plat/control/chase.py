"""Control loop: a keyframe sequence, a controller and a simulator, step by step."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from plat.bounds import Range, check_value
from plat.control.simulator import Simulator
from plat.deploy import Pose, RobotState
from plat.errors import KeyframeError, PlatError, StateError
from plat.json_file import short
from plat.keyframes import Command, Keyframe, KeyframeSequence
from plat.keyframes.sequence import check_sequence
from plat.spec.parts import whole_only
from plat.spec.timing import Timing

__all__ = ["Chase", "ChaseStep", "Controller", "check_parts_are_seen"]


class Controller(Protocol):
    """Protocol of a policy in the control loop."""

    @property
    def timing(self) -> Timing:
        """Return the policy's control step, longest command and arrival window."""
        ...

    def reset(self, joint_target: NDArray[np.floating] | None = None) -> None:
        """Start a new chase.

        Args:
            joint_target: last joint position target ``[J]`` (rad), for example of another controller; None for
                the default pose.
        """

    def __call__(self, state: RobotState, keyframe: Pose, steps_left: int) -> NDArray[np.floating]:
        """Compute joint position targets ``[J]`` (rad) for a keyframe that is due in some control steps."""


@dataclass(frozen=True)
class ChaseStep:
    """Record of a control step."""

    time: float
    """seconds since the start, at the end of the step"""
    command: Command
    """command of the step; ``steps_left`` at its beginning"""
    holding: bool
    """whether the last keyframe's arrival had passed and the command was to hold it"""
    before: RobotState
    """state that the controller received"""
    joint_target: NDArray[np.floating]
    """joint position targets ``[J]`` (rad)"""
    after: RobotState
    """state at the end of the step"""
    reference: Keyframe
    """the sequence at the end of the step, see :meth:`plat.keyframes.KeyframeSequence.sample`"""
    timing: Timing
    """of the policy"""
    root: Keyframe | None = None
    """where the root is to be at the end of the step, see :meth:`plat.keyframes.KeyframeSequence.on_the_way`"""
    ends: tuple[Keyframe, ...] = ()
    """poses that the command leads from and to, see :meth:`plat.keyframes.KeyframeSequence.ends`; none in the hold"""

    @property
    def in_window(self) -> bool:
        """Return whether the end of the step is in the arrival window: the last ``timing.window`` steps."""
        return self.command.steps_left <= self.timing.window and not self.holding


class Chase(Iterator[ChaseStep]):
    """Control loop of a robot that chases keyframes; each item is a completed control step.

    The robot begins at rest in the sequence's start. After the last arrival its command is the last keyframe by
    the next step, over and over, for ``hold`` seconds.

    ``controller`` and ``sequence`` may be replaced between steps: another policy takes over at what the motors were
    told last, and an edited sequence is obeyed from the present time on. The simulator may be pushed and changed.

    Args:
        controller: the policy.
        sequence: the keyframes.
        simulator: the robot.
        hold: seconds to stay in the last keyframe; ``math.inf`` never ends.

    Attributes:
        simulator: the robot.

    Raises:
        KeyframeError: for a command that is longer than the policy's timing allows, or that a policy for whole poses
            cannot follow.
        PlatError: when policy and simulator have different control steps, or one of them is none.

    >>> from plat.robots import G1
    >>> from plat.keyframes import standing
    >>> from plat.modules import LatentPolicy
    >>> from plat.control import PolicyController
    >>> controller = PolicyController(LatentPolicy(G1).deployed(), G1)
    >>> sequence = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),))
    >>> [step.command.steps_left for step in Chase(controller, sequence, Simulator(G1.model()), hold=0.04)]
    [5, 4, 3, 2, 1, 1, 1]
    """

    def __init__(self, controller: Controller, sequence: KeyframeSequence, simulator: Simulator, *, hold: float = 0.0):
        if not hasattr(simulator, "control_dt"):
            raise PlatError(f"chase: simulator is {short(simulator)}, expected a Simulator")
        _check_controller(controller)
        controller.timing.check_control_dt(simulator.control_dt, "simulator")
        check_value("chase: hold", hold, Annotated[float, Range(0, infinite=True)])
        self.simulator = simulator
        self._controller = controller
        self._sequence = _for_controller(sequence, controller)
        self._hold = hold
        self._began: tuple[int, Keyframe] | None = None
        self.restart()

    @property
    def controller(self) -> Controller:
        """Return the controller."""
        return self._controller

    @controller.setter
    def controller(self, controller: Controller) -> None:
        self.hand_over(controller, self._sequence)

    def hand_over(self, controller: Controller, sequence: KeyframeSequence) -> None:
        """Replace policy and keyframes together, or, on an error, neither.

        Raises:
            KeyframeError, PlatError: as for a new chase.
        """
        _check_controller(controller)
        controller.timing.check_control_dt(self.simulator.control_dt, "simulator")
        sequence = _for_controller(sequence, controller)
        controller.reset(self._joint_target)
        self._controller, self._sequence = controller, sequence
        self._began = None

    @property
    def sequence(self) -> KeyframeSequence:
        """Return the keyframes, at the timing of the policy."""
        return self._sequence

    @sequence.setter
    def sequence(self, sequence: KeyframeSequence) -> None:
        self._sequence = _for_controller(sequence, self._controller)
        self._began = None

    @property
    def time(self) -> float:
        """Return the seconds since the start."""
        return self._steps * self._controller.timing.control_dt

    def restart(self) -> None:
        """Reset the robot to the start, at time 0."""
        self._steps = 0
        self._joint_target: NDArray[np.floating] | None = None
        self._began = None
        self._controller.reset()
        _begin(self.simulator, self.sequence)

    def __next__(self) -> ChaseStep:
        command = self.sequence.command(self.time)
        holding = command is None
        if command is None:
            # a small margin, for times are multiples of the control step up to rounding
            arrival = self.sequence.arrival_steps[-1] * self.sequence.timing.control_dt
            if self.time + 1e-9 >= arrival + self._hold:
                raise StopIteration
            command = Command(len(self.sequence) - 1, self.sequence.keyframes[-1], steps_left=1, length=1)
        before = self.simulator.state()
        if self._began is None or self._began[0] != command.index:
            measured = replace(self.sequence.start, root_pos=before.root_pos_w, root_quat=before.root_quat_w)
            self._began = command.index, self.sequence.began(command.index, measured)
        self._joint_target = self._controller(before, command.keyframe, command.steps_left)
        self.simulator.step(self._joint_target)
        self._steps += 1
        after, reference = self.simulator.state(), self.sequence.sample(self.time)
        timing, root = self._controller.timing, self.sequence.on_the_way(*self._began, self.time)
        ends = () if holding else self.sequence.ends(command.index)
        return ChaseStep(self.time, command, holding, before, self._joint_target, after, reference, timing, root, ends)


def check_parts_are_seen(sequence: KeyframeSequence, controller: Controller, file: Path | None = None) -> None:
    """Raise an error for a partial keyframe that a controller would take for a whole one.

    Args:
        sequence: the keyframes.
        controller: that is to follow them.
        file: that they are of.

    Raises:
        KeyframeError: naming the file and the keyframe.
    """
    partial = sequence.partial
    if partial is not None and not getattr(controller, "sees_parts", True):
        where = "" if file is None else f"keyframe file {str(file)!r}: "
        raise KeyframeError(f"{where}{whole_only(partial)}")


def check_start(sequence: KeyframeSequence, simulator: Simulator, file: Path) -> None:
    """Raise an error for a start that no chase can begin with, such as one in the floor.

    Raises:
        KeyframeError: naming the file.
    """
    try:
        _begin(simulator, sequence)
    except StateError as error:
        raise KeyframeError(f"keyframe file {str(file)!r}: {error}") from None


def _begin(simulator: Simulator, sequence: KeyframeSequence) -> None:
    """Reset the robot to the start of a sequence; an error is about the start."""
    try:
        simulator.reset(sequence.start)
    except StateError as error:
        raise StateError(f"start: {str(error).removeprefix('pose: ')}") from None


def _check_controller(controller: Controller) -> None:
    """Raise an error for what is no controller; a policy is one within a PolicyController."""
    if not isinstance(getattr(controller, "timing", None), Timing) or not callable(getattr(controller, "reset", None)):
        raise PlatError(f"chase: controller is {short(controller)}, expected one such as a PolicyController")


def _for_controller(sequence: KeyframeSequence, controller: Controller) -> KeyframeSequence:
    """Return a sequence at the timing of a controller that can follow it."""
    check_sequence("chase: sequence", sequence)
    check_parts_are_seen(sequence, controller)
    return sequence.with_timing(controller.timing)
