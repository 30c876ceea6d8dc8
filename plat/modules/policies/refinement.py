"""Stage 3: refinements of a student by reinforcement learning, each a composition of the same modules.

A refinement has four views. ``frozen()`` writes features and never changes. ``head()`` is the stochastic part that
learns; it reads those features, so that an update does not run the frozen part again. ``actor()`` is both, down to the
action. ``deployed()`` is the deterministic policy.
"""

import copy

from tensordict import NestedKey
from tensordict.nn import (
    ProbabilisticTensorDictSequential,
    TensorDictModule,
    TensorDictModuleBase,
    TensorDictSequential,
)
from torch import nn

from plat.errors import ConfigError
from plat.modules.deployed import DeployedPolicy, timed
from plat.modules.heads import GaussianNoise, gaussian_action
from plat.modules.lead import KeyframeLead, led
from plat.modules.policies.student import LatentPolicy, Shown, on_both_sides
from plat.modules.residual import Residual
from plat.modules.settings import RefinementConfig
from plat.spec.timing import Timing

__all__ = [
    "FinetunedPolicy",
    "LatentNoisePolicy",
    "Refinement",
    "RefinementConfig",
    "ResidualActionPolicy",
    "ResidualLatentPolicy",
]


class Refinement(nn.Module):
    """Base class of the refinements: frozen features, a head that learns, and what follows the head.

    It works on a copy of the student: the student that is handed in stays as it is.

    Args:
        student: policy of stage 2.
        config: sizes and exploration.
        noise: exploration noise, from ``loc`` to ``loc`` and ``scale``; None for one with a learned scale.
        freeze: the student's weights do not learn; else all of them do.

    Raises:
        ConfigError: for a student without a latent.
    """

    sample_key: str = "action"
    """The entry that the head's distribution is over."""

    def __init__(
        self,
        student: LatentPolicy,
        config: RefinementConfig | None = None,
        *,
        noise: TensorDictModuleBase | None = None,
        freeze: bool = True,
    ):
        super().__init__()
        if not hasattr(student, "prior"):
            raise ConfigError(f"refinement: student is a {type(student).__name__}, expected a LatentPolicy")
        self.config = config = config or RefinementConfig()
        self.robot = student.robot
        self.student = copy.deepcopy(student, {id(student.robot): student.robot})
        # the student of a refinement is frozen, and its copy would be; requires_grad_() refuses lazy layers that wait
        # for their weights
        for parameter in self.student.parameters():
            parameter.requires_grad = not freeze
        self.noise = noise or GaussianNoise(self.num_samples, config.init_std, config.min_std)

    @classmethod
    def build(cls, student: LatentPolicy, config: RefinementConfig) -> "Refinement":
        """Return the policy that a saved ``config`` describes. A subclass hands parts of its own over here."""
        return cls(student, config)

    @property
    def num_samples(self) -> int:
        """Return the size of what is sampled."""
        return self.robot.num_joints

    @property
    def timing(self) -> Timing:
        """Return the time constants of the student."""
        return self.student.timing

    def shown(self) -> Shown:
        """Return what comes before the student, and where the student then finds its observation."""
        before, keys = self.student.shown()
        if not self.config.lead:
            return before, keys
        group = "near_goal" if before else "goal"
        parts = "parts" in self.student.config.also
        lead = KeyframeLead(self.config.lead, self.timing.longest, self.config.shortest_lead, group, parts)
        return [*before, lead], led(keys, lead)

    def frozen(self, shown: Shown | None = None) -> TensorDictModuleBase:
        """Return the part that never changes: writes what the head reads.

        Args:
            shown: what comes before the student, and where its observation then is; None for :meth:`shown`.
        """
        before, keys = shown or self.shown()
        return TensorDictSequential(*before, self.student.features(keys))

    def mean(self) -> list[TensorDictModuleBase]:
        """Return the learning part: from features to ``loc``, the mean of what is sampled."""
        raise NotImplementedError

    def after_sample(self, key: str) -> list[TensorDictModuleBase]:
        """Return what leads from the sample, at ``key``, to the action."""
        return []

    def head(self) -> ProbabilisticTensorDictSequential:
        """Return the stochastic part that learns, for PPO."""
        return ProbabilisticTensorDictSequential(*self.mean(), self.noise, gaussian_action(self.sample_key))

    def actor(self) -> TensorDictSequential:
        """Return the policy that collects; the rollout holds all that :meth:`head` reads."""
        features = self.frozen()
        kept = [*features.out_keys, "loc", "scale", f"{self.sample_key}_log_prob", self.sample_key, "action"]
        parts = (features, self.head(), *self.after_sample(self.sample_key))
        return timed(TensorDictSequential(*parts, selected_out_keys=list(dict.fromkeys(kept))), self.timing)

    def deployed(self) -> DeployedPolicy:
        """Return the deterministic policy, of both sides if its student is symmetric: writes ``action``."""
        before, keys, after = on_both_sides(self.robot, self.student.config, self.shown())
        if self.sample_key == "action":
            rename = [TensorDictModule(nn.Identity(), in_keys=["loc"], out_keys=["action"])]
        else:
            rename = self.after_sample("loc")
        # a subclass of one's own may have a frozen() without arguments, which serves one side
        features = self.frozen((before, keys)) if after else self.frozen()
        return DeployedPolicy(features, *self.mean(), *rename, *after, timing=self.timing)


