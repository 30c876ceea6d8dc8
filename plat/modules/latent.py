"""Gaussian latents: the deployable prior ``P_theta`` and the privileged posterior ``Q_phi``."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import InteractionType, ProbabilisticTensorDictModule, TensorDictModule
from torch import Tensor, nn
from torchrl.modules import IndependentNormal, NormalParamExtractor

from plat.bounds import Count, NonNegative, check_value
from plat.entries import expects
from plat.modules.networks import mlp

__all__ = ["GaussianLatent", "LatentPosterior", "LatentPrior", "sample_latent"]


class GaussianLatent(TensorDictModule):
    """Diagonal Gaussian: mean and standard deviation ``[*B, latent_size]`` from concatenated features.

    Args:
        in_features: total size of the inputs.
        latent_size: size of ``z``.
        hidden: sizes of the hidden layers.
        in_keys: features.
        group: results go to ``(group, "loc")`` and ``(group, "scale")``.
        min_std: lower bound on the standard deviation; bounds the KL divergence and its gradients.
    """

    def __init__(
        self,
        in_features: int,
        latent_size: int,
        hidden: Sequence[int],
        in_keys: Sequence[NestedKey],
        group: str,
        min_std: float = 0.01,
    ):
        check_value(f"{group}: latent_size", latent_size, Count)
        check_value(f"{group}: min_std", min_std, NonNegative)
        super().__init__(
            _GaussianHead(in_features, latent_size, hidden, min_std),
            in_keys=list(in_keys),
            out_keys=[(group, "loc"), (group, "scale")],
        )
        self.group = group


class _GaussianHead(nn.Module):
    def __init__(self, in_features: int, latent_size: int, hidden: Sequence[int], min_std: float):
        super().__init__()
        self.network = mlp(in_features, hidden, 2 * latent_size)
        self.split = NormalParamExtractor(scale_lb=min_std)

    def forward(self, *features: Tensor) -> tuple[Tensor, ...]:
        return self.split(self.network(torch.cat(features, -1)))


class LatentPrior(GaussianLatent):
    """Prior ``(mu_p, sigma_p) = P_theta(h)`` over the latent, from the deployable observation.

    >>> loc, scale = LatentPrior(16, 8, (32,))(torch.zeros(4, 16))
    >>> loc.shape, bool((scale > 0).all())
    (torch.Size([4, 8]), True)
    """

    def __init__(
        self,
        hidden_features: int,
        latent_size: int,
        hidden: Sequence[int],
        in_key: NestedKey = "hidden",
        group: str = "prior",
        min_std: float = 0.01,
    ):
        super().__init__(hidden_features, latent_size, hidden, [in_key], group, min_std)
        expects(self, {in_key: (hidden_features,)}, group)


class LatentPosterior(GaussianLatent):
    """Posterior ``(mu_q, sigma_q) = Q_phi(h, e)`` over the latent, from the privileged goal sequence as well.

    >>> loc, scale = LatentPosterior(16, 12, 8, (32,))(torch.zeros(4, 16), torch.zeros(4, 12))
    >>> loc.shape
    torch.Size([4, 8])
    """

    def __init__(
        self,
        hidden_features: int,
        code_features: int,
        latent_size: int,
        hidden: Sequence[int],
        in_keys: tuple[NestedKey, NestedKey] = ("hidden", "goal_code"),
        group: str = "posterior",
        min_std: float = 0.01,
    ):
        super().__init__(hidden_features + code_features, latent_size, hidden, in_keys, group, min_std)
        expects(self, {in_keys[0]: (hidden_features,), in_keys[1]: (code_features,)}, group)


def sample_latent(group: str) -> ProbabilisticTensorDictModule:
    """Return the module that draws ``z = mu + sigma * eps`` from ``(group, "loc")`` and ``(group, "scale")``.

    It writes ``(group, "latent")``: a reparameterized sample, or the mean under
    ``ExplorationType.DETERMINISTIC``.
    """
    return ProbabilisticTensorDictModule(
        in_keys={"loc": (group, "loc"), "scale": (group, "scale")},
        out_keys=[(group, "latent")],
        distribution_class=IndependentNormal,
        default_interaction_type=InteractionType.RANDOM,
    )
