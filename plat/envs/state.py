"""Generalized state of the robot: the full state of the simulation, beside the joint targets."""

from typing import NamedTuple

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.errors import ActionError
from plat.gpu import constant
from plat.robots.robot import Robot
from plat.rotations import quat_rotate, quat_rotate_inverse
from plat.spec.observation import entries_of, quantities

__all__ = ["GeneralizedState", "joint_target"]


class GeneralizedState(NamedTuple):
    """Generalized state: root pose, joint angles and their velocities for a batch ``[*B]`` of robots.

    The order of the fields is MuJoCo's: ``qpos`` and then ``qvel`` of a model with a free joint first.

    Attributes:
        root_pos_w: position of the root ``[*B, 3]`` (m, world).
        root_quat_w: its orientation ``[*B, 4]``, ``wxyz``, root to world.
        joint_pos: joint angles ``[*B, J]`` (rad).
        root_lin_vel_w: velocity of the root ``[*B, 3]`` (m/s, world).
        root_ang_vel_b: its angular velocity ``[*B, 3]`` (rad/s, root frame).
        joint_vel: joint velocities ``[*B, J]`` (rad/s).

    >>> state = GeneralizedState.unpack(torch.zeros(2, 71))
    >>> state.joint_pos.shape, state.pack().shape
    (torch.Size([2, 29]), torch.Size([2, 71]))
    """

    root_pos_w: Tensor
    root_quat_w: Tensor
    joint_pos: Tensor
    root_lin_vel_w: Tensor
    root_ang_vel_b: Tensor
    joint_vel: Tensor

    @classmethod
    def unpack(cls, values: Tensor) -> "GeneralizedState":
        """Return views of packed states ``[*B, 13 + 2 J]``."""
        joints = (values.shape[-1] - 13) // 2
        return cls(*values.split((3, 4, joints, 3, 3, joints), -1))

    def pack(self) -> Tensor:
        """Return all fields concatenated ``[*B, 13 + 2 J]``."""
        return torch.cat(self, -1)

    def at(self, rows: Tensor | slice) -> "GeneralizedState":
        """Return the states of rows ``[n]``."""
        return GeneralizedState(*(part[rows] for part in self))

    @classmethod
    def from_entries(cls, tensordict: TensorDictBase) -> "GeneralizedState":
        """Return the state in the entries of :class:`plat.envs.MotionTrackingEnv`."""
        state, keys = tensordict["state"], (("robot", "root_lin_vel_b"), ("robot", "root_ang_vel_b"))
        lin_vel, ang_vel = quantities(entries_of(keys), [tensordict[key] for key in keys])
        return cls(
            state["root_pos_w"],
            state["root_quat_w"],
            state["joint_pos"],
            quat_rotate(state["root_quat_w"], lin_vel),
            ang_vel,
            state["joint_vel"],
        )

    @classmethod
    def from_motion(cls, frames: TensorDictBase) -> "GeneralizedState":
        """Return the state of a motion, from rows ``[*B]`` of :meth:`plat.motions.MotionLibrary.states`."""
        root_quat_w = frames["keypoint_quat"][..., 0, :]
        return cls(
            frames["keypoint_pos"][..., 0, :],
            root_quat_w,
            frames["joint_pos"],
            frames["keypoint_lin_vel"][..., 0, :],
            quat_rotate_inverse(root_quat_w, frames["keypoint_ang_vel"][..., 0, :]),
            frames["joint_vel"],
        )

    @property
    def qpos(self) -> Tensor:
        """Return the MuJoCo position vectors ``[*B, 7 + J]``."""
        return torch.cat(self[:3], -1)

    @property
    def qvel(self) -> Tensor:
        """Return the MuJoCo velocity vectors ``[*B, 6 + J]``."""
        return torch.cat(self[3:], -1)

    def in_root_frame(self) -> tuple[Tensor, Tensor]:
        """Return the direction of gravity and the velocity of the root, both ``[*B, 3]`` in the root frame."""
        down = torch.zeros_like(self.root_pos_w)
        down[..., 2] = -1.0
        turned = quat_rotate_inverse(self.root_quat_w[..., None, :], torch.stack((down, self.root_lin_vel_w), -2))
        gravity_b, root_lin_vel_b = turned.unbind(-2)
        return gravity_b, root_lin_vel_b


def joint_target(robot: Robot, action: Tensor) -> Tensor:
    """Return the joint position targets ``[*B, J]`` (rad) of actions: ``q_default + scale * a``, at least in float32.

    Raises:
        ActionError: for actions of another number of joints.

    >>> from plat.robots import G1
    >>> bool((joint_target(G1, torch.zeros(29)) == G1.default_joint_pos).all())
    True
    """
    if action.shape[-1:] != robot.default_joint_pos.shape:
        raise ActionError(f"action has shape {tuple(action.shape)}, expected [*B, {robot.num_joints}]")
    # a network may end in half precision, and the simulator takes what it says as it is
    action = action.to(torch.promote_types(action.dtype, torch.float32))
    return constant(robot.default_joint_pos, action) + constant(robot.action_scale, action) * action
