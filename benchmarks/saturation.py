"""Steps a second on more cores than there are, computed from figures of two cores: where does the learner saturate?

python benchmarks/saturation.py                              # the tables of docs/scale.md and docs/speed.md
python benchmarks/saturation.py --figures benchmarks/expected/amx.json

Nothing is timed. The figures are those of benchmarks/run.py. Rollouts of workers are drawn with a spread of their
times, and the learner waits for the slowest: a simulation of the schedule, not of robots.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from guard import Figures, read_figures

FIGURES = Path(__file__).parent / "expected" / "avx512_bf16.json"
BYTES = 3506 + 232 + 169
"""Bytes a step of PPO between learner and worker with 256 robots in it, of benchmarks/workers.py."""
LINKS = {"1 Gbit/s": 125e6, "10 Gbit/s": 1.25e9, "100 Gbit/s": 12.5e9}
"""Networks, bytes a second."""


@dataclass(frozen=True)
class Costs:
    """Times of a control step of a robot.

    Attributes:
        physics: core seconds in physics, which every core shares.
        rest: seconds of everything else of the simulation, in one process.
        updates: core seconds of the updates that follow from a step, by recipe.
    """

    physics: float
    rest: float
    updates: dict[str, float]

    @classmethod
    def of(cls, figures: Figures) -> "Costs":
        """Return the costs that some measured rates come from."""
        acting = figures.rows["+ policy and collector"]
        assert acting.physics is not None
        whole = {"PPO": "whole PPO iteration", "DAgger": "whole DAgger iteration"}
        return cls(
            figures.threads * acting.physics / acting.value,
            (1 - acting.physics) / acting.value,
            {name: figures.threads * (1 / figures.rows[row].value - 1 / acting.value) for name, row in whole.items()},
        )

    def simulation(self, cores: float) -> float:
        """Return the steps a second of one process on some cores."""
        return 1 / (self.physics / cores + self.rest)


def in_turn(costs: Costs, workers: int, cores: float, learner: float, spread: float = 0.1, rounds: int = 2000) -> float:
    """Return the steps a second of PPO: workers simulate, then the learner updates.

    Args:
        costs: of a step.
        workers: their number.
        cores: of each.
        learner: cores that the updates keep busy.
        spread: standard deviation of a worker's time, as a part of it.
        rounds: that are drawn.
    """
    slowest = _times(workers, spread, rounds).max(1).mean()
    return 1 / (slowest / (workers * costs.simulation(cores)) + costs.updates["PPO"] / learner)


def ahead(costs: Costs, workers: int, cores: float, learner: float, spread: float = 0.1, rounds: int = 2000) -> float:
    """Return the steps a second of DAgger: workers simulate while the learner updates; arguments as in :func:`in_turn`.

    Neither begins its next round before the other has ended this one.
    """
    simulated = _times(workers, spread, rounds).max(1) / (workers * costs.simulation(cores))
    return 1 / float(np.maximum(simulated, costs.updates["DAgger"] / learner).mean())


def _times(workers: int, spread: float, rounds: int) -> np.ndarray:
    """Return the times of rollouts ``[rounds, workers]``, 1 in the mean."""
    drawn = 1 + spread * np.random.default_rng(0).standard_normal((rounds, workers))
    return drawn.clip(0.1)


def saturation(costs: Costs, workers: Sequence[int], learner: int) -> list[str]:
    """Return the lines of the table by workers of two cores, beside a learner of some."""
    lines = ["| workers | simulation alone | PPO, in turn | DAgger, at the same time |", "|---|---|---|---|"]
    for count in workers:
        rates = (count * costs.simulation(2), in_turn(costs, count, 2, learner), ahead(costs, count, 2, learner))
        lines.append(f"| {count} | {' | '.join(map(_rounded, rates))} |")
    limits = (learner / costs.updates[name] for name in ("PPO", "DAgger"))
    return [*lines, f"| no end | | {' | '.join(map(_rounded, limits))} |"]


def machines(costs: Costs, cores: Sequence[int]) -> list[str]:
    """Return the lines of the table by cores: one process, workers, and how far updates use the cores."""
    lines = [
        "| cores | simulation, one process | simulation, a worker for every 2 | PPO, updates on 2 cores | "
        "PPO, updates on all |",
        "|---|---|---|---|---|",
    ]
    for count in cores:
        workers = count // 2
        rates = (
            costs.simulation(count),
            workers * costs.simulation(2),
            in_turn(costs, workers, 2, 2) if workers > 1 else in_turn(costs, 1, 2, 2, spread=0),
            in_turn(costs, workers, 2, count) if workers > 1 else in_turn(costs, 1, 2, 2, spread=0),
        )
        lines.append(f"| {count} | {' | '.join(map(_rounded, rates))} |")
    return lines


def links(bytes_a_step: float) -> list[str]:
    """Return the lines of the table by networks: steps a second that they carry."""
    lines = ["| network | steps/s |", "|---|---|"]
    return lines + [f"| {name} | {_rounded(rate / bytes_a_step)} |" for name, rate in LINKS.items()]


def _rounded(rate: float) -> str:
    """Return a rate with three digits."""
    return f"{float(f'{rate:.3g}'):,.0f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, default=FIGURES, help="results of benchmarks/run.py --json")
    parser.add_argument("--learner", type=int, default=2, help="cores of the learner")
    options = parser.parse_args(arguments)
    costs = Costs.of(read_figures(options.figures))
    told = ", ".join(f"{1e6 * seconds:.0f} of a {name} update" for name, seconds in costs.updates.items())
    print(
        f"computed, not measured, from {options.figures.name}; core microseconds a step: "
        f"{1e6 * costs.physics:.0f} of physics, {1e6 * costs.rest:.1f} (one process) of the rest, {told}\n"
    )
    tables = (
        saturation(costs, (1, 2, 4, 8, 16, 32), options.learner),
        machines(costs, (2, 16, 128)),
        links(BYTES),
    )
    print("\n\n".join("\n".join(table) for table in tables))


if __name__ == "__main__":
    main()
