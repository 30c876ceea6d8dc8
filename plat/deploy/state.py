"""Measured robot state, and the pose interface of a keyframe."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Pose", "RobotState", "state_widths"]

Array = NDArray[np.floating]


@dataclass
class RobotState:
    """Measured state of a robot at one moment. Joints are in the order of ``RobotDescription.joint_names``."""

    joint_pos: Array
    """joint angles ``[J]`` (rad)"""
    joint_vel: Array
    """joint velocities ``[J]`` (rad/s)"""
    root_pos_w: Array
    """position of the root body's origin ``[3]`` (m, world)"""
    root_quat_w: Array
    """orientation of the root body ``[4]``: unit quaternion ``wxyz``, root to world"""
    root_lin_vel_b: Array
    """velocity of the root body's origin ``[3]`` (m/s, root frame)"""
    root_ang_vel_b: Array
    """angular velocity of the root ``[3]`` (rad/s, root frame), as a gyroscope at the root measures it"""

    @property
    def qpos(self) -> Array:
        """Return the MuJoCo position vector ``[7 + J]``: root position and quaternion, joint angles."""
        return np.concatenate((self.root_pos_w, self.root_quat_w, self.joint_pos))


def state_widths(joints: int) -> dict[str, int]:
    """Return how many numbers each field of a :class:`RobotState` with so many joints has."""
    vectors = {"root_pos_w": 3, "root_quat_w": 4, "root_lin_vel_b": 3, "root_ang_vel_b": 3}
    return {"joint_pos": joints, "joint_vel": joints, **vectors}


class Pose(Protocol):
    """Protocol of a pose in the world; :class:`plat.keyframes.Keyframe` is one.

    A pose may have an attribute ``commands``, the :class:`plat.spec.parts.Parts` that it commands; without one, or
    with None, it commands everything.
    """

    @property
    def root_pos(self) -> Array:
        """Return the position of the root body's origin ``[3]`` (m, world)."""

    @property
    def root_quat(self) -> Array:
        """Return the orientation of the root body ``[4]``: unit quaternion ``wxyz``, root to world."""

    @property
    def joint_pos(self) -> Array:
        """Return the joint angles ``[J]`` (rad)."""
