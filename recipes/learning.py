"""The loop that the recipes of imagination share: simulate, learn the robot, imagine, learn the policy."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import nn
from torchrl.envs import EnvBase

from plat.collectors import RolloutReplay, collect, rollouts
from plat.envs.physics import get_physics
from plat.envs.randomized_physics import num_physics
from plat.envs.transforms import NoiseLevels
from plat.envs.transforms.settings import robot_ranges
from plat.errors import ConfigError, RenderingError
from plat.evaluation.model_error import model_errors
from plat.figures import save_figure
from plat.figures.model_error_plot import model_error_plot
from plat.modules import DynamicsConfig, DynamicsModel
from plat.motions import MotionLibrary
from plat.objectives import ImaginationLearner, ImaginationLoss, exploring
from plat.recipes.options import ImaginationRecipe
from plat.rendering import Films, Playback
from plat.robots import G1, get_robot
from plat.runs import DYNAMICS_FILE, Budget, Run, SavedRun, load_dynamics, run_inputs
from plat.runs.announce import begins
from plat.runs.outputs import is_kept
from plat.spec.timing import Timing
from plat.tasks import SimulatedTask, Task
from plat.tasks.disturbed import measuring
from plat.words import counted

R = TypeVar("R", bound=ImaginationRecipe)

MODEL_STEPS = 48
"""Control steps over which the model's error is reported."""
REPORT_ROBOTS, REPORT_ROLLOUTS = 64, 8
"""Robots that the report is of, and how often each makes so many steps."""


def learn(
    recipe: ImaginationRecipe,
    library: MotionLibrary,
    policy: nn.Module,
    actor: TensorDictModuleBase,
    make_task: Callable[[MotionLibrary], Task],
    *,
    good: str,
    show: Callable[[Any], Playback],
    weights: Mapping[str, nn.Module | None],
    start: DynamicsModel | None,
    effort: NestedKey = "action",
    imagined: TensorDictModuleBase | None = None,
    loss: Callable[..., ImaginationLoss] = ImaginationLoss,
    reference_updates: int = 0,
) -> None:
    """Train a policy by imagination into a run directory.

    Args:
        recipe: settings.
        library: motions to train on.
        policy: what learns; the moving average of its weights is saved.
        actor: its deterministic actor.
        make_task: the task on some motions.
        good: which figures on the screen are good.
        show: returns a playback of a policy, for videos.
        weights: other runs' policies that it started from, by the name of the setting; None for none.
        start: model of the robot to go on from, see :func:`starting_model`; None for a new one.
        effort: entry of the actor that is kept small.
        imagined: what imagined robots act by; None for the actor.
        loss: the policy's loss.
        reference_updates: updates of a new policy toward the task's reference in each warm-up iteration.
    """
    goes_on = recipe.resume and is_kept(recipe.out)  # else it starts over
    recipe = replace(recipe, imagination=recipe.with_rates(SavedRun(recipe.out).settings if goes_on else None))
    device, settings = recipe.device, recipe.imagination
    # read before the work: what is wrong with them had better be said now
    unseen = unseen_motions(recipe, library)
    num_parameters = num_physics(library.robot) if recipe.disturbed else 0
    imagined = imagined or actor
    if recipe.disturbed:
        actor, imagined = (measuring(acts, NoiseLevels().scaled(recipe.disturbed)) for acts in (actor, imagined))
    inputs = run_inputs(library, init_model=start, **weights)
    if start is not None:
        model = start
    else:
        model = DynamicsModel(library.robot, recipe.model, library.dt, num_parameters).to(device)
    task = make_task(library)
    learner = ImaginationLearner(
        policy,
        imagined,
        model,
        task,
        settings,
        effort=effort,
        loss=loss,
        reference_updates=reference_updates,
        overlap=recipe.overlap,
    )
    replay = RolloutReplay(recipe.num_envs, recipe.kept_steps, ["robot_state", "memory", "action"], device)
    budget = Budget(recipe.minutes, recipe.steps)
    workers = max(recipe.workers, int(recipe.overlap))
    source = collect(
        # a worker makes a task of its own: this one is full of tables
        partial(
            simulated_task,
            make_task if workers else lambda motions: task,
            randomization=robot_ranges(recipe.disturbed),
            physics=get_physics(recipe.physics),
        ),
        library,
        recipe.num_envs,
        exploring(actor, recipe.noise),
        recipe.rollout,
        settings.precision,
        device=device,
        workers=workers,
        ray=recipe.ray,
        ahead=True,
    )
    films = Films(recipe.out / "videos", library.robot, partial(show, learner.average), recipe.video_every)
    with (
        closing(learner),
        source,
        Run.of(
            recipe,
            policy=learner.average,
            budget=budget,
            state={"learner": learner, "rollouts": source, **({"replay": replay} if recipe.save_replay else {})},
            inputs=inputs,
            modules={DYNAMICS_FILE: model},
            film=films.take,
        ) as run,
    ):
        if run.finished:
            return
        begins(recipe, library, settings.precision, good)
        while not budget.done:
            rollout = next(source)
            budget.add(rollout.numel())
            replay.extend(rollout)
            learner.observe(rollout)
            losses = learner.step(replay, budget.fraction)
            simulated = -float(rollout["next", "reward"].mean())
            warning = learner.watch.add(losses["imagined_cost"], simulated) if "imagined_cost" in losses else None
            if warning:
                print(f"warning: {warning}", flush=True)
            failures = failures_per_second(rollout, library.dt)
            run.log(
                {**losses, **failures, "simulated_cost": simulated},
                {
                    **{name.replace("_", " "): f"{value:.2f}" for name, value in failures.items()},
                    "cost": f"{simulated:.3f}",
                    # a dash before the first update, so that nan is none that was computed
                    "imagined": f"{losses['imagined_cost']:.3f}" if "imagined_cost" in losses else "-",
                    "model": f"{losses['model/loss']:.2f}" if "model/loss" in losses else "-",
                },
            )
        budget.end()
        run.save()  # what follows may fail, or be killed
        if learner.iterations <= (warmup := learner.rates.warmup):
            told = f"the budget ended within the {counted(warmup, 'iteration')} of warm-up"
            print(f"warning: {told}: the policy has not learned by imagination yet", flush=True)
        if unseen is not None:
            env = SimulatedTask(make_task(unseen), REPORT_ROBOTS, device=device)
            report_model_error(recipe.out, model, env, actor)
        run.finish()


