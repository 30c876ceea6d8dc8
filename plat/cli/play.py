"""Let a policy chase the keyframes of a file: one robot, plain MuJoCo, 50 Hz.

plat play --policy plat-g1 --keyframes recipes/examples/bow.json --video bow.mp4
"""

import math
from collections.abc import Sequence
from pathlib import Path

import torch

import plat.headless  # noqa: F401

# isort: split

from plat.cli.options import PlayRecipe
from plat.cli.together import check_effect
from plat.control import (
    Chase,
    ChaseStep,
    HoldScore,
    KeyframeScore,
    KeyframeScorer,
    PolicyController,
    Simulator,
    StepErrors,
    Viewer,
    distance_text,
    error_text,
    mean_errors,
    record,
    tally,
)
from plat.control.chase import check_parts_are_seen, check_start
from plat.control.shoves import Shoves
from plat.control.simulator import PHYSICS_STEPS
from plat.errors import ActionError, KeyframeError
from plat.files import TABLES, check_file, replace_table
from plat.keyframes import KeyframeSequence
from plat.rendering import Stage, check_video, film_with_progress, stage_model, write_video
from plat.robots import get_robot
from plat.runs import load_policy
from plat.runs.user_modules import import_modules
from plat.spec.timing import Timing, timing_of
from plat.words import in_table

LONGEST_HOLD = 3600.0
"""Most seconds of a hold without a viewer: each step of it is kept."""


def main(recipe: PlayRecipe) -> list[KeyframeScore]:
    """Run the recipe: print a table, return its rows.

    Raises:
        PlatError: for what cannot be run or written.
        ActionError: when the simulation diverged, or the policy gave no action that is finite, after all is written.
    """
    # networks for one robot are so small that more threads only get in each other's way
    torch.set_num_threads(1)
    check_effect("--push-every", recipe.push_every != type(recipe).push_every, "--push", recipe.push)
    check_effect("--seed", recipe.seed != type(recipe).seed, "--push", recipe.push)
    if recipe.csv is not None:  # what cannot be written shows before the robot runs
        check_file(recipe.csv, "--csv", TABLES)
    import_modules(recipe.imports)
    get_robot(recipe.robot)  # a description file makes the policy's robot known
    policy = load_policy(recipe.policy)
    robot, timing = policy.robot, timing_of(policy) or Timing()
    sequence = KeyframeSequence.load(
        recipe.keyframes, robot, split=recipe.split, timing=timing, tell=lambda interval: print(interval.words)
    )
    if not recipe.viewer and recipe.hold > LONGEST_HOLD:
        raise KeyframeError(f"hold is {recipe.hold:g} s, expected at most {LONGEST_HOLD:g} without --viewer")
    stage = None
    if recipe.video is not None:
        check_video(recipe.video)
        stage = Stage(robot)
    model = stage_model(robot) if recipe.viewer else robot.model()
    model.opt.timestep = timing.control_dt / PHYSICS_STEPS  # as in training, whatever the description says
    simulator = Simulator(model, timing.control_dt)
    controller = PolicyController(policy.deployed(), robot, timing)
    check_parts_are_seen(sequence, controller, recipe.keyframes)
    check_start(sequence, simulator, recipe.keyframes)
    chase = Chase(controller, sequence, simulator, hold=recipe.hold)
    scorer = KeyframeScorer(robot, recipe.reach)
    shoves = Shoves(recipe.push, recipe.push_every, recipe.seed, timing.control_dt)
    viewer = Viewer(simulator) if recipe.viewer else None
    steps: list[tuple[ChaseStep, StepErrors]] = []
    for step, errors in scorer.follow(chase):
        if stage is not None:  # to film: a viewer may stay open for hours
            steps.append((step, errors))
        shoves.after_step(simulator)
        if viewer is not None:
            if not viewer.running:
                break
            viewer.show(step)
    if viewer is not None:
        viewer.close()
    print_table(scorer.scores(), scorer.hold(), timing.window)
    if recipe.csv is not None:
        write_scores(recipe.csv, scorer.scores(), timing.window)
        print(f"wrote {recipe.csv}")
    if stage is not None and recipe.video is not None and steps:
        write_video(recipe.video, film_with_progress(stage, [record(steps, scorer)]))
        print(f"wrote {recipe.video}")
    if stage is not None:
        stage.close()
    if scorer.ended:
        raise ActionError(f"{str(recipe.keyframes)!r} {scorer.ended}")
    return scorer.scores()


def print_table(scores: Sequence[KeyframeScore], hold: HoldScore | None, window: int) -> None:
    """Print a row a keyframe, what they come to over an arrival window, and what became of the hold."""
    tks, joint, keypoint = f"TKS@{window}", f"MPJPE@{window} rad", f"MPKPE@{window} mm"
    print(f"{'':>3}  {'keyframe':<20}  {'time s':>6}  {tks:<5}  {joint:>11}  {keypoint:>10}  outcome")
    for score in scores:
        success = "yes" if score.success else "no"
        print(
            f"{score.index:>3}  {in_table(score.name):<20.20}  {score.time:>6.2f}  {success:<5}  "
            f"{error_text(score.joint_error):>11}  {distance_text(score.keypoint_error):>10}  {score.words}"
        )
    print(summary(scores, window))
    if hold is not None:
        print(hold.words)


COLUMNS = (
    *("keyframe", "name", "time_s", "outcome", "late_s"),
    *("root_m", "joints_rad", "bodies_m", "turn_rad", "fell_afterwards"),
)
"""Of the file of scores, before the figures of TKS."""


def write_scores(path: Path, scores: Sequence[KeyframeScore], window: int) -> None:
    """Write a CSV with a row a keyframe; cells of what it does not command, or no robot came to, are empty.

    The last columns name the arrival window (control steps) that they are over.
    """
    rows: list[tuple[object, ...]] = []
    for score in scores:
        late = "" if score.late is None else f"{score.late:.3f}"
        at = score.arrival
        away = (*map(_cell, (at.root, at.joint, at.bodies, at.turn)), int(score.fell_afterwards))
        figures = (int(score.success), _cell(score.joint_error), _cell(score.keypoint_error))
        rows.append((score.index, score.name or "", str(score.time), score.outcome, late, *away, *figures))
    replace_table(path, (*COLUMNS, f"tks{window}", f"mpjpe{window}_rad", f"mpkpe{window}_m"), rows)


def _cell(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.4f}"


def summary(scores: Sequence[KeyframeScore], window: int) -> str:
    """Return how many keyframes had each outcome, and the errors of those that TKS counts."""
    succeeded = [score for score in scores if score.success]
    errors = f"TKS@{window} {len(succeeded)} of {len(scores)}"
    if succeeded:
        joint, keypoint = mean_errors(succeeded)
        joints, places = error_text(joint, " rad"), distance_text(keypoint, " mm")
        errors += f", these with MPJPE@{window} {joints}, MPKPE@{window} {places}"
    return f"{tally(scores)}; {errors}"
