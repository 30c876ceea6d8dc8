import sys
from pathlib import Path

from plat.modules import Expert
from plat.robots import G1

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import workers


def test_bytes_that_pass_are_those_of_numbers():
    sizes = workers.measured(2)["plat expert"]
    assert sizes.steps == 2 * 24
    parameters = sum(value.numel() * value.element_size() for value in Expert(G1).actor().state_dict().values())
    assert parameters < sizes.weights < 1.2 * parameters + 50_000
    assert sizes.rollout > sizes.steps * 2 * 4 * 29  # at least joint angles before and after each step
    assert sizes.line("a").startswith("| a | ")
