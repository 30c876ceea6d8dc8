"""Run a policy through every command of a schedule."""

from collections.abc import Callable, Mapping, Sequence

import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import Compose, Transform, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import (
    NEXT_FRAME,
    CommandSchedule,
    DenseGoal,
    DomainRandomization,
    Horizon,
    KeyframeClock,
    KeyframeCommand,
    KeyframeMetrics,
    KeyframeTermination,
    RandomizationRanges,
    ReferenceMotion,
    ScheduledStarts,
    TerminationLimits,
)
from plat.envs.transforms.command import check_timing
from plat.evaluation.finite import check_actions
from plat.evaluation.records import CommandRecorder, CommandRecords
from plat.motions.library import MotionLibrary
from plat.robots.robot import FootContacts
from plat.spec.timing import Timing, timing_of

__all__ = ["Observe", "evaluate", "make_evaluation_env"]

Observe = Callable[[MotionLibrary, bool], Sequence[Transform]]
"""Makes the transforms that show a policy what it reads beside the usual groups, of the motions and of whether it is
shown the dense reference."""


def make_evaluation_env(
    library: MotionLibrary,
    schedule: CommandSchedule,
    num_envs: int,
    *,
    dense: bool = False,
    goals: Mapping[str, int] = NEXT_FRAME,
    observe: Observe | None = None,
    timing: Timing | None = None,
    randomization: RandomizationRanges | None = None,
    limits: TerminationLimits | None = None,
    decimation: int = 4,
    feet: FootContacts = "spheres",
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
) -> TransformedEnv:
    """The environment of :func:`evaluate`: no noise, no reward; see there for the arguments."""
    timing = timing or Timing(control_dt=library.dt)
    env = MotionTrackingEnv(library, num_envs, decimation=decimation, feet=feet, num_threads=num_threads, device=device)
    transforms: list[Transform] = [
        ReferenceMotion(env.library),
        KeyframeClock(timing.window),
        KeyframeTermination(env.robot, limits),
        KeyframeMetrics(env.library, limits),
        ScheduledStarts(env.library, schedule, num_envs),
        KeyframeCommand(env.library, schedule.horizon, schedule, "keyframe" if dense else "goal", timing),
    ]
    if dense:
        transforms += DenseGoal.of_groups(env.library, goals)
    if observe is not None:
        transforms += observe(env.library, dense)
    if randomization is not None:
        transforms.append(DomainRandomization(env, randomization))
    return TransformedEnv(env, Compose(*transforms))


@torch.no_grad()
def evaluate(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    horizon: Horizon,
    *,
    seed: int = 0,
    dense: bool = False,
    goals: Mapping[str, int] = NEXT_FRAME,
    observe: Observe | None = None,
    timing: Timing | None = None,
    randomization: RandomizationRanges | None = None,
    num_envs: int = 256,
    limits: TerminationLimits | None = None,
    decimation: int = 4,
    feet: FootContacts = "spheres",
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
    progress: Callable[[float], None] | None = None,
) -> CommandRecords:
    """Timed keyframe tracking along every motion of a library.

    Each motion is followed from its first frame. Commands come from a schedule that ``seed`` fixes: the same for
    every policy. A failed command ends there; the robot is put back on the reference where the next one begins.

    Args:
        policy: deterministic policy that reads the groups ``"robot"``, ``"goal"`` and ``"command"`` and writes
            ``action``.
        library: motions, of the robot that the policy drives.
        horizon: range of the commands' lengths.
        seed: draws the commands.
        dense: show the policy the next reference frame in place of the keyframe; commands still set the windows in
            which it is measured.
        goals: with ``dense``, the groups in which it is shown the reference, and how many frames ahead each is.
        timing: of the policy; None for the one that it carries, or, where it carries none, the default at the control
            step of the motions.
        observe: shows a policy what it reads beside those groups, as :meth:`plat.baselines.Tracker.observe` does.
        randomization: from which robot, motors and ground are drawn anew whenever a robot is put on its motion, and
            how it is pushed; None for the robot as it is, undisturbed. ``seed`` fixes the draws, but robots are put
            back after failures, so that no two policies meet quite the same.
        num_envs: robots at a time; the figures do not depend on it without ``randomization``.
        limits: when a command has failed.
        decimation: physics steps a control step.
        feet: contact geometry of the soles.
        num_threads: threads of the physics pool.
        device: where the policy and tensors live.
        progress: called now and then with the share of the commands that is done.

    Raises:
        MotionError: when a motion is shorter than the horizon's shortest command.
        ActionError: when the policy gives an action that is not finite.
        PlatError: when motions or horizon do not fit the policy's timing.

    >>> from plat.robots import G1
    >>> from plat.motions import generate_motions
    >>> from plat.envs.transforms import HORIZONS
    >>> from plat.modules import Expert
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> records = evaluate(Expert(G1).deployed(), library, HORIZONS["long"])
    >>> len(records.failed) == CommandSchedule(library, HORIZONS["long"], seed=0).num_commands
    True
    """
    library = library.to(device)
    timing = timing or timing_of(policy) or Timing(control_dt=library.dt)
    check_timing(library, horizon, timing)
    schedule = CommandSchedule(library, horizon, seed)
    recorder = CommandRecorder(library, schedule)
    total_steps = int((schedule.target_frame >= 0).sum())
    done_steps = 0
    with torch.random.fork_rng(devices=[]), set_exploration_type(ExplorationType.DETERMINISTIC):
        torch.default_generator.manual_seed(seed)  # the one that the randomisation draws from
        env = make_evaluation_env(
            library,
            schedule,
            min(num_envs, library.num_clips),
            dense=dense,
            goals=goals,
            observe=observe,
            timing=timing,
            randomization=randomization,
            limits=limits,
            decimation=decimation,
            feet=feet,
            num_threads=num_threads,
            device=device,
        )
        starts = next(transform for transform in env.transform if isinstance(transform, ScheduledStarts))
        tensordict = env.reset()
        while not starts.finished:
            active, frame = starts.active.clone(), tensordict["motion", "frame"]
            tensordict = policy(tensordict)
            check_actions(tensordict["action"], active)
            tensordict, following = env.step_and_maybe_reset(tensordict)
            recorder.add(frame, active, tensordict["next"])
            tensordict = following
            done_steps += int(active.sum())
            if progress is not None:
                progress(min(1.0, done_steps / total_steps))
    env.close()
    return recorder.records()
