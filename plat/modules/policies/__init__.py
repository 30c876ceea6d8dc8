"""Policies of the three stages, each a composition of the layers in :mod:`plat.modules`."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.modules.policies.critic import Critic
    from plat.modules.policies.expert import Expert
    from plat.modules.policies.refinement import (
        FinetunedPolicy,
        LatentNoisePolicy,
        Refinement,
        ResidualActionPolicy,
        ResidualLatentPolicy,
    )
    from plat.modules.policies.student import LatentPolicy, PlainPolicy
    from plat.modules.policies.teacher import Teacher
    from plat.modules.settings import ExpertConfig, LatentPolicyConfig, PlainPolicyConfig, RefinementConfig
else:
    lazy(__name__)

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
