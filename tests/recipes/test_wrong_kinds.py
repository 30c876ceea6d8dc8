"""Runs of the wrong kind, and settings that make no sense, end in one line."""

from pathlib import Path

import pytest

from plat.errors import ConfigError
from plat.modules import Expert, ExpertConfig, LatentPolicy, PlainPolicy, ResidualLatentPolicy
from plat.recipes import distill, expert, refine
from plat.robots import G1
from plat.runs import report_errors
from tests.modules.policies.test_student import SMALL
from tests.recipes.runs import save_run, write_motions

POLICIES = {
    "expert": lambda: Expert(G1, ExpertConfig(hidden=(8,))),
    "latent": lambda: LatentPolicy(G1, SMALL),
    "plain": lambda: PlainPolicy(G1, SMALL),
    "residual_latent": lambda: ResidualLatentPolicy(LatentPolicy(G1, SMALL)),
}


def last_line(main, recipe) -> str:
    """What a recipe ends with."""
    with pytest.raises(SystemExit) as end, report_errors():
        main(recipe)
    message = str(end.value)
    assert "\n" not in message
    assert not recipe.out.exists()
    return message


def settings(folder: Path) -> dict:
    return {"motions": (write_motions(folder),), "out": folder / "out", "steps": 1, "num_envs": 2, "device": "cpu"}


@pytest.mark.parametrize("kind", ["expert", "plain", "residual_latent"])
def test_refining_what_is_no_student_with_a_latent(tmp_path, kind):
    run = save_run(tmp_path / kind, POLICIES[kind]())
    message = last_line(refine.main, refine.RefineRecipe(student=run, **settings(tmp_path)))
    assert f"{kind}' holds a policy of kind '{kind}', expected a student with a latent" in message


@pytest.mark.parametrize("kind", ["latent", "plain"])
def test_distilling_from_what_is_no_teacher(tmp_path, kind):
    run = save_run(tmp_path / kind, POLICIES[kind]())
    message = last_line(distill.main, distill.DistillRecipe(expert=run, **settings(tmp_path)))
    assert f"{kind}' holds a policy of kind '{kind}', expected a teacher" in message


def test_going_on_from_what_is_no_expert(tmp_path):
    run = save_run(tmp_path / "plain", POLICIES["plain"]())
    message = last_line(expert.main, expert.ExpertRecipe(init=run, **settings(tmp_path)))
    assert "holds a policy of kind 'plain', expected an expert (--init)" in message


def test_an_expert_that_sees_too_few_frames(tmp_path):
    with pytest.raises(ConfigError, match=r"ahead is \(1,\), expected two frames for the action"):
        expert.ExpertRecipe(policy=ExpertConfig(action="reference_velocity", ahead=(1,)), **settings(tmp_path))


def test_a_stride_of_nothing(tmp_path):
    run = save_run(tmp_path / "expert", POLICIES["expert"]())
    with pytest.raises(ConfigError, match="stride is 0, expected a whole number of at least 1"):
        distill.DistillRecipe(expert=run, stride=0, **settings(tmp_path))
