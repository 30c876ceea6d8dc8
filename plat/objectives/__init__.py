"""Losses and their updates."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.objectives.divergence import gaussian_kl
    from plat.objectives.dynamics import DynamicsLoss
    from plat.objectives.exploitation import ExploitationWatch
    from plat.objectives.graphed import GraphedLoss
    from plat.objectives.imagination import ImaginationLoss, LatentImaginationLoss
    from plat.objectives.imagination_learner import ImaginationLearner, exploring
    from plat.objectives.imitation import ImitationLoss, LatentImitationLoss
    from plat.objectives.model_updates import ModelUpdates, ModelUpdatesBeside
    from plat.objectives.motor_gradient import motor_gradient
    from plat.objectives.muon import hidden_matrices, muon_and_adam
    from plat.objectives.ppo import PPO
    from plat.objectives.reference import ReferenceLoss
    from plat.objectives.settings import ImaginationConfig, MotorGradientConfig, PPOConfig
    from plat.precision import Precision, autocast, has_fast_bfloat16
else:
    lazy(__name__)

__all__ = [
    "PPO",
    "DynamicsLoss",
    "ExploitationWatch",
    "GraphedLoss",
    "ImaginationConfig",
    "ImaginationLearner",
    "ImaginationLoss",
    "ImitationLoss",
    "LatentImaginationLoss",
    "LatentImitationLoss",
    "ModelUpdates",
    "ModelUpdatesBeside",
    "MotorGradientConfig",
    "PPOConfig",
    "Precision",
    "ReferenceLoss",
    "autocast",
    "exploring",
    "gaussian_kl",
    "has_fast_bfloat16",
    "hidden_matrices",
    "motor_gradient",
    "muon_and_adam",
]
