"""Inverse kinematics of the legs, and the center of mass, for all frames of a motion at once."""

import mujoco
import torch
from torch import Tensor

from plat.robots.center_of_mass import CenterOfMass
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_rotate, quat_to_rotvec

__all__ = ["WholeBody", "has_six_joint_legs"]

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_ITERATIONS = 40
_CONVERGED = 1e-7  # rad: the search stops at frames where no joint moves further
_DAMPING = 1e-6
_LARGEST_STEP = 0.3  # rad


def has_six_joint_legs(robot: Robot) -> bool:
    """Return whether a robot has the legs that :class:`WholeBody` solves for: six joints on the way to each foot.

    >>> from plat.robots import G1
    >>> has_six_joint_legs(G1)
    True
    """
    return all(
        {f"{side}_{joint}" for joint in _LEG} == {robot.joint_names[joint] for joint in robot.joints_to(foot)}
        for side, foot in zip(("left", "right"), robot.feet, strict=True)
    )


class WholeBody:
    """Whole-body poses of a robot with two six-joint legs, from given poses of its root and feet.

    Args:
        robot: the six joints of its legs are named like those of the G1, in any order from the root to the foot.

    >>> from plat.robots import G1
    >>> body = WholeBody(G1)
    >>> round(float(body.center_of_mass(torch.as_tensor(G1.default_qpos)[None])[0, 2]), 2)
    0.67
    """

    def __init__(self, robot: Robot):
        self.robot = robot
        model = robot.model()
        self._com = CenterOfMass(robot)
        self._legs = [_Leg(robot, model, foot) for foot in robot.feet]

    def solve_legs(
        self,
        root_pos: Tensor,
        root_quat: Tensor,
        feet_pos: Tensor,
        feet_quat: Tensor,
        orientation_weight: Tensor,
        joint_pos: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Solve for leg angles that put both feet at their targets.

        Args:
            root_pos: ``[F, 3]`` (m, world).
            root_quat: ``[F, 4]``.
            feet_pos: positions of the left and right foot body ``[F, 2, 3]`` (m, world).
            feet_quat: their orientations ``[F, 2, 4]``.
            orientation_weight: meters that a radian of each foot's orientation counts as ``[F, 2]``, where joint
                limits do not let a foot have both.
            joint_pos: all angles ``[F, J]`` (rad); those of the legs are the initial guess.

        Returns:
            ``joint_pos`` with the legs solved as well as they can be, and how far each foot stays off in position
            ``[F, 2]`` (m) and orientation ``[F, 2]`` (rad).
        """
        joint_pos = joint_pos.clone()
        off = [
            leg.solve(
                root_pos, root_quat, feet_pos[:, side], feet_quat[:, side], orientation_weight[:, side], joint_pos
            )
            for side, leg in enumerate(self._legs)
        ]
        pos_off, rot_off = (torch.stack(errors, -1) for errors in zip(*off, strict=True))
        return joint_pos, pos_off, rot_off

    def center_of_mass(self, qpos: Tensor) -> Tensor:
        """Return the center of mass ``[F, 3]`` (m, world) of poses ``[F, 7 + J]``."""
        return self._com(*qpos.split((3, 4, self.robot.num_joints), -1))[0]


class _Leg:
    """Inverse kinematics of a six-joint leg: damped Gauss-Newton with the geometric Jacobian and joint limits."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, foot: str):
        self._joints = robot.joints_to(foot)
        # a joint's body is the one it moves; its origin lies on the axis
        bodies = [model.body(int(model.jnt_bodyid[joint + 1])).name for joint in self._joints]
        self._kinematics = ForwardKinematics(robot, (*bodies, foot))
        self._axis = torch.from_numpy(model.jnt_axis[[joint + 1 for joint in self._joints]])
        self._range = torch.from_numpy(model.jnt_range[[joint + 1 for joint in self._joints]])

    def solve(
        self,
        root_pos: Tensor,
        root_quat: Tensor,
        foot_pos: Tensor,
        foot_quat: Tensor,
        orientation_weight: Tensor,
        joint_pos: Tensor,
    ) -> tuple[Tensor, Tensor]:
        low, high = self._range.unbind(-1)
        weight = torch.ones(len(joint_pos), 6, dtype=joint_pos.dtype)
        weight[:, 3:] = orientation_weight[:, None]
        rows = torch.arange(len(joint_pos))  # frames that still move
        for _ in range(_ITERATIONS):
            pos, quat, error = self._off(*(t[rows] for t in (root_pos, root_quat, foot_pos, foot_quat, joint_pos)))
            axis = quat_rotate(quat[:, :-1], self._axis)  # (n, 6, 3), world
            lever = pos[:, -1:] - pos[:, :-1]
            jacobian = torch.cat((torch.linalg.cross(axis, lever), axis), -1).transpose(-1, -2)  # (n, 6, 6)
            jacobian, error = weight[rows, :, None] * jacobian, weight[rows] * error
            angle = joint_pos[rows][:, self._joints]
            downhill = (jacobian.transpose(-1, -2) @ error[..., None])[..., 0]
            # a joint at its limit stays there, and the others take the remaining error
            stuck = ((angle <= low) & (downhill < 0)) | ((angle >= high) & (downhill > 0))
            jacobian = jacobian.masked_fill(stuck[:, None], 0.0)
            normal = jacobian.transpose(-1, -2) @ jacobian + torch.diag_embed(_DAMPING + stuck.to(jacobian))
            step = torch.linalg.solve(normal, downhill.masked_fill(stuck, 0.0)).clamp(-_LARGEST_STEP, _LARGEST_STEP)
            following = (angle + step).clamp(low, high)
            joint_pos[rows[:, None], self._joints] = following
            rows = rows[(following - angle).abs().amax(-1) > _CONVERGED]
            if len(rows) == 0:
                break
        _, _, error = self._off(root_pos, root_quat, foot_pos, foot_quat, joint_pos)
        return torch.linalg.vector_norm(error[:, :3], dim=-1), torch.linalg.vector_norm(error[:, 3:], dim=-1)

    def _off(
        self, root_pos: Tensor, root_quat: Tensor, foot_pos: Tensor, foot_quat: Tensor, joint_pos: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return the poses of the leg's six bodies and the foot, and the foot's error ``[n, 6]`` (m, and rad)."""
        pos, quat = self._kinematics(root_pos, root_quat, joint_pos)
        turn = quat_to_rotvec(quat_multiply(foot_quat, quat_conjugate(quat[:, -1])))
        return pos, quat, torch.cat((foot_pos - pos[:, -1], turn), -1)
