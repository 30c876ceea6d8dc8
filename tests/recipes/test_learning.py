import pytest
import torch
from tensordict import TensorDict

from plat.recipes.learning import _tell_strength, failures_per_second
from plat.recipes.options import ImagineRecipe
from plat.runs import write_json


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
    ("before", "now", "told"), [(0.3, 1.0, True), (0.3, 0.3, False), (0.3, 0.0, False), (0, 1.0, False)]
)
def test_a_model_at_another_strength_of_disturbances_is_told(tmp_path, capsys, before, now, told):
    write_json(tmp_path / "config.json", {"recipe": {"settings": {"disturbed": before}}})
    recipe = ImagineRecipe(motions=("a",), steps=1, device="cpu", out=tmp_path, init_model=tmp_path, disturbed=now)
    _tell_strength(recipe)
    assert ("learned with --disturbed 0.3, and goes on with 1: " in capsys.readouterr().out) == told
