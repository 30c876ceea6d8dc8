"""Measurement in rounds: everything is measured once a round, and ratios are taken within rounds.

Other load on the machine then affects everything that is compared.
"""

import platform
import re
import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import torch

__all__ = ["bfloat16_unit", "in_rounds", "machine", "median_ratio", "peak_memory", "rate"]


def in_rounds(measures: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, list[float]]:
    """Return each measure's value in each round, after a warm-up round; progress goes to stderr."""
    values: dict[str, list[float]] = {name: [] for name in measures}
    for number in range(rounds + 1):
        for name, measure in measures.items():
            value = measure()
            print(f"round {number} of {rounds}: {name}: {value:,.5g}", file=sys.stderr)
            if number > 0:
                values[name].append(value)
    return values


def median_ratio(values: Sequence[float], reference: Sequence[float]) -> float:
    """Return the median ratio of two measures over the rounds."""
    return statistics.median(value / other for value, other in zip(values, reference, strict=True))


def rate(work: Callable[[], int], seconds: float = 0.0) -> float:
    """Return the work done per second; the work is repeated until some time has passed."""
    began, done = time.perf_counter(), 0
    while True:
        done += work()
        spent = time.perf_counter() - began
        if spent >= seconds:
            return done / spent


def bfloat16_unit() -> str:
    """Return the CPU's unit for half-precision matrix products: ``"amx"``, ``"avx512_bf16"`` or ``"none"``."""
    features = torch.cpu.get_capabilities()
    return "amx" if features.get("amx_bf16") else "avx512_bf16" if features.get("avx512_bf16") else "none"


def machine() -> str:
    """Return a description of the machine."""
    return (
        f"{platform.processor() or platform.machine()}, bfloat16: {bfloat16_unit()}, {torch.get_num_threads()} threads"
    )


def peak_memory() -> float:
    """Return the peak memory of this process (MB)."""
    # not getrusage where there is better: on Linux a process inherits the peak of the one that started it
    status = Path("/proc/self/status")
    if status.exists() and (found := re.search(r"VmHWM:\s+(\d+) kB", status.read_text())):
        return int(found[1]) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
