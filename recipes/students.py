"""The student that a recipe trains: a new one, or one that goes on from another run."""

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import torch

from plat.errors import CheckpointError, ConfigError
from plat.modules import FinetunedPolicy, LatentPolicy, PlainPolicy, take_over
from plat.recipes.options import DistillRecipe, ImagineRecipe, check_partial
from plat.recipes.shapes import in_shape_of, tell_robot, with_values
from plat.robots import Robot
from plat.runs import SavedRun

R = TypeVar("R", DistillRecipe, ImagineRecipe)
KINDS: dict[str, type[Any]] = {"latent": LatentPolicy, "plain": PlainPolicy}
_KEPT = ("normalizer", "reach", "symmetric")


def trained_student(recipe: R) -> tuple[R, Any]:
    """Return the student that ``--init`` names, or None, and the recipe in its shape unless ``--policy`` has another.

    A line says in what the shape differs. Reach and symmetry stay unless ``--policy`` sets them.

    Raises:
        CheckpointError: for a run that holds no such student.
        ConfigError: for partial keyframes, to a student that does not see which parts are commanded.
    """
    trained = None
    if recipe.init:
        expected = f"a {recipe.student} student (--init, --student)"
        trained = saved_student(recipe.init, KINDS[recipe.student], expected, recipe.device)
        policy = in_shape_of(recipe.init, recipe.policy, type(recipe.policy)(), trained.config, _KEPT)
        recipe = replace(recipe, policy=policy)
    check_partial(recipe.task.partial, recipe.policy.also)
    return recipe, trained


def make_student(recipe: R, robot: Robot, trained: Any) -> Any:
    """Return a student for a robot that acts like a trained one, if there is one.

    Raises:
        CheckpointError: when the trained one has layers that this one lacks.
    """
    kind, config = KINDS[recipe.student], recipe.policy
    if trained is not None:
        tell_robot(recipe.init, trained.robot, robot)
        # a class of one's own goes on as one, with settings that only it has
        kind, config = type(trained), with_values(trained.config, vars(config))
    student = kind.build(robot, config).to(recipe.device)
    if trained is not None:
        try:
            take_over(student, trained)
        except ConfigError as error:
            raise CheckpointError(f"--init {str(recipe.init)!r}: {error}") from None
    return student


def saved_student(
    folder: Path, kind: type[Any], expected: str, device: torch.device | str = "cpu", lead: float = 0.0
) -> Any:
    """Return the student that a run holds. One that was fine-tuned is a student with other weights.

    Args:
        folder: the run, or the name of shipped weights.
        kind: class of the student.
        expected: description for the message, such as ``"a latent student (--init)"``.
        device: device of the weights.
        lead: feed-forward (s) that whoever goes on from it acts with.

    Raises:
        CheckpointError: for another policy.
        ConfigError: for a fine-tuned one with another lead, without which it acts otherwise.
    """
    saved = SavedRun(folder)
    if saved.kind != "finetuned" or kind is not LatentPolicy:
        return saved.policy_as(kind, expected, device)
    tuned = saved.policy_as(FinetunedPolicy, expected, device)
    if tuned.config.lead != lead:
        told = f"lead is {lead:g} s, expected {tuned.config.lead:g} s"
        raise ConfigError(f"{told}, with which {str(folder)!r} was fine-tuned (--policy.lead of stage 3)")
    return tuned.student
