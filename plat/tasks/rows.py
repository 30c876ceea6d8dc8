"""Costs that some robots have: computed for them alone where that is faster."""

from collections.abc import Callable

import torch
from torch import Tensor

from plat.gpu import on_gpu

__all__ = ["for_some"]


def for_some(counts: Tensor, compute: Callable[[Tensor | slice], Tensor]) -> Tensor:
    """Return what is computed of some robots ``[N]``, and 0 for the others.

    On a CPU it is computed for these alone. On a GPU it is computed for all: a batch of varying size would have to be
    waited for, and cannot be part of a CUDA graph.

    Args:
        counts: mask ``[N]``.
        compute: is given rows ``[n]``, or a slice that is all of them, and returns ``[n]`` values, finite everywhere.

    >>> heights = torch.tensor([1.0, 2.0, 3.0])
    >>> for_some(heights > 1.5, lambda rows: 10 * heights[rows])
    tensor([ 0., 20., 30.])
    """
    if on_gpu(counts):
        return torch.where(counts, compute(slice(None)), 0.0)
    rows = counts.nonzero()[:, 0]
    if len(rows) == 0:
        return torch.zeros(counts.shape)
    values = compute(rows)
    return values.new_zeros(counts.shape).index_add(0, rows, values)
