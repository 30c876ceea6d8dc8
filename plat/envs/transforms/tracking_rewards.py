"""Default rewards with their weights: motion tracking, reaching keyframes, and penalties."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, TypeAlias

from plat.bounds import Bounded, Fraction, Range
from plat.envs.transforms.settings import TrackingTerm

if TYPE_CHECKING:
    from tensordict import TensorDictBase
    from torch import Tensor

    from plat.envs.transforms.rewards import Reward
    from plat.robots.robot import Robot

__all__ = ["DenseRewards", "KeyframeRewards", "Regularization", "TrackingTerm"]

Penalty: TypeAlias = Annotated[float, Range(high=0)]
"""Weight of a penalty."""


@dataclass(frozen=True)
class DenseRewards(Bounded):
    """Rewards of frame-by-frame tracking.

    On the way to a partial keyframe they are for what it commands: joints, positions of bodies, and the orientation of
    the root in place of that of the anchor and of all bodies.

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
        from plat.envs.transforms import reward_terms as terms  # torch: a help text has no use for it

        anchor, aligned = robot.anchor_index, ("keypoint_pos_w", "keypoint_pos_aligned_w")
        anchor_pos = partial(terms.anchor_pos_error, anchor=anchor)
        anchor_rot = partial(terms.anchor_rot_error, anchor=anchor)
        return (
            terms.tracking("anchor_pos", self.anchor_pos, anchor_pos, terms.commanded_anchor_pos_error(anchor)),
            terms.tracking("anchor_rot", self.anchor_rot, anchor_rot, terms.commanded_rot_error),
            terms.tracking(
                "keypoint_pos", self.keypoint_pos, terms.difference(*aligned), terms.commanded_difference(*aligned)
            ),
            terms.tracking("keypoint_rot", self.keypoint_rot, terms.keypoint_rot_error, terms.commanded_rot_error),
            terms.tracking(
                "keypoint_lin_vel",
                self.keypoint_lin_vel,
                terms.difference("keypoint_lin_vel_w"),
                terms.commanded_difference("keypoint_lin_vel_w"),
            ),
            terms.tracking(
                "keypoint_ang_vel",
                self.keypoint_ang_vel,
                terms.difference("keypoint_ang_vel_w"),
                terms.commanded_ang_vel_error,
            ),
            terms.tracking("joint_pos", self.joint_pos, terms.joint_pos_error, terms.commanded_joint_pos_error),
        )


@dataclass(frozen=True)
class KeyframeRewards(Bounded):
    """Rewards of reaching a commanded keyframe, paid at each step of its arrival window.

    Of a partial keyframe they are for what it commands, as :class:`DenseRewards` are.
    """

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
        from plat.envs.transforms import reward_terms as terms  # torch: a help text has no use for it

        turned = partial(terms.anchor_rot_error, anchor=robot.anchor_index)
        keypoints, commanded = terms.difference("keypoint_pos_w"), terms.commanded_difference("keypoint_pos_w")
        return (
            terms.arriving("joint_pos", self.joint_pos, terms.joint_pos_error, terms.commanded_joint_pos_error),
            terms.arriving("keypoint_pos", self.keypoint_pos, keypoints, commanded),
            terms.arriving("anchor_rot", self.anchor_rot, turned, terms.commanded_rot_error),
        )


@dataclass(frozen=True)
class Regularization(Bounded):
    """Penalties on a step. The weights are negative; a weight of 0 switches a term off."""

    action_rate: Penalty = -0.1
    """times the squared change of the action"""
    joint_limit: Penalty = -10.0
    """times the excess over the soft limits (rad)"""
    stray_contact: Penalty = -0.1
    """times the number of contacts that are not of a foot with the floor"""
    torque: Penalty = 0.0
    """times the squared torque over the effort limit"""
    foot_slip: Penalty = 0.0
    """times the squared horizontal speed of a loaded foot (m/s)"""
    impact: Penalty = 0.0
    """times the ground reaction beyond twice the robot's weight, in weights"""
    floor: Penalty | None = -5.0
    """lower bound on the summed penalties per second; None for no bound"""
    soft_limit: Fraction = 0.95
    """fraction of each joint's range, about its middle, that is free"""

    def rewards(self, robot: Robot) -> tuple[Reward, ...]:
        """Return the penalties, without the bound."""
        from plat.envs.transforms import reward_terms as terms  # torch: a help text has no use for it

        low, high = robot.joint_range.unbind(-1)
        middle, half = robot.joint_range.mean(-1), 0.5 * (high - low)
        soft_low, soft_high = middle - self.soft_limit * half, middle + self.soft_limit * half
        effort = robot.effort_limit
        feet = [robot.keypoints.index(foot) for foot in robot.feet]
        robot_weight = 9.81 * float(robot.shared_model.body_mass.sum())

        def action_rate(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return (before["action"] - terms.last_action(before)).square().sum(-1)

        def joint_limit(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            joint_pos = after["state", "joint_pos"]
            return terms.limit_excess(joint_pos, soft_low.to(joint_pos), soft_high.to(joint_pos))

        def stray_contact(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return after["state", "stray_contacts"][:, 0]

        def torque(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            joint_torque = after["state", "joint_torque"]
            return (joint_torque / effort.to(joint_torque)).square().sum(-1)

        def slip(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return terms.foot_slip(after["state"], feet)

        def impact(before: TensorDictBase, after: TensorDictBase) -> Tensor:
            return (after["state", "foot_force"] / robot_weight - 2.0).clamp_min(0).sum(-1)

        return (
            terms.Reward("action_rate", self.action_rate, action_rate),
            terms.Reward("joint_limit", self.joint_limit, joint_limit),
            terms.Reward("stray_contact", self.stray_contact, stray_contact),
            terms.Reward("torque", self.torque, torque),
            terms.Reward("foot_slip", self.foot_slip, slip),
            terms.Reward("impact", self.impact, impact),
        )
