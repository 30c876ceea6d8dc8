"""Score policies on motions: timed keyframe tracking, the same commands for each.

python recipes/evaluate.py runs/plat runs/dagger runs/expert --motions clips.npz --horizon mixed
"""

import csv
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from plat.envs import MotionLibrary
from plat.envs.transforms import HORIZONS
from plat.evaluation import Estimate, evaluate, report
from plat.training import default_device, load_policy, report_errors

HorizonName = Literal["single", "short", "medium", "long", "mixed"]


@dataclass(kw_only=True)
class EvaluateRecipe:
    """Score policies on motions."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """run directories; an expert is given keyframes in place of its next reference frame (Scratch RL)"""
    motions: tuple[str, ...]
    """motion files, folders or globs; "generated:val" or "generated:test" for the motions that plat makes itself"""
    horizon: tuple[HorizonName, ...] = ("single", "short", "medium", "long", "mixed")
    """lengths of the commands"""
    dense: bool = False
    """show policies the next reference frame instead of the keyframe: how well a dense tracker tracks"""
    seed: int = 0
    """draws the commands"""
    num_envs: int = 256
    """robots that are simulated at a time; the figures do not depend on it"""
    csv: Path | None = None
    """file to write every figure to, with its interval"""
    device: str = field(default_factory=default_device)
    """where networks and tensors live"""


def main(recipe: EvaluateRecipe) -> list[dict[str, str | Estimate]]:
    """Run the recipe: print a table, return its rows."""
    library = MotionLibrary.load(recipe.motions)
    policies = {run.name: load_policy(run, recipe.device).deployed() for run in recipe.runs}
    print(f"{library.num_clips} motions, {library.duration:.0f} s; 95 % intervals over motions in parentheses")
    print(f"{'policy':<14}{'horizon':<9}{'TKS@3 %':<21}{'MPJPE@3 rad':<22}{'MPKPE@3 m':<22}{'falls %':<9}seconds")
    rows: list[dict[str, str | Estimate]] = []
    for horizon in recipe.horizon:
        for name, policy in policies.items():
            started = time.monotonic()
            records = evaluate(
                policy,
                library,
                HORIZONS[horizon],
                seed=recipe.seed,
                dense=recipe.dense,
                num_envs=recipe.num_envs,
                device=recipe.device,
            )
            figures = report(records)
            rows.append({"policy": name, "horizon": horizon, **figures})
            tks, mpjpe, mpkpe = f"{figures['tks']:.1f}", f"{figures['mpjpe']:.3f}", f"{figures['mpkpe']:.3f}"
            falls, seconds = f"{figures['fall_rate'].value:.1f}", f"{time.monotonic() - started:.0f}"
            print(f"{name:<14}{horizon:<9}{tks:<21}{mpjpe:<22}{mpkpe:<22}{falls:<9}{seconds}", flush=True)
    if recipe.csv is not None:
        write_table(recipe.csv, rows)
    return rows


def write_table(path: Path, rows: list[dict[str, str | Estimate]]) -> None:
    """One line a policy, horizon and metric."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["policy", "horizon", "metric", "value", "low", "high"])
        for row in rows:
            for metric, figure in row.items():
                if isinstance(figure, Estimate):
                    values = (f"{value:.6g}" for value in (figure.value, figure.low, figure.high))
                    writer.writerow([row["policy"], row["horizon"], metric, *values])


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(EvaluateRecipe))
