"""Observation backbone ``h_t = B_theta(o_t)``."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.entries import expects
from plat.modules.networks import mlp

__all__ = ["Backbone"]


class Backbone(TensorDictModule):
    """Features of the normalized observation, shared by prior, posterior and decoder.

    Args:
        in_features: size of the observation.
        hidden: sizes of the hidden layers.
        out_features: size of ``h``.
        in_key: normalized observation ``[*B, in_features]``.
        out_key: features ``[*B, out_features]``.

    >>> import torch
    >>> Backbone(10, (32,), 16)(observation=torch.zeros(4, 10)).shape
    torch.Size([4, 16])
    """

    def __init__(
        self,
        in_features: int,
        hidden: Sequence[int],
        out_features: int,
        in_key: NestedKey = "observation",
        out_key: NestedKey = "hidden",
    ):
        network = nn.Sequential(mlp(in_features, hidden, out_features, exact=False), _Float32ELU())
        super().__init__(network, in_keys=[in_key], out_keys=[out_key])
        expects(self, {in_key: (in_features,)}, "backbone")


class _Float32ELU(nn.ELU):
    """ELU that returns float32 after layers in half precision."""

    def forward(self, inputs: Tensor) -> Tensor:
        return super().forward(inputs.to(torch.promote_types(inputs.dtype, torch.float32)))
