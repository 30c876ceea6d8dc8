"""Inverse kinematics of the legs, and the center of mass, for all frames of a motion at once."""

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.robots.center_of_mass import CenterOfMass
from plat.robots.robot import Robot
from plat.rotations import quat_conjugate, quat_rotate, quat_to_rotvec

__all__ = ["WholeBody", "has_six_joint_legs"]

_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_SIDES = ("left", "right")
_ITERATIONS = 40
_CONVERGED = 1e-7  # rad: the search stops at frames where no joint moves further
_DAMPING = 1e-6
_LARGEST_STEP = 0.3  # rad


def has_six_joint_legs(robot: Robot) -> bool:
    """Return whether a robot has the legs that :class:`WholeBody` solves for.

    >>> from plat.robots import G1
    >>> has_six_joint_legs(G1)
    True
    """
    return all(f"{side}_{joint}" in robot.joint_names for side in _SIDES for joint in _LEG)


class WholeBody:
    """Whole-body poses of a robot with two six-joint legs, from given poses of its root and feet.

    Args:
        robot: its leg joints are named like those of the G1.

    >>> from plat.robots import G1
    >>> body = WholeBody(G1)
    >>> round(float(body.center_of_mass(torch.as_tensor(G1.default_qpos)[None])[0, 2]), 2)
    0.67
    """

    def __init__(self, robot: Robot):
        self.robot = robot
        model = robot.model()
        self._com = CenterOfMass(robot)
        self._legs = _Legs(robot, model)

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
        return self._legs.solve(root_pos, root_quat, feet_pos, feet_quat, orientation_weight, joint_pos)

    def center_of_mass(self, qpos: Tensor) -> Tensor:
        """Return the center of mass ``[F, 3]`` (m, world) of poses ``[F, 7 + J]``."""
        return self._com(*qpos.split((3, 4, self.robot.num_joints), -1))[0]


