"""A keyframe policy without an expert: by imagined rollouts of a learned model of the robot.

plat imagine --motions clips.npz --init-model runs/expert --minutes 20 --out runs/imagined
"""

from functools import partial
from typing import Any

import torch

from plat.cli.settings import parse
from plat.envs.transforms import Horizon
from plat.evaluation import play
from plat.modules import LatentPolicy, PlainPolicy
from plat.motions import MotionLibrary
from plat.objectives import LatentImaginationLoss
from plat.recipes.learning import learn, starting_model
from plat.recipes.options import ImagineRecipe, check_distant
from plat.recipes.students import make_student, trained_student
from plat.rendering import Playback
from plat.robots import get_robot
from plat.runs import begin, report_errors, training_motions
from plat.runs.announce import next_command
from plat.tasks import TimedKeyframes

REFERENCE_UPDATES = 8
"""Updates of a new policy toward the motion's joint angles in each iteration of the warm-up."""


def main(recipe: ImagineRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    recipe, trained = trained_student(recipe)
    check_distant(recipe, recipe.policy.timing)
    recipe, start = starting_model(recipe, recipe.policy.timing.control_dt)
    student = make_student(recipe, get_robot(recipe.robot), trained)
    library = training_motions(recipe, recipe.policy.timing.control_dt)

    def task(motions: MotionLibrary) -> TimedKeyframes:
        return TimedKeyframes(motions, recipe.task, timing=recipe.policy.timing, seed=recipe.seed)

    def show(average: LatentPolicy | PlainPolicy) -> Playback:
        return play(average.deployed(), library, 0, Horizon(1, recipe.policy.timing.max_steps), device=recipe.device)

    settings: dict[str, Any] = {"start": start, "reference_updates": 0 if trained else REFERENCE_UPDATES}
    if recipe.posterior:
        loss = partial(LatentImaginationLoss, beta=recipe.beta)
        settings |= {"imagined": student.imagined(recipe.posterior), "loss": loss}
    good = "failures that fall; plat evaluate says the rest"
    started = {"init": trained}
    learn(recipe, library, student, student.deployed(), task, good=good, show=show, weights=started, **settings)


def after(recipe: ImagineRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_command(recipe, "plat evaluate", recipe.out, "--motions", "test.npz")


if __name__ == "__main__":
    with report_errors():
        main(parse(ImagineRecipe))
