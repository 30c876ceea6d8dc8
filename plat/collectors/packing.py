"""Values as bytes and as tensors, which pass through any pipe and into any checkpoint."""

import io
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

__all__ = ["as_bytes", "as_tensor", "packed", "unpacked"]


def packed(values: Mapping[str, Any]) -> bytes:
    """Return values as bytes, which pass through any pipe."""
    file = io.BytesIO()
    torch.save(dict(values), file)
    return file.getvalue()


def unpacked(data: bytes) -> dict[str, Any]:
    """Return the values of :func:`packed`.

    >>> unpacked(packed({"steps": 3}))
    {'steps': 3}
    """
    return torch.load(io.BytesIO(data), weights_only=True)


def as_tensor(data: bytes) -> Tensor:
    """Return bytes as a tensor, for a checkpoint.

    >>> as_bytes(as_tensor(b"abc"))
    b'abc'
    """
    return torch.frombuffer(bytearray(data), dtype=torch.uint8)


def as_bytes(data: Tensor) -> bytes:
    """Return the bytes of :func:`as_tensor`."""
    return data.cpu().numpy().tobytes()
