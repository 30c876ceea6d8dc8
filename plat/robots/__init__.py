"""Robots: their description, MJCF, motors, kinematics and names."""

from plat.robots.describe import describe_robot
from plat.robots.g1 import G1
from plat.robots.kinematics import ForwardKinematics
from plat.robots.mjcf import Capsule
from plat.robots.registry import get_robot, register_robot
from plat.robots.robot import FootContacts, Robot, without_side

__all__ = [
    "G1",
    "Capsule",
    "FootContacts",
    "ForwardKinematics",
    "Robot",
    "describe_robot",
    "get_robot",
    "register_robot",
    "without_side",
]
