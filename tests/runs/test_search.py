import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import torch

from plat.envs.physics import available_cpus
from plat.errors import ConfigError
from plat.objectives import PPOConfig
from plat.recipes.options import ExpertRecipe
from plat.runs import MetricsFile, write_json
from plat.runs.changes import settings_of
from plat.runs.search import trainable, with_settings


def recipe(out: Path) -> ExpertRecipe:
    return ExpertRecipe(motions=("generated:val@8",), out=out, steps=100, num_envs=2)


def test_settings_are_named_as_on_the_command_line(tmp_path):
    start = recipe(tmp_path)
    found = with_settings(start, {"seed": 3, "ppo.lr": 1e-4, "ppo.epochs": 2, "policy.hidden": (8,)})
    ppo = dataclasses.replace(start.ppo, lr=1e-4, epochs=2)
    assert found == dataclasses.replace(start, seed=3, ppo=ppo, policy=dataclasses.replace(start.policy, hidden=(8,)))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("ppo.rate", 1.0, "PPOConfig: no setting 'rate', expected one of .*lr"),
        ("lr", 1.0, "ExpertRecipe: no setting 'lr'"),
        ("seed.low", 1, "ExpertRecipe: seed has no settings of its own, 'seed.low' names one"),
        ("ppo.lr", -1.0, "lr is -1.0"),
    ],
)
def test_settings_that_make_no_sense_are_named(tmp_path, name, value, message):
    with pytest.raises(ConfigError, match=message):
        with_settings(recipe(tmp_path), {name: value})


def test_numbers_of_numpy_and_torch_are_those_of_python(tmp_path):
    values = {
        "ppo.epochs": np.int64(3),
        "ppo.lr": np.float32(0.5),
        "num_envs": torch.tensor(4),
        "mirror": np.bool_(True),
        "policy.hidden": (np.int64(8), 16),
        "critic": np.array([32, 32]),
    }
    of_python = {
        "ppo.epochs": 3,
        "ppo.lr": 0.5,
        "num_envs": 4,
        "mirror": True,
        "policy.hidden": (8, 16),
        "critic": [32, 32],
    }
    found = settings_of(with_settings(recipe(tmp_path), values))
    assert found == settings_of(with_settings(recipe(tmp_path), of_python))
    assert (found["ppo"]["epochs"], found["ppo"]["lr"], found["num_envs"]) == (3, 0.5, 4)
    made = []

    def train(settings: ExpertRecipe) -> None:
        made.append(settings.out)
        MetricsFile(settings.out / "metrics.csv").write(1, {"cost": 1.0})

    for sample in (values, of_python):
        trainable(train, recipe(tmp_path))(sample)
    assert made[0] == made[1]


def test_each_sample_has_a_run_that_is_kept(tmp_path, monkeypatch):
    made = []

    def train(settings: ExpertRecipe) -> None:
        made.append(settings)
        write_json(settings.out / "config.json", {})
        (settings.out / "model.safetensors").touch()
        file = MetricsFile(settings.out / "metrics.csv")
        for step in range(20):
            file.write(step, {"cost": settings.ppo.lr * step})
        file.write(20, {"cost": 0.0, "late": 4.0})

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PLAT_CPUS", "")
    search = trainable(train, recipe(Path("search")), cpus=1)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")  # as Ray Tune does
    for lr in (2.0, 4.0):
        assert search({"ppo.lr": lr, "ppo.epochs": 2}) == pytest.approx(
            {"step": 19.0, "cost": lr * (18 + 19) / 3, "late": 4.0}  # 3 of 21 rows are the last tenth
        )
    assert search({"ppo.epochs": 2, "ppo.lr": 2.0})["late"] == 4.0
    assert Path.cwd() == tmp_path / "elsewhere"
    assert [settings.resume for settings in made] == [False, False, True]
    assert made[0].out == made[2].out != made[1].out
    assert made[0].out.name.startswith("epochs=2-lr=2.0-")
    assert made[0].ppo == dataclasses.replace(PPOConfig(), lr=2.0, epochs=2)
    assert {path.name for path in (tmp_path / "search").iterdir()} == {made[0].out.name, made[1].out.name}
    assert os.environ["PLAT_CPUS"] == "1"
    assert available_cpus() == 1
