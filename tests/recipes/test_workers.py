"""Recipes with robots in worker processes."""

import csv
from pathlib import Path

import pytest
from safetensors.torch import load_file

from plat.cli import main

COMMON = ["--motions", "generated:val", "--num-envs", "4", "--rollout", "8"]
SMALL = {
    "expert": [*COMMON, "--policy.hidden", "16", "--critic", "16", "--ppo.epochs", "1", "--steps", "90"],
    "expert-model": [
        *(*COMMON, "--policy.hidden", "16", "--unseen", "generated:val@8", "--replay", "64", "--steps", "100"),
        *("--model.hidden", "16", "16", "--imagination.warmup", "1", "--imagination.steps", "3"),
        *("--imagination.window", "4", "--imagination.model-batch", "16", "--imagination.policy-batch", "16"),
        *("--imagination.recent", "16"),
    ],
}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open(newline="") as file:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(file)]


def trained(recipe: str, out: Path, *arguments: object) -> tuple[list[dict[str, str]], dict[str, object]]:
    main([recipe, *SMALL[recipe], "--out", str(out), *map(str, arguments)])
    return rows(out), load_file(out / "model.safetensors")


@pytest.mark.parametrize("recipe", SMALL)
def test_one_worker_trains_the_same_policy(tmp_path, recipe):
    (metrics, weights), (found, same) = (
        trained(recipe, tmp_path / str(workers), "--workers", workers) for workers in (0, 1)
    )
    assert len(metrics) > 1
    assert found == metrics
    assert all(same[name].equal(value) for name, value in weights.items())


def test_more_workers_than_robots_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="--workers is 5, expected at most num_envs, 4"):
        trained("expert", tmp_path / "run", "--workers", 5)
    assert not (tmp_path / "run").exists()
