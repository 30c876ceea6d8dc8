"""Transfers from the CPU, where MuJoCo simulates, to the device of the networks."""

from typing import Any, TypeVar

import torch

__all__ = ["to_device"]

T = TypeVar("T", bound=Any)


def to_device(values: T, device: torch.device) -> T:
    """Return a tensor, or tensors in a TensorDict, of the CPU on a device.

    To a GPU they go through page-locked memory. The CPU does not wait for that: what is computed there from them does.

    >>> to_device(torch.ones(2), torch.device("cpu"))
    tensor([1., 1.])
    """
    if device.type != "cuda":
        return values.to(device)
    return values.pin_memory().to(device, non_blocking=True)
