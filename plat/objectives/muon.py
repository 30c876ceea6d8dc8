"""Muon for the hidden matrices of networks, Adam for the rest."""

from collections.abc import Iterable

import torch
from torch import Tensor, nn

__all__ = ["hidden_matrices", "muon_and_adam"]


def hidden_matrices(network: nn.Module) -> list[Tensor]:
    """Return the weights of a network's linear layers that are followed by something in an ``nn.Sequential``.

    Those at its end say what comes out, as a policy's action or a distribution, and are no hidden ones.

    >>> from plat.modules import mlp
    >>> [tuple(matrix.shape) for matrix in hidden_matrices(mlp(4, (8, 6), 2))]
    [(8, 4), (6, 8)]
    """
    layers: dict[nn.Module, None] = {}
    for part in network.modules():
        if isinstance(part, nn.Sequential):
            leaves = [leaf for leaf in part.modules() if not any(True for _ in leaf.children())]
            layers |= dict.fromkeys(leaves[:-1])
    return [layer.weight for layer in layers if isinstance(layer, nn.Linear)]


def muon_and_adam(
    network: nn.Module, muon_lr: float, adam_lr: float, learning: Iterable[Tensor] | None = None
) -> list[torch.optim.Optimizer]:
    """Return the optimizers of a network: Muon for its :func:`hidden_matrices`, Adam for the rest.

    Args:
        network: the network.
        muon_lr: learning rate of the matrices, whose every update has a spectral norm of about this; 0 for Adam alone.
        adam_lr: learning rate of the rest.
        learning: those of its parameters that learn; None for all.

    Source: Jordan et al. 2024, "Muon: an optimizer for hidden layers in neural networks".

    >>> from plat.modules import mlp
    >>> [len(optimizer.param_groups[0]["params"]) for optimizer in muon_and_adam(mlp(4, (8, 8), 2), 4e-3, 1e-3)]
    [2, 4]
    """
    rest = {id(parameter): parameter for parameter in (network.parameters() if learning is None else learning)}
    matrices = [rest.pop(id(matrix)) for matrix in hidden_matrices(network) if muon_lr and id(matrix) in rest]
    muon = [torch.optim.Muon(matrices, lr=muon_lr, weight_decay=0.0)] if matrices else []
    return [*muon, torch.optim.Adam(list(rest.values()), lr=adam_lr, fused=True)]
