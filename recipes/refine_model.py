"""Stage 3 without PPO: refine the student by imagined rollouts of a learned model of the robot.

plat refine-model --student runs/dagger --init-model runs/expert --motions clips.npz --minutes 15 --out runs/plat
"""

import torch

from plat.cli.settings import parse
from plat.envs.transforms import Horizon
from plat.evaluation import play
from plat.modules import Refinement
from plat.motions import MotionLibrary
from plat.recipes.learning import learn, starting_model
from plat.recipes.options import RefineModelRecipe, check_distant
from plat.recipes.refine import VARIANTS, load_student
from plat.rendering import Playback
from plat.runs import begin, report_errors, training_motions
from plat.runs.announce import next_command
from plat.tasks import TimedKeyframes


def main(recipe: RefineModelRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    device = recipe.device
    student, timing = load_student(recipe, "plat distill or plat imagine --student latent")
    check_distant(recipe, timing)
    recipe, start = starting_model(recipe, timing.control_dt)
    library = training_motions(recipe, timing.control_dt)
    policy = VARIANTS[recipe.variant](student, recipe.policy).to(device)

    def task(motions: MotionLibrary) -> TimedKeyframes:
        return TimedKeyframes(motions, recipe.task, timing=timing, seed=recipe.seed)

    def show(average: Refinement) -> Playback:
        return play(average.deployed(), library, 0, Horizon(1, timing.max_steps), device=recipe.device)

    good = "failures that fall; plat evaluate says the rest"
    started = {"student": student}
    learn(recipe, library, policy, policy.deployed(), task, good=good, show=show, weights=started, start=start)


def after(recipe: RefineModelRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_command(recipe, "plat evaluate", recipe.student, recipe.out, "--motions", "test.npz")


if __name__ == "__main__":
    with report_errors():
        main(parse(RefineModelRecipe))
