"""Forward kinematics in torch: batched, differentiable, on any device. Its numpy twin is ``plat.deploy.kinematics``."""

import mujoco
import torch
from torch import Tensor

from plat.errors import RobotError
from plat.robots.robot import Robot
from plat.rotations import quat_multiply, quat_rotate

__all__ = ["ForwardKinematics"]


class ForwardKinematics:
    """Forward kinematics: world poses of a robot's bodies from its root pose and joint angles.

    Args:
        robot: the robot.
        bodies: names of the bodies to compute; by default the robot's keypoints.

    Raises:
        RobotError: when a joint does not pass through the origin of its body, which this code relies on.

    >>> from plat.robots import G1
    >>> kinematics = ForwardKinematics(G1)
    >>> root_quat_w = torch.tensor([1.0, 0, 0, 0])
    >>> pos_w, quat_w = kinematics(torch.zeros(3), root_quat_w, G1.default_joint_pos)
    >>> pos_w.shape, quat_w.shape
    (torch.Size([14, 3]), torch.Size([14, 4]))
    """

    def __init__(self, robot: Robot, bodies: tuple[str, ...] | None = None):
        model = robot.shared_model
        if abs(model.jnt_pos[1:]).max() > 0:
            raise RobotError(f"robot {robot.name!r}: a joint is off its body's origin; set its pos to 0 0 0")
        names = robot.keypoints if bodies is None else bodies
        self._wanted = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in names]
        needed: set[int] = set()
        for body in self._wanted:
            while body > 1 and body not in needed:
                needed.add(body)
                body = int(model.body_parentid[body])
        # MuJoCo numbers parents before children; body 1 is the root; joint 0 is the free joint
        self.chain = [
            (body, int(model.body_parentid[body]), max(int(model.body_jntadr[body]) - 1, -1)) for body in sorted(needed)
        ]
        """Bodies between the root and the wanted ones: MuJoCo's ids of body and parent, and the joint's index or -1."""
        self._body_pos = torch.from_numpy(model.body_pos).float()
        self._body_quat = torch.from_numpy(model.body_quat).float()
        self._axis = torch.from_numpy(model.jnt_axis[1:]).float()

    def __call__(self, root_pos_w: Tensor, root_quat_w: Tensor, joint_pos: Tensor) -> tuple[Tensor, Tensor]:
        """Compute the poses of the selected bodies.

        Args:
            root_pos_w: ``[*B, 3]`` (m, world).
            root_quat_w: ``[*B, 4]``, root to world.
            joint_pos: ``[*B, J]`` (rad).

        Returns:
            Positions ``[*B, K, 3]`` (m, world) and orientations ``[*B, K, 4]`` (body to world).
        """
        body_pos, body_quat, axis = (tensor.to(root_pos_w) for tensor in (self._body_pos, self._body_quat, self._axis))
        half = 0.5 * joint_pos[..., None]
        joint_quat = torch.cat((half.cos(), half.sin() * axis), -1)  # (*B, J, 4)
        pos_w = {1: root_pos_w}
        quat_w = {1: root_quat_w}
        for body, parent, joint in self.chain:
            pos_w[body] = pos_w[parent] + quat_rotate(quat_w[parent], body_pos[body])
            local = body_quat[body]
            if joint >= 0:
                local = quat_multiply(local.expand_as(joint_quat[..., joint, :]), joint_quat[..., joint, :])
            quat_w[body] = quat_multiply(quat_w[parent], local.expand_as(root_quat_w))
        return (
            torch.stack([pos_w[body] for body in self._wanted], -2),
            torch.stack([quat_w[body] for body in self._wanted], -2),
        )
