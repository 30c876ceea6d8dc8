from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from tensordict import TensorDict

from plat.recipes import learning
from plat.recipes.learning import failures_per_second, usual_processes
from plat.recipes.options import ImagineRecipe


def rollout(failed, authored=None):
    """One step of robots that failed or not."""
    parts = {"next": {"terminated": torch.tensor(failed)[:, None, None]}}
    if authored is not None:
        parts["memory"] = {"authored": torch.tensor(authored)[:, None]}
    return TensorDict(parts, [len(failed), 1])


def test_failures_of_both_kinds_of_keyframes():
    found = failures_per_second(rollout([True, False, False, False], [True, True, False, False]), dt=0.02)
    assert found == {"failures_per_second": 0.0, "authored_failures_per_second": 25.0}


def test_a_kind_that_nobody_chases_has_no_failures_to_count():
    assert failures_per_second(rollout([True, False], [False, False]), dt=0.02) == {"failures_per_second": 25.0}
    assert failures_per_second(rollout([False, False], [True, True]), dt=0.02) == {"authored_failures_per_second": 0.0}


def test_a_task_without_authored_keyframes():
    assert failures_per_second(rollout([True, False]), dt=0.02) == {"failures_per_second": 25.0}


@pytest.mark.parametrize(
    ("cpus", "changed", "expected"),
    [
        (1, {}, 1),
        (2, {}, 2),
        (16, {}, 2),
        (16, {"minutes": 0.5}, 1),
        (16, {"minutes": None, "steps": 10**6}, 2),
        (16, {"minutes": None, "steps": 1000}, 1),
        (16, {"device": "cuda"}, 1),
        (16, {"workers": 2}, 1),
    ],
)
def test_gradients_are_computed_at_once_where_that_pays(monkeypatch, cpus, changed, expected):
    monkeypatch.setattr(learning, "available_cpus", lambda: cpus)
    recipe = ImagineRecipe(motions=("generated:train@8",), out=Path("run"), minutes=20.0, steps=None, device="cpu")
    assert usual_processes(replace(recipe, **changed), frames=10_000) == expected
    assert usual_processes(recipe, frames=10**7) == 1
    monkeypatch.setattr(learning, "current_process", lambda: SimpleNamespace(daemon=True))
    assert usual_processes(recipe, frames=10_000) == 1
