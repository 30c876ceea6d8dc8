"""Rewards: dense tracking, keyframes in their arrival window, and regularisation.

Every term is a small function of the entries of a step, with its weight and scale in a dataclass. The rewards of the
transforms in an environment add up.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.transforms.base import Statistics
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = [
    "DenseRewards",
    "DenseTrackingReward",
    "KeyframeReward",
    "KeyframeRewards",
    "Regularisation",
    "RegularisationReward",
    "Term",
]


@dataclass(frozen=True)
class Term:
    """A tracking term: ``weight * exp(-squared_error / scale**2)``."""

    weight: float
    scale: float


@dataclass(frozen=True)
class DenseRewards:
    """Frame-by-frame tracking. Source: the rewards of BeyondMimic, arXiv 2508.08241, with twice its ``anchor_pos``
    and a term on the joints."""

    anchor_pos: Term = Term(1.0, 0.3)
    """m, world"""
    anchor_rot: Term = Term(0.5, 0.4)
    """rad"""
    keypoint_pos: Term = Term(1.0, 0.3)
    """m, aligned to the robot's anchor"""
    keypoint_rot: Term = Term(1.0, 0.4)
    """rad, aligned"""
    keypoint_lin_vel: Term = Term(1.0, 1.0)
    """m/s, world"""
    keypoint_ang_vel: Term = Term(1.0, 3.14)
    """rad/s, world"""
    joint_pos: Term = Term(1.5, 0.15)
    """rad; the other terms hardly see how wrists and elbows are turned"""


@dataclass(frozen=True)
class KeyframeRewards:
    """Reaching a commanded keyframe, paid at each step of its arrival window."""

    joint_pos: Term = Term(1.0, 0.2)
    """rad"""
    keypoint_pos: Term = Term(1.0, 0.2)
    """m, world"""
    anchor_rot: Term = Term(0.5, 0.4)
    """rad"""


@dataclass(frozen=True)
class Regularisation:
    """Penalties; the weights are negative, and a weight of 0 switches a term off."""

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
    """the least that the penalties of a step add up to, so that what a robot does on its way to the ground is not all
    that a critic learns; None for no such bound"""
    soft_limit: float = 0.95
    """share of each joint's range, about its middle, that is free"""


