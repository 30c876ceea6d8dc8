"""Losses and updates."""

from plat.objectives.divergence import gaussian_kl
from plat.objectives.imitation import LatentImitationLoss, plain_imitation_loss
from plat.objectives.ppo import PPO, PPOConfig

__all__ = ["PPO", "LatentImitationLoss", "PPOConfig", "gaussian_kl", "plain_imitation_loss"]
