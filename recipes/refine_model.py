"""Stage 3 without PPO: refine the student by imagined rollouts of a learned model of the robot.

plat refine-model --student runs/dagger --init-model runs/expert --motions clips.npz --minutes 15 --out runs/plat
"""

import torch

from plat.cli.settings import parse
from plat.modules import LatentPolicy
from plat.motions import MotionLibrary
from plat.recipes.learning import learn
from plat.recipes.options import RefineModelRecipe, check_partial
from plat.recipes.refine import VARIANTS
from plat.robots import get_robot
from plat.runs import SavedRun, begin, report_errors
from plat.runs.announce import next_command
from plat.spec.timing import Timing, timing_of
from plat.tasks import TimedKeyframes


def main(recipe: RefineModelRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    device = recipe.device
    expected = "a student with a latent, of plat distill or plat imagine --student latent (--student)"
    student = SavedRun(recipe.student).policy_as(LatentPolicy, expected)
    timing = timing_of(student) or Timing()
    check_partial(recipe.task.partial, student.config.also)
    library = MotionLibrary.load(
        recipe.motions, get_robot(recipe.robot), dt=timing.control_dt, mirror=recipe.mirror, drop_bad=recipe.drop_bad
    ).to(device)
    policy = VARIANTS[recipe.variant](student, recipe.policy).to(device)

    def task(motions: MotionLibrary) -> TimedKeyframes:
        return TimedKeyframes(motions, recipe.task, timing=timing, seed=recipe.seed)

    good = "failures that fall; plat evaluate says the rest"
    learn(recipe, library, policy, policy.deployed(), task, good=good, init=student)


def after(recipe: RefineModelRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_command(recipe.out, "plat evaluate", recipe.student, recipe.out, "--motions", recipe.motions)


if __name__ == "__main__":
    with report_errors():
        main(parse(RefineModelRecipe))
