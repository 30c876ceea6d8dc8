"""Robots: their description, MJCF, motors, kinematics and names."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.robots.contacts import FootContacts
    from plat.robots.describe import describe_robot
    from plat.robots.g1 import G1
    from plat.robots.kinematics import ForwardKinematics
    from plat.robots.mjcf import Capsule
    from plat.robots.registry import get_robot, register_robot
    from plat.robots.robot import Robot, without_side
    from plat.robots.symmetry import joint_symmetry, keypoint_symmetry
else:
    lazy(__name__)

__all__ = [
    "G1",
    "Capsule",
    "FootContacts",
    "ForwardKinematics",
    "Robot",
    "describe_robot",
    "get_robot",
    "joint_symmetry",
    "keypoint_symmetry",
    "register_robot",
    "without_side",
]
