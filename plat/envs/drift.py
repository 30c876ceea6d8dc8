"""Drift of state estimation: where a robot that only dead-reckons takes itself to be."""

import torch
from torch import Tensor

from plat.gpu import HORIZONTAL, constant
from plat.rotations import quat_yaw, yaw_multiply, yaw_rotate

__all__ = ["drifted", "estimated_root"]


def estimated_root(drift: Tensor, root_pos_w: Tensor, root_quat_w: Tensor) -> tuple[Tensor, Tensor]:
    """Return position ``[*B, 3]`` (m, world) and orientation ``[*B, 4]`` of the root as they are estimated.

    Args:
        drift: offset of the position and of the heading ``[*B, 4]`` (m, m, m, rad).
        root_pos_w: true position.
        root_quat_w: true orientation.

    >>> pos, quat = estimated_root(torch.tensor([0.5, 0.0, 0.0, torch.pi]), torch.ones(3), torch.eye(4)[0])
    >>> pos.tolist(), round(float(quat[3]), 3)
    ([1.5, 1.0, 1.0], 1.0)
    """
    return root_pos_w + drift[..., :3], yaw_multiply(_turn(drift), root_quat_w)


@torch.no_grad()
def drifted(drift: Tensor, rate: Tensor, root_quat_w: Tensor, root_lin_vel_w: Tensor, dt: float) -> Tensor:
    """Return the drift ``[*B, 4]`` after a control step.

    A walking robot misjudges its steps, and a heading that is off turns the way that it reckons. A robot that stands
    keeps its place and loses its heading alone. No gradient passes: nothing is to be gained by going slowly.

    Args:
        drift: before the step, as of :func:`estimated_root`.
        rate: forward and leftward drift per meter of way, and drift of the heading ``[*B, 3]`` (m/m, m/m, rad/s).
        root_quat_w: true orientation after the step ``[*B, 4]``.
        root_lin_vel_w: true velocity after the step ``[*B, 3]`` (m/s).
        dt: control step (s).

    >>> walking = torch.tensor([2.0, 0.0, 0.0])
    >>> after = drifted(torch.zeros(4), torch.tensor([0.1, 0.0, 0.5]), torch.eye(4)[0], walking, 1.0)
    >>> [round(value, 3) for value in after.tolist()]
    [0.2, 0.0, 0.0, 0.5]
    """
    turn = _turn(drift)
    way = root_lin_vel_w * constant(HORIZONTAL, root_lin_vel_w)
    misjudged = torch.nn.functional.pad(way.norm(dim=-1, keepdim=True) * rate[..., :2], (0, 1))
    heading = quat_yaw(yaw_multiply(turn, root_quat_w))
    speed = yaw_rotate(turn, way) - way + yaw_rotate(heading, misjudged)
    # a simulation that diverged is on its way to a reset
    return drift + dt * torch.cat((speed, rate[..., 2:]), -1).nan_to_num(0.0, 0.0, 0.0)


def _turn(drift: Tensor) -> Tensor:
    """The offset of the heading as a quaternion ``[*B, 4]``."""
    half = 0.5 * drift[..., 3]
    zero = torch.zeros_like(half)
    return torch.stack((half.cos(), zero, zero, half.sin()), -1)
