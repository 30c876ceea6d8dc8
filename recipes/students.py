"""The student that a recipe trains: a new one, or one that goes on from another run."""

from dataclasses import replace
from typing import Any, TypeVar

from plat.errors import CheckpointError, ConfigError
from plat.modules import LatentPolicy, PlainPolicy, take_over
from plat.recipes.options import DistillRecipe, ImagineRecipe, check_partial
from plat.robots import Robot
from plat.runs import SavedRun

R = TypeVar("R", DistillRecipe, ImagineRecipe)
KINDS: dict[str, type[Any]] = {"latent": LatentPolicy, "plain": PlainPolicy}


def trained_student(recipe: R) -> tuple[R, Any]:
    """Return the student that ``--init`` names, or None, and the recipe in its shape unless ``--policy`` has another.

    Raises:
        CheckpointError: for a run that holds no such student.
        ConfigError: for partial keyframes, to a student that does not see which parts are commanded.
    """
    trained = None
    if recipe.init:
        expected = f"a {recipe.student} student (--init, --student)"
        trained = SavedRun(recipe.init).policy_as(KINDS[recipe.student], expected, recipe.device)
        if recipe.policy == type(recipe.policy)():
            recipe = replace(recipe, policy=replace(recipe.policy, **vars(trained.config)))
    check_partial(recipe.task.partial, recipe.policy.also)
    return recipe, trained


def make_student(recipe: R, robot: Robot, trained: Any) -> Any:
    """Return a student for a robot that acts like a trained one, if there is one.

    Raises:
        CheckpointError: when the trained one has layers that this one lacks.
    """
    student = KINDS[recipe.student](robot, recipe.policy).to(recipe.device)
    if trained is not None:
        try:
            take_over(student, trained)
        except ConfigError as error:
            raise CheckpointError(f"--init {str(recipe.init)!r}: {error}") from None
    return student
