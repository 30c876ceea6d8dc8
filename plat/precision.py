"""Half-precision matrix products where the hardware has them."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Literal

from plat.errors import ConfigError

if TYPE_CHECKING:
    import torch

__all__ = ["Precision", "autocast", "has_fast_bfloat16"]

Precision = Literal["auto", "float32", "bfloat16"]


def has_fast_bfloat16(device: torch.device | str) -> bool:
    """Return whether bfloat16 is worth it there: CPUs with AMX or AVX512-BF16, GPUs of compute capability 8 and up."""
    import torch  # not at the top: a help text that names the precisions has no use for it

    device = _known(device)
    if device.type == "cuda":
        return torch.cuda.is_available() and torch.cuda.get_device_capability(device)[0] >= 8
    # PyTorch 2.10 does not say what a CPU has: there "auto" is float32
    features: dict[str, bool] = getattr(torch.cpu, "get_capabilities", dict)()
    return device.type == "cpu" and bool(features.get("amx_bf16") or features.get("avx512_bf16"))


def autocast(device: torch.device | str | None, precision: Precision) -> AbstractContextManager:
    """Return the context in which networks run at a precision.

    Hidden layers and recurrences run in it. Actions, log-probabilities and losses stay in float32, because the last
    layer of :func:`plat.modules.mlp` does, unless set otherwise. ``"auto"`` is bfloat16 where that is fast. A device of
    None is the CPU, as that of a tensordict is that was never moved.

    Raises:
        ConfigError: for a precision or a device that there is not.
    """
    import torch

    if precision not in ("auto", "float32", "bfloat16"):
        raise ConfigError(f"precision is {precision!r:.60}, expected 'auto', 'float32' or 'bfloat16'")
    device = _known(device or "cpu")
    if not torch.amp.is_autocast_available(device.type):  # the device "meta", on which nothing is computed
        return nullcontext()
    half = precision == "bfloat16" or (precision == "auto" and has_fast_bfloat16(device))
    return torch.autocast(device.type, torch.bfloat16, enabled=half)


def _known(device: torch.device | str) -> torch.device:
    import torch

    if isinstance(device, torch.device):  # at every call of a network
        return device
    try:
        return torch.device(device)
    except (RuntimeError, TypeError):
        raise ConfigError(f"device {device!r:.60}: unknown to torch, expected cpu or cuda") from None