def starting_model(recipe: R, dt: float) -> tuple[R, DynamicsModel | None]:
    """Return the model that ``--init-model`` names, or None, and the recipe in its shape.

    Recipes ask for it before they read motions, which may take long.

    Args:
        recipe: settings.
        dt: control step (s) of the policy.

    Raises:
        PlatError: for a run without a model, or one of another robot, control step or shape.
    """
    if not recipe.init_model:
        return recipe, None
    robot = get_robot(recipe.robot)
    start = load_dynamics(recipe.init_model, robot, recipe.device, num_physics(robot) if recipe.disturbed else 0)
    recipe = _shaped_like(start, recipe, dt)
    _tell_strength(recipe)
    return recipe, start


def unseen_motions(recipe: ImaginationRecipe, library: MotionLibrary) -> MotionLibrary | None:
    """Return the motions on which the model's error is reported; None for none.

    The default ones are made for the joints of the G1: other robots go without, and a line says so.
    """
    default = type(recipe).unseen
    if recipe.unseen == default and library.robot.joint_names != G1.joint_names:
        print(f"model error: not reported, {default[0]} is for the G1 (--unseen names other motions)", flush=True)
        return None
    if not recipe.unseen:
        return None
    return MotionLibrary.load(recipe.unseen, library.robot, dt=library.dt).to(recipe.device)


def _shaped_like(start: DynamicsModel, recipe: R, dt: float) -> R:
    """Return the recipe with the shape of the model that it goes on from, which has to have its control step (s).

    Raises:
        PlatError: when control step or shape are others than were asked for.
    """
    what, layers = f"--init-model {str(recipe.init_model)!r}", start.config.hidden
    Timing(control_dt=dt).check_control_dt(start.dt, what)
    if recipe.model not in (DynamicsConfig(), start.config):
        raise ConfigError(f"--model.hidden is {recipe.model.hidden}, expected {layers}, the layers of {what}")
    return replace(recipe, model=start.config)


def _tell_strength(recipe: ImaginationRecipe) -> None:
    """Print at which strength a model was told of the robots' physics, if at another: 1 meant another mass there."""
    assert recipe.init_model is not None
    before = SavedRun(recipe.init_model).settings.get("disturbed")
    if before and recipe.disturbed and before != recipe.disturbed:
        told = f"learned with --disturbed {before:g}, and goes on with {recipe.disturbed:g}"
        print(f"--init-model {str(recipe.init_model)!r} {told}: its physics inputs are on another scale")


def simulated_task(
    make_task: Callable[[MotionLibrary], Task], library: MotionLibrary, num_envs: int, **options: Any
) -> SimulatedTask:
    """The environment of some robots with a task of their own."""
    return SimulatedTask(make_task(library), num_envs, **options)


def failures_per_second(rollout: TensorDictBase, dt: float) -> dict[str, float]:
    """Failures per robot and second of a rollout; of authored keyframes apart where the task has some.

    Kinds of keyframes that no robot chases are left out: that nobody failed at them says nothing.
    """
    failed = rollout["next", "terminated"][..., 0].float()
    authored = rollout.get(("memory", "authored"), None)
    if authored is None:
        return {"failures_per_second": float(failed.mean()) / dt}
    kinds = {"failures_per_second": ~authored, "authored_failures_per_second": authored}
    return {name: float(failed[mask].mean()) / dt for name, mask in kinds.items() if mask.any()}


def report_model_error(folder: Path, model: DynamicsModel, env: EnvBase, actor: TensorDictModuleBase) -> None:
    """Print the model's error on an environment's motions, and write ``model_error.csv`` and figures."""
    replay = RolloutReplay(env.batch_size[0], REPORT_ROLLOUTS * MODEL_STEPS, ["robot_state", "action"])
    for rollout in rollouts(env, exploring(actor, 0.1), MODEL_STEPS):
        replay.extend(rollout.cpu())
        if len(replay) == replay.capacity:
            break
    try:
        windows = replay.windows(512, MODEL_STEPS + 1)
    except ConfigError:
        print(f"model error: no episode of the unseen motions lasted {MODEL_STEPS} steps, nothing to report")
        return
    errors = model_errors(model, windows.to(model.mean.device))
    errors.write(folder / "model_error.csv")
    for step in (1, 8, 24, MODEL_STEPS):
        print(
            f"model error after {step:2d} steps: root {100 * errors.root_pos[step - 1]:.1f} cm, "
            f"{errors.root_rot[step - 1]:.3f} rad; joints {errors.joint_pos[step - 1]:.3f} rad"
        )
    try:
        save_figure(model_error_plot(errors), folder / "model_error")
    except RenderingError as error:
        print(f"no figure of the model's error: {error}")