class _Legs:
    """Inverse kinematics of both six-joint legs: damped Gauss-Newton with the geometric Jacobian and joint limits.

    Rows ``[N]`` are the legs of all frames, and each stops when it has converged. For a few frames the number of
    operations is what takes time: they are few, and compute to the last bit what
    :class:`plat.robots.ForwardKinematics` does.
    """

    def __init__(self, robot: Robot, model: mujoco.MjModel):
        joints = np.array([[robot.joint_names.index(f"{side}_{name}") for name in _LEG] for side in _SIDES])
        self._joints = torch.from_numpy(joints)
        self._low, self._high = torch.from_numpy(model.jnt_range[joints + 1]).unbind(-1)
        # a joint's body is the one it moves; its origin lies on the axis
        bodies = model.jnt_bodyid[joints + 1]
        chains = [_chain(model, int(leg[-1])) for leg in bodies]
        longest = max(len(chain) for chain in chains)
        # a shorter chain begins with the world, which is where its parent is
        chains = [[0] * (longest - len(chain)) + chain for chain in chains]
        self._wanted = torch.tensor([[chain.index(b) for b in leg] for chain, leg in zip(chains, bodies, strict=True)])
        # a body without a joint finds no turn behind the last joint
        turning = [[max(int(model.body_jntadr[body]), 0) for body in chain] for chain in chains]
        self._turning = torch.tensor([[joint - 1 if joint else robot.num_joints for joint in leg] for leg in turning])
        # in single precision, as the kinematics has them
        self._body_pos, self._body_quat, self._turn_axis = (
            torch.from_numpy(values).float().double()
            for values in (model.body_pos[chains], model.body_quat[chains], model.jnt_axis[turning])
        )
        self._axis = torch.from_numpy(model.jnt_axis[joints + 1])

    def solve(
        self,
        root_pos: Tensor,
        root_quat: Tensor,
        feet_pos: Tensor,
        feet_quat: Tensor,
        orientation_weight: Tensor,
        joint_pos: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        frames = len(joint_pos)
        low, high = (limit.repeat(frames, 1) for limit in (self._low, self._high))
        weight = torch.ones(2 * frames, 6, dtype=joint_pos.dtype)
        weight[:, 3:] = orientation_weight.reshape(-1, 1)
        angle = joint_pos[:, self._joints].flatten(0, 1)
        turns = torch.nn.functional.pad(joint_pos, (0, 1))[:, self._turning].flatten(0, 1)
        given = (
            root_pos.repeat_interleave(2, 0),
            root_quat.repeat_interleave(2, 0),
            feet_pos.flatten(0, 1),
            feet_quat.flatten(0, 1),
            turns,
            *(
                values.repeat(frames, *(1 for _ in values.shape[1:]))
                for values in (self._wanted, self._body_pos, self._body_quat, self._turn_axis, self._axis)
            ),
        )
        rows = torch.arange(2 * frames)  # legs that still move
        now, here = angle, given
        for _ in range(_ITERATIONS):
            jacobian, error = self._off(now, *here)
            jacobian, error = weight[:, :, None] * jacobian, weight * error
            downhill = (jacobian.transpose(-1, -2) @ error[..., None])[..., 0]
            # a joint at its limit stays there, and the others take the remaining error
            stuck = ((now <= low) & (downhill < 0)) | ((now >= high) & (downhill > 0))
            jacobian = jacobian.masked_fill(stuck[:, None], 0.0)
            normal = jacobian.transpose(-1, -2) @ jacobian + torch.diag_embed(_DAMPING + stuck.to(jacobian))
            step = torch.linalg.solve(normal, downhill.masked_fill(stuck, 0.0)).clamp(-_LARGEST_STEP, _LARGEST_STEP)
            following = torch.minimum(torch.maximum(now + step, low), high)
            moves = (following - now).abs().amax(-1) > _CONVERGED
            angle[rows] = now = following
            if not moves.all():
                rows, now, low, high, weight = (values[moves] for values in (rows, now, low, high, weight))
                here = tuple(values[moves] for values in here)
            if len(rows) == 0:
                break
        _, error = self._off(angle, *given)
        joint_pos = joint_pos.clone()
        joint_pos[:, self._joints] = angle.unflatten(0, (frames, 2))
        off = torch.linalg.vector_norm(error.unflatten(0, (frames, 2)).unflatten(-1, (2, 3)), dim=-1)
        return joint_pos, off[..., 0], off[..., 1]

    @staticmethod
    def _off(
        angle: Tensor,
        root_pos: Tensor,
        root_quat: Tensor,
        foot_pos: Tensor,
        foot_quat: Tensor,
        turns: Tensor,
        wanted: Tensor,
        body_pos: Tensor,
        body_quat: Tensor,
        turn_axis: Tensor,
        axis: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Return the Jacobian ``[N, 6, 6]``, and the foot's error ``[N, 6]`` (m, rotation vector in rad)."""
        half = 0.5 * turns.scatter(-1, wanted, angle)[..., None]
        local = _multiply(body_quat, torch.cat((half.cos(), half.sin() * turn_axis), -1))
        quats = [root_quat]
        for link in local.unbind(-2):
            quats.append(_multiply(quats[-1], link))
        quat = torch.stack(quats, -2)  # (N, 1 + L, 4), the root's first
        pos = torch.cat((root_pos[:, None], quat_rotate(quat[:, :-1], body_pos)), -2).cumsum(-2)[:, 1:]
        rows = torch.arange(len(angle))[:, None]
        pos, quat = pos[rows, wanted], quat[rows, 1 + wanted]
        turn = quat_to_rotvec(_multiply(foot_quat, quat_conjugate(quat[:, -1])))
        axis = quat_rotate(quat, axis)  # (N, 6, 3), world
        lever = pos[:, -1:] - pos
        jacobian = torch.cat((torch.linalg.cross(axis, lever), axis), -1).transpose(-1, -2)
        return jacobian, torch.cat((foot_pos - pos[:, -1], turn), -1)


def _chain(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the bodies from below the root to one, MuJoCo's ids."""
    chain: list[int] = []
    while body > 1:
        chain.insert(0, body)
        body = int(model.body_parentid[body])
    return chain


# of the matrix that a product's right quaternion is to the left one, row by row
_PRODUCT_PARTS = torch.tensor([0, 1, 2, 3, 1, 0, 3, 2, 2, 3, 0, 1, 3, 2, 1, 0])
_PRODUCT_SIGNS = torch.tensor([1.0, -1, -1, -1, 1, 1, 1, -1, 1, -1, 1, 1, 1, 1, -1, 1], dtype=torch.float64)


def _multiply(a: Tensor, b: Tensor) -> Tensor:
    """Return :func:`plat.rotations.quat_multiply` of ``[*B, 4]``, the same sums in a quarter of the operations."""
    right = (b.index_select(-1, _PRODUCT_PARTS) * _PRODUCT_SIGNS).unflatten(-1, (4, 4))
    first, second, third, fourth = (right * a[..., None, :]).unbind(-1)
    return first + second + third + fourth
