"""Stage 1: train a dense motion-tracking expert with PPO.

python recipes/expert.py --motions clips.npz --minutes 30 --out runs/expert
"""

from dataclasses import dataclass, field

import torch
import tyro
from torchrl.collectors import Collector

from plat.envs import MotionLibrary, TaskConfig, make_tracking_env
from plat.envs.transforms import pop_statistics
from plat.modules import Critic, Expert, ExpertConfig
from plat.objectives import PPO, PPOConfig
from plat.training import Budget, RecipeConfig, Run, report_errors


@dataclass(kw_only=True)
class ExpertRecipe(RecipeConfig):
    """Train a dense motion-tracking expert."""

    rollout: int = 24
    """control steps of each robot between updates"""
    policy: ExpertConfig = field(default_factory=ExpertConfig)
    task: TaskConfig = field(default_factory=TaskConfig)
    ppo: PPOConfig = field(default_factory=PPOConfig)


def main(recipe: ExpertRecipe) -> None:
    """Run the recipe."""
    torch.manual_seed(recipe.seed)
    library = MotionLibrary.load(recipe.motions, mirror=recipe.mirror)
    env = make_tracking_env(library, recipe.num_envs, recipe.task, device=recipe.device)
    expert = Expert(library.robot, recipe.policy).to(recipe.device)
    critic = Critic(library.robot, expert.normalizer.in_keys).to(recipe.device)
    ppo = PPO(expert.head(), critic.head(), critic.observe(), recipe.ppo)
    budget = Budget(recipe.minutes, recipe.steps)
    run = Run(
        recipe.out,
        recipe=recipe,
        policy=expert,
        budget=budget,
        state={"critic": critic, "optimizer": ppo.optimizer, "env": env},
        resume=recipe.resume,
        save_every=recipe.save_every,
        wandb=recipe.wandb,
    )
    collector = Collector(
        env,
        expert.actor(),
        frames_per_batch=recipe.num_envs * recipe.rollout,
        track_traj_ids=False,
        trust_policy=True,
        auto_register_policy_transforms=False,
    )
    for rollout in collector:
        budget.add(rollout.numel())
        statistics = pop_statistics(env)
        # the first rollout of a run only fills the normalisers: learning from raw observations would be wasted
        losses = ppo.step(rollout) if expert.normalizer.count > 0 else {}
        expert.normalizer.update(rollout)
        critic.normalizer.update(rollout)
        terminations = statistics["terminated"] / library.dt
        keypoint_error = statistics["error/keypoint_aligned"]
        run.log(
            {**statistics, **losses, "terminations_per_second": terminations},
            {"terminations": f"{terminations:.2f}/s", "keypoint error": f"{100 * keypoint_error:.1f} cm"},
        )
        if budget.done:
            break
    collector.shutdown()
    run.finish()


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(ExpertRecipe))
