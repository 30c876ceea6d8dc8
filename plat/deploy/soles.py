"""Kinematics of the soles: where their points are, and how joints move them."""

import numpy as np
from numpy.typing import NDArray

from plat.deploy.description import RobotDescription, check_description
from plat.deploy.state import Array
from plat.errors import RobotError
from plat.rotations_np import quat_to_matrix

__all__ = ["SoleKinematics"]

_Floats = NDArray[np.float64]


class SoleKinematics:
    """Kinematics of the points of the soles in the root's frame: positions and Jacobians.

    Args:
        robot: with its feet.

    Raises:
        RobotError: for a description without feet, and for what is none.

    >>> from plat.robots import G1, describe_robot
    >>> soles = SoleKinematics(describe_robot(G1, control_dt=0.02))
    >>> points_b, jacobian_b = soles(np.zeros(29))
    >>> points_b.shape, jacobian_b.shape, soles.foot.tolist()
    ((8, 3), (8, 3, 29), [0, 0, 0, 0, 1, 1, 1, 1])
    """

    def __init__(self, robot: RobotDescription):
        check_description(robot)
        if not robot.feet:
            raise RobotError(
                f"robot {robot.name!r}: its description has no feet: export the bundle again, with contact geoms of "
                "feet that are spheres, capsules, cylinders, boxes or meshes"
            )
        self._joints = len(robot.joint_names)
        index = {body.name: number for number, body in enumerate(robot.bodies)}
        # for each foot, the links from the root's child down to it: joint, position, rotation at angle 0
        self._chains: list[list[tuple[int, _Floats, _Floats]]] = []
        self._axes: list[_Floats] = []
        self.legs: list[list[int]] = []
        """Joints that move each foot, the nearest to the root first."""
        for foot in robot.feet:
            chain = []
            link = index[foot.body]
            while robot.bodies[link].parent >= 0:
                chain.append(body := robot.bodies[link])
                link = body.parent
            chain.reverse()
            self._chains.append([(body.joint, np.array(body.pos), quat_to_matrix(body.quat)) for body in chain])
            hinges = [body for body in chain if body.joint >= 0]
            self._axes.append(np.array([body.axis for body in hinges]).reshape(-1, 3))
            self.legs.append([body.joint for body in hinges])
        self._soles = [np.array(foot.soles, dtype=np.float64) for foot in robot.feet]
        self.foot = np.repeat(np.arange(len(robot.feet)), [len(sole) for sole in self._soles])
        """Number of the foot of every point ``[P]``."""

    def __call__(self, joint_pos: Array) -> tuple[_Floats, _Floats]:
        """Return positions ``[P, 3]`` (m, root frame) and Jacobians ``[P, 3, J]`` (m/rad, root frame).

        Args:
            joint_pos: joint angles ``[J]`` (rad).
        """
        positions, jacobians = [], []
        for chain, axes, leg, sole in zip(self._chains, self._axes, self.legs, self._soles, strict=True):
            turns = iter(_turns(axes, np.asarray(joint_pos, dtype=np.float64)[leg]))
            rotation, origin = np.eye(3), np.zeros(3)
            pivots, frames = [], []
            for joint, pos, rest in chain:
                origin = origin + rotation @ pos
                rotation = rotation @ rest
                if joint >= 0:
                    pivots.append(origin)
                    frames.append(rotation)
                    rotation = rotation @ next(turns)
            points = origin + sole @ rotation.T
            jacobian = np.zeros((len(sole), 3, self._joints))
            if leg:
                hinges = np.einsum("hij,hj->hi", np.array(frames), axes)
                moved = np.cross(hinges, points[:, None] - np.array(pivots))  # (points, hinges, 3)
                jacobian[:, :, leg] = np.swapaxes(moved, 1, 2)
            positions.append(points)
            jacobians.append(jacobian)
        return np.concatenate(positions), np.concatenate(jacobians)


def _turns(axes: _Floats, angles: _Floats) -> _Floats:
    """Return rotation matrices ``[H, 3, 3]`` about unit axes ``[H, 3]``, by Rodrigues' formula."""
    cross = np.zeros((len(axes), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axes[:, 2], axes[:, 1], -axes[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    angle = angles[:, None, None]
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
