"""Runs of the wrong kind, and settings that make no sense, end in one line."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from plat.errors import ConfigError
from plat.modules import Expert, ExpertConfig, LatentPolicy, PlainPolicy, ResidualLatentPolicy, WalkingReach
from plat.objectives import MotorGradientConfig
from plat.recipes import distill, expert, expert_model, imagine, refine, refine_model
from plat.recipes.students import make_student, trained_student
from plat.robots import G1, Robot, register_robot
from plat.runs import report_errors
from plat.spec.timing import Timing
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


@pytest.fixture
def crouched() -> Robot:
    """A robot with the G1's joints and another default pose, from which its actions count."""
    pose = {**G1.default_pose, "left_knee": 0.9, "right_knee": 0.9}
    return register_robot(replace(G1, name="g1-crouched", root_height=0.7, default_pose=pose))


def test_a_policy_of_another_robot_is_refused(tmp_path, crouched):
    student = save_run(tmp_path / "student", LatentPolicy(crouched, SMALL))
    message = last_line(refine.main, refine.RefineRecipe(student=student, **settings(tmp_path)))
    assert "student' drives robot 'g1-crouched', expected 'g1', that of --robot" in message
    recipe = refine_model.RefineModelRecipe(student=student, unseen=(), **settings(tmp_path))
    assert "drives robot 'g1-crouched', expected 'g1'" in last_line(refine_model.main, recipe)
    teacher = save_run(tmp_path / "teacher", Expert(crouched, ExpertConfig(hidden=(8,))))
    message = last_line(distill.main, distill.DistillRecipe(expert=teacher, **settings(tmp_path)))
    assert "teacher' drives robot 'g1-crouched', expected 'g1', that of --robot" in message


def test_going_on_with_another_robot_is_told(tmp_path, crouched, capsys):
    start = save_run(tmp_path / "start", PlainPolicy(crouched, SMALL))
    recipe = distill.DistillRecipe(expert=start, init=start, student="plain", **settings(tmp_path))
    recipe, trained = trained_student(recipe)
    make_student(recipe, G1, trained)
    assert "start' drove robot 'g1-crouched', and goes on with 'g1'\n" in capsys.readouterr().out


def test_a_student_goes_on_with_its_reach_on_both_sides_in_another_shape(tmp_path, capsys):
    config = replace(SMALL, reach=WalkingReach(), symmetric=True)
    start = save_run(tmp_path / "start", LatentPolicy(G1, config))
    wider = replace(SMALL, timing=Timing(max_steps=150))
    recipe, _ = trained_student(distill.DistillRecipe(expert=start, init=start, policy=wider, **settings(tmp_path)))
    assert (recipe.policy.reach, recipe.policy.symmetric) == (WalkingReach(), True)
    assert recipe.policy.timing.max_steps == 150
    assert "start' goes on with timing " in capsys.readouterr().out


def test_a_motor_gradient_over_more_steps_than_a_rollout(tmp_path):
    with pytest.raises(ConfigError, match=r"RefineRecipe: motor.steps is 24, expected less than 24, the rollout"):
        refine.RefineRecipe(student=tmp_path, motor=MotorGradientConfig(steps=24), **settings(tmp_path))


@pytest.mark.parametrize("kind", ["latent", "plain"])
def test_distilling_from_what_is_no_teacher(tmp_path, kind):
    run = save_run(tmp_path / kind, POLICIES[kind]())
    message = last_line(distill.main, distill.DistillRecipe(expert=run, **settings(tmp_path)))
    assert f"{kind}' holds a policy of kind '{kind}', expected a teacher" in message


def test_a_teacher_at_another_control_step_is_named_with_both(tmp_path):
    teacher = save_run(tmp_path / "teacher", Expert(G1, ExpertConfig(hidden=(8,), timing=Timing(control_dt=0.04))))
    message = last_line(distill.main, distill.DistillRecipe(expert=teacher, **settings(tmp_path)))
    assert "teacher': control step of 0.04 s, expected the policy's 0.02 s" in message
    recipe = expert.ExpertRecipe(**{**settings(tmp_path), "out": teacher})
    assert f"plat distill --expert {teacher} " in expert.after(recipe)  # as after --init
    assert " --policy.timing.control-dt 0.04 --minutes" in expert.after(recipe)
    assert "control-dt" not in expert.after(expert.ExpertRecipe(**settings(tmp_path)))


def test_going_on_from_what_is_no_expert(tmp_path):
    run = save_run(tmp_path / "plain", POLICIES["plain"]())
    message = last_line(expert.main, expert.ExpertRecipe(init=run, **settings(tmp_path)))
    assert "holds a policy of kind 'plain', expected an expert (--init)" in message


SHORT = replace(SMALL, timing=Timing(max_steps=25))
TOLD_FIRST = {
    "no model": (imagine, imagine.ImagineRecipe, {"init_model": "expert"}, "dynamics.safetensors': no such file"),
    "no model of an expert": (
        expert_model,
        expert_model.ExpertModelRecipe,
        {"init_model": "expert"},
        "dynamics.safetensors': no such file",
    ),
    "no model to refine in": (
        refine_model,
        refine_model.RefineModelRecipe,
        {"student": "latent", "init_model": "expert"},
        "dynamics.safetensors': no such file",
    ),
    "fewer neurons": (
        expert,
        expert.ExpertRecipe,
        {"init": "expert", "policy": ExpertConfig(hidden=(4,))},
        "(--policy.ahead, --policy.hidden)",
    ),
    "horizon": (
        distill,
        distill.DistillRecipe,
        {"expert": "expert", "policy": SHORT},
        "horizon 'mixed': 50 control steps, expected at most the policy's 25; 'all' is every length up to that",
    ),
}


@pytest.mark.parametrize("case", TOLD_FIRST)
def test_wrong_runs_are_told_before_motions_are_read(tmp_path, case):
    module, kind, given, told = TOLD_FIRST[case]
    runs = {name: save_run(tmp_path / name, POLICIES[name]()) for name in ("expert", "latent")}
    given = {name: runs.get(value, value) if isinstance(value, str) else value for name, value in given.items()}
    recipe = kind(**{**settings(tmp_path), "motions": ("nowhere.npz",)}, **given)
    assert told in last_line(module.main, recipe)


def test_a_logger_that_is_missing_is_told_before_motions_are_read(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "trackio", None)
    recipe = imagine.ImagineRecipe(**{**settings(tmp_path), "motions": ("nowhere.npz",)}, trackio=True)
    assert "--trackio needs: pip install" in last_line(imagine.main, recipe)


def test_an_expert_that_sees_too_few_frames(tmp_path):
    with pytest.raises(ConfigError, match=r"ahead is \(1,\), expected two frames for the action"):
        expert.ExpertRecipe(policy=ExpertConfig(action="reference_velocity", ahead=(1,)), **settings(tmp_path))


def test_a_stride_of_nothing(tmp_path):
    run = save_run(tmp_path / "expert", POLICIES["expert"]())
    with pytest.raises(ConfigError, match="stride is 0, expected a whole number of at least 1"):
        distill.DistillRecipe(expert=run, stride=0, **settings(tmp_path))
