"""Robots: their description, MJCF, motors and kinematics."""

from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import G1, FootContacts, Robot

__all__ = ["G1", "FootContacts", "ForwardKinematics", "Robot"]
