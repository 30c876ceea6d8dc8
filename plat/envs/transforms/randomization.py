"""Domain randomization of the robot, its motors and the ground."""

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms.settings import RandomizationRanges

__all__ = ["DomainRandomization", "RandomizationRanges"]


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

    def get_extra_state(self) -> Tensor:
        """Return, for :meth:`state_dict`, the steps to each robot's next push; the parameters are the physics'."""
        return self._steps_to_push

    def set_extra_state(self, state: Tensor) -> None:
        """Restore what :meth:`get_extra_state` returned."""
        self._steps_to_push = state.clone()

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
