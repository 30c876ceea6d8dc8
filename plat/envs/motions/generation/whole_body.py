"""Inverse kinematics of the legs and the centre of mass, for all frames of a motion at once."""

import mujoco
import torch
from torch import Tensor

from plat.envs.kinematics import ForwardKinematics
from plat.envs.robot import Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_rotate, quat_to_rotvec

__all__ = ["WholeBody"]

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
# The search stops when every foot is this close (m, and rad at a lever of 1 m).
_CONVERGED = 5e-5


class WholeBody:
    """Poses of a robot with two six-joint legs from where its root and feet are to be.

    Args:
        robot: the robot; its leg joints are called as those of the G1.

    >>> from plat.envs import G1
    >>> body = WholeBody(G1)
    >>> round(float(body.center_of_mass(torch.as_tensor(G1.default_qpos)[None])[0, 2]), 2)
    0.67
    """

    def __init__(self, robot: Robot):
        self.robot = robot
        model = robot.model()
        names = [model.body(i).name for i in range(1, model.nbody)]
        self._all_bodies = ForwardKinematics(robot, tuple(names))
        self._mass = torch.from_numpy(model.body_mass[1:])
        self._local_com = torch.from_numpy(model.body_ipos[1:])
        self._legs = [_Leg(robot, model, side) for side in ("left", "right")]

    def solve_legs(
        self, root_pos: Tensor, root_quat: Tensor, feet_pos: Tensor, feet_quat: Tensor, joint_pos: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Leg angles that put both feet where they are wanted.

        Args:
            root_pos: ``[F, 3]`` (m, world).
            root_quat: ``[F, 4]``.
            feet_pos: positions of the left and right foot body ``[F, 2, 3]`` (m, world).
            feet_quat: their orientations ``[F, 2, 4]``.
            joint_pos: all angles ``[F, J]`` (rad); those of the legs are where the search begins.

        Returns:
            ``joint_pos`` with the legs solved as well as they can be, and how far each foot stays off ``[F, 2]`` (m,
            and rad at a lever of 1 m).
        """
        joint_pos = joint_pos.clone()
        errors = [
            leg.solve(root_pos, root_quat, feet_pos[:, side], feet_quat[:, side], joint_pos)
            for side, leg in enumerate(self._legs)
        ]
        return joint_pos, torch.stack(errors, -1)

    def center_of_mass(self, qpos: Tensor) -> Tensor:
        """Centre of mass ``[F, 3]`` (m, world) of poses ``[F, 7 + J]``."""
        pos, quat = self._all_bodies(*qpos.split((3, 4, self.robot.num_joints), -1))
        body_com = pos + quat_rotate(quat, self._local_com)
        return (self._mass[:, None] * body_com).sum(-2) / self._mass.sum()

    def feet(self, qpos: Tensor) -> tuple[Tensor, Tensor]:
        """Positions ``[F, 2, 3]`` and orientations ``[F, 2, 4]`` of the feet of poses ``[F, 7 + J]``."""
        kinematics = ForwardKinematics(self.robot, self.robot.feet)
        return kinematics(*qpos.split((3, 4, self.robot.num_joints), -1))


class _Leg:
    """Damped Gauss-Newton on the six joints of a leg, with the geometric Jacobian."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, side: str):
        self._joints = [robot.joint_names.index(f"{side}_{joint}") for joint in _LEG]
        # a joint's body is the one it moves; its origin lies on the axis
        bodies = [model.body(int(model.jnt_bodyid[joint + 1])).name for joint in self._joints]
        self._kinematics = ForwardKinematics(robot, tuple(bodies))
        self._axis = torch.from_numpy(model.jnt_axis[[joint + 1 for joint in self._joints]])
        self._range = torch.from_numpy(model.jnt_range[[joint + 1 for joint in self._joints]])

    def solve(
        self, root_pos: Tensor, root_quat: Tensor, foot_pos: Tensor, foot_quat: Tensor, joint_pos: Tensor
    ) -> Tensor:
        damping = 1e-6 * torch.eye(6, dtype=joint_pos.dtype)
        for _ in range(30):
            pos, quat = self._kinematics(root_pos, root_quat, joint_pos)
            turn = quat_to_rotvec(quat_multiply(foot_quat, quat_conjugate(quat[:, -1])))
            error = torch.cat((foot_pos - pos[:, -1], turn), -1)  # (F, 6)
            if error.abs().max() < _CONVERGED:
                break
            axis = quat_rotate(quat, self._axis)  # (F, 6, 3), world
            lever = pos[:, -1:] - pos
            jacobian = torch.cat((torch.linalg.cross(axis, lever), axis), -1).transpose(-1, -2)  # (F, 6, 6)
            normal = jacobian.transpose(-1, -2) @ jacobian + damping
            step = torch.linalg.solve(normal, (jacobian.transpose(-1, -2) @ error[..., None])[..., 0])
            moved = joint_pos[:, self._joints] + step.clamp(-0.3, 0.3)
            joint_pos[:, self._joints] = moved.clamp(self._range[:, 0], self._range[:, 1])
        return error.abs().amax(-1)
