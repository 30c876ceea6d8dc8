"""Stage 1 without PPO: learn a model of the robot, and an expert by imagined rollouts of it.

python recipes/expert_model.py --motions clips.npz --minutes 30 --out runs/expert
"""

from dataclasses import dataclass, field
from pathlib import Path

import torch
import tyro
from learning import ImaginationRecipe, learn

from plat.errors import CheckpointError
from plat.modules import Expert, ExpertConfig
from plat.motions import MotionLibrary
from plat.runs import load_policy, report_errors
from plat.tasks import DenseTracking, TrackingCosts


@dataclass(kw_only=True)
class ExpertModelRecipe(ImaginationRecipe):
    """Learn a model of the robot, and a dense motion-tracking expert by imagined rollouts of it."""

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
        trained = load_policy(recipe.init, recipe.device)
        if not isinstance(trained, Expert):
            raise CheckpointError(f"--init {str(recipe.init)!r}: a {type(trained).__name__}, expected an expert")
        expert.start_from(trained)

    def task(motions: MotionLibrary) -> DenseTracking:
        return DenseTracking(motions, expert.goals, costs=recipe.costs, uniform=recipe.uniform_starts)

    # what the network adds to the reference is kept small, not the reference
    residual = recipe.policy.action != "default_offset"
    actor = expert.deployed(tuple(expert.goals)).reset_out_keys()
    learn(recipe, library, expert, actor, task, effort="residual" if residual else "action")


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(ExpertModelRecipe))