class _Reward(Transform):
    """Adds ``weight * dt * sum of terms`` to the reward of a step."""

    def __init__(self, dt: float, weight: float):
        super().__init__()
        self.statistics = Statistics()
        self._dt = dt
        self._weight = weight

    def terms(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> dict[str, Tensor]:
        """Weighted terms ``[N]`` of a step."""
        raise NotImplementedError

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        terms = self.terms(tensordict, next_tensordict)
        for name, value in terms.items():
            self.statistics.add(f"reward/{name}", value)
        if terms:
            total = torch.stack(list(terms.values())).sum(0)
            next_tensordict["reward"] = next_tensordict["reward"] + (self._weight * self._dt) * total[:, None]
        return next_tensordict


class DenseTrackingReward(_Reward):
    """How closely the robot follows the reference at this frame. Needs :class:`ReferenceMotion` before it.

    Args:
        robot: names the anchor.
        dt: control step (s); rewards are per second of motion.
        rewards: weights and scales.
        weight: factor on all terms, ``w_dense`` of the paper.
    """

    def __init__(self, robot: Robot, dt: float, rewards: DenseRewards | None = None, weight: float = 1.0):
        super().__init__(dt, weight)
        self._anchor = robot.anchor_index
        self._rewards = rewards or DenseRewards()

    def terms(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> dict[str, Tensor]:
        """Dense terms ``[N]``."""
        state, reference = next_tensordict["state"], next_tensordict["reference"]
        rewards = self._rewards
        squared_errors: dict[str, tuple[Term, Callable[[], Tensor]]] = {
            "anchor_pos": (rewards.anchor_pos, lambda: anchor_pos_error(state, reference, self._anchor)),
            "anchor_rot": (rewards.anchor_rot, lambda: anchor_rot_error(state, reference, self._anchor)),
            "keypoint_pos": (
                rewards.keypoint_pos,
                lambda: squared_distance(state["keypoint_pos_w"], reference["keypoint_pos_aligned_w"]),
            ),
            "keypoint_rot": (rewards.keypoint_rot, lambda: keypoint_rot_error(state, reference)),
            "keypoint_lin_vel": (
                rewards.keypoint_lin_vel,
                lambda: squared_distance(state["keypoint_lin_vel_w"], reference["keypoint_lin_vel_w"]),
            ),
            "keypoint_ang_vel": (
                rewards.keypoint_ang_vel,
                lambda: squared_distance(state["keypoint_ang_vel_w"], reference["keypoint_ang_vel_w"]),
            ),
            "joint_pos": (rewards.joint_pos, lambda: joint_pos_error(state, reference)),
        }
        distance = torch.linalg.vector_norm(state["keypoint_pos_w"] - reference["keypoint_pos_aligned_w"], dim=-1)
        self.statistics.add("error/keypoint_aligned", distance)
        return _kernels(squared_errors)


class KeyframeReward(_Reward):
    """How close the robot is to the commanded motion in the arrival window; 0 outside it.

    Needs :class:`ReferenceMotion` and :class:`KeyframeClock` before it.

    Args:
        robot: names the anchor.
        dt: control step (s).
        rewards: weights and scales.
        weight: factor on all terms, ``w_sparse`` of the paper.
    """

    def __init__(self, robot: Robot, dt: float, rewards: KeyframeRewards | None = None, weight: float = 1.0):
        super().__init__(dt, weight)
        self._anchor = robot.anchor_index
        self._rewards = rewards or KeyframeRewards()

    def terms(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> dict[str, Tensor]:
        """Keyframe terms ``[N]``."""
        state, reference = next_tensordict["state"], next_tensordict["reference"]
        rewards = self._rewards
        terms = _kernels(
            {
                "keyframe_joint_pos": (rewards.joint_pos, lambda: joint_pos_error(state, reference)),
                "keyframe_keypoint_pos": (
                    rewards.keypoint_pos,
                    lambda: squared_distance(state["keypoint_pos_w"], reference["keypoint_pos_w"]),
                ),
                "keyframe_anchor_rot": (
                    rewards.anchor_rot,
                    lambda: anchor_rot_error(state, reference, self._anchor),
                ),
            }
        )
        in_window = next_tensordict["command", "in_window"][:, 0]
        return {name: value * in_window for name, value in terms.items()}


class RegularisationReward(_Reward):
    """What a real robot should not do: jerk, hit its limits, slip, stamp.

    Args:
        robot: gives limits, feet and weight.
        dt: control step (s).
        weights: one a term.
        weight: factor on all terms, ``w_reg`` of the paper.
    """

    def __init__(self, robot: Robot, dt: float, weights: Regularisation | None = None, weight: float = 1.0):
        super().__init__(dt, weight)
        weights = weights or Regularisation()
        self._weights = asdict(weights)
        self._floor = weights.floor
        middle, half = robot.joint_range.mean(-1), 0.5 * (robot.joint_range[:, 1] - robot.joint_range[:, 0])
        self.register_buffer("_soft_low", middle - weights.soft_limit * half, persistent=False)
        self.register_buffer("_soft_high", middle + weights.soft_limit * half, persistent=False)
        self.register_buffer("_effort", robot.effort_limit, persistent=False)
        self._feet = [robot.keypoints.index(foot) for foot in robot.feet]
        self._robot_weight = 9.81 * float(robot.model().body_mass.sum())

    def terms(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> dict[str, Tensor]:
        """Penalties ``[N]``."""
        state = next_tensordict["state"]
        penalties: dict[str, Callable[[], Tensor]] = {
            "action_rate": lambda: (tensordict["action"] - tensordict["robot", "last_action"]).square().sum(-1),
            "joint_limit": lambda: limit_excess(state["joint_pos"], self._soft_low, self._soft_high),
            "stray_contact": lambda: state["stray_contacts"][:, 0],
            "torque": lambda: (state["joint_torque"] / self._effort).square().sum(-1),
            "foot_slip": lambda: foot_slip(state, self._feet),
            "impact": lambda: (state["foot_force"] / self._robot_weight - 2.0).clamp_min(0).sum(-1),
        }
        weights = self._weights
        terms = {name: weights[name] * penalty() for name, penalty in penalties.items() if weights[name] != 0}
        if not terms or self._floor is None:
            return terms
        total = torch.stack(list(terms.values())).sum(0)
        kept = self._floor / total.clamp_max(self._floor)
        return {name: value * kept for name, value in terms.items()}


def _kernels(squared_errors: dict[str, tuple[Term, Callable[[], Tensor]]]) -> dict[str, Tensor]:
    return {
        name: term.weight * torch.exp(error() / -(term.scale**2))
        for name, (term, error) in squared_errors.items()
        if term.weight != 0
    }


def squared_distance(actual: Tensor, wanted: Tensor) -> Tensor:
    """Mean over keypoints of the squared distance: ``[N, K, 3]`` to ``[N]``."""
    # summed at one go: reducing over a last dimension of 3 alone is several times slower
    return (actual - wanted).square().flatten(1).sum(-1) / actual.shape[1]


def joint_pos_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Mean over joints of the squared error ``[N]`` (rad^2)."""
    return (state["joint_pos"] - reference["joint_pos"]).square().mean(-1)


def anchor_pos_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Squared distance ``[N]`` (m^2, world) of the anchor body from its reference."""
    return (state["keypoint_pos_w"][:, anchor] - reference["keypoint_pos_w"][:, anchor]).square().sum(-1)


def anchor_rot_error(state: TensorDictBase, reference: TensorDictBase, anchor: int) -> Tensor:
    """Squared angle ``[N]`` (rad^2) between the anchor body and its reference."""
    return quat_angle(state["keypoint_quat_w"][:, anchor], reference["keypoint_quat_w"][:, anchor]).square()


def keypoint_rot_error(state: TensorDictBase, reference: TensorDictBase) -> Tensor:
    """Mean over keypoints of the squared angle ``[N]`` (rad^2) to the aligned reference."""
    return quat_angle(state["keypoint_quat_w"], reference["keypoint_quat_aligned_w"]).square().mean(-1)


def limit_excess(joint_pos: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Sum over joints ``[N]`` (rad) of how far angles are beyond the limits."""
    return ((low - joint_pos).clamp_min(0) + (joint_pos - high).clamp_min(0)).sum(-1)


def foot_slip(state: TensorDictBase, feet: list[int], loaded: float = 5.0) -> Tensor:
    """Sum over feet ``[N]`` ((m/s)^2) of the squared horizontal speed of those that bear over ``loaded`` N."""
    speed = state["keypoint_lin_vel_w"][:, feet, :2].square().sum(-1)
    return (speed * (state["foot_force"] > loaded)).sum(-1)
