"""Stage 1: train a dense motion-tracking expert with PPO.

plat expert --motions clips.npz --minutes 30 --out runs/expert
"""

from dataclasses import replace
from functools import partial

import torch

from plat.cli.settings import parse
from plat.collectors import collect
from plat.envs import make_tracking_env
from plat.envs.physics import get_physics
from plat.envs.transforms import Horizon
from plat.evaluation import play
from plat.modules import Critic
from plat.objectives import PPO, PPOConfig, motor_gradient
from plat.recipes.experts import make_expert, next_stage, trained_expert
from plat.recipes.options import ExpertRecipe
from plat.rendering import Films
from plat.robots import get_robot
from plat.runs import Budget, Run, begin, report_errors, run_inputs, training_motions
from plat.runs.announce import begins


def main(recipe: ExpertRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    recipe, start = trained_expert(recipe)
    timing = recipe.policy.timing
    expert = make_expert(recipe, get_robot(recipe.robot), start)
    library = training_motions(recipe, timing.control_dt)
    critic = Critic(library.robot, expert.normalizer.in_keys, recipe.critic).to(recipe.device)
    ppo = PPO(expert.head(), critic.head(), critic.observe(), ppo_config(recipe))
    budget = Budget(recipe.minutes, recipe.steps)
    source = collect(
        partial(make_tracking_env, config=recipe.task, goals=expert.goals, physics=get_physics(recipe.physics)),
        library,
        recipe.num_envs,
        expert.actor(),
        recipe.rollout,
        recipe.ppo.precision,
        device=recipe.device,
        workers=recipe.workers,
        ray=recipe.ray,
    )
    lengths = Horizon(1, timing.max_steps)
    watch = partial(play, expert.deployed(tuple(expert.goals)), library, 0, lengths, device=recipe.device)
    films = Films(
        recipe.out / "videos", library.robot, partial(watch, dense=True, goals=expert.goals), recipe.video_every
    )
    # and one more: the first rollout fills the normalizers
    warmup_steps = (recipe.critic_warmup + 1) * recipe.num_envs * recipe.rollout if recipe.init else 0
    with (
        source,
        Run.of(
            recipe,
            policy=expert,
            budget=budget,
            state={"critic": critic, "ppo": ppo, "rollouts": source},
            inputs=run_inputs(library, init=start),
            film=films.take,
        ) as run,
    ):
        if not run.finished:
            begins(
                recipe, library, recipe.ppo.precision, "fewer than 0.3 terminations a second, keypoint error below 6 cm"
            )
        while not budget.done:
            rollout = next(source)
            budget.add(rollout.numel())
            statistics = source.statistics()
            # the first rollout of a run only fills the normalizers: learning from raw observations would be wasted
            warming = budget.steps <= warmup_steps
            gradient = None
            if recipe.motor.weight:
                gradient = motor_gradient(rollout, expert.robot, recipe.motor, ahead=expert.goals["goal"])
            losses = ppo.step(rollout, not warming, gradient) if critic.normalizer.count > 0 else {}
            expert.normalizer.update(rollout)
            critic.normalizer.update(rollout)
            terminations = statistics["terminated"] / library.dt
            keypoint_error = statistics["error/keypoint_aligned"]
            run.log(
                {**statistics, **losses, "terminations_per_second": terminations},
                {"terminations": f"{terminations:.2f}/s", "keypoint error": f"{100 * keypoint_error:.1f} cm"},
            )
        run.finish()


def after(recipe: ExpertRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_stage(recipe)


def ppo_config(recipe: ExpertRecipe) -> PPOConfig:
    """The recipe's hyperparameters, with the learning rate of an expert that is trained already after --init."""
    config, most = recipe.ppo, recipe.init_lr
    return replace(config, lr=min(config.lr, most), min_lr=min(config.min_lr, most)) if recipe.init else config


if __name__ == "__main__":
    with report_errors():
        main(parse(ExpertRecipe))
