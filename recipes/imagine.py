"""A keyframe policy without an expert: by imagined rollouts of a learned model of the robot.

plat imagine --motions clips.npz --init-model runs/expert --minutes 20 --out runs/imagined
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch

from plat.cli.settings import parse
from plat.errors import CheckpointError
from plat.modules import LatentPolicy, LatentPolicyConfig, PlainPolicy
from plat.motions import MotionLibrary
from plat.recipes.learning import ImaginationRecipe, learn
from plat.runs import SavedRun, report_errors
from plat.tasks import TimedKeyframes, TimedKeyframesConfig


@dataclass(kw_only=True)
class ImagineRecipe(ImaginationRecipe):
    """Learn a keyframe policy by imagined rollouts of a learned model of the robot, without an expert."""

    name = "imagine"

    student: Literal["plain", "latent"] = "plain"
    """without a latent, or through the prior's mean"""
    init: Path | None = None
    """run whose student to go on from; it has the shape of --policy"""
    policy: LatentPolicyConfig = field(default_factory=LatentPolicyConfig)
    task: TimedKeyframesConfig = field(default_factory=TimedKeyframesConfig)


def main(recipe: ImagineRecipe) -> None:
    """Run the recipe."""
    torch.manual_seed(recipe.seed)
    library = MotionLibrary.load(recipe.motions, mirror=recipe.mirror).to(recipe.device)
    kind: type[Any] = LatentPolicy if recipe.student == "latent" else PlainPolicy
    student = kind(library.robot, recipe.policy).to(recipe.device)
    if recipe.init:
        trained = SavedRun(recipe.init).policy_as(
            kind, f"a {recipe.student} student (--init, --student)", recipe.device
        )
        if trained.config != student.config:
            raise CheckpointError(
                f"--init {str(recipe.init)!r}: a student of {trained.config}, expected {student.config} (--policy)"
            )
        student.load_state_dict(trained.state_dict())

    def task(motions: MotionLibrary) -> TimedKeyframes:
        return TimedKeyframes(motions, recipe.task, timing=recipe.policy.timing, seed=recipe.seed)

    learn(recipe, library, student, student.deployed(), task)


COMMAND = ImagineRecipe

if __name__ == "__main__":
    with report_errors():
        main(parse(COMMAND))
