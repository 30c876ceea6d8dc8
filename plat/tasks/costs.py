"""What a control step costs."""

from dataclasses import dataclass

from torch import Tensor

from plat.envs.state import RobotState
from plat.tasks.distances import smooth_angle, smooth_length

__all__ = ["AuthoredCosts", "TrackingCosts", "pose_cost", "tilt", "tracking_cost"]


@dataclass(frozen=True)
class TrackingCosts:
    """Weights of the distances from a reference."""

    root_pos: float = 2.0
    """of the root's position (m)"""
    root_rot: float = 1.0
    """of its orientation (rad)"""
    joint_pos: float = 3.0
    """of the joint angles, mean over joints (rad)"""
    root_lin_vel: float = 0.2
    """of the root's velocity (m/s)"""
    root_ang_vel: float = 0.05
    """of its angular velocity, mean over axes (rad/s)"""
    joint_vel: float = 0.03
    """of the joint velocities, mean over joints (rad/s)"""


@dataclass(frozen=True)
class AuthoredCosts:
    """Weights where there is no reference but the keyframe."""

    underway: float = 0.15
    """pull to the line between keyframes before the arrival window, as a share of the pull in it"""
    height: float = 0.5
    """of the root's height above or below that line (m)"""
    root_lin_vel: float = 0.02
    """of the root's speed (m/s)"""
    root_ang_vel: float = 0.01
    """of its angular velocity, mean over axes (rad/s)"""
    joint_vel: float = 0.01
    """of the joint velocities, mean over joints (rad/s)"""


def pose_cost(state: RobotState, pose: RobotState, weights: TrackingCosts) -> Tensor:
    """Distance ``[*B]`` from a pose: position, orientation and joint angles."""
    return (
        weights.root_pos * smooth_length(state.root_pos_w - pose.root_pos_w)
        + weights.root_rot * smooth_angle(state.root_quat_w, pose.root_quat_w)
        + weights.joint_pos * (state.joint_pos - pose.joint_pos).abs().mean(-1)
    )


def tracking_cost(state: RobotState, reference: RobotState, weights: TrackingCosts) -> Tensor:
    """Distance ``[*B]`` from a reference: its pose and its velocities."""
    return (
        pose_cost(state, reference, weights)
        + weights.root_lin_vel * smooth_length(state.root_lin_vel_w - reference.root_lin_vel_w)
        + weights.root_ang_vel * (state.root_ang_vel_b - reference.root_ang_vel_b).abs().mean(-1)
        + weights.joint_vel * (state.joint_vel - reference.joint_vel).abs().mean(-1)
    )


def tilt(quat: Tensor) -> Tensor:
    """Vertical component ``[*B]`` of gravity in a body's frame: -1 when it is upright.

    >>> import torch
    >>> tilt(torch.tensor([1.0, 0, 0, 0])).item()
    -1.0
    """
    return 2 * quat[..., 1:3].square().sum(-1) - 1
