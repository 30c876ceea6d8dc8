"""Half-precision matrix products where the hardware has them."""

from contextlib import AbstractContextManager
from typing import Literal

import torch

__all__ = ["Precision", "autocast", "has_fast_bfloat16"]

Precision = Literal["auto", "float32", "bfloat16"]


def has_fast_bfloat16(device: torch.device | str) -> bool:
    """Whether bfloat16 is worth it there: CPUs with AMX, GPUs of compute capability 8 and up."""
    device = torch.device(device)
    if device.type == "cuda":
        return torch.cuda.get_device_capability(device)[0] >= 8
    return device.type == "cpu" and bool(torch.cpu.get_capabilities().get("amx_bf16", False))


def autocast(device: torch.device | str, precision: Precision) -> AbstractContextManager:
    """Context in which networks run at a precision.

    Hidden layers and recurrences run in it; the last layer of every network made by :func:`plat.modules.mlp`, and so
    actions, log-probabilities and losses, stays in float32. ``"auto"`` is bfloat16 where that is fast.
    """
    device = torch.device(device)
    half = precision == "bfloat16" or (precision == "auto" and has_fast_bfloat16(device))
    return torch.autocast(device.type, torch.bfloat16, enabled=half)
