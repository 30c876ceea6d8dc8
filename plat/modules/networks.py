"""Multilayer perceptron."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from plat.bounds import Count, Layers, check_value
from plat.precision import autocast

__all__ = ["mlp"]


def mlp(
    in_features: int, hidden: Sequence[int], out_features: int, out_scale: float = 1.0, exact: bool = True
) -> nn.Sequential:
    """Return a multilayer perceptron with ELU activations.

    Args:
        in_features: size of the input.
        hidden: sizes of the hidden layers.
        out_features: size of the output.
        out_scale: factor on the last layer at the start; 0 makes the output exactly 0.
        exact: the last layer computes in float32 even under autocast, as actions, values and distributions ask for.

    Raises:
        ConfigError: for a size that is no whole number above 0.

    >>> network = mlp(3, (8,), 2, out_scale=0.0)
    >>> network(torch.ones(3)).tolist()
    [0.0, 0.0]
    """
    check_value("mlp: in_features", in_features, Count)
    check_value("mlp: hidden", tuple(hidden) if isinstance(hidden, Sequence) else hidden, Layers)
    check_value("mlp: out_features", out_features, Count)
    sizes = [in_features, *hidden]
    layers: list[nn.Module] = []
    for before, after in pairwise(sizes):
        layers += [nn.Linear(before, after), nn.ELU(inplace=True)]
    last = (_Float32Linear if exact else nn.Linear)(sizes[-1], out_features)
    with torch.no_grad():
        last.weight.mul_(out_scale)
        last.bias.mul_(out_scale)
    return nn.Sequential(*layers, last)


class _Float32Linear(nn.Linear):
    """A linear layer that leaves half precision: what follows it has the precision of its weights, float32."""

    def forward(self, inputs: Tensor) -> Tensor:
        with autocast(inputs.device, "float32"):
            return super().forward(inputs.to(self.weight.dtype))
