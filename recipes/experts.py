"""The expert that a recipe trains: a new one, or one that goes on from another run."""

from dataclasses import replace
from typing import TypeVar

from plat.errors import CheckpointError, ConfigError
from plat.modules import Expert
from plat.recipes.options import ExpertModelRecipe, ExpertRecipe
from plat.recipes.shapes import in_shape_of, tell_robot, with_values
from plat.robots import Robot
from plat.runs import SavedRun, is_run
from plat.runs.announce import next_command
from plat.runs.dynamics import control_dt_of
from plat.runs.saved_run import CONFIG_FILE
from plat.spec.timing import Timing

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
    policy = in_shape_of(recipe.init, recipe.policy, type(recipe).policy, trained.config)
    return replace(recipe, policy=policy), trained


def make_expert(recipe: R, robot: Robot, trained: Expert | None) -> Expert:
    """Return an expert for a robot that starts from a trained one, if there is one.

    Raises:
        CheckpointError: when the trained one sees other frames, or has layers that this one lacks.
    """
    kind, config = Expert, recipe.policy
    if trained is not None:
        tell_robot(recipe.init, trained.robot, robot)
        # a class of one's own goes on as one, with settings that only it has
        kind, config = type(trained), with_values(trained.config, vars(config))
    expert = kind.build(robot, config).to(recipe.device)
    if trained is not None:
        try:
            expert.start_from(trained)
        except ConfigError as error:
            raise CheckpointError(f"--init {str(recipe.init)!r}: {error} (--policy.ahead, --policy.hidden)") from None
    return expert


def next_stage(recipe: R) -> str:
    """Return the lines that say where an expert is, and how a student learns from it: at its control step."""
    dt = recipe.policy.timing.control_dt
    if is_run(recipe.out):  # which may have gone on from another one, in the shape of that
        dt = control_dt_of(SavedRun(recipe.out).config.get("policy"), recipe.out / CONFIG_FILE)
    pace = () if dt == Timing.control_dt else ("--policy.timing.control-dt", f"{dt:g}")
    rest = ("--minutes", "15", "--out", "runs/dagger")
    return next_command(recipe, "plat distill", "--expert", recipe.out, "--motions", recipe.motions, pace, rest)
