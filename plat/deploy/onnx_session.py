"""onnxruntime sessions for ONNX files."""

import os
from functools import cache
from pathlib import Path
from typing import Any

from plat.errors import BundleError

__all__ = ["open_session"]

MAX_BYTES = 512 << 20
"""Largest file that is read: released trackers take a fifth of it."""
_MOST_MEMORY = 1536 << 20
"""Bytes for tensors of all networks of this process: a network of 20 KB can ask for a terabyte."""


def open_session(path: Path) -> Any:
    """Return an onnxruntime session on one CPU thread; for networks this small, more threads are slower.

    Raises:
        BundleError: when there is no such file, it cannot be read, or onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise BundleError("ONNX policies need: pip install onnxruntime") from error
    if not os.path.isfile(path):  # false for a name that is too long, too
        what = "not a regular file" if os.path.exists(path) else "no such file"
        raise BundleError(f"ONNX policy {str(path)!r}: {what}")
    if path.stat().st_size > MAX_BYTES:
        raise BundleError(
            f"ONNX policy {str(path)!r}: {path.stat().st_size / 1e6:.0f} MB, expected at most {MAX_BYTES / 1e6:.0f} MB"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    if _limit_memory():
        options.add_session_config_entry("session.use_env_allocators", "1")
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime has a class of its own for every kind of failure
        line = str(error).strip().splitlines()[0]
        raise BundleError(f"ONNX policy {str(path)!r}: not a readable .onnx file ({line})") from error


@cache
def _limit_memory() -> bool:
    """Limit the memory of onnxruntime's tensors, once in a process; return whether it could be."""
    import onnxruntime

    kind, memory = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, onnxruntime.OrtMemType.DEFAULT
    try:
        place = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, memory)
        onnxruntime.create_and_register_allocator(place, onnxruntime.OrtArenaCfg(_MOST_MEMORY, -1, -1, -1))
    except Exception:  # the program has registered another one
        return False
    return True
