"""A keyframe policy without an expert: by imagined rollouts of a learned model of the robot.

plat imagine --motions clips.npz --init-model runs/expert --minutes 20 --out runs/imagined
"""

from dataclasses import replace
from functools import partial
from typing import Any

import torch

from plat.cli.settings import parse
from plat.errors import CheckpointError, ConfigError
from plat.modules import LatentPolicy, PlainPolicy, take_over
from plat.motions import MotionLibrary
from plat.objectives import LatentImaginationLoss
from plat.recipes.learning import learn
from plat.recipes.options import ImagineRecipe, check_partial
from plat.runs import SavedRun, begin, report_errors, training_motions
from plat.runs.announce import next_command
from plat.tasks import TimedKeyframes


def main(recipe: ImagineRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    kind: type[Any] = LatentPolicy if recipe.student == "latent" else PlainPolicy
    trained: Any = None
    if recipe.init:
        trained = SavedRun(recipe.init).policy_as(
            kind, f"a {recipe.student} student (--init, --student)", recipe.device
        )
        if recipe.policy == type(recipe.policy)():
            recipe = replace(recipe, policy=replace(recipe.policy, **vars(trained.config)))
    check_partial(recipe.task.partial, recipe.policy.also)
    library = training_motions(recipe, recipe.policy.timing.control_dt)
    student = kind(library.robot, recipe.policy).to(recipe.device)
    if trained is not None:
        try:
            take_over(student, trained)
        except ConfigError as error:
            raise CheckpointError(f"--init {str(recipe.init)!r}: {error}") from None

    def task(motions: MotionLibrary) -> TimedKeyframes:
        return TimedKeyframes(motions, recipe.task, timing=recipe.policy.timing, seed=recipe.seed)

    privileged: dict[str, Any] = {}
    if recipe.posterior:
        loss = partial(LatentImaginationLoss, beta=recipe.beta)
        privileged = {"imagined": student.imagined(recipe.posterior), "loss": loss}
    good = "failures that fall; plat evaluate says the rest"
    learn(recipe, library, student, student.deployed(), task, good=good, init=trained, **privileged)


def after(recipe: ImagineRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_command(recipe.out, "plat evaluate", recipe.out, "--motions", recipe.motions)


if __name__ == "__main__":
    with report_errors():
        main(parse(ImagineRecipe))
