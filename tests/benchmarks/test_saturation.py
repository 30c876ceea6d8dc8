import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import saturation
from guard import Figure, Figures
from saturation import Costs, ahead, in_turn, main

FIGURES = Figures(
    threads=2,
    num_envs=8,
    rows={
        "+ policy and collector": Figure(10_000.0, "steps/s", 1.0, physics=0.8),
        "whole PPO iteration": Figure(5_000.0, "steps/s", 0.5),
        "whole DAgger iteration": Figure(4_000.0, "steps/s", 0.4),
    },
)
COSTS = Costs.of(FIGURES)


def test_costs_give_back_the_rates_that_they_are_of():
    assert COSTS.physics == pytest.approx(160e-6)
    assert COSTS.simulation(2) == pytest.approx(10_000)
    assert in_turn(COSTS, 1, 2, 2, spread=0) == pytest.approx(5_000)
    assert COSTS.updates["DAgger"] / 2 == pytest.approx(1 / 4_000 - 1 / 10_000)


def test_one_process_is_limited_by_what_is_not_physics():
    assert COSTS.simulation(1e9) == pytest.approx(1 / 20e-6)


def test_workers_raise_the_rate_until_the_learner_saturates():
    rates = [in_turn(COSTS, workers, 2, 2, spread=0) for workers in (1, 2, 1000)]
    assert rates == sorted(rates)
    assert rates[1] == pytest.approx(1 / (1 / 20_000 + 100e-6))
    assert rates[2] == pytest.approx(1 / 100e-6, rel=2e-3)
    # at the same time: the slower of both
    assert ahead(COSTS, 1, 2, 2, spread=0) == pytest.approx(min(10_000, 1 / 150e-6))
    assert ahead(COSTS, 1, 2, 8, spread=0) == pytest.approx(10_000)


def test_the_slowest_worker_is_waited_for():
    even, uneven = (in_turn(COSTS, 16, 2, 16, spread=spread) for spread in (0.0, 0.3))
    assert uneven < 0.9 * even
    assert ahead(COSTS, 16, 2, 1000, spread=0.3) < 0.7 * ahead(COSTS, 16, 2, 1000, spread=0.0)


def test_tables_are_printed_from_the_committed_figures(capsys):
    main([])
    said = capsys.readouterr().out
    assert "computed, not measured, from avx512_bf16.json" in said
    assert "| no end | | 14,600 | 11,100 |" in said
    assert len([line for line in said.splitlines() if line.startswith("| ")]) == 8 + 4 + 4


def test_networks_carry_so_many_steps():
    assert saturation.links(1000.0)[2:] == [
        "| 1 Gbit/s | 125,000 |",
        "| 10 Gbit/s | 1,250,000 |",
        "| 100 Gbit/s | 12,500,000 |",
    ]
