"""A policy that chases keyframes at the pace of a clock."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from plat.control import (
    Chase,
    ChaseStep,
    Controller,
    KeyframeScore,
    KeyframeScorer,
    PoseComparison,
    PoseErrors,
    Simulator,
)
from plat.keyframes import KeyframeSequence
from plat.robots.robot import Robot

__all__ = ["HOLD", "Player", "Summary", "score", "simulator"]

HOLD = 0.6
"""Seconds that a played robot stays in the last keyframe."""
# Steps that are made up for at once when the machine is too slow; beyond that, time is stretched.
_CATCH_UP = 5


class Player:
    """One robot and a chase that goes on as time passes.

    The keyframes and the policy may be exchanged while it plays; there are scores only of a chase that had neither
    exchanged.

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
        """Back to the start."""
        self._chase.restart()
        self._scorer = KeyframeScorer(self._robot)
        self._changed = False
        self._ahead = 0.0
        self.finished = False
        """Whether the last keyframe's arrival and :data:`HOLD` are over."""
        self.step: ChaseStep | None = None
        """The last step that was taken."""
        self.times: list[float] = []
        """Seconds since the start, for each step that was taken."""
        self.errors: list[PoseErrors] = []
        """For each step, how far the robot was from the keyframe that it was commanded to."""

    @property
    def qpos(self) -> np.ndarray:
        """The robot ``[7 + J]``."""
        return self._chase.simulator.data.qpos.copy()

    @property
    def sequence(self) -> KeyframeSequence:
        """The keyframes; others are obeyed from the present time on."""
        return self._chase.sequence

    @sequence.setter
    def sequence(self, sequence: KeyframeSequence) -> None:
        self._chase.sequence = sequence
        self._changed = True

    def hand_over(self, controller: Controller) -> None:
        """Another policy goes on from here."""
        self._chase.controller = controller
        self._changed = True

    def advance(self, seconds: float) -> None:
        """Let time pass: take the control steps that are due."""
        self._ahead += seconds
        control_dt = self._chase.controller.timing.control_dt
        due = int(self._ahead / control_dt + 1e-9)  # the margin is for rounding
        self._ahead = self._ahead - due * control_dt if due <= _CATCH_UP else 0.0
        for _ in range(min(due, _CATCH_UP)):
            if not self.finished:
                self._take_step()

    def _take_step(self) -> None:
        step = next(self._chase, None)
        if step is None:
            self.finished = True
            return
        self._scorer.add(step)
        self.step = step
        self.times.append(step.time)
        self.errors.append(self._compare(step.after, step.command.keyframe))

    @property
    def scores(self) -> list[KeyframeScore] | None:
        """Of the keyframes whose arrival has come; None when policy or keyframes were exchanged on the way."""
        return None if self._changed else self._scorer.scores()


def simulator(robot: Robot, controller: Controller) -> Simulator:
    """Return a simulated robot at the control step of a policy."""
    return Simulator(robot.shared_model, controller.timing.control_dt)


def score(robot: Robot, controller: Controller, sequence: KeyframeSequence) -> list[KeyframeScore]:
    """Scores of a chase at full speed: the same as those of a :class:`Player`."""
    scorer = KeyframeScorer(robot)
    for step in Chase(controller, sequence, simulator(robot, controller)):
        scorer.add(step)
    return scorer.scores()


@dataclass(frozen=True)
class Summary:
    """Scores of a sequence in one line.

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
        """Of at least one keyframe."""
        scores = list(scores)
        return cls(
            sum(score.reached for score in scores),
            len(scores),
            float(np.mean([score.joint_error for score in scores])),
            float(np.mean([score.keypoint_error for score in scores])),
        )
