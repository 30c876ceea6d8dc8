"""Policies of the three stages, each a composition of the layers in :mod:`plat.modules`."""

from plat.modules.policies.critic import Critic
from plat.modules.policies.expert import Expert, ExpertConfig
from plat.modules.policies.refinement import (
    FinetunedPolicy,
    LatentNoisePolicy,
    Refinement,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.modules.policies.student import LatentPolicy, LatentPolicyConfig, PlainPolicy, PlainPolicyConfig
from plat.modules.policies.teacher import Teacher

__all__ = [
    "Critic",
    "Expert",
    "ExpertConfig",
    "FinetunedPolicy",
    "LatentNoisePolicy",
    "LatentPolicy",
    "LatentPolicyConfig",
    "PlainPolicy",
    "PlainPolicyConfig",
    "Refinement",
    "RefinementConfig",
    "ResidualActionPolicy",
    "ResidualLatentPolicy",
    "Teacher",
]
