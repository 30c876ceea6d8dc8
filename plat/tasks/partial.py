"""Cost of missing what a partial keyframe commands."""

import torch
from torch import Tensor

from plat.envs.state import GeneralizedState
from plat.tasks.distances import smooth_angle, smooth_length
from plat.tasks.settings import TrackingCosts

__all__ = ["partial_pose_cost", "points_cost"]


def partial_pose_cost(state: GeneralizedState, pose: GeneralizedState, parts: Tensor, weights: TrackingCosts) -> Tensor:
    """Distance ``[*B]`` from the commanded part of a pose, bodies aside.

    Args:
        state, pose: robot and target.
        parts: masks ``[*B, J + K + 3]``, float.
        weights: of the distances; joints count by the mean over the commanded ones.
    """
    horizontal, height, orientation = parts[..., -3:].unbind(-1)
    off = state.root_pos_w - pose.root_pos_w
    off = off * torch.stack((horizontal, horizontal, height), -1)
    joints = parts[..., : state.joint_pos.shape[-1]]
    joint_error = ((state.joint_pos - pose.joint_pos).abs() * joints).sum(-1) / joints.sum(-1).clamp_min(1.0)
    return (
        weights.root_pos * smooth_length(off)
        + weights.root_rot * orientation * smooth_angle(state.root_quat_w, pose.root_quat_w)
        + weights.joint_pos * joint_error
    )


def points_cost(points: Tensor, wanted: Tensor, bodies: Tensor) -> Tensor:
    """Mean distance ``[n]`` (m) of the commanded bodies.

    Args:
        points, wanted: positions ``[n, K, 3]`` (m).
        bodies: masks ``[n, K]``, float.
    """
    return (smooth_length(points - wanted) * bodies).sum(-1) / bodies.sum(-1).clamp_min(1.0)
