"""Stage 3: refine the student with PPO on a residual in its latent, or by one of the ablations.

python recipes/refine.py --student runs/dagger --motions clips.npz --minutes 15 --out runs/plat
"""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import torch
import tyro

from plat.collectors import rollouts
from plat.envs import KeyframeTaskConfig, make_keyframe_env
from plat.envs.transforms import DenseRewards, KeyframeRewards, TrackingTerm, horizon_named, pop_statistics
from plat.evaluation import play
from plat.modules import (
    STUDENT_KEYS,
    Critic,
    FinetunedPolicy,
    LatentNoisePolicy,
    RefinementConfig,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.motions import MotionLibrary
from plat.objectives import PPO, MotorGradientConfig, PPOConfig, motor_gradient
from plat.rendering import Films
from plat.runs import Budget, RecipeConfig, Run, load_policy, report_errors
from plat.spec.timing import Timing, timing_of

VARIANTS = {
    "latent": ResidualLatentPolicy,
    "latent-noise": LatentNoisePolicy,
    "action": ResidualActionPolicy,
    "finetune": FinetunedPolicy,
}


@dataclass(kw_only=True)
class RefineRecipe(RecipeConfig):
    """Refine a student with PPO."""

    student: Path
    """run of stage 2"""
    variant: Literal["latent", "latent-noise", "action", "finetune"] = "latent"
    """PLAT with noise on the action, or on the latent (no motor gradient then); residual in the action; all weights"""
    policy: RefinementConfig = field(default_factory=lambda: RefinementConfig(lead=0.05))
    task: KeyframeTaskConfig = field(
        # two thirds of the reward are for keyframes: what is in between, the policy is not shown
        default_factory=lambda: KeyframeTaskConfig(
            dense_weight=0.3,
            sparse_weight=20.0,
            dense=DenseRewards(anchor_pos=TrackingTerm(2.0, 0.3)),
            sparse=KeyframeRewards(joint_pos=TrackingTerm(1.0, 0.1), keypoint_pos=TrackingTerm(1.0, 0.1)),
        )
    )
    ppo: PPOConfig = field(
        # motions end with a keyframe, and so where most is paid
        default_factory=lambda: PPOConfig(
            entropy=0.0, lr=1e-4, min_lr=2e-5, max_lr=3e-4, target_kl=0.005, truncated="mean"
        )
    )
    motor: MotorGradientConfig = field(default_factory=MotorGradientConfig)
    horizon: Literal["single", "short", "medium", "long", "mixed", "distant", "all"] = "mixed"
    """lengths of the commands; "all" that the timing allows"""
    rollout: int = 24
    """control steps of each robot between updates"""
    critic_warmup: int = 10
    """rollouts from which only the critic learns: a critic that knows nothing would undo the student"""


def main(recipe: RefineRecipe) -> None:
    """Run the recipe."""
    torch.manual_seed(recipe.seed)
    device = recipe.device
    student = load_policy(recipe.student)
    timing = timing_of(student) or Timing()
    horizon = horizon_named(recipe.horizon, timing)
    library = MotionLibrary.load(recipe.motions, dt=timing.control_dt, mirror=recipe.mirror).to(device)
    env = make_keyframe_env(library, recipe.num_envs, recipe.task, horizon=horizon, timing=timing, device=device)
    policy = VARIANTS[recipe.variant](student, recipe.policy).to(device)
    critic = Critic(library.robot, STUDENT_KEYS).to(device)
    ppo = PPO(policy.head(), critic.head(), critic.observe(), recipe.ppo, action_key=policy.sample_key)
    budget = Budget(recipe.minutes, recipe.steps)
    watch = partial(play, policy.deployed(), library, 0, horizon, device=device)
    films = Films(recipe.out / "videos", library.robot, watch, recipe.video_every)
    run = Run(
        recipe.out,
        recipe=recipe,
        policy=policy,
        budget=budget,
        state={
            "critic": critic,
            "optimizer": ppo.optimizer,
            "critic_optimizer": ppo.critic_optimizer,
            "env": env,
        },
        resume=recipe.resume,
        save_every=recipe.save_every,
        loggers=recipe.loggers,
        film=films.take,
    )
    warmup_steps = recipe.critic_warmup * recipe.num_envs * recipe.rollout
    for rollout in rollouts(env, policy.actor(), recipe.rollout, recipe.ppo.precision):
        budget.add(rollout.numel())
        statistics = pop_statistics(env)
        warming = budget.steps <= warmup_steps
        gradient = None
        if recipe.motor.weight and policy.sample_key == "action":
            gradient = motor_gradient(rollout, library.robot, recipe.motor, goal="dense_goal")
        losses = ppo.step(rollout, not warming, gradient) if critic.normalizer.count > 0 else {}
        critic.normalizer.update(rollout)
        terminations = statistics["terminated"] / library.dt
        reward = float(rollout["next", "reward"].mean()) / library.dt
        run.log(
            {**statistics, **losses, "terminations_per_second": terminations, "reward_per_second": reward},
            {"failures": f"{terminations:.2f}/s", "reward": f"{reward:.2f}/s"},
        )
        if budget.done:
            break
    run.finish()


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(RefineRecipe, config=(tyro.conf.CascadeSubcommandArgs,)))
