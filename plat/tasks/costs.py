"""What a control step costs."""

from torch import Tensor

from plat.envs.state import GeneralizedState
from plat.tasks.distances import smooth_angle, smooth_length
from plat.tasks.settings import AuthoredCosts, TrackingCosts

__all__ = ["AuthoredCosts", "TrackingCosts", "pose_cost", "tracking_cost"]


def pose_cost(state: GeneralizedState, pose: GeneralizedState, weights: TrackingCosts) -> Tensor:
    """Return the distance ``[*B]`` from a pose: position, orientation and joint angles."""
    return (
        weights.root_pos * smooth_length(state.root_pos_w - pose.root_pos_w)
        + weights.root_rot * smooth_angle(state.root_quat_w, pose.root_quat_w)
        + weights.joint_pos * (state.joint_pos - pose.joint_pos).abs().mean(-1)
    )


def tracking_cost(state: GeneralizedState, reference: GeneralizedState, weights: TrackingCosts) -> Tensor:
    """Return the distance ``[*B]`` from a reference: its pose and its velocities."""
    return (
        pose_cost(state, reference, weights)
        + weights.root_lin_vel * smooth_length(state.root_lin_vel_w - reference.root_lin_vel_w)
        + weights.root_ang_vel * (state.root_ang_vel_b - reference.root_ang_vel_b).abs().mean(-1)
        + weights.joint_vel * (state.joint_vel - reference.joint_vel).abs().mean(-1)
    )
