"""Residuals of stage 3: in the latent, or in the action."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import NonNegative, check_value
from plat.entries import expects
from plat.modules.networks import mlp

__all__ = ["Residual"]


class Residual(TensorDictModule):
    """``base + alpha * R_psi(h, z)``, and exactly ``base`` before the first update.

    With the latent as base it is the paper's latent residual ``z_hat = z_p + alpha * R(h, z_p)``; with the decoded
    action as base, the residual-action ablation ``a = pi(h, z_p) + alpha * R(h, z_p)``.

    Args:
        hidden_features: size of ``h``.
        latent_size: size of ``z``.
        num_outputs: size of the base.
        hidden: sizes of the hidden layers.
        alpha: scale of the correction.
        in_keys: ``h``, ``z`` and the base.
        out_key: corrected base ``[*B, num_outputs]``.

    >>> residual = Residual(16, 8, 8, (32,), alpha=0.5, in_keys=("hidden", "z", "z"), out_key="z_hat")
    >>> z = torch.randn(4, 8)
    >>> torch.equal(residual(torch.randn(4, 16), z, z), z)
    True
    """

    def __init__(
        self,
        hidden_features: int,
        latent_size: int,
        num_outputs: int,
        hidden: Sequence[int],
        alpha: float,
        in_keys: tuple[NestedKey, NestedKey, NestedKey],
        out_key: NestedKey,
    ):
        check_value("residual: alpha", alpha, NonNegative)
        correction = _Correction(hidden_features + latent_size, hidden, num_outputs, alpha)
        super().__init__(correction, in_keys=list(in_keys), out_keys=[out_key])
        widths = (hidden_features, latent_size, num_outputs)
        expects(self, {key: (width,) for key, width in zip(in_keys, widths, strict=True)}, "residual")


class _Correction(nn.Module):
    def __init__(self, in_features: int, hidden: Sequence[int], num_outputs: int, alpha: float):
        super().__init__()
        self.alpha = alpha
        self.network = mlp(in_features, hidden, num_outputs, out_scale=0.0)

    def forward(self, hidden: Tensor, latent: Tensor, base: Tensor) -> Tensor:
        return base + self.alpha * self.network(torch.cat((hidden, latent), -1))
