"""Motions that go on from where a robot is, after a partial keyframe left open where it goes."""

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.state import GeneralizedState
from plat.gpu import HORIZONTAL, constant
from plat.rotations import quat_conjugate, quat_multiply, quat_rotate, quat_rotate_inverse, quat_yaw

__all__ = ["moved_motion", "on_motion"]


def on_motion(state: GeneralizedState, memory: TensorDictBase) -> GeneralizedState:
    """Return states ``[N]`` in the worlds of their motions, which may have been moved.

    Args:
        state: robots, in their world.
        memory: with ``anchor_pos`` ``[N, 3]`` (m) and ``anchor_quat`` ``[N, 4]``, the origins of the motions' worlds;
            without, none was moved.
    """
    pos = memory.get("anchor_pos", None)
    if pos is None:
        return state
    quat = memory["anchor_quat"]
    return state._replace(
        root_pos_w=quat_rotate_inverse(quat, state.root_pos_w - pos),
        root_quat_w=quat_multiply(quat_conjugate(quat), state.root_quat_w),
        root_lin_vel_w=quat_rotate_inverse(quat, state.root_lin_vel_w),
    )


def moved_motion(
    state: GeneralizedState, memory: TensorDictBase, reference: GeneralizedState, parts: Tensor, ended: Tensor
) -> tuple[Tensor, Tensor]:
    """Return ``anchor_pos`` and ``anchor_quat`` that take motions to robots that were free to go elsewhere.

    Both have the gradient of the robot's place: who stands further ahead has a motion that begins further ahead, and
    is no nearer to its end.

    Args:
        state: robots ``[N]``.
        memory: of :func:`on_motion`.
        reference: the motions now ``[N]``, in their worlds.
        parts: masks ``[N, J + K + 3]`` of what was commanded.
        ended: commands ``[N]`` along motions that have ended.
    """
    # neither bodies nor the root's place
    open_pos = ended & ~(parts[:, state.joint_pos.shape[-1] : -2] > 0).any(-1)
    open_yaw = open_pos & ~(parts[:, -1] > 0)
    # the heading of who lies exactly on its back has no gradient, which would make those of all others NaN
    facing = quat_yaw(torch.where(open_yaw[:, None], state.root_quat_w, reference.root_quat_w))
    turned = quat_multiply(facing, quat_conjugate(quat_yaw(reference.root_quat_w)))
    quat = torch.where(open_yaw[:, None], turned, memory["anchor_quat"])
    here = torch.where(open_pos[:, None], reference.root_pos_w, on_motion(state, memory).root_pos_w)
    pos = (state.root_pos_w - quat_rotate(quat, here)) * constant(HORIZONTAL, quat)
    return torch.where(open_pos[:, None], pos, memory["anchor_pos"]), quat