class ResidualLatentPolicy(Refinement):
    """PLAT: residual in the latent, ``a = pi(h, mu_p + alpha R(h, mu_p))``, with exploration noise on the action.

    Backbone, prior and decoder are frozen.

    Args:
        student: policy of stage 2; a copy of it is frozen.
        config: sizes and exploration.
        residual: from the student's features to ``refined_latent``; None for a :class:`plat.modules.Residual`.
        noise: exploration noise; None for one with a learned scale.

    >>> from plat.robots import G1
    >>> policy = ResidualLatentPolicy(LatentPolicy(G1))
    >>> sorted({name.split(".")[0] for name, weight in policy.named_parameters() if weight.requires_grad})
    ['noise', 'residual']
    """

    def __init__(
        self,
        student: LatentPolicy,
        config: RefinementConfig | None = None,
        *,
        residual: TensorDictModuleBase | None = None,
        noise: TensorDictModuleBase | None = None,
    ):
        super().__init__(student, config, noise=noise)
        latent_size = student.config.latent_size
        self.residual = residual or _residual(student, self.config, latent_size, student.mode, "refined_latent")

    def mean(self) -> list[TensorDictModuleBase]:
        """Return the corrected latent, decoded."""
        return [self.residual, self.student.decoder.using("hidden", "refined_latent", out_key="loc")]


class LatentNoisePolicy(ResidualLatentPolicy):
    """PLAT with exploration in the latent: noise on the corrected latent, which is then decoded.

    PPO's action is the latent, so exploration moves along what the decoder knows.
    """

    sample_key = "sampled_latent"

    @property
    def num_samples(self) -> int:
        """Return the size of the latent."""
        return self.student.config.latent_size

    def mean(self) -> list[TensorDictModuleBase]:
        """Return the corrected latent."""
        return [self.residual, TensorDictModule(nn.Identity(), in_keys=["refined_latent"], out_keys=["loc"])]

    def after_sample(self, key: str) -> list[TensorDictModuleBase]:
        """Return the decoder."""
        return [self.student.decoder.using("hidden", key)]


class ResidualActionPolicy(Refinement):
    """Residual-action ablation: ``a = pi(h, mu_p) + alpha R(h, mu_p)``, student frozen.

    Args:
        student: policy of stage 2; a copy of it is frozen.
        config: sizes and exploration.
        residual: from the student's features and ``base_action`` to ``loc``; None for a
            :class:`plat.modules.Residual`.
        noise: exploration noise; None for one with a learned scale.
    """

    def __init__(
        self,
        student: LatentPolicy,
        config: RefinementConfig | None = None,
        *,
        residual: TensorDictModuleBase | None = None,
        noise: TensorDictModuleBase | None = None,
    ):
        super().__init__(student, config, noise=noise)
        self.residual = residual or _residual(student, self.config, self.robot.num_joints, "base_action", "loc")

    def frozen(self, shown: Shown | None = None) -> TensorDictModuleBase:
        """Return the features and the student's action."""
        decode = self.student.decoder.using("hidden", self.student.mode, out_key="base_action")
        return TensorDictSequential(super().frozen(shown), decode)

    def mean(self) -> list[TensorDictModuleBase]:
        """Return the corrected action."""
        return [self.residual]


class FinetunedPolicy(Refinement):
    """Direct-fine-tuning ablation: PPO on every deployed weight of a copy of the student.

    Args:
        student: policy of stage 2, where learning starts.
        config: exploration.
        noise: exploration noise; None for one with a learned scale.
    """

    def __init__(
        self,
        student: LatentPolicy,
        config: RefinementConfig | None = None,
        *,
        noise: TensorDictModuleBase | None = None,
    ):
        super().__init__(student, config, noise=noise, freeze=False)

    def frozen(self, shown: Shown | None = None) -> TensorDictModuleBase:
        """Return the normalized observation: its statistics stay as they are."""
        before, keys = shown or self.shown()
        return TensorDictSequential(*before, self.student.normalizer.using(keys))

    def mean(self) -> list[TensorDictModuleBase]:
        """Return backbone, prior mean and decoder."""
        student = self.student
        return [student.backbone, student.prior, student.decoder.using("hidden", student.mode, out_key="loc")]


def _residual(
    student: LatentPolicy, config: RefinementConfig, num_outputs: int, base: NestedKey, out_key: str
) -> Residual:
    shape = student.config
    keys = ("hidden", student.mode, base)
    return Residual(shape.hidden_size, shape.latent_size, num_outputs, config.hidden, config.alpha, keys, out_key)
