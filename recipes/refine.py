"""Stage 3: refine the student with PPO on a residual in its latent, or by one of the ablations.

plat refine --student runs/dagger --motions clips.npz --minutes 15 --out runs/plat
"""

from functools import partial

import torch

from plat.cli.settings import parse
from plat.collectors import collect
from plat.envs import make_keyframe_env
from plat.envs.physics import get_physics
from plat.envs.transforms import horizon_named
from plat.evaluation import play
from plat.modules import (
    Critic,
    FinetunedPolicy,
    LatentNoisePolicy,
    LatentPolicy,
    Refinement,
    ResidualActionPolicy,
    ResidualLatentPolicy,
)
from plat.objectives import PPO, motor_gradient
from plat.recipes.options import RefineModelRecipe, RefineRecipe, check_partial
from plat.recipes.students import saved_student
from plat.rendering import Films
from plat.robots import get_robot
from plat.runs import Budget, Run, begin, check_drives, report_errors, run_inputs, training_motions
from plat.runs.announce import begins, next_command
from plat.spec.observation import student_keys
from plat.spec.timing import Timing, timing_of

VARIANTS: dict[str, type[Refinement]] = {
    "latent": ResidualLatentPolicy,
    "latent-noise": LatentNoisePolicy,
    "action": ResidualActionPolicy,
    "finetune": FinetunedPolicy,
}


def main(recipe: RefineRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    device = recipe.device
    student, timing = load_student(recipe, "plat distill")
    horizon = horizon_named(recipe.horizon, timing)
    library = training_motions(recipe, timing.control_dt)
    policy = VARIANTS[recipe.variant](student, recipe.policy).to(device)
    critic = Critic(library.robot, student_keys(student.config.also), recipe.critic).to(device)
    ppo = PPO(policy.head(), critic.head(), critic.observe(), recipe.ppo, action_key=policy.sample_key)
    budget = Budget(recipe.minutes, recipe.steps)
    source = collect(
        partial(
            make_keyframe_env, config=recipe.task, horizon=horizon, timing=timing, physics=get_physics(recipe.physics)
        ),
        library,
        recipe.num_envs,
        policy.actor(),
        recipe.rollout,
        recipe.ppo.precision,
        device=device,
        workers=recipe.workers,
        ray=recipe.ray,
    )
    watch = partial(play, policy.deployed(), library, 0, horizon, device=device)
    films = Films(recipe.out / "videos", library.robot, watch, recipe.video_every)
    # and one more: the first rollout fills the normalizers
    warmup_steps = (recipe.critic_warmup + 1) * recipe.num_envs * recipe.rollout
    with (
        source,
        Run.of(
            recipe,
            policy=policy,
            budget=budget,
            state={"critic": critic, "ppo": ppo, "rollouts": source},
            inputs=run_inputs(library, student=student),
            film=films.take,
        ) as run,
    ):
        if not run.finished:
            begins(
                recipe,
                library,
                recipe.ppo.precision,
                "failures that fall; plat evaluate says how many commands are met",
            )
        while not budget.done:
            rollout = next(source)
            budget.add(rollout.numel())
            statistics = source.statistics()
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
        run.finish()


def load_student(recipe: RefineRecipe | RefineModelRecipe, made_by: str) -> tuple[LatentPolicy, Timing]:
    """The student of stage 2 and its timing; ``made_by`` names the commands that make such a one.

    One that was fine-tuned is a student with other weights.

    Raises:
        CheckpointError: for another policy.
        ConfigError: for one of another robot, and a fine-tuned one whose lead is not that of the recipe.
    """
    expected = f"a student with a latent, of {made_by} (--student)"
    student = saved_student(recipe.student, LatentPolicy, expected, lead=recipe.policy.lead)
    check_partial(recipe.task.partial, student.config.also)
    check_drives(student.robot, get_robot(recipe.robot), f"--student {str(recipe.student)!r}")
    return student, timing_of(student) or Timing()


def after(recipe: RefineRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    return next_command(recipe, "plat evaluate", recipe.student, recipe.out, "--motions", "test.npz")


if __name__ == "__main__":
    with report_errors():
        main(parse(RefineRecipe))
