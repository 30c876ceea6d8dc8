"""Default rewards with their weights: motion tracking, reaching keyframes, and penalties."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.rewards import Reward, RewardFunction
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = ["DenseRewards", "KeyframeRewards", "Regularization", "TrackingTerm"]

_IN_WINDOW = ("command", "in_window")


@dataclass(frozen=True)
class TrackingTerm:
    """Tracking term of a reward: ``weight * exp(-squared_error / scale**2)``."""

    weight: float
    """factor; 0 leaves the term out"""
    scale: float
    """error at which the term has fallen to 1/e, in the unit of the error"""


@dataclass(frozen=True)
class DenseRewards:
    """Rewards of frame-by-frame tracking.

    Source: BeyondMimic, arXiv 2508.08241, with twice its ``anchor_pos`` and a term on the joints.
    """

    anchor_pos: TrackingTerm = TrackingTerm(1.0, 0.3)
    """position of the anchor (m, world)"""
    anchor_rot: TrackingTerm = TrackingTerm(0.5, 0.4)
    """orientation of the anchor (rad)"""
    keypoint_pos: TrackingTerm = TrackingTerm(1.0, 0.3)
    """positions of the keypoints (m), aligned to the robot's anchor"""
    keypoint_rot: TrackingTerm = TrackingTerm(1.0, 0.4)
    """orientations of the keypoints (rad), aligned"""
    keypoint_lin_vel: TrackingTerm = TrackingTerm(1.0, 1.0)
    """linear velocities of the keypoints (m/s, world)"""
    keypoint_ang_vel: TrackingTerm = TrackingTerm(1.0, 3.14)
    """angular velocities of the keypoints (rad/s, world)"""
    joint_pos: TrackingTerm = TrackingTerm(1.5, 0.15)
    """joint angles (rad), for errors that the other terms hardly see, such as a turned wrist"""

    def rewards(self, robot: Robot) -> tuple[Reward, ...]:
        """Return the terms, see :class:`plat.envs.transforms.Reward`; they need :class:`ReferenceMotion`."""
        anchor = robot.anchor_index
        return (
            _tracking("anchor_pos", self.anchor_pos, partial(anchor_pos_error, anchor=anchor)),
            _tracking("anchor_rot", self.anchor_rot, partial(anchor_rot_error, anchor=anchor)),
            _tracking("keypoint_pos", self.keypoint_pos, _difference("keypoint_pos_w", "keypoint_pos_aligned_w")),
            _tracking("keypoint_rot", self.keypoint_rot, keypoint_rot_error),
            _tracking("keypoint_lin_vel", self.keypoint_lin_vel, _difference("keypoint_lin_vel_w")),
            _tracking("keypoint_ang_vel", self.keypoint_ang_vel, _difference("keypoint_ang_vel_w")),
            _tracking("joint_pos", self.joint_pos, joint_pos_error),
        )


@dataclass(frozen=True)
class KeyframeRewards:
    """Rewards of reaching a commanded keyframe, paid at each step of its arrival window."""

    joint_pos: TrackingTerm = TrackingTerm(1.0, 0.2)
    """joint angles (rad)"""
    keypoint_pos: TrackingTerm = TrackingTerm(1.0, 0.2)
    """positions of the keypoints (m, world)"""
    anchor_rot: TrackingTerm = TrackingTerm(0.5, 0.4)
    """orientation of the anchor (rad)"""

    def rewards(self, robot: Robot) -> tuple[Reward, ...]:
        """Return the terms, whose names begin with ``keyframe_``; they are 0 outside the arrival window.

        They need :class:`ReferenceMotion` and :class:`KeyframeClock`.
        """
        anchor = robot.anchor_index
        return (
            _arriving("joint_pos", self.joint_pos, joint_pos_error),
            _arriving("keypoint_pos", self.keypoint_pos, _difference("keypoint_pos_w")),
            _arriving("anchor_rot", self.anchor_rot, partial(anchor_rot_error, anchor=anchor)),
        )


