"""The expert that a recipe trains: a new one, or one that goes on from another run."""

from dataclasses import asdict, replace
from typing import TypeVar

from plat.errors import CheckpointError, ConfigError
from plat.modules import Expert
from plat.recipes.options import ExpertModelRecipe, ExpertRecipe
from plat.robots import Robot
from plat.runs import SavedRun

R = TypeVar("R", ExpertRecipe, ExpertModelRecipe)


def trained_expert(recipe: R) -> tuple[R, Expert | None]:
    """Return the expert that ``--init`` names, or None, and the recipe in its shape unless ``--policy`` has another.

    A line says in what the shape differs from that of the recipe.

    Raises:
        CheckpointError: for a run that holds no expert.
    """
    if not recipe.init:
        return recipe, None
    trained = SavedRun(recipe.init).policy_as(Expert, "an expert (--init)", recipe.device)
    ours, theirs = asdict(recipe.policy), asdict(trained.config)
    changed = [name for name in ours if ours[name] != theirs[name]]
    if recipe.policy == type(recipe).policy:
        recipe = replace(recipe, policy=trained.config)
        words = [f"{name} {theirs[name]}" for name in changed]
        told = f"goes on in its shape: {', '.join(words)}"
    else:
        told = f"goes on with {', '.join(f'{name} {ours[name]} in place of {theirs[name]}' for name in changed)}"
    if changed:
        print(f"--init {str(recipe.init)!r} {told}")
    return recipe, trained


def make_expert(recipe: R, robot: Robot, trained: Expert | None) -> Expert:
    """Return an expert for a robot that starts from a trained one, if there is one.

    Raises:
        CheckpointError: when the trained one sees other frames, or has layers that this one lacks.
    """
    expert = Expert(robot, recipe.policy).to(recipe.device)
    if trained is not None:
        try:
            expert.start_from(trained)
        except ConfigError as error:
            raise CheckpointError(f"--init {str(recipe.init)!r}: {error} (--policy.ahead, --policy.hidden)") from None
    return expert
