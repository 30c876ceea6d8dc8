"""Stage 1 without PPO: learn a model of the robot, and an expert by imagined rollouts of it.

plat expert-model --motions clips.npz --minutes 30 --out runs/expert
"""

from dataclasses import dataclass, field
from pathlib import Path

import torch

from plat.cli.settings import parse
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionLibrary
from plat.recipes.learning import ImaginationRecipe, learn
from plat.runs import SavedRun, report_errors
from plat.tasks import DenseTracking, TrackingCosts


@dataclass(kw_only=True)
class ExpertModelRecipe(ImaginationRecipe):
    """Learn a model of the robot, and a dense motion-tracking expert by imagined rollouts of it."""

    name = "expert-model"

    init: Path | None = None
    """run whose expert to go on from"""
    policy: ExpertConfig = field(default_factory=lambda: ExpertConfig(action="reference_velocity", ahead=(1, 2, 5, 10)))
    costs: TrackingCosts = field(default_factory=TrackingCosts)
    uniform_starts: float = 0.3
    """share of the episodes that start anywhere; the others start where failures are"""


def main(recipe: ExpertModelRecipe) -> None:
    """Run the recipe."""
    torch.manual_seed(recipe.seed)
    library = MotionLibrary.load(recipe.motions, mirror=recipe.mirror).to(recipe.device)
    expert = Expert(library.robot, recipe.policy).to(recipe.device)
    if recipe.init:
        expert.start_from(SavedRun(recipe.init).policy_as(Expert, "an expert (--init)", recipe.device))

    def task(motions: MotionLibrary) -> DenseTracking:
        return DenseTracking(motions, expert.goals, costs=recipe.costs, uniform=recipe.uniform_starts)

    # what the network adds to the reference is kept small, not the reference
    residual = recipe.policy.action != "default_offset"
    actor = expert.deployed(tuple(expert.goals)).reset_out_keys()
    learn(recipe, library, expert, actor, task, effort="residual" if residual else "action")


COMMAND = ExpertModelRecipe

if __name__ == "__main__":
    with report_errors():
        main(parse(COMMAND))
