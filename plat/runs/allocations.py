"""Limit on the tensors that a policy is built of."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

from plat.errors import ConfigError

__all__ = ["LimitedAllocations"]

MOST_NUMBERS = 250_000_000
"""Numbers in all tensors: 1 GB, a hundred times the largest policy that comes with plat."""
# The least that a tensor counts for: thousands of small layers take as long as a large one takes memory.
_LEAST = 50_000
_FACTORIES = frozenset((torch.empty, torch.zeros, torch.ones, torch.full, torch.rand, torch.randn))


class LimitedAllocations(TorchFunctionMode):
    """Context in which new tensors, all together, must not exceed a size. It is checked before they are made.

    Args:
        most: numbers in all of them.

    Raises:
        ConfigError: within the context, by the tensor that is too large or one too many.

    >>> with LimitedAllocations():
    ...     layer = torch.nn.Linear(8, 8)
    """

    def __init__(self, most: int = MOST_NUMBERS):
        super().__init__()
        self._most = most
        self._spare = most

    def __torch_function__(
        self, func: Callable[..., Any], types: Iterable[Any], args: Any = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Count what a function is about to allocate."""
        kwargs = kwargs or {}
        if func in _FACTORIES:
            size = kwargs.get("size", args if args and isinstance(args[0], int) else (args or ((),))[0])
            if func is torch.full:
                size = kwargs.get("size", args[0] if args else ())
            numbers = [length for length in size if isinstance(length, int)]
            self._spare -= max(_LEAST, math.prod(numbers))
            if self._spare < 0:
                raise ConfigError(
                    f"its networks have more than {self._most / 1e6:.0f} million weights, or thousands of layers: "
                    "are its sizes right?"
                )
        return func(*args, **kwargs)
