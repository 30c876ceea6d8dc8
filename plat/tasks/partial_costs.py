"""Cost of missing what a partial keyframe commands."""

import torch
from torch import Tensor

from plat.envs.state import GeneralizedState
from plat.tasks.distances import smooth_angle, smooth_length
from plat.tasks.settings import TrackingCosts

__all__ = ["joint_error", "partial_pose_cost", "points_cost", "root_offset"]


def root_offset(state: GeneralizedState, pose: GeneralizedState, parts: Tensor) -> Tensor:
    """Return the offset ``[*B, 3]`` (m) of the root from a pose, 0 where masks ``[*B, J + K + 3]`` leave it open."""
    horizontal, height, _ = parts[..., -3:].unbind(-1)
    return (state.root_pos_w - pose.root_pos_w) * torch.stack((horizontal, horizontal, height), -1)


def joint_error(state: GeneralizedState, pose: GeneralizedState, parts: Tensor) -> Tensor:
    """Return the mean absolute error ``[*B]`` (rad) of joints that masks ``[*B, J + K + 3]`` command; 0 for none."""
    joints = parts[..., : state.joint_pos.shape[-1]]
    return ((state.joint_pos - pose.joint_pos).abs() * joints).sum(-1) / joints.sum(-1).clamp_min(1.0)


def partial_pose_cost(state: GeneralizedState, pose: GeneralizedState, parts: Tensor, weights: TrackingCosts) -> Tensor:
    """Return the distance ``[*B]`` from the commanded part of a pose, bodies aside.

    Args:
        state, pose: robot and target.
        parts: masks ``[*B, J + K + 3]``, float.
        weights: of the distances; joints count by the mean over the commanded ones.
    """
    return (
        weights.root_pos * smooth_length(root_offset(state, pose, parts))
        + weights.root_rot * parts[..., -1] * smooth_angle(state.root_quat_w, pose.root_quat_w)
        + weights.joint_pos * joint_error(state, pose, parts)
    )


def points_cost(points: Tensor, wanted: Tensor, bodies: Tensor) -> Tensor:
    """Return the mean distance ``[n]`` (m) of the commanded bodies.

    Args:
        points, wanted: positions ``[n, K, 3]`` (m).
        bodies: masks ``[n, K]``, float.
    """
    return (smooth_length(points - wanted) * bodies).sum(-1) / bodies.sum(-1).clamp_min(1.0)
