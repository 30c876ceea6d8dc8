"""Trajectory of a robot and its keyframes, for pictures and videos."""

from dataclasses import dataclass

import numpy as np

__all__ = ["Playback"]


@dataclass(frozen=True)
class Playback:
    """T control steps of one robot.

    Attributes:
        qpos: the robot ``[T, 7 + J]``.
        target_qpos: the commanded keyframe ``[T, 7 + J]``.
        steps_left: control steps to its arrival ``[T]``.
        command_length: control steps of the command in all ``[T]``.
        failed: whether the command was failed at this step ``[T]``.
        reached_qpos: the robot at the end of the step ``[T, 7 + J]``.
        dt: seconds a step.
        words: line of text at each step ``[T]``; empty for none.
    """

    qpos: np.ndarray
    target_qpos: np.ndarray
    steps_left: np.ndarray
    command_length: np.ndarray
    failed: np.ndarray
    reached_qpos: np.ndarray
    dt: float
    words: tuple[str, ...] = ()
