"""Forward kinematics in numpy, for programs without torch; the twin of :mod:`plat.robots.kinematics`."""

import numpy as np
from numpy.typing import NDArray

from plat.deploy.description import RobotDescription, check_description
from plat.deploy.state import Array
from plat.errors import StateError
from plat.rotations_np import quat_to_matrix

__all__ = ["KeypointKinematics"]


class KeypointKinematics:
    """Forward kinematics of a robot's keypoints: world positions from root pose and joint angles.

    Args:
        robot: its kinematic tree and keypoints.

    Raises:
        RobotError: for what is no description.

    >>> from plat.robots import G1
    >>> from plat.robots import describe_robot
    >>> kinematics = KeypointKinematics(describe_robot(G1, control_dt=0.02))
    >>> kinematics(np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(29)).shape
    (14, 3)
    """

    def __init__(self, robot: RobotDescription):
        check_description(robot)
        count = len(robot.bodies)
        # A link's frame in its parent's is rest @ turn(axis, angle). By Rodrigues' formula that is
        # rest + sin(angle) * sine + (1 - cos(angle)) * cosine with three fixed matrices.
        self._rest, self._sine, self._cosine = (np.zeros((count, 4, 4)) for _ in range(3))
        for index, body in enumerate(robot.bodies):
            self._rest[index] = np.eye(4)
            if body.parent < 0:
                continue  # the root's pose is given
            rest = quat_to_matrix(np.array(body.quat))
            x, y, z = body.axis
            cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
            self._rest[index, :3, :3] = rest
            self._rest[index, :3, 3] = body.pos
            self._sine[index, :3, :3] = rest @ cross
            self._cosine[index, :3, :3] = rest @ cross @ cross
        # a link without a joint looks up the angle 0 behind the last joint
        joints = len(robot.joint_names)
        self._angles = np.zeros(joints + 1)
        self._joint = np.array([body.joint if body.joint >= 0 else joints for body in robot.bodies])
        self._world = np.empty((count, 4, 4))
        self._world[0] = np.eye(4)
        self._chain = [(body.parent, index) for index, body in enumerate(robot.bodies) if body.parent >= 0]
        names = [body.name for body in robot.bodies]
        self._wanted = np.array([names.index(name) for name in robot.keypoints])

    def __call__(self, root_pos_w: Array, root_quat_w: Array, joint_pos: Array) -> NDArray[np.float64]:
        """Compute positions ``[K, 3]`` (m, world) from a root pose ``[3]``, ``[4]`` (``wxyz``) and angles ``[J]``
        (rad).

        Raises:
            StateError: for another number of angles.
        """
        if np.shape(joint_pos) != self._angles[1:].shape:
            raise StateError(f"joint_pos has shape {np.shape(joint_pos)}, expected {self._angles[1:].shape}")
        self._angles[:-1] = joint_pos
        angle = self._angles[self._joint][:, None, None]
        local = self._rest + np.sin(angle) * self._sine + (1.0 - np.cos(angle)) * self._cosine
        world = self._world
        world[0, :3, :3] = quat_to_matrix(root_quat_w)
        world[0, :3, 3] = root_pos_w
        for parent, index in self._chain:
            np.matmul(world[parent], local[index], out=world[index])
        return world[self._wanted, :3, 3]
