"""Stage 2: teach a student that sees only keyframes, by DAgger with a privileged latent.

plat distill --expert runs/expert --motions clips.npz --minutes 15 --out runs/dagger
"""

import copy
from functools import partial
from typing import Any

import torch
from torch import nn
from torchrl.envs import EnvBase

from plat.cli.settings import parse
from plat.collectors import ExpertLabels, MixedPolicy, collect, dagger_buffer
from plat.envs import make_keyframe_env
from plat.envs.physics import get_physics
from plat.envs.transforms import horizon_named
from plat.errors import ConfigError
from plat.evaluation import play
from plat.modules import Expert, Teacher
from plat.motions import MotionLibrary
from plat.objectives import ImitationLoss, LatentImitationLoss, autocast
from plat.recipes.options import DistillRecipe
from plat.recipes.students import make_student, trained_student
from plat.rendering import Films
from plat.robots import get_robot
from plat.runs import (
    DYNAMICS_FILE,
    Budget,
    Run,
    SavedRun,
    begin,
    check_drives,
    report_errors,
    run_folder,
    run_inputs,
    training_motions,
)
from plat.runs.announce import begins, next_command
from plat.spec.timing import timing_of


def main(recipe: DistillRecipe) -> None:
    """Run the recipe."""
    recipe = begin(recipe)
    torch.manual_seed(recipe.seed)
    recipe, trained = trained_student(recipe)
    device, timing, robot = recipe.device, recipe.policy.timing, get_robot(recipe.robot)
    expected = "a teacher, such as the expert of stage 1 (--expert)"
    teacher: Teacher = SavedRun(recipe.expert).policy_as(Teacher, expected, device)  # type: ignore[type-abstract]
    flag = f"--expert {str(recipe.expert)!r}"
    timing.check_control_dt((timing_of(teacher) or timing).control_dt, flag)
    if isinstance(teacher, Expert):  # released trackers have motors of their own, and say what they want as plat does
        check_drives(teacher.robot, robot, flag)
    horizon = horizon_named(recipe.horizon, timing)
    if teacher.stateful and recipe.workers:
        raise ConfigError("--workers: this teacher (--expert) keeps its memory of a robot in one process, use 0")
    student = make_student(recipe, robot, trained)
    library = training_motions(recipe, timing.control_dt)
    loss: Any
    if recipe.student == "latent":
        loss = LatentImitationLoss(
            student.training_graph(), prior_weight=recipe.prior_weight, beta=recipe.beta, free_bits=recipe.free_bits
        )
    else:
        loss = ImitationLoss(student.training_graph())
    optimizer = torch.optim.Adam(student.parameters(), lr=recipe.lr, fused=True)
    buffer = dagger_buffer(library, recipe.buffer_size, recipe.batch_size, recipe.stride, device)
    labels = teacher.labels()
    policy = MixedPolicy(student.sampled(), labels, recipe.expert_share, keep_labels=teacher.stateful)
    budget = Budget(recipe.minutes, recipe.steps)
    source = collect(
        partial(
            robots,
            on_cpu(teacher) if recipe.workers else teacher,
            config=recipe.task,
            horizon=horizon,
            timing=timing,
            physics=get_physics(recipe.physics),
        ),
        library,
        recipe.num_envs,
        policy,
        recipe.rollout,
        recipe.precision,
        device=device,
        workers=recipe.workers,
        ray=recipe.ray,
        ahead=True,
    )
    watch = partial(play, student.deployed(), library, 0, horizon, device=device)
    films = Films(recipe.out / "videos", library.robot, watch, recipe.video_every)
    labeled = ExpertLabels(None if teacher.stateful else labels, student.normalizer.in_keys, recipe.precision)
    with (
        source,
        Run.of(
            recipe,
            policy=student,
            budget=budget,
            state={"optimizer": optimizer, "rollouts": source, **({"buffer": buffer} if recipe.save_buffer else {})},
            inputs=run_inputs(library, expert=teacher if isinstance(teacher, nn.Module) else None, init=trained),
            film=films.take,
        ) as run,
    ):
        if not run.finished:
            begins(
                recipe, library, recipe.precision, "failures that fall; plat evaluate says how many commands are met"
            )
        while not budget.done:
            # set before the rollout: a resumed run knows its budget alone
            policy.expert_share.fill_(recipe.expert_share * max(0.0, 1 - budget.fraction / recipe.expert_until))
            rollout = next(source)
            states = labeled(rollout)
            budget.add(len(states))
            buffer.extend(states)
            student.update_normalizers(states)
            if recipe.student == "latent":
                loss.beta.fill_(recipe.beta * min(1.0, budget.fraction / recipe.beta_warmup))
            for group in optimizer.param_groups:
                group["lr"] = cosine(recipe.lr, 0.1 * recipe.lr, budget.fraction)
            for _ in range(recipe.updates):
                batch = buffer.sample()
                with autocast(device, recipe.precision):
                    losses = loss(batch)
                total = sum(value for name, value in losses.items() if name.startswith("loss_"))
                optimizer.zero_grad()
                total.backward()
                nn.utils.clip_grad_norm_(student.parameters(), recipe.grad_norm)
                optimizer.step()
            statistics = source.statistics()
            terminations = statistics["terminated"] / library.dt
            run.log(
                {
                    **statistics,
                    **{name: float(value) for name, value in losses.detach().items()},
                    "terminations_per_second": terminations,
                    "expert_share": float(policy.expert_share),
                },
                {"failures": f"{terminations:.2f}/s", "loss": f"{float(total.detach()):.2f}"},
            )
        run.finish()


def robots(teacher: Teacher, library: MotionLibrary, num_envs: int, **options: Any) -> EnvBase:
    """The environment of the student, which shows the teacher its reference as well."""
    return make_keyframe_env(library, num_envs, dense_goals={}, transforms=teacher.references(library), **options)


def on_cpu(teacher: Teacher) -> Teacher:
    """The teacher where workers have it: they compute on the CPU."""
    return copy.deepcopy(teacher).to("cpu") if isinstance(teacher, nn.Module) else teacher


def after(recipe: DistillRecipe) -> str:
    """Return the lines that say where the run is and what comes next."""
    if recipe.student == "plain":
        return next_command(recipe, "plat evaluate", recipe.out, "--motions", "test.npz")
    rest = ("--student", recipe.out, "--motions", recipe.motions, "--minutes", "10", "--out", "runs/plat")
    if (run_folder(recipe.expert) / DYNAMICS_FILE).exists():  # the robot is learned already: imagine with it
        return next_command(recipe, "plat refine-model", "--init-model", recipe.expert, *rest)
    return next_command(recipe, "plat refine", *rest)


def cosine(start: float, end: float, fraction: float) -> float:
    """From ``start`` to ``end`` along half a cosine."""
    return end + 0.5 * (start - end) * (1 + torch.cos(torch.tensor(min(1.0, fraction) * torch.pi)).item())


if __name__ == "__main__":
    with report_errors():
        main(parse(DistillRecipe))
