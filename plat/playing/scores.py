"""Which keyframes were reached, and how well."""

from dataclasses import dataclass

import numpy as np

from plat.envs.robot import Robot
from plat.envs.transforms import WINDOW, TerminationLimits
from plat.playing.chase import ChaseStep
from plat.playing.errors import PoseComparison, PoseErrors

__all__ = ["KeyframeScore", "KeyframeScorer"]


@dataclass(frozen=True)
class KeyframeScore:
    """How a keyframe went.

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


class KeyframeScorer:
    """Scores every command of a chase by the rules of :func:`plat.evaluation.evaluate`, but never puts the robot back.

    A command's arrival window is its last three control steps. There the robot is compared with the sequence at the
    same time (:meth:`plat.keyframes.KeyframeSequence.sample`), which is the keyframe at the arrival.

    Args:
        robot: the robot.
        limits: what counts as too far, and as fallen.
    """

    def __init__(self, robot: Robot, limits: TerminationLimits | None = None):
        self._compare = PoseComparison(robot, limits)
        self._steps: dict[int, list[tuple[ChaseStep, PoseErrors]]] = {}

    def add(self, step: ChaseStep) -> PoseErrors:
        """Take a step in; returns how far the robot is from the sequence at the end of it."""
        errors = self._compare(step.after, step.reference)
        if not step.holding:
            self._steps.setdefault(step.command.index, []).append((step, errors))
        return errors

    def scores(self) -> list[KeyframeScore]:
        """Scores of the keyframes whose arrival has come."""
        return [self._score(steps) for _, steps in sorted(self._steps.items()) if steps[-1][0].command.steps_left == 1]

    def _score(self, steps: list[tuple[ChaseStep, PoseErrors]]) -> KeyframeScore:
        window = [errors for step, errors in steps if step.command.steps_left <= WINDOW]
        before = [errors for step, errors in steps if step.command.steps_left > WINDOW]
        command = steps[-1][0].command
        return KeyframeScore(
            command.index,
            command.keyframe.name,
            command.keyframe.time,
            reached=not any(errors.fallen for errors in before) and not any(errors.off_pose for errors in window),
            fell=any(errors.fallen for _, errors in steps),
            joint_error=float(np.mean([errors.joint for errors in window])),
            keypoint_error=float(np.mean([errors.keypoint for errors in window])),
        )
