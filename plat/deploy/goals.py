"""Goal entries in numpy, for a robot's onboard computer; ``plat.envs.goals`` is the same in torch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.deploy.state import RobotState

__all__ = ["GOAL_ENTRIES", "GoalArrays"]


@dataclass(frozen=True)
class GoalArrays:
    """Arrays from which the entries of a goal are computed.

    Args:
        state: of the robot.
        target_joint_pos: joint angles of the target ``[J]`` (rad).
        target_to_world: rotation matrix of the target's root ``[3, 3]``.
        root_to_world: rotation matrix of the robot's root ``[3, 3]``.
        keypoint_pos_b: from the robot's root to the target's keypoints ``[K, 3]`` (m, root frame), the root first.
        root_to_target_w: from the robot's root to the target's ``[3]`` (m, world).
        parts: mask ``[J + K + 3]`` of what is commanded; None for a whole pose.
    """

    state: RobotState
    target_joint_pos: NDArray[np.float64]
    target_to_world: NDArray[np.float64]
    root_to_world: NDArray[np.float64]
    keypoint_pos_b: NDArray[np.float64]
    root_to_target_w: NDArray[np.float64]
    parts: NDArray[np.float64] | None = None


def _joint_pos(view: GoalArrays) -> NDArray[np.floating]:
    return view.target_joint_pos if view.parts is None else view.target_joint_pos * view.parts[: _joints(view)]


def _root_pos_b(view: GoalArrays) -> NDArray[np.floating]:
    if view.parts is None:
        return view.keypoint_pos_b[0]
    # height and horizontal position are apart in the world, not in a tilted root frame
    horizontal, height = view.parts[-3:-1]
    return (view.root_to_target_w * (horizontal, horizontal, height)) @ view.root_to_world


def _root_rot6d_b(view: GoalArrays) -> NDArray[np.floating]:
    sixd = (view.root_to_world.T @ view.target_to_world)[:, :2].T.ravel()
    return sixd if view.parts is None else sixd * view.parts[-1]


def _keypoint_pos_b(view: GoalArrays) -> NDArray[np.floating]:
    points = view.keypoint_pos_b
    return points.ravel() if view.parts is None else (points * view.parts[_joints(view) : -3, None]).ravel()


def _joints(view: GoalArrays) -> int:
    return len(view.target_joint_pos)


GOAL_ENTRIES: dict[str, Callable[[GoalArrays], NDArray[np.floating]]] = {
    "joint_pos": _joint_pos,
    "root_pos_b": _root_pos_b,
    "root_rot6d_b": _root_rot6d_b,
    "keypoint_pos_b": _keypoint_pos_b,
}
"""How each entry of a goal is computed, by name, in the unit and frame that ``plat.spec.observation`` says."""
