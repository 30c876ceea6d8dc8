"""Real-time playback of a policy that chases keyframes."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from plat.control import (
    HOLD,
    Chase,
    ChaseStep,
    Controller,
    KeyframeScore,
    KeyframeScorer,
    PoseComparison,
    PoseErrors,
    Simulator,
    StepErrors,
    mean_errors,
)
from plat.keyframes import KeyframeSequence
from plat.keyframes.roots import with_commanded_root
from plat.robots.robot import Robot

__all__ = ["Player", "Summary", "chased", "score"]

# Most control steps to catch up on at once on a slow machine; beyond that, playback slows down.
_CATCH_UP = 5


class Player:
    """Real-time playback: one robot and a chase that advances with time.

    Keyframes and policy may be exchanged while it plays. Scores exist only for a chase without an exchange.

    Args:
        robot: the robot.
        controller: a policy.
        sequence: the keyframes.
    """

    def __init__(self, robot: Robot, controller: Controller, sequence: KeyframeSequence):
        self._robot = robot
        self._compare = PoseComparison(robot)
        self._chase = Chase(controller, sequence, simulator(robot, controller), hold=HOLD)
        self.restart()

    def restart(self) -> None:
        """Go back to the start."""
        self._chase.restart()
        self._scorer = KeyframeScorer(self._robot)
        self._followed = self._scorer.follow(self._chase)
        self._changed = False
        self._ahead = 0.0
        self.finished = False
        """Whether the last keyframe's arrival and :data:`plat.control.HOLD` are over, or the simulation ended early."""
        self.step: ChaseStep | None = None
        """The last step that was taken."""
        self.times: list[float] = []
        """Seconds since the start, for each step that was taken."""
        self.errors: list[PoseErrors] = []
        """For each step, how far the robot was from what was commanded of its keyframe."""
        self.steps: list[ChaseStep] = []
        """All steps that were taken, to look at them again."""
        self._poses = [self.qpos]

    @property
    def ended(self) -> str:
        """Return when and why the simulation ended early; empty where it did not."""
        return self._scorer.ended

    @property
    def time(self) -> float:
        """Return the seconds since the start."""
        return self._chase.time

    def pose_at(self, time: float) -> np.ndarray:
        """Return the robot's pose ``[7 + J]`` at a time that was played (s), to a control step."""
        return self._poses[min(max(self._number(time), 0), len(self._poses) - 1)]

    def step_at(self, time: float) -> ChaseStep | None:
        """Return the step that ended at a time that was played (s); None at the start."""
        number = min(self._number(time), len(self.steps))
        return self.steps[number - 1] if number > 0 else None

    def _number(self, time: float) -> int:
        return self._chase.controller.timing.steps(time)

    @property
    def qpos(self) -> np.ndarray:
        """Return the robot's pose ``[7 + J]``."""
        return self._chase.simulator.data.qpos.copy()

    @property
    def sequence(self) -> KeyframeSequence:
        """Return the keyframes; replaced ones apply from the present time on."""
        return self._chase.sequence

    @sequence.setter
    def sequence(self, sequence: KeyframeSequence) -> None:
        self._chase.sequence = sequence
        self._changed = True

    def hand_over(self, controller: Controller, sequence: KeyframeSequence) -> None:
        """Continue with another policy, and with the keyframes as it is given them; on an error, as before.

        Raises:
            KeyframeError: for a partial keyframe and a policy that knows whole poses only.
        """
        self._chase.hand_over(controller, sequence)
        self._changed = True

    def advance(self, seconds: float) -> None:
        """Advance in time: take the control steps that are due."""
        self._ahead += seconds
        control_dt = self._chase.controller.timing.control_dt
        due = int(self._ahead / control_dt + 1e-9)  # the margin is for rounding
        self._ahead = self._ahead - due * control_dt if due <= _CATCH_UP else 0.0
        for _ in range(min(due, _CATCH_UP)):
            self.take_step()

    def take_step(self) -> None:
        """Take one control step, unless all is over."""
        if self.finished:
            return
        taken = next(self._followed, None)
        if taken is None:
            self.finished = True
            return
        step, _ = taken
        self.step = step
        self.steps.append(step)
        self._poses.append(self.qpos)
        self.times.append(step.time)
        keyframe = step.command.keyframe
        root = step.root and with_commanded_root(step.root, keyframe)
        self.errors.append(self._compare(step.after, keyframe, keyframe.commands, root))

    @property
    def scores(self) -> list[KeyframeScore] | None:
        """Return the scores of the keyframes that have arrived, or never will; None when anything was exchanged."""
        return None if self._changed else self._scorer.scores()


def simulator(robot: Robot, controller: Controller) -> Simulator:
    """Return a simulated robot at the control step of a policy, with the physics that it was trained with."""
    return Simulator.of(robot, controller.timing.control_dt)


def chased(
    robot: Robot, controller: Controller, sequence: KeyframeSequence
) -> tuple[list[tuple[ChaseStep, StepErrors]], KeyframeScorer]:
    """Return the steps of a chase and its hold at full speed, and their scorer."""
    chase, scorer = Chase(controller, sequence, simulator(robot, controller), hold=HOLD), KeyframeScorer(robot)
    return list(scorer.follow(chase)), scorer


def score(robot: Robot, controller: Controller, sequence: KeyframeSequence) -> tuple[list[KeyframeScore], str]:
    """Compute the scores of a chase at full speed, equal to those of a :class:`Player`, and when and why it ended."""
    _, scorer = chased(robot, controller, sequence)
    return scorer.scores(), scorer.ended


@dataclass(frozen=True)
class Summary:
    """Summary of a sequence's scores in one line.

    Args:
        reached: keyframes that were reached.
        total: keyframes in all.
        joint_error: mean of all keyframes (rad).
        keypoint_error: mean of all keyframes (m).
    """

    reached: int
    total: int
    joint_error: float
    keypoint_error: float

    @classmethod
    def of(cls, scores: Iterable[KeyframeScore]) -> "Summary":
        """Summarize scores of at least one keyframe."""
        scores = list(scores)
        return cls(
            sum(score.reached for score in scores),
            len(scores),
            *mean_errors(scores),
        )
