"""Distances whose gradients are finite everywhere, for costs that a policy learns from by backpropagation."""

import torch
from torch import Tensor

__all__ = ["smooth_angle", "smooth_length"]

# square of what a distance is rounded by at 0
_SOFT = 1e-4


def smooth_length(vec: Tensor) -> Tensor:
    """Return the length ``[*B]`` of vectors ``[*B, D]``, rounded at 0: ``sqrt(|v|^2 + 0.01^2)``.

    >>> round(smooth_length(torch.tensor([3.0, 4.0])).item(), 3)
    5.0
    """
    return (vec.square().sum(-1) + _SOFT).sqrt()


def smooth_angle(a: Tensor, b: Tensor) -> Tensor:
    """Return the angle ``[*B]`` (rad) between unit quaternions ``[*B, 4]``, whose gradient at 0 is 0 and not infinite.

    >>> turn = torch.tensor([1.0, 0, 0, 0], requires_grad=True)
    >>> smooth_angle(turn, turn.detach()).backward()
    >>> turn.grad.isfinite().all().item()
    True
    """
    chord = torch.minimum((a - b).square().sum(-1), (a + b).square().sum(-1))
    return 4.0 * torch.asin(0.5 * (chord + 1e-8).sqrt().clamp_max(1.5))
