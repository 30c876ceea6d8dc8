"""Networks of PLAT, each a TensorDict module, and the policies composed of them."""

from typing import TYPE_CHECKING

from plat.lazy import lazy

if TYPE_CHECKING:
    from plat.modules.backbone import Backbone
    from plat.modules.decoder import ActionDecoder
    from plat.modules.deployed import DeployedPolicy
    from plat.modules.dynamics import DynamicsModel
    from plat.modules.goal_encoder import GoalSequenceEncoder
    from plat.modules.heads import GaussianNoise, ReferenceOffset, gaussian_action
    from plat.modules.keyframe_reach import KeyframeReach
    from plat.modules.latent import GaussianLatent, LatentPosterior, LatentPrior, sample_latent
    from plat.modules.lead import GoalLead, KeyframeLead
    from plat.modules.networks import mlp
    from plat.modules.normalizer import ObservationNormalizer
    from plat.modules.policies import (
        Critic,
        Expert,
        FinetunedPolicy,
        LatentNoisePolicy,
        LatentPolicy,
        PlainPolicy,
        Refinement,
        ResidualActionPolicy,
        ResidualLatentPolicy,
        Teacher,
    )
    from plat.modules.residual import Residual
    from plat.modules.settings import (
        DynamicsConfig,
        ExpertConfig,
        LatentPolicyConfig,
        NormalizerConfig,
        PlainPolicyConfig,
        RefinementConfig,
        WalkingReach,
    )
    from plat.modules.symmetry import BothSides, MeanOfSides
    from plat.modules.widening import take_over
    from plat.spec.observation import STUDENT_KEYS
else:
    lazy(__name__)

__all__ = [
    "STUDENT_KEYS",
    "ActionDecoder",
    "Backbone",
    "BothSides",
    "Critic",
    "DeployedPolicy",
    "DynamicsConfig",
    "DynamicsModel",
    "Expert",
    "ExpertConfig",
    "FinetunedPolicy",
    "GaussianLatent",
    "GaussianNoise",
    "GoalLead",
    "GoalSequenceEncoder",
    "KeyframeLead",
    "KeyframeReach",
    "LatentNoisePolicy",
    "LatentPolicy",
    "LatentPolicyConfig",
    "LatentPosterior",
    "LatentPrior",
    "MeanOfSides",
    "NormalizerConfig",
    "ObservationNormalizer",
    "PlainPolicy",
    "PlainPolicyConfig",
    "ReferenceOffset",
    "Refinement",
    "RefinementConfig",
    "Residual",
    "ResidualActionPolicy",
    "ResidualLatentPolicy",
    "Teacher",
    "WalkingReach",
    "gaussian_action",
    "mlp",
    "sample_latent",
    "take_over",
]
