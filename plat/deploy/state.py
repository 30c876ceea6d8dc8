"""Measured robot state, and the pose interface of a keyframe."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from plat.errors import StateError
from plat.json_file import short
from plat.rotations_np import UNIT_TOLERANCE

__all__ = ["Array", "Pose", "RobotState", "finite_vector", "root_of", "state_widths", "unit_quaternion"]

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


def finite_vector(what: str, values: Any, size: int) -> NDArray[np.float64]:
    """Return a copy of so many finite numbers.

    Raises:
        StateError: beginning with ``what``, for anything else.
    """
    try:
        numbers = np.array(values, dtype=np.float64)
    except (OverflowError, RuntimeError, TypeError, ValueError):
        raise StateError(f"{what} is {short(values)}, expected {size} numbers") from None
    if numbers.shape != (size,):
        raise StateError(f"{what} has shape {numbers.shape}, expected ({size},)")
    if (wrong := np.flatnonzero(~np.isfinite(numbers))).size:
        raise StateError(f"{what}[{wrong[0]}] is {numbers[wrong[0]]}, expected a finite number")
    return numbers


def unit_quaternion(what: str, values: Any) -> NDArray[np.float64]:
    """Return a copy of a unit quaternion ``[4]``.

    Raises:
        StateError: beginning with ``what``, for anything else.
    """
    quat = finite_vector(what, values, 4)
    length = float(np.linalg.norm(quat))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise StateError(f"{what} has length {length:.6g}, expected a unit quaternion wxyz")
    return quat


def root_of(what: str, pose: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the root's position ``[3]`` and orientation ``[4]`` of a :class:`Pose`.

    Raises:
        StateError: beginning with ``what``, for what is no pose.
    """
    if not hasattr(pose, "root_pos"):
        raise StateError(f"{what} is {short(pose)}, expected a pose, such as the start of a keyframe sequence")
    position = finite_vector(f"{what}: root_pos", pose.root_pos, 3)
    return position, unit_quaternion(f"{what}: root_quat", getattr(pose, "root_quat", None))
