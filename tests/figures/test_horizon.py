from dataclasses import replace

import pytest
import torch

from plat.figures.horizon import _binned
from tests.figures.scores import records


def test_bins_go_to_the_longest_command():
    """Commands of more than 3 s were in none."""
    made = records(0.5, 0.1, 0.2, commands=4)  # the first two fail
    times, shares, _ = _binned([replace(made, length=torch.tensor([4, 50, 150, 225]))], dt=0.02)
    assert times == pytest.approx([0.05, 0.9, 2.75, 4.25])
    assert shares == [0, 0, 100, 100]
    assert _binned([replace(made, length=torch.tensor([4, 4, 5, 50]))], dt=0.02)[0] == pytest.approx([0.05, 0.9])
