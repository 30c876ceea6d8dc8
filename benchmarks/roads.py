"""Roads to a keyframe policy, in equal total time on the same motions.

python benchmarks/roads.py --motions train.npz --tests val.npz --minutes 60 --seeds 0 1 2 --out runs/roads

Each road is trained from scratch, a stage a process, and goes on where it was when the benchmark is started again.
A stage that roads have in common is trained once. Nothing else should run meanwhile: budgets are wall time. All
policies are then scored on the same commands.
"""

import csv
import shlex
import statistics
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, get_args

import tyro

from plat.bounds import Bounded, Positive
from plat.errors import ConfigError, PlatError
from plat.evaluation.score_table import HEADLINE
from plat.files import replace_table
from plat.runs import is_run, report_errors

Road = Literal["ppo", "model", "finetune", "imagine", "recorded"]


@dataclass(kw_only=True)
class RoadsConfig(Bounded):
    """Settings of the benchmark of roads to a keyframe policy."""

    motions: tuple[str, ...]
    """motion files, folders or globs to train on"""
    tests: tuple[str, ...]
    """motion files, folders or globs to score on, each by itself"""
    out: Path
    """folder of the runs and tables"""
    minutes: Positive = 60.0
    """training time of each road, all its stages together"""
    seeds: tuple[int, ...] = (0, 1, 2)
    """training seeds"""
    roads: tuple[Road, ...] = get_args(Road)
    """which to take"""
    horizons: tuple[str, ...] = ("mixed", "long")
    """lengths of the commands that are scored"""
    authored: int = 30
    """chains per family of authored keyframes to score; 0 for none"""
    more: str = ""
    """settings that every stage gets, in one word with an equals sign: --more='--num-envs 256 --mirror'"""


@dataclass(frozen=True)
class Stage:
    """Stage of a road.

    Args:
        name: folder of its run; the same for roads that share it.
        command: of plat.
        share: of the road's time.
        needs: flags with the stage whose run they name.
        settings: other settings.
    """

    name: str
    command: str
    share: float
    needs: Mapping[str, str] = field(default_factory=dict)
    settings: tuple[str, ...] = ()


_BY_PPO = (Stage("expert", "expert", 0.6), Stage("student", "distill", 0.25, {"--expert": "expert"}))
_BY_MODEL = (
    Stage("expert-model", "expert-model", 0.4),
    Stage("student-model", "distill", 0.25, {"--expert": "expert-model"}),
)
_IN_MODEL = {"--student": "student-model", "--init-model": "expert-model"}
ROADS: dict[Road, tuple[Stage, ...]] = {
    "ppo": (*_BY_PPO, Stage("policy", "refine", 0.15, {"--student": "student"})),
    "model": (*_BY_MODEL, Stage("policy", "refine-model", 0.35, _IN_MODEL)),
    "finetune": (*_BY_MODEL, Stage("policy", "refine-model", 0.35, _IN_MODEL, ("--variant", "finetune"))),
    "imagine": (Stage("policy", "imagine", 1.0),),
    "recorded": (Stage("policy", "imagine", 1.0, settings=("--task.authored", "0")),),
}
"""The paper's three stages by PPO; the same with stages 1 and 3 by imagination, once as a residual in the latent and
once as every deployed weight; and imagination alone, with authored keyframes and, as ``recorded``, without.
"""


def commands(config: RoadsConfig, road: Road, seed: int) -> list[tuple[Path, list[str]]]:
    """Return, for each stage, the folder of its run and the words of its command after ``plat``.

    The last stage's folder has the name of road and seed, under which it is scored.
    """
    folders = {stage.name: config.out / "stages" / f"{stage.name}_{seed}" for stage in ROADS[road]}
    folders["policy"] = config.out / f"{road}_{seed}"
    return [
        (
            folders[stage.name],
            [
                *(stage.command, "--motions", *config.motions),
                *(word for flag, needed in stage.needs.items() for word in (flag, str(folders[needed]))),
                *stage.settings,
                *("--minutes", f"{stage.share * config.minutes:g}", "--seed", str(seed)),
                *shlex.split(config.more),
                *("--out", str(folders[stage.name])),
            ],
        )
        for stage in ROADS[road]
    ]


def train(config: RoadsConfig) -> dict[Path, Road]:
    """Train every stage of all roads once, and return the road of each policy by its folder.

    What is finished stays as it is.
    """
    taken = [(road, commands(config, road, seed)) for seed in config.seeds for road in config.roads]
    for folder, words in {folder: words for _, stages in taken for folder, words in stages}.items():
        run([*words, *(["--resume"] if is_run(folder) else [])])
    return {stages[-1][0]: road for road, stages in taken}


def run(words: list[str]) -> None:
    """Run a command of plat in a process of its own.

    Raises:
        PlatError: when it fails; what it printed stands above.
    """
    print("\nplat", *words, flush=True)
    status = subprocess.run([sys.executable, "-m", "plat", *words], check=False).returncode
    if status:
        raise PlatError(f"plat {words[0]} ended with {status}; started again, the benchmark goes on from there")


def table(scores: Mapping[str, Path], roads: Mapping[str, Road], minutes: float) -> list[dict[str, str]]:
    """Return a row for each test, horizon, road and metric: mean, least and greatest over the seeds.

    Args:
        scores: table of ``plat evaluate --csv`` of each test.
        roads: road of each policy that stands in it.
        minutes: training time of each road.
    """
    rows = []
    for test, path in scores.items():
        with path.open(newline="") as file:
            figures = [row for row in csv.DictReader(file) if row["metric"] in HEADLINE]
        cells: dict[tuple[str, str, str], list[float]] = {}
        for row in figures:
            cells.setdefault((row["horizon"], roads[row["policy"]], row["metric"]), []).append(float(row["value"]))
        for (horizon, road, metric), values in cells.items():
            mean, low, high = statistics.mean(values), min(values), max(values)
            rows.append(
                {"test": test, "horizon": horizon, "road": road, "metric": metric, "minutes": f"{minutes:g}"}
                | {"seeds": str(len(values)), "mean": f"{mean:.4g}", "low": f"{low:.4g}", "high": f"{high:.4g}"}
            )
    return rows


def main(config: RoadsConfig) -> list[dict[str, str]]:
    """Run the benchmark; write ``roads.csv``, print it and return its rows."""
    if config.minutes * min(stage.share for road in config.roads for stage in ROADS[road]) < 1 / 60:
        raise ConfigError(f"--minutes {config.minutes:g}: expected enough for a second of each stage")
    policies = train(config)
    scores = {}
    for number, test in enumerate(config.tests):
        scores[test] = config.out / f"scores_{number}.csv"
        authored = ["--authored", str(config.authored)] if config.authored and number == 0 else []
        horizons = ("--horizon", *config.horizons)
        run(["evaluate", *map(str, policies), "--motions", test, *horizons, *authored, "--csv", str(scores[test])])
    rows = table(scores, {folder.name: road for folder, road in policies.items()}, config.minutes)
    replace_table(config.out / "roads.csv", list(rows[0]), (row.values() for row in rows))
    for row in rows:
        print("  ".join(f"{value:>9}" for value in row.values()))
    return rows


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(RoadsConfig, description=__doc__))
