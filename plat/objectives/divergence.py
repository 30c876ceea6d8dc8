"""Closed-form divergence of diagonal Gaussians."""

from torch import Tensor

__all__ = ["gaussian_kl"]


def gaussian_kl(loc: Tensor, scale: Tensor, other_loc: Tensor, other_scale: Tensor) -> Tensor:
    """Return ``KL(N(loc, scale) || N(other_loc, other_scale))`` of each dimension ``[*B, n]`` (nats).

    >>> import torch
    >>> gaussian_kl(torch.ones(2), torch.ones(2), torch.zeros(2), torch.ones(2)).tolist()
    [0.5, 0.5]
    """
    variance_ratio = (scale / other_scale).square()
    distance = ((loc - other_loc) / other_scale).square()
    return 0.5 * (variance_ratio + distance - 1 - variance_ratio.log())
