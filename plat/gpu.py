"""What a GPU does in another way: it starts kernels one by one, and small ones take as long as large ones."""

import torch
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from plat.errors import ConfigError
from plat.json_file import short

__all__ = ["HORIZONTAL", "UP", "check_device", "check_stays", "constant", "on_gpu", "overhead_bound"]

HORIZONTAL = torch.tensor([1.0, 1.0, 0.0])
"""Factors that leave a vector's horizontal part."""
UP = torch.tensor([0.0, 0.0, 1.0])
"""Factors that leave its vertical part."""

# From so many numbers on, a CPU takes longer for few operations on products of all than for many on what is needed
# (about a thousand quaternions; tried with one thread on CPUs with AVX-512).
_SMALL = 4096

_COPIES = WeakTensorKeyDictionary()


def check_device(device: torch.device | str, what: str = "device", *, meta: bool = False) -> torch.device:
    """Return a device that this machine has.

    Args:
        device: it, or its name.
        what: begins the message.
        meta: let torch's device through that holds no numbers.

    Raises:
        ConfigError: naming it, and the one that there is.

    >>> check_device("cpu")
    device(type='cpu')
    """
    try:
        if (found := torch.device(device)).type == "meta" and not meta:
            raise RuntimeError("it holds no numbers")
        torch.zeros(1, device=found)
        return found
    except (AssertionError, NotImplementedError, RuntimeError, TypeError) as error:
        reason = str(error).partition("\n")[0][:120]
        there = "cuda" if torch.cuda.is_available() else "cpu"
        raise ConfigError(f"{what} {short(device)}: not on this machine ({reason}); expected {there}") from None


def check_stays(device: torch.device | str, here: torch.device | None, what: str) -> None:
    """Raise where something is to be moved that stays where it was made.

    Args:
        device: where it is to be moved.
        here: where it is.
        what: it is; begins the message.

    Raises:
        ConfigError: saying how it is made there.

    >>> check_stays("cpu", torch.device("cpu"), "environment")
    """
    wanted = check_device(device)
    if here is None or wanted.type != here.type or wanted.index not in (None, here.index):
        raise ConfigError(
            f"{what}: is on {str(here)!r} and cannot be moved, expected one made with device={str(wanted)!r}"
        )


def on_gpu(tensor: Tensor) -> bool:
    """Return whether a tensor is on a GPU, where few operations on much are faster than many on little.

    >>> on_gpu(UP)
    False
    """
    return tensor.device.type != "cpu"


def overhead_bound(tensor: Tensor) -> bool:
    """Return whether the number of operations counts for more than a tensor's size: on a GPU, and where it is small.

    >>> overhead_bound(UP), overhead_bound(torch.zeros(2000, 4))
    (True, False)
    """
    return tensor.numel() <= _SMALL or on_gpu(tensor)


def constant(values: Tensor, like: Tensor | torch.device) -> Tensor:
    """Return a constant on another tensor's device, with its data type.

    It is copied once: a copy to a GPU in every control step would stop the GPU each time, and cannot be part of a CUDA
    graph.

    Args:
        values: the constant, a tensor that is kept and never changed.
        like: whose device and data type it gets; a device, for one that keeps its type.

    >>> constant(UP, torch.zeros(3, dtype=torch.float64)).dtype
    torch.float64
    """
    device, dtype = (like.device, like.dtype) if isinstance(like, Tensor) else (like, values.dtype)
    if values.device == device and values.dtype == dtype:
        return values
    copies: dict[tuple[torch.device, torch.dtype], Tensor] = _COPIES.setdefault(values, {})
    if (device, dtype) not in copies:
        with torch.inference_mode(False):  # whoever comes first may not need gradients, others may
            copies[device, dtype] = values.to(device, dtype)
    return copies[device, dtype]
