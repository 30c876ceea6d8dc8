"""Goal entries in numpy, for a robot's onboard computer; ``plat.envs.goals`` is the same in torch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.deploy.state import RobotState

__all__ = ["GOAL_ENTRIES", "GoalView"]


@dataclass(frozen=True)
class GoalView:
    """Inputs from which the entries of a goal are computed.

    Args:
        state: of the robot.
        target_joint_pos: joint angles of the target ``[J]`` (rad).
        target_to_world: rotation matrix of the target's root ``[3, 3]``.
        root_to_world: rotation matrix of the robot's root ``[3, 3]``.
        keypoint_pos_b: from the robot's root to the target's keypoints ``[K, 3]`` (m, root frame), the root first.
    """

    state: RobotState
    target_joint_pos: NDArray[np.float64]
    target_to_world: NDArray[np.float64]
    root_to_world: NDArray[np.float64]
    keypoint_pos_b: NDArray[np.float64]


GOAL_ENTRIES: dict[str, Callable[[GoalView], NDArray[np.floating]]] = {
    "joint_pos": lambda view: view.target_joint_pos,
    "root_pos_b": lambda view: view.keypoint_pos_b[0],
    "root_rot6d_b": lambda view: (view.root_to_world.T @ view.target_to_world)[:, :2].T.ravel(),
    "keypoint_pos_b": lambda view: view.keypoint_pos_b.ravel(),
}
"""How each entry of a goal is computed, by name, in the unit and frame that ``plat.spec.observation`` says."""
