"""Measuring side by side: everything is measured once a round, and ratios are taken within rounds.

What else the machine does at the time hits all that is compared.
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
    """What each measure gave in each round, after one round that only warms up; progress goes to stderr."""
    values: dict[str, list[float]] = {name: [] for name in measures}
    for number in range(rounds + 1):
        for name, measure in measures.items():
            value = measure()
            print(f"round {number} of {rounds}: {name}: {value:,.5g}", file=sys.stderr)
            if number > 0:
                values[name].append(value)
    return values


def median_ratio(values: Sequence[float], reference: Sequence[float]) -> float:
    """Median over rounds of one measure over another."""
    return statistics.median(value / other for value, other in zip(values, reference, strict=True))


def rate(work: Callable[[], int], seconds: float = 0.0) -> float:
    """How much a second gets done by work that says how much it did; it is repeated until some time has passed."""
    began, done = time.perf_counter(), 0
    while True:
        done += work()
        spent = time.perf_counter() - began
        if spent >= seconds:
            return done / spent


def bfloat16_unit() -> str:
    """What multiplies matrices in half precision here: ``"amx"``, ``"avx512_bf16"`` or ``"none"``."""
    features = torch.cpu.get_capabilities()
    return "amx" if features.get("amx_bf16") else "avx512_bf16" if features.get("avx512_bf16") else "none"


def machine() -> str:
    """What the figures were measured on."""
    return (
        f"{platform.processor() or platform.machine()}, bfloat16: {bfloat16_unit()}, {torch.get_num_threads()} threads"
    )


def peak_memory() -> float:
    """The most memory that this process has held so far (MB)."""
    # not getrusage where there is better: on Linux a process inherits the peak of the one that started it
    status = Path("/proc/self/status")
    if status.exists() and (found := re.search(r"VmHWM:\s+(\d+) kB", status.read_text())):
        return int(found[1]) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS
