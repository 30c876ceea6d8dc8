"""The multilayer perceptron that every part is made of."""

from collections.abc import Sequence

import torch
from torch import nn
from torchrl.modules import MLP

__all__ = ["mlp"]


def mlp(in_features: int, hidden: Sequence[int], out_features: int, out_scale: float = 1.0) -> MLP:
    """ELU network.

    Args:
        in_features: size of the input.
        hidden: sizes of the hidden layers.
        out_features: size of the output.
        out_scale: factor on the last layer at the start; 0 makes the output exactly 0.

    >>> network = mlp(3, (8,), 2, out_scale=0.0)
    >>> network(torch.ones(3)).tolist()
    [0.0, 0.0]
    """
    network = MLP(in_features=in_features, out_features=out_features, num_cells=list(hidden), activation_class=nn.ELU)
    with torch.no_grad():
        network[-1].weight.mul_(out_scale)
        network[-1].bias.mul_(out_scale)
    return network
