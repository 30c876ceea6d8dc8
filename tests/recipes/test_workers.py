"""Recipes with robots in worker processes."""

import csv
import gc
import sys
from functools import partial
from pathlib import Path
from types import FunctionType, MethodType
from typing import Any

import pytest
from safetensors.torch import load_file
from torch import nn

from plat.cli import main
from plat.collectors import workers
from plat.errors import WorkerError
from plat.modules import Expert, ExpertConfig, LatentPolicy
from plat.recipes import distill
from plat.robots import G1
from plat.runs import recipe as settings
from tests.modules.policies.test_student import SMALL as STUDENT
from tests.recipes.runs import save_run

COMMON = ["--motions", "generated:val@30", "--num-envs", "4", "--rollout", "8"]
SMALL = {
    "expert": [*COMMON, "--policy.hidden", "16", "--critic", "16", "--ppo.epochs", "1", "--steps", "90"],
}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "metrics.csv").open(newline="") as file:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(file)]


def trained(recipe: str, out: Path, *arguments: object) -> tuple[list[dict[str, str]], dict[str, object]]:
    main([recipe, *SMALL[recipe], "--out", str(out), *map(str, arguments)])
    return rows(out), load_file(out / "model.safetensors")


def test_one_worker_trains_the_same_policy(tmp_path):
    (metrics, weights), (found, same) = (
        trained("expert", tmp_path / str(workers), "--workers", workers) for workers in (0, 1)
    )
    assert len(metrics) > 1
    assert found == metrics
    assert all(same[name].equal(value) for name, value in weights.items())


def test_a_run_goes_on_in_one_worker_and_back(tmp_path):
    _, expected = trained("expert", tmp_path / "whole", "--steps", 96)
    for steps, number, rest in ((32, 0, []), (64, 1, ["--resume"]), (96, 0, ["--resume"])):
        _, weights = trained("expert", tmp_path / "run", "--steps", steps, "--workers", number, *rest)
    assert all(weights[name].equal(value) for name, value in expected.items())
    with pytest.raises(SystemExit, match="workers is 2, was 0"):
        trained("expert", tmp_path / "run", "--steps", 128, "--workers", 2, "--resume")


def test_more_workers_than_robots_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="--workers is 5, expected at most num_envs, 4"):
        trained("expert", tmp_path / "run", "--workers", 5)
    assert not (tmp_path / "run").exists()


@pytest.fixture
def runs(tmp_path):
    """Runs of a teacher and a student, as arguments of the recipes that need one."""
    expert = save_run(tmp_path / "expert", Expert(G1, ExpertConfig(hidden=(8,))), steps=1)
    student = save_run(tmp_path / "student", LatentPolicy(G1, STUDENT), steps=1)
    chains = ["--task.chains", 12]  # by default there are 1200, which take seconds
    needs = {
        "distill": ["--expert", expert],
        "refine": ["--student", student],
        "refine-model": ["--student", student, "--unseen", *chains],
        "expert": [],
        "expert-model": ["--unseen"],
        "imagine": ["--unseen", *chains],
    }
    return {name: [*map(str, flags)] for name, flags in needs.items()}


@pytest.mark.parametrize("recipe", ["expert", "expert-model", "imagine", "distill", "refine", "refine-model"])
def test_every_recipe_takes_its_workers_to_ray(tmp_path, runs, recipe, monkeypatch):
    def nobody():
        raise WorkerError("no cluster")

    monkeypatch.setattr(settings, "check_ray", lambda: None)
    monkeypatch.setattr(workers, "RayActors", nobody)
    with pytest.raises(SystemExit, match="error: no cluster"):
        main(
            [recipe, *COMMON, *runs[recipe], "--out", str(tmp_path / "run"), "--steps", "9", "--workers", "2", "--ray"]
        )


def networks(value: Any) -> list[nn.Module]:
    """Networks that a function holds, and so takes along to another process."""
    if isinstance(value, nn.Module):
        return [value]
    if isinstance(value, FunctionType):
        return [found for cell in value.__closure__ or () for found in networks(cell.cell_contents)]
    return [found for held in gc.get_referents(value) for found in networks(held)] if _holds(value) else []


def _holds(value: Any) -> bool:
    return isinstance(value, partial | MethodType | tuple | list | dict)


@pytest.mark.parametrize("recipe", ["expert", "expert-model", "imagine", "distill", "refine", "refine-model"])
def test_no_network_of_the_learner_goes_to_workers_with_their_environments(tmp_path, runs, recipe, monkeypatch):
    sent, on_cpu = [], []

    def share(self, library, make_env, policy, precision):
        sent.extend(networks(make_env))
        raise WorkerError("seen")

    def copied(teacher):
        on_cpu.append(copied_before(teacher))
        return on_cpu[0]

    copied_before = distill.on_cpu
    monkeypatch.setattr(distill, "on_cpu", copied)
    monkeypatch.setattr(workers.Processes, "share", share)
    flags = [*COMMON, *runs[recipe], "--out", str(tmp_path / "run"), "--steps", "9", "--workers", "2"]
    with pytest.raises(SystemExit, match="error: seen"):
        main([recipe, *flags])
    assert list(map(id, sent)) == list(map(id, on_cpu))


def test_a_teacher_is_copied_for_workers():
    teacher, released = Expert(G1, ExpertConfig(hidden=(8,))).double(), object()
    copied = distill.on_cpu(teacher)
    weights = {value.data_ptr() for value in teacher.parameters()}
    assert weights.isdisjoint(value.data_ptr() for value in copied.parameters())
    assert distill.on_cpu(released) is released


def test_ray_that_is_missing_or_has_no_workers_is_told_before_the_work(tmp_path, monkeypatch):
    with pytest.raises(SystemExit, match="--ray is for workers, expected workers to be at least 1"):
        trained("expert", tmp_path / "run", "--ray")
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SystemExit, match="--ray needs: pip install 'plat-rl.ray.'"):
        trained("expert", tmp_path / "run", "--workers", 1, "--ray")
    assert not (tmp_path / "run").exists()
