"""Domain randomization of the robot, its motors and the ground."""

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.envs.randomized_physics import PhysicsDraw, RandomizedPhysics
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms.settings import RandomizationRanges

__all__ = ["DomainRandomization", "RandomizationRanges", "apply_draw"]


class DomainRandomization(Transform):
    """Domain randomization: samples model parameters at each reset and pushes the robots at random intervals.

    Args:
        env: the simulated robots, whose physics it changes.
        ranges: ranges of the parameters.
    """

    def __init__(self, env: MotionTrackingEnv, ranges: RandomizationRanges | None = None):
        super().__init__()
        self._env = [env]  # in a list: nn.Module would otherwise adopt the environment as a child
        ranges = ranges or RandomizationRanges()
        self._random = RandomizedPhysics(env.robot, env.physics, env.num_envs, ranges, env.library.dt)

    @property
    def _steps_to_push(self) -> Tensor:
        return self._random.clock.steps

    def get_extra_state(self) -> Tensor:
        """Return, for :meth:`state_dict`, the steps to each robot's next push; the parameters are the physics'."""
        return self._steps_to_push.clone()

    def set_extra_state(self, state: Tensor) -> None:
        """Restore what :meth:`get_extra_state` returned."""
        self._random.clock.steps = state.clone()

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase | None:
        env = self._env[0]
        mask = None if tensordict is None else tensordict.get("_reset", None)
        ids = torch.arange(env.num_envs) if mask is None else mask.view(-1).cpu().nonzero()[:, 0]
        apply_draw(env, self._random.draw(ids), ids)
        return tensordict

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        self._random.push()
        return tensordict


def apply_draw(env: MotionTrackingEnv, drawn: PhysicsDraw, ids: Tensor) -> None:
    """Set what an environment keeps of the drawn robots ``[n]`` beside their physics."""
    rows = ids.to(env.device)
    env.encoder_bias[rows] = drawn.encoder_bias.to(env.encoder_bias)
    env.gyro_bias[rows] = drawn.gyro_bias.to(env.gyro_bias)
    env.velocity_bias[rows] = drawn.velocity_bias.to(env.velocity_bias)
    env.delay[rows] = drawn.delay.to(env.device)
    env.drift[rows] = drawn.drift.to(env.drift)
    env.drift_rate[rows] = drawn.drift_rate.to(env.drift_rate)
