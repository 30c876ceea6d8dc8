"""Another residual in stage 3: a linear map shifts the frozen student's latent, and PPO trains it.

python examples/shifted_latent.py
"""

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

import plat
from plat.collectors import rollouts
from plat.envs import make_keyframe_env
from plat.modules import STUDENT_KEYS, Critic, LatentPolicy, ResidualLatentPolicy
from plat.motions import MotionLibrary
from plat.objectives import PPO, PPOConfig
from plat.robots import G1


class Shift(nn.Module):
    """A linear map of the features, added to the latent."""

    def __init__(self, hidden_size: int, latent_size: int):
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(latent_size, hidden_size))  # at first it is the student

    def forward(self, hidden: Tensor, latent: Tensor) -> Tensor:
        return latent + nn.functional.linear(hidden, self.weight)


student = plat.load("dagger-g1")
assert isinstance(student, LatentPolicy)
shift = Shift(student.config.hidden_size, student.config.latent_size)
residual = TensorDictModule(shift, ["hidden", ("prior", "loc")], ["refined_latent"])
policy = ResidualLatentPolicy(student, residual=residual)
critic = Critic(G1, STUDENT_KEYS)
ppo = PPO(policy.head(), critic.head(), critic.observe(), PPOConfig(lr=3e-4, entropy=0.0))
env = make_keyframe_env(MotionLibrary.load(["generated:train@60"]), num_envs=16)
for number, rollout in enumerate(rollouts(env, policy.actor(), steps=8)):
    metrics = ppo.step(rollout)  # a dictionary: policy_loss, kl, ...
    critic.normalizer.update(rollout)
    if number == 2:
        break
