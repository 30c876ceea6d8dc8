"""Robot description for running a policy: joints, motor gains, limits and kinematic tree."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plat.errors import RobotError

__all__ = ["Body", "Foot", "RobotDescription", "check_description"]


@dataclass(frozen=True)
class Body:
    """A link of the kinematic tree and the hinge that moves it.

    Args:
        name: of the link.
        parent: index of its parent in :attr:`RobotDescription.bodies`; -1 for the root.
        joint: index of its joint in every joint vector; -1 where it has none.
        axis: of the joint, in the link's frame, a unit vector. The joint passes through the link's origin.
        pos: the link's origin in its parent's frame (m).
        quat: the link's orientation in its parent's frame at joint angle 0, ``wxyz``.
    """

    name: str
    parent: int
    joint: int
    axis: tuple[float, float, float]
    pos: tuple[float, float, float]
    quat: tuple[float, float, float, float]


@dataclass(frozen=True)
class Foot:
    """A foot and the points of its sole.

    Args:
        body: name of the link, one of :attr:`RobotDescription.bodies`.
        soles: points that touch a level floor when the foot is flat, each ``(x, y, z)`` in the link's frame (m).
    """

    body: str
    soles: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class RobotDescription:
    """Description of a position-controlled humanoid as its policy knows it.

    Args:
        name: of the robot.
        joint_names: in the order of every joint vector (J of them).
        root_height: height of the root above the floor in the default pose (m).
        default_joint_pos: angles that an action of 0 asks for ``[J]`` (rad).
        joint_range: lower and upper joint limits ``[J, 2]`` (rad).
        stiffness: proportional gains kp ``[J]`` (N m/rad).
        damping: derivative gains kd ``[J]`` (N m s/rad).
        effort_limit: largest joint torque ``[J]`` (N m).
        action_scale: joint angle per unit of action ``[J]`` (rad).
        control_dt: seconds from one action to the next.
        keypoints: bodies whose positions a keyframe commands (K of them).
        bodies: the kinematic tree down to the keypoints, the root first and parents before children.
        feet: what the robot stands on; empty in bundles that do not say.
        mass: of the whole robot (kg); None in bundles that do not say.
    """

    name: str
    joint_names: tuple[str, ...]
    root_height: float
    default_joint_pos: NDArray[np.float64]
    joint_range: NDArray[np.float64]
    stiffness: NDArray[np.float64]
    damping: NDArray[np.float64]
    effort_limit: NDArray[np.float64]
    action_scale: NDArray[np.float64]
    control_dt: float
    keypoints: tuple[str, ...]
    bodies: tuple[Body, ...]
    feet: tuple[Foot, ...] = ()
    mass: float | None = None

    @property
    def default_qpos(self) -> NDArray[np.float64]:
        """Return the default pose at the origin ``[7 + J]``: root position, quaternion ``wxyz``, joint angles."""
        return np.concatenate(([0.0, 0.0, self.root_height, 1.0, 0.0, 0.0, 0.0], self.default_joint_pos))


def check_description(robot: object) -> None:
    """Raise where something else stands in a description's place, such as the robot of the training.

    Raises:
        RobotError: naming what it is.
    """
    if not hasattr(robot, "bodies"):
        raise RobotError(
            f"robot is a {type(robot).__name__}, expected a RobotDescription, as plat.robots.describe_robot() or a "
            "bundle has it"
        )
