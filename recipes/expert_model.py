"""Stage 1 without PPO: learn a model of the robot, and an expert by imagined rollouts of it.

plat expert-model --motions clips.npz --minutes 30 --out runs/expert
"""

import torch

from plat.cli.settings import parse
from plat.envs.transforms import Horizon
from plat.evaluation import play
from plat.modules import Expert
from plat.motions import MotionLibrary
from plat.recipes.experts import make_expert, next_stage, trained_expert
from plat.recipes.learning import learn, starting_model
from plat.recipes.options import ExpertModelRecipe
from plat.rendering import Playback
from plat.robots import get_robot
from plat.runs import begin, report_errors, training_motions
from plat.tasks import DenseTracking


def main(recipe: ExpertModelRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    recipe, trained = trained_expert(recipe)
    recipe, start = starting_model(recipe, recipe.policy.timing.control_dt)
    expert = make_expert(recipe, get_robot(recipe.robot), trained)
    library = training_motions(recipe, recipe.policy.timing.control_dt)
    goals = expert.goals  # apart from the expert, whose weights may be on a GPU: workers make tasks of their own

    def task(motions: MotionLibrary) -> DenseTracking:
        return DenseTracking(motions, goals, costs=recipe.costs, uniform=recipe.uniform_starts)

    def show(average: Expert) -> Playback:
        lengths = Horizon(1, recipe.policy.timing.max_steps)
        actor = average.deployed(tuple(goals))
        return play(actor, library, 0, lengths, dense=True, goals=goals, device=recipe.device)

    # what the network adds to the reference is kept small, not the reference
    residual = recipe.policy.action != "default_offset"
    actor = expert.deployed(tuple(expert.goals)).reset_out_keys()
    good = "fewer than 0.3 failures a second"
    effort = "residual" if residual else "action"
    started = {"init": trained}
    learn(recipe, library, expert, actor, task, good=good, show=show, weights=started, start=start, effort=effort)


def after(recipe: ExpertModelRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_stage(recipe)


if __name__ == "__main__":
    with report_errors():
        main(parse(ExpertModelRecipe))
