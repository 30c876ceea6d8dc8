import pytest
import torch
from torch import nn

from plat.errors import ConfigError
from plat.runs.allocations import LimitedAllocations


def test_tensors_are_counted_before_they_are_made():
    with LimitedAllocations(), pytest.raises(ConfigError, match="its networks have more than 250 million weights"):
        nn.Linear(10**6, 10**6)  # four terabytes


@pytest.mark.parametrize(
    "make",
    [
        lambda: torch.zeros(1000, 1001),
        lambda: torch.ones((1000, 1001)),
        lambda: torch.empty(size=(1000, 1001)),
        lambda: torch.full((1000, 1001), 3.0),
        lambda: [torch.rand(500, 1001), torch.randn(500, 1001)],
    ],
)
def test_each_way_to_make_one(make):
    with LimitedAllocations(most=1_001_000):
        make()
    with LimitedAllocations(most=1_000_999), pytest.raises(ConfigError, match="more than 1 million weights"):
        make()


def test_thousands_of_small_layers():
    with LimitedAllocations(), pytest.raises(ConfigError, match="or thousands of layers"):
        nn.Sequential(*(nn.Linear(1, 1) for _ in range(10_000)))


def test_outside_of_it_nothing_is_limited():
    with LimitedAllocations(most=1):
        pass
    assert torch.zeros(1000).sum() == 0
