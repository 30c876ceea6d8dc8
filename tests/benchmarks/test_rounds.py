import sys
from pathlib import Path

import pytest
import torch

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from rounds import bfloat16_unit, in_rounds, median_ratio, peak_memory, rate


def test_everything_is_measured_in_turn_and_the_first_round_is_dropped():
    order = []

    def measure(name: str) -> float:
        order.append(name)
        return float(len(order))

    values = in_rounds({"a": lambda: measure("a"), "b": lambda: measure("b")}, rounds=2)
    assert order == ["a", "b"] * 3
    assert values == {"a": [3.0, 5.0], "b": [4.0, 6.0]}


def test_ratios_are_taken_within_rounds():
    # a machine that is half as fast in the second round
    assert median_ratio([8.0, 4.0, 9.0], [10.0, 5.0, 10.0]) == pytest.approx(0.8)


def test_work_is_repeated_until_the_time_has_passed(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("rounds.time.perf_counter", lambda: now[0])

    def work() -> int:
        now[0] += 2.0
        return 3

    assert rate(work, seconds=5.0) == pytest.approx(9 / 6)
    assert now == [6.0]
    assert rate(work) == pytest.approx(3 / 2)
    assert now == [8.0]


def test_the_peak_of_memory_stays_when_memory_is_given_back():
    # more than whatever the tests held before
    block = bytearray(b"x") * int((peak_memory() + 50) * 2**20)
    held = peak_memory()
    assert held >= 0.99 * len(block) / 2**20
    del block
    assert peak_memory() >= 0.99 * held  # the kernel counts by batches


@pytest.mark.parametrize(
    ("features", "unit"),
    [
        ({"amx_bf16": True, "avx512_bf16": True}, "amx"),
        ({"amx_bf16": False, "avx512_bf16": True}, "avx512_bf16"),
        ({"avx2": True}, "none"),
    ],
)
def test_the_unit_that_multiplies_in_half_precision(monkeypatch, features, unit):
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: features)
    assert bfloat16_unit() == unit
