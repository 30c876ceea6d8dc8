"""Stage 3: what reinforcement learning may change of a student, each choice a composition of the same modules.

Every class here has the same parts. ``frozen`` writes features and never changes; ``head()`` is the stochastic part
that learns and reads those features, so that an update need not run the frozen part again; ``actor()`` is both,
down to the action; ``deployed()`` is the deterministic policy.
"""

from dataclasses import dataclass

from tensordict import NestedKey
from tensordict.nn import (
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from torch import nn

from plat.modules.heads import GaussianNoise, gaussian_action
from plat.modules.lead import KeyframeLead, led
from plat.modules.policies.student import LatentPolicy
from plat.modules.residual import Residual
from plat.spec.observation import student_keys
from plat.spec.timing import Timing

__all__ = [
    "FinetunedPolicy",
    "LatentNoisePolicy",
    "RefinementConfig",
    "ResidualActionPolicy",
    "ResidualLatentPolicy",
]

_PRIOR_MEAN = ("prior", "loc")


@dataclass(frozen=True)
class RefinementConfig:
    """Size of the residual and exploration around the student."""

    hidden: tuple[int, ...] = (256, 128)
    """hidden layers of the residual"""
    alpha: float = 0.5
    """scale of the residual"""
    init_std: float = 0.2
    """exploration noise at the start, in units of what it is added to"""
    lead: float = 0.0
    """seconds by which the keyframe is shown ahead along the way to it, to a student that otherwise arrives late"""


class _Refinement(nn.Module):
    """What the variants share: acting is the frozen features, the head, and what follows the head."""

    sample_key: str = "action"
    """The entry that the head's distribution is over."""

    def __init__(self, student: LatentPolicy, config: RefinementConfig | None, num_samples: int):
        super().__init__()
        self.config = config or RefinementConfig()
        self.robot = student.robot
        self.student = student
        self.noise = GaussianNoise(num_samples, self.config.init_std)

    @property
    def timing(self) -> Timing:
        """Time constants of the student."""
        return self.student.timing

    def shown(self) -> tuple[list[TensorDictModuleBase], list[NestedKey]]:
        """What comes before the student, and where the student then finds its observation."""
        if not self.config.lead:
            return [], list(student_keys())
        lead = KeyframeLead(self.config.lead, self.timing.longest)
        return [lead], led(student_keys(), lead)

    def frozen(self) -> TensorDictModuleBase:
        """The part that never changes: writes what the head reads."""
        before, keys = self.shown()
        return TensorDictSequential(*before, self.student.features(keys))

    def mean(self) -> list[TensorDictModuleBase]:
        """The learning part: from features to ``loc``, the mean of what is sampled."""
        raise NotImplementedError

    def after_sample(self, key: str) -> list[TensorDictModuleBase]:
        """From what is sampled, at ``key``, to the action."""
        return []

    def head(self) -> ProbabilisticTensorDictSequential:
        """The stochastic part that learns, for PPO."""
        return ProbabilisticTensorDictSequential(*self.mean(), self.noise, gaussian_action(self.sample_key))

    def actor(self) -> TensorDictSequential:
        """The policy that collects; the rollout holds all that :meth:`head` reads."""
        features = self.frozen()
        kept = [*features.out_keys, "loc", "scale", f"{self.sample_key}_log_prob", self.sample_key, "action"]
        return TensorDictSequential(
            features, self.head(), *self.after_sample(self.sample_key), selected_out_keys=list(dict.fromkeys(kept))
        )

    def deployed(self) -> TensorDictSequential:
        """The deterministic policy: writes ``action``."""
        if self.sample_key == "action":
            rename = [TensorDictModule(nn.Identity(), in_keys=["loc"], out_keys=["action"])]
        else:
            rename = self.after_sample("loc")
        return TensorDictSequential(self.frozen(), *self.mean(), *rename, selected_out_keys=["action"])


class ResidualLatentPolicy(_Refinement):
    """PLAT with ``a = pi(h, mu_p + alpha R(h, mu_p))``, backbone, prior and decoder frozen, and noise on the action.

    Args:
        student: policy of stage 2; its weights are frozen here.
        config: sizes and exploration.

    >>> from plat.robots import G1
    >>> policy = ResidualLatentPolicy(LatentPolicy(G1))
    >>> sorted({name.split(".")[0] for name, weight in policy.named_parameters() if weight.requires_grad})
    ['noise', 'residual']
    """

    def __init__(
        self, student: LatentPolicy, config: RefinementConfig | None = None, *, num_samples: int | None = None
    ):
        super().__init__(student.requires_grad_(False), config, num_samples or student.robot.num_joints)
        shape = student.config
        self.residual = _residual(student, self.config, shape.latent_size, _PRIOR_MEAN, "refined_latent")

    def mean(self) -> list[TensorDictModuleBase]:
        """The corrected latent, decoded."""
        return [self.residual, self.student.decoder.using("hidden", "refined_latent", out_key="loc")]


class LatentNoisePolicy(ResidualLatentPolicy):
    """PLAT with exploration in the latent: noise on the corrected latent, which is then decoded.

    What is sampled, and what PPO sees as the action, is the latent; exploration moves along what the decoder knows.
    """

    sample_key = "sampled_latent"

    def __init__(self, student: LatentPolicy, config: RefinementConfig | None = None):
        super().__init__(student, config, num_samples=student.config.latent_size)

    def mean(self) -> list[TensorDictModuleBase]:
        """The corrected latent."""
        return [self.residual, TensorDictModule(nn.Identity(), in_keys=["refined_latent"], out_keys=["loc"])]

    def after_sample(self, key: str) -> list[TensorDictModuleBase]:
        """The decoder."""
        return [self.student.decoder.using("hidden", key)]


class ResidualActionPolicy(_Refinement):
    """The residual-action ablation: ``a = pi(h, mu_p) + alpha R(h, mu_p)``, student frozen.

    Args:
        student: policy of stage 2; its weights are frozen here.
        config: sizes and exploration.
    """

    def __init__(self, student: LatentPolicy, config: RefinementConfig | None = None):
        super().__init__(student.requires_grad_(False), config, student.robot.num_joints)
        self.residual = _residual(student, self.config, student.robot.num_joints, "base_action", "loc")

    def frozen(self) -> TensorDictModuleBase:
        """Features and the student's action."""
        return TensorDictSequential(
            super().frozen(), self.student.decoder.using("hidden", _PRIOR_MEAN, out_key="base_action")
        )

    def mean(self) -> list[TensorDictModuleBase]:
        """The corrected action."""
        return [self.residual]


class FinetunedPolicy(_Refinement):
    """The direct-fine-tuning ablation: PPO on every deployed weight of the student.

    Args:
        student: policy of stage 2; a starting point that changes.
        config: exploration.
    """

    def __init__(self, student: LatentPolicy, config: RefinementConfig | None = None):
        super().__init__(student, config, student.robot.num_joints)

    def frozen(self) -> TensorDictModuleBase:
        """The normalised observation: its statistics stay as they are."""
        before, keys = self.shown()
        return TensorDictSequential(*before, self.student.normalizer.using(keys))

    def mean(self) -> list[TensorDictModuleBase]:
        """Backbone, prior mean and decoder."""
        student = self.student
        return [student.backbone, student.prior, student.decoder.using("hidden", _PRIOR_MEAN, out_key="loc")]


def _residual(
    student: LatentPolicy, config: RefinementConfig, num_outputs: int, base: NestedKey, out_key: str
) -> Residual:
    shape = student.config
    keys = ("hidden", _PRIOR_MEAN, base)
    return Residual(shape.hidden_size, shape.latent_size, num_outputs, config.hidden, config.alpha, keys, out_key)