@dataclass(frozen=True)
class Regularization:
    """Penalties on a step. The weights are negative; a weight of 0 switches a term off."""

    action_rate: float = -0.1
    """times the squared change of the action"""
    joint_limit: float = -10.0
    """times the excess over the soft limits (rad)"""
    stray_contact: float = -0.1
    """times the number of contacts that are not of a foot with the floor"""
    torque: float = 0.0
    """times the squared torque over the effort limit"""
    foot_slip: float = 0.0
    """times the squared horizontal speed of a loaded foot (m/s)"""
    impact: float = 0.0
    """times the ground reaction beyond twice the robot's weight, in weights"""
    floor: float | None = -5.0
    """lower bound on the summed penalties per second; None for no bound"""
    soft_limit: float = 0.95
    """fraction of each joint's range, about its middle, that is free"""

    def rewards(self, robot: Robot) -> tuple[Reward, ...]:
        """Return the penalties, without the bound."""
        low, high = robot.joint_range.unbind(-1)
        middle, half = robot.joint_range.mean(-1), 0.5 * (high - low)
        soft_low, soft_high = middle - self.soft_limit * half, middle + self.soft_limit * half
        effort = robot.effort_limit
        feet = [robot.keypoints.index(foot) for foot in robot.feet]
        robot_weight = 9.81 * float(robot.shared_model.body_mass.sum())

        def action_rate(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return (before["action"] - before["robot", "last_action"]).square().sum(-1)

        def joint_limit(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            joint_pos = after["state", "joint_pos"]
            return limit_excess(joint_pos, soft_low.to(joint_pos), soft_high.to(joint_pos))

        def stray_contact(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return after["state", "stray_contacts"][:, 0]

        def torque(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            joint_torque = after["state", "joint_torque"]
            return (joint_torque / effort.to(joint_torque)).square().sum(-1)

        def slip(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return foot_slip(after["state"], feet)

        def impact(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return (after["state", "foot_force"] / robot_weight - 2.0).clamp_min(0).sum(-1)

        return (
            Reward("action_rate", self.action_rate, action_rate),
            Reward("joint_limit", self.joint_limit, joint_limit),
            Reward("stray_contact", self.stray_contact, stray_contact),
            Reward("torque", self.torque, torque),
            Reward("foot_slip", self.foot_slip, slip),
            Reward("impact", self.impact, impact),
        )


# A squared error [N] of the state and the reference after a step.
_SquaredError = Callable[[TensorDictBase, TensorDictBase], Tensor]


def _kernel(squared_error: _SquaredError, scale: float) -> RewardFunction:
    return lambda before, after: torch.exp(squared_error(after["state"], after["reference"]) / -(scale**2))


def _tracking(name: str, term: TrackingTerm, squared_error: _SquaredError) -> Reward:
    return Reward(name, term.weight, _kernel(squared_error, term.scale), needs=(("reference", "joint_pos"),))


def _arriving(name: str, term: TrackingTerm, squared_error: _SquaredError) -> Reward:
    kernel = _kernel(squared_error, term.scale)
    needs: tuple[NestedKey, ...] = (("reference", "joint_pos"), _IN_WINDOW)
    return Reward(
        f"keyframe_{name}", term.weight, lambda before, after: kernel(before, after) * after[_IN_WINDOW][:, 0], needs
    )


def _difference(entry: str, reference_entry: str | None = None) -> _SquaredError:
    """Return the squared distance of an entry ``[N, K, 3]`` of the state from that of the reference."""
    return lambda state, reference: squared_distance(state[entry], reference[reference_entry or entry])


def squared_distance(actual: Tensor, wanted: Tensor) -> Tensor:
    """Return the mean over keypoints of the squared distance: ``[N, K, 3]`` to ``[N]``."""
    # one sum over both dimensions: reducing a last dimension of 3 alone is several times slower
    return (actual - wanted).square().flatten(1).sum(-1) / actual.shape[1]


def joint_pos_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Return the mean over joints of the squared error ``[N]`` (rad^2)."""
    return (state["joint_pos"] - reference["joint_pos"]).square().mean(-1)


def anchor_pos_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Return the squared distance ``[N]`` (m^2, world) of the anchor body from its reference."""
    return (state["keypoint_pos_w"][:, anchor] - reference["keypoint_pos_w"][:, anchor]).square().sum(-1)


def anchor_rot_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Return the squared angle ``[N]`` (rad^2) between the anchor body and its reference."""
    return quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor]).square()


def keypoint_rot_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Return the mean over keypoints of the squared angle ``[N]`` (rad^2) to the aligned reference."""
    return quat_angle(state["keypoint_quat_w"], reference["keypoint_quat_aligned_w"]).square().mean(-1)


def limit_excess(joint_pos: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return the sum over joints ``[N]`` (rad) of the angles beyond the limits."""
    return ((low - joint_pos).clamp_min(0) + (joint_pos - high).clamp_min(0)).sum(-1)


def foot_slip(state: TensorDictBase, feet: list[int], loaded: float = 5.0) -> Tensor:
    """Return the sum over feet ``[N]`` ((m/s)^2) of the squared horizontal speed of those loaded over ``loaded`` N."""
    speed = state["keypoint_lin_vel_w"][:, feet, :2].square().sum(-1)
    return (speed * (state["foot_force"] > loaded)).sum(-1)
