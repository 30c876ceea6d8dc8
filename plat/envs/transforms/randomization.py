"""Domain randomization of the robot, its motors and the ground."""

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.tracking import MotionTrackingEnv

__all__ = ["DomainRandomization", "RandomizationRanges"]


@dataclass(frozen=True)
class RandomizationRanges:
    """Ranges of domain randomization, sampled uniformly at each reset. A range of width 0 switches its term off."""

    foot_friction: tuple[float, float] = (0.3, 1.2)
    """sliding friction of the soles"""
    torso_com: tuple[float, float, float] = (0.025, 0.05, 0.05)
    """half widths of the shift of the anchor body's center of mass (m)"""
    encoder_bias: float = 0.01
    """half width of the constant error of each joint encoder (rad)"""
    motor_gain: float = 0.1
    """half width of the relative error of each joint's stiffness and damping"""
    control_delay: float = 0.5
    """fraction of the robots whose targets arrive one control step late"""
    push_interval: tuple[float, float] = (1.0, 3.0)
    """seconds between pushes"""
    push_lin_vel: tuple[float, float, float] = (0.5, 0.5, 0.2)
    """half widths of the change of root velocity by a push (m/s, world)"""
    push_ang_vel: tuple[float, float, float] = (0.52, 0.52, 0.78)
    """half widths of the change of root angular velocity by a push (rad/s, root frame)"""


class DomainRandomization(Transform):
    """Domain randomization: samples model parameters at each reset and pushes the robots at random intervals.

    Args:
        env: the simulated robots, whose physics it changes.
        ranges: ranges of the parameters.

    Source: the randomization of BeyondMimic, arXiv 2508.08241.
    """

    def __init__(self, env: MotionTrackingEnv, ranges: RandomizationRanges | None = None):
        super().__init__()
        self._env = [env]  # in a list: nn.Module would otherwise adopt the environment as a child
        self._ranges = ranges or RandomizationRanges()
        self._steps_to_push = self._draw_intervals(env.num_envs)

    def _draw_intervals(self, count: int) -> Tensor:
        low, high = (seconds / self._env[0].library.dt for seconds in self._ranges.push_interval)
        return (low + (high - low) * torch.rand(count)).long().clamp_min(1)

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        env = self._env[0]
        mask = None if tensordict is None else tensordict.get("_reset", None)
        ids = torch.arange(env.num_envs) if mask is None else mask.view(-1).cpu().nonzero()[:, 0]
        self._randomize(ids)
        return tensordict

    def _randomize(self, ids: Tensor) -> None:
        env, ranges, count = self._env[0], self._ranges, len(ids)
        joints = env.robot.num_joints
        low, high = ranges.foot_friction
        friction = low + (high - low) * torch.rand(count, 1, dtype=torch.float64)
        env.physics.set_friction(ids, env.robot.feet, friction[:, 0])
        if any(ranges.torso_com):
            shift = torch.tensor(ranges.torso_com, dtype=torch.float64) * _uniform(count, 3)
            env.physics.set_com(ids, env.robot.anchor, shift)
        stiffness = 1 + ranges.motor_gain * _uniform(count, joints)
        damping = 1 + ranges.motor_gain * _uniform(count, joints)
        env.physics.set_gains(ids, stiffness, damping)
        rows = ids.to(env.device)
        env.encoder_bias[rows] = ranges.encoder_bias * _uniform(count, joints).to(env.encoder_bias)
        env.delayed[rows] = (torch.rand(count) < ranges.control_delay).to(env.device)
        self._steps_to_push[ids] = self._draw_intervals(count)

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        self._steps_to_push -= 1
        due = (self._steps_to_push <= 0).nonzero()[:, 0]
        if len(due):
            env = self._env[0]
            push = torch.tensor((*self._ranges.push_lin_vel, *self._ranges.push_ang_vel), dtype=torch.float64)
            env.physics.push(due, push * _uniform(len(due), 6))
            self._steps_to_push[due] = self._draw_intervals(len(due))
        return tensordict


def _uniform(*shape: int) -> Tensor:
    return 2 * torch.rand(shape, dtype=torch.float64) - 1
