"""Run a bundle in MuJoCo at other physics than it was trained in, and see how the score holds up.

plat sim-to-sim bundle --motions generated:val@60 --keyframes wave.json

The policy sees what a robot would give it and nothing else: it runs in onnxruntime, and motors have the gains of its
bundle. The robot begins at rest in the first pose and is never put back, so a fall costs every keyframe after it.
"""

from statistics import fmean

import torch

from plat.cli.options import SimToSimRecipe
from plat.cli.together import check_effect
from plat.control import (
    Chase,
    Controller,
    KeyframeScore,
    KeyframeScorer,
    Simulator,
    distance_text,
    error_text,
    mean_errors,
)
from plat.control.changed_physics import Delayed, PhysicsSetting, make_model, physics_settings
from plat.control.chase import check_parts_are_seen, check_start
from plat.deploy import PolicyRunner
from plat.envs.transforms import CommandSchedule, Horizon
from plat.errors import ActionError, BundleError, KeyframeError
from plat.keyframes import Keyframe, KeyframeSequence
from plat.motions import MotionLibrary
from plat.robots import G1, Robot, get_robot
from plat.spec.timing import Timing
from plat.words import counted, percent


def main(recipe: SimToSimRecipe) -> dict[str, list[KeyframeScore]]:
    """Run the recipe: print a table, return the scores of every keyframe by setting.

    Raises:
        PlatError: for what cannot be run.
        ActionError: when a simulation diverged or a target was not finite, after the whole table.
    """
    check_effect("--seed", recipe.seed != type(recipe).seed, "--motions", recipe.motions)
    check_effect("--split", recipe.split, "--keyframes", recipe.keyframes)
    torch.set_num_threads(1)  # only the scores are torch's, one robot at a time
    robot = get_robot(recipe.robot)
    runner = PolicyRunner(recipe.bundle, robot.joint_names)
    if runner.robot.name != robot.name:  # of the same joints, or it would have been refused
        expected = f"expected {robot.name!r}, that of --robot"
        raise BundleError(f"bundle {str(recipe.bundle)!r}: drives robot {runner.robot.name!r}, {expected}")
    timing = runner.timing
    sequences, long = [], []
    still = Simulator.of(robot, timing.control_dt)
    for path in recipe.keyframes:
        tell = lambda interval, path=path: long.append(f"{path}: {interval.words}")  # noqa: E731
        sequences.append(KeyframeSequence.load(path, robot, split=recipe.split, timing=timing, tell=tell))
        check_parts_are_seen(sequences[-1], runner, path)
        check_start(sequences[-1], still, path)
    names = [str(path) for path in recipe.keyframes]
    for line in long:  # after all files were read: one of them may be refused
        print(line)
    if recipe.motions:
        library = MotionLibrary.load(recipe.motions, robot, dt=timing.control_dt)
        sequences += motion_keyframes(library, recipe.seed, timing)
        names += library.clip_names
    if not sequences:
        raise KeyframeError("nothing to run: give --motions or --keyframes")
    settings = possible_settings(robot, timing.control_dt)
    if len(settings) < len(physics_settings(timing.control_dt)):
        print(f"left out: settings with capsule feet, robot {robot.name!r} has no sole_capsules")
    seconds = sum(sequence.duration for sequence in sequences)
    print(f"{counted(len(sequences), 'sequence')}, {counted(sum(map(len, sequences)), 'keyframe')}, {seconds:.0f} s")
    success, joint_mean, place_mean = (f"{name}@{timing.window}" for name in ("TKS", "MPJPE", "MPKPE"))
    print(f"{'':<40}{f'{success} %':>10}{'falls %':>9}{f'{joint_mean} rad':>13}{f'{place_mean} mm':>12}")
    results: dict[str, list[KeyframeScore]] = {}
    broken = 0
    for physics in settings:
        simulator = Simulator(make_model(robot, runner.robot, physics), timing.control_dt)
        controller = Delayed(runner, runner.robot, physics.delay)
        scores: list[KeyframeScore] = []
        told = []
        for name, sequence in zip(names, sequences, strict=True):
            of_sequence, error = run(controller, sequence, simulator, robot)
            scores += of_sequence
            if error:
                told.append(f"{name!r} {error}")
        results[physics.name] = scores
        broken += len(told)
        succeeded = [score for score in scores if score.success]
        joint, keypoint = mean_errors(succeeded)
        share, falls = len(succeeded) / len(scores), fmean(score.root_off for score in scores)
        errors = f"{error_text(joint):>13}{distance_text(keypoint):>12}"
        print(f"{physics.name:<40}{percent(100 * share):>10}{percent(100 * falls):>9}{errors}", flush=True)
        for line in told:
            print(f"  {line}", flush=True)
    print(f"errors are means over the keyframes that {success} counts, of what they command")
    if broken:
        of = f"{broken} of {counted(len(sequences) * len(results), 'run')}"
        raise ActionError(f"{of} ended early, because the simulation diverged or a target was not finite")
    return results


def possible_settings(robot: Robot, control_dt: float) -> list[PhysicsSetting]:
    """Return the settings that a robot can be simulated at: capsule feet need its ``sole_capsules``."""
    settings = physics_settings(control_dt)
    return [physics for physics in settings if physics.feet != "capsules" or robot.sole_capsules]


def motion_keyframes(library: MotionLibrary, seed: int, timing: Timing = Timing()) -> list[KeyframeSequence]:
    """Return the commands that plat evaluate gives along every motion, as keyframes."""
    schedule = CommandSchedule(library, Horizon(1, min(50, timing.max_steps)), seed)
    issued = schedule.first_frame
    sequences = []
    for clip, start in enumerate(library.clip_start.tolist()):
        targets = schedule.target_frame[issued[library.clip_of(issued) == clip]]
        keyframes = [_keyframe(library, frame, (frame - start) * timing.control_dt) for frame in targets.tolist()]
        sequences.append(KeyframeSequence(library.robot, _keyframe(library, start, 0.0), tuple(keyframes), timing))
    return sequences


def _keyframe(library: MotionLibrary, frame: int, time: float) -> Keyframe:
    pose = library.poses(torch.tensor(frame)).double()
    qpos = torch.cat((pose["keypoint_pos"][0], pose["keypoint_quat"][0], pose["joint_pos"]))
    return Keyframe.from_qpos(time, qpos.numpy())


def run(
    controller: Controller, sequence: KeyframeSequence, simulator: Simulator, robot: Robot = G1
) -> tuple[list[KeyframeScore], str]:
    """Return the scores of a sequence of keyframes, and when and why it ended early; empty where it did not."""
    scorer = KeyframeScorer(robot)
    for _ in scorer.follow(Chase(controller, sequence, simulator)):
        pass
    return scorer.scores(), scorer.ended
