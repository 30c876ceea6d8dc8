"""Center of mass of a robot in torch: batched and differentiable."""

import mujoco
import torch
from torch import Tensor

from plat.errors import RobotError
from plat.gpu import constant
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_rotate

__all__ = ["CenterOfMass", "link_names"]


def link_names(model: mujoco.MjModel, robot: Robot) -> tuple[str, ...]:
    """Return the names of all links of a robot, the root first.

    Raises:
        RobotError: for a link without a name, or a body that is no part of the robot.

    >>> from plat.robots import G1
    >>> link_names(G1.shared_model, G1)[:2]
    ('pelvis', 'left_hip_pitch_link')
    """
    names = tuple(model.body(number).name for number in range(1, model.nbody))
    for number, name in enumerate(names, 1):
        if not name:
            raise RobotError(f"robot {robot.name!r}: body {number} of {robot.asset} has no name, expected one")
        if model.body_rootid[number] != 1:
            raise RobotError(f"robot {robot.name!r}: {robot.asset} holds {name!r} too, expected the robot alone")
    return names


class CenterOfMass:
    """Center of mass of poses, and the places of all links that it is computed from.

    Args:
        robot: the robot.

    >>> from plat.robots import G1
    >>> root_pos_w, root_quat_w, joint_pos = torch.as_tensor(G1.default_qpos).split((3, 4, 29))
    >>> com_w, _, _ = CenterOfMass(G1)(root_pos_w, root_quat_w, joint_pos)
    >>> round(float(com_w[2]), 2)
    0.67
    """

    def __init__(self, robot: Robot):
        model = robot.model()
        self.bodies = link_names(model, robot)
        """Names of all links, the root first."""
        self._kinematics = ForwardKinematics(robot, self.bodies)
        self._mass = torch.from_numpy(model.body_mass[1:])
        self._local_com = torch.from_numpy(model.body_ipos[1:])

    def __call__(self, root_pos_w: Tensor, root_quat_w: Tensor, joint_pos: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Compute the center of mass, and where the links are.

        Args:
            root_pos_w: ``[*B, 3]`` (m, world).
            root_quat_w: ``[*B, 4]``, root to world.
            joint_pos: ``[*B, J]`` (rad).

        Returns:
            Center of mass ``[*B, 3]`` (m, world), positions ``[*B, L, 3]`` (m, world) and orientations ``[*B, L, 4]``
            (link to world) of :attr:`bodies`.
        """
        pos_w, quat_w = self._kinematics(root_pos_w, root_quat_w, joint_pos)
        mass, local_com = constant(self._mass, pos_w), constant(self._local_com, pos_w)
        com_w = (mass[:, None] * (pos_w + quat_rotate(quat_w, local_com.expand_as(pos_w)))).sum(-2) / mass.sum()
        return com_w, pos_w, quat_w
