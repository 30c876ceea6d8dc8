"""Scores of one robot's keyframes. The twin of :mod:`plat.evaluation.records`, which scores batches."""

from dataclasses import dataclass

import numpy as np

from plat.control.chase import ChaseStep
from plat.control.pose_errors import PoseComparison, PoseErrors
from plat.envs.transforms import TerminationLimits
from plat.robots.robot import Robot

__all__ = ["KeyframeScore", "KeyframeScorer", "StepErrors"]


@dataclass(frozen=True)
class KeyframeScore:
    """Score of a keyframe.

    Args:
        index: its number in the sequence.
        name: its name.
        time: of its arrival (s).
        reached: whether the robot had not fallen before the arrival window and was in the pose throughout it.
        fell: whether the root was at the wrong height or tilt at some step of the command.
        joint_error: mean absolute joint error over the arrival window (rad): MPJPE@3.
        keypoint_error: mean error of the keypoints in the world over the arrival window (m): MPKPE@3.
    """

    index: int
    name: str | None
    time: float
    reached: bool
    fell: bool
    joint_error: float
    keypoint_error: float


@dataclass(frozen=True)
class StepErrors(PoseErrors):
    """Distance of the robot from the sequence at the end of a control step."""

    failed: bool
    """whether this step alone fails the command: off the pose in the arrival window, fallen before it"""


class KeyframeScorer:
    """Scorer of every command of a chase, by the rules of :func:`plat.evaluation.evaluate` but without resets.

    A command's arrival window is its last three control steps. The robot is compared with the sequence at the same time
    (:meth:`plat.keyframes.KeyframeSequence.sample`), which is the keyframe at the arrival.

    Args:
        robot: the robot.
        limits: what counts as too far, and as fallen.
    """

    def __init__(self, robot: Robot, limits: TerminationLimits | None = None):
        self._compare = PoseComparison(robot, limits)
        self._steps: dict[int, list[tuple[ChaseStep, StepErrors]]] = {}

    def add(self, step: ChaseStep) -> StepErrors:
        """Add a step; return the robot's distance from the sequence at its end."""
        errors = self._compare(step.after, step.reference)
        failed = errors.off_pose if step.in_window else errors.fallen
        scored = StepErrors(errors.joint, errors.keypoint, errors.off_pose, errors.fallen, failed)
        if not step.holding:
            self._steps.setdefault(step.command.index, []).append((step, scored))
        return scored

    def scores(self) -> list[KeyframeScore]:
        """Return the scores of the keyframes that have arrived."""
        return [self._score(steps) for _, steps in sorted(self._steps.items()) if steps[-1][0].command.steps_left == 1]

    def _score(self, steps: list[tuple[ChaseStep, StepErrors]]) -> KeyframeScore:
        window = [errors for step, errors in steps if step.in_window]
        command = steps[-1][0].command
        return KeyframeScore(
            command.index,
            command.keyframe.name,
            command.keyframe.time,
            reached=not any(errors.failed for _, errors in steps),
            fell=any(errors.fallen for _, errors in steps),
            joint_error=float(np.mean([errors.joint for errors in window])),
            keypoint_error=float(np.mean([errors.keypoint for errors in window])),
        )
