"""Comparison of plat with its alternatives: same machine, robot, control step and substeps, in one run.

python benchmarks/compare.py --mjbatch DIR

Everything is measured in turn, for several rounds. Ratios of rates are taken within a round, and their medians over
rounds are printed. docs/speed.md describes each row. A missing package only removes its row.
"""

import importlib.metadata
import json
import statistics
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
import tyro
from rivals import RIVALS, Rival, Setup, Work
from rounds import in_rounds, machine, median_ratio, rate

from plat.envs.physics import available_cpus
from plat.runs import report_errors

_VERSIONS = ("plat-rl", "mujoco", "torch", "torchrl", "gymnasium", "stable-baselines3", "envpool")


@dataclass(kw_only=True)
class CompareConfig:
    """Settings of the comparison: steps per second of plat and of its alternatives."""

    motions: tuple[str, ...] = ("generated:train",)
    """motion files, folders or globs"""
    num_envs: int = 1024
    """robots of rivals that simulate a batch"""
    num_singles: int = 8 * available_cpus()
    """robots of rivals that have one environment per robot"""
    rounds: int = 5
    """rounds of measurement"""
    seconds: float = 3.0
    """least time of a measurement (s)"""
    mjbatch: Path | None = None
    """folder with an installed mjbatch and its MuJoCo"""
    only: tuple[str, ...] = ()
    """rows whose name contains one of these words, and plat; by default all"""
    json: Path | None = None
    """file to write the results to"""


@dataclass(frozen=True)
class Row:
    """Measured rival."""

    name: str
    version: str
    note: str = ""
    collect: float | None = None
    """steps per second with a policy in the loop"""
    collect_ratio: float | None = None
    """plat's rate over it"""
    learn: float | None = None
    """steps per second of a whole PPO loop"""
    learn_ratio: float | None = None
    """plat's rate over it"""


def installed_version(package: str, folder: Path | None = None) -> str | None:
    """Return the version of a distribution, found in a folder or by Python; None where it is missing."""
    path = sys.path if folder is None else [str(folder)]
    return next((found.version for found in importlib.metadata.distributions(name=package, path=path)), None)


def versions() -> str:
    """Return the versions of all possible participants."""
    return ", ".join(f"{package} {installed_version(package) or '-'}" for package in _VERSIONS)


def rows_of(rivals: list[Rival], versions: dict[str, str | None], values: dict[str, list[float]]) -> list[Row]:
    """Return the table, from the rates of each round under ``NAME/collect`` and ``NAME/learn``."""
    first = rivals[0].name
    rows = []
    for rival in rivals:
        version = versions[rival.name]
        if version is None:
            rows.append(Row(rival.name, "-", f"not installed: {rival.install}"))
            continue
        figures: dict[str, Any] = {}
        for kind in ("collect", "learn"):
            rates = values.get(f"{rival.name}/{kind}")
            if rates:
                figures[kind] = statistics.median(rates)
                figures[f"{kind}_ratio"] = median_ratio(values[f"{first}/{kind}"], rates)
        rows.append(Row(rival.name, version, **figures))
    return rows


def table(rows: list[Row]) -> str:
    """Return the rows as text."""

    def cell(value: float | None, form: str, unit: str = "") -> str:
        return "-" if value is None else format(value, form) + unit

    lines = [f"{'':<60}{'version':>10}{'collect/s':>12}{'plat is':>10}{'PPO/s':>10}{'plat is':>10}"]
    for row in rows:
        line = f"{row.name:<60}{row.version:>10}"
        if row.note:
            lines.append(f"{line}  {row.note}")
            continue
        lines.append(
            f"{line}{cell(row.collect, ',.0f'):>12}{cell(row.collect_ratio, '.2f', ' x'):>10}"
            f"{cell(row.learn, ',.0f'):>10}{cell(row.learn_ratio, '.2f', ' x'):>10}"
        )
    return "\n".join(lines)


def main(config: CompareConfig) -> None:
    """Measure and print."""
    torch.manual_seed(0)
    setup = Setup(config.motions, config.num_envs, config.num_singles, config.mjbatch)
    first, *others = RIVALS
    rivals = [first, *(one for one in others if not config.only or any(word in one.name for word in config.only))]
    found = {
        rival.name: installed_version(rival.package, config.mjbatch if rival.package == "mjbatch" else None)
        for rival in rivals
    }
    print(f"{machine()}, {config.num_envs} robots a batch, {config.num_singles} single environments")
    print(versions(), flush=True)
    with ExitStack() as stack:
        # the last first: what forks does so before this process has used its threads
        works: dict[str, Work] = {
            rival.name: rival.make(setup, stack) for rival in reversed(rivals) if found[rival.name]
        }
        measures: dict[str, Callable[[], float]] = {}
        for rival in rivals:
            for kind in ("collect", "learn"):
                work = getattr(works.get(rival.name, Work()), kind)
                if work is not None:
                    measures[f"{rival.name}/{kind}"] = partial(rate, work, config.seconds)
        rows = rows_of(rivals, found, in_rounds(measures, config.rounds))
    print(table(rows))
    if config.json is not None:
        figures = {"machine": machine(), "versions": versions(), "rows": [vars(row) for row in rows]}
        config.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(CompareConfig))
