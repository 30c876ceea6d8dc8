"""Run a policy through every command of a schedule."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from heapq import heapreplace
from operator import index
from typing import Any

import torch
from tensordict.nn import TensorDictModuleBase

from plat.bounds import check_value
from plat.entries import check_policy
from plat.envs.part_masks import draw_parts
from plat.envs.transforms import NEXT_FRAME, CommandSchedule, Horizon
from plat.envs.transforms.command import check_timing
from plat.errors import MotionError, TaskError
from plat.evaluation.records import CommandRecorder, CommandRecords
from plat.evaluation.rollout import make_evaluation_env
from plat.evaluation.setting import EvaluationSetting, Interface, Observe, ReferenceView
from plat.json_file import short
from plat.motions.library import MotionLibrary
from plat.spec.observation import optional_groups
from plat.spec.parts import WHOLE_ONLY
from plat.spec.timing import Timing, timing_of

__all__ = ["chosen_clips", "evaluate", "robots_for", "schedule_of_clips"]

# A control step costs as much CPU time as it does for this many more robots: 9 ms against 0.145 ms a robot.
_STEP_WITHOUT_ROBOTS = 62


def evaluate(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    horizon: Horizon,
    setting: EvaluationSetting | None = None,
    *,
    dense: bool = False,
    goals: Mapping[str, int] = NEXT_FRAME,
    observe: Observe | None = None,
    interface: Interface = "next-frame",
    clips: Sequence[int] | None = None,
    progress: Callable[[float], None] | None = None,
    **conditions: Any,
) -> CommandRecords:
    """Return records of timed keyframe tracking along every motion of a library.

    Each motion is followed from its first frame. The seed fixes the commands, so they are the same for every policy.
    A failed command ends at once; the robot is then reset onto the reference where the next command begins.

    Args:
        policy: deterministic policy that reads the groups ``"robot"``, ``"goal"`` and ``"command"`` and writes
            ``action``.
        library: motions, of the robot that the policy drives.
        horizon: range of the commands' lengths.
        setting: seed, randomization and the other conditions.
        dense, goals, observe, interface: how the policy is shown its reference, see
            :class:`plat.evaluation.ReferenceView`.
        clips: numbers of the motions to follow, by the commands that they have among all; None for all motions.
        progress: called after each step with the fraction of the commands' steps that is done.
        conditions: fields of :class:`plat.evaluation.EvaluationSetting` that replace those of ``setting``.

    Raises:
        ConfigError: for a policy that writes no ``action``.
        MotionError: when a motion is shorter than the horizon's shortest command, and for ``clips`` that are none.
        ActionError: when the policy gives an action that is not finite.
        PlatError: when motions or horizon do not fit the policy's timing.
        TaskError: for partial keyframes, when the policy does not see what is commanded.

    >>> from plat.robots import G1
    >>> from plat.motions import generate_motions
    >>> from plat.envs.transforms import HORIZONS
    >>> from plat.modules import Expert
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> records = evaluate(Expert(G1).deployed(), library, HORIZONS["long"], seed=3)
    >>> len(records.failed) == CommandSchedule(library, HORIZONS["long"], seed=3).num_commands
    True
    """
    check_policy(policy, "evaluate")
    check_value("evaluate: library", library, MotionLibrary)
    check_value("evaluate: setting", setting, EvaluationSetting | None)
    setting = replace(setting or EvaluationSetting(), **conditions)
    timing = setting.timing or timing_of(policy) or Timing(control_dt=library.dt)
    setting = replace(setting, timing=timing)
    check_timing(library, horizon, timing)
    library = library.to(setting.device)
    chosen = chosen_clips(library, clips, "evaluate")
    library, schedule = schedule_of_clips(library, horizon, setting.seed, chosen)
    if setting.partial is not None:
        schedule = _partial(policy, library, schedule, setting.partial, setting.seed, chosen)
    recorder = CommandRecorder(library, schedule)
    total_steps = int((schedule.target_frame >= 0).sum())
    done_steps = 0
    with torch.random.fork_rng(devices=[]):
        # for a policy that draws; another for each part
        torch.default_generator.manual_seed(setting.seed + 1_000_003 * chosen[0])
        view = ReferenceView(dense, goals, observe, interface)
        robots = robots_for((library.clip_length - 1).tolist(), min(setting.num_envs, library.num_clips))
        task = make_evaluation_env(library, schedule, robots, view, setting, chosen)
        for step in task.steps(policy):
            recorder.add(step["motion", "frame"], task.active, step["next"])
            done_steps += int(task.active.sum())
            if progress is not None:
                progress(min(1.0, done_steps / total_steps))
    task.close()
    records = recorder.records()
    records.clip = torch.tensor(list(chosen))[records.clip]
    return records


def chosen_clips(library: MotionLibrary, clips: Sequence[int] | None, what: str) -> list[int]:
    """Return the numbers of the motions that are followed; all of a library for None.

    Args:
        library: all motions.
        clips: as they were given.
        what: is given them; begins the message.

    Raises:
        MotionError: for no clips, and what is none of the library's.

    >>> from plat.motions import generate_motions
    >>> chosen_clips(MotionLibrary.from_clips(generate_motions("val", seconds=8)), [1], "evaluate")
    [1]
    """
    try:
        chosen = list(range(library.num_clips)) if clips is None else [index(clip) for clip in clips]
    except TypeError:
        chosen = []
    if not chosen or min(chosen) < 0 or max(chosen) >= library.num_clips:
        most = library.num_clips - 1
        raise MotionError(f"{what}: clips is {short(clips)}, expected numbers of motions from 0 to {most}")
    return chosen


def robots_for(steps: Iterable[int], most: int) -> int:
    """Return how many robots follow some clips in the least CPU time.

    Robots take the longest clips first, and another one when they are done. Where one clip is much longer than the
    others, more robots would only wait for the one that follows it.

    Args:
        steps: of each clip, at least one.
        most: robots at a time.

    >>> robots_for([900, 300, 300, 300], 4), robots_for([250] * 64, 256)
    (2, 64)
    """
    longest_first = sorted(steps, reverse=True)
    least = math.ceil(sum(longest_first) / longest_first[0])
    counts = {min(count, most, len(longest_first)) for count in (least, math.ceil(1.15 * least), len(longest_first))}
    return min(sorted(counts), key=lambda count: _duration(longest_first, count) * (_STEP_WITHOUT_ROBOTS + count))


def _duration(longest_first: Sequence[int], robots: int) -> int:
    """Return after how many steps the last robot ends."""
    ends = [0] * robots
    for steps in longest_first:
        heapreplace(ends, ends[0] + steps)
    return max(ends)


def schedule_of_clips(
    library: MotionLibrary, horizon: Horizon, seed: int, clips: Sequence[int], *, whole: bool = False
) -> tuple[MotionLibrary, CommandSchedule]:
    """Return some motions of a library, and the commands that they have in the schedule of all.

    Args:
        library: all motions.
        horizon: range of the commands' lengths.
        seed: of the schedule.
        clips: numbers of the motions.
        whole: command what is left at a clip's end as well, however short.
    """
    schedule = CommandSchedule(library, horizon, seed)
    chosen = list(clips)
    if chosen == list(range(library.num_clips)) and not whole:
        return library, schedule
    first = schedule.first_frame.to(library.device)
    of_clip, target = library.clip_of(first), schedule.target_frame[first]
    arrivals = []
    for clip in chosen:
        ends = (target[of_clip == clip] - library.clip_start[clip]).tolist()
        last = int(library.clip_length[clip]) - 1
        arrivals.append([*ends, last] if whole and ends[-1] < last else ends)
    motions = library.only(*chosen)
    return motions, CommandSchedule.of_arrivals(motions, arrivals)


def _partial(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    schedule: CommandSchedule,
    kind: str,
    seed: int,
    clips: Sequence[int],
) -> CommandSchedule:
    """Return a schedule of partial keyframes; those of a clip are the same whatever the other clips."""
    if "parts" not in optional_groups(getattr(policy, "in_keys", ())):
        raise TaskError(f"partial keyframes ({kind}): {WHOLE_ONLY} (--policy.also parts)")
    of_clip = library.clip_of(schedule.first_frame.to(library.device))
    masks = []
    for row, clip in enumerate(clips):
        count = int((of_clip == row).sum())
        drawn_from = (seed * 1_000_003 + clip) % 2**32  # torch's generator on a CPU takes no more of it
        masks.append(draw_parts(library.robot, count + 1, drawn_from, (kind,), root=False)[1:])
    return schedule.with_parts(torch.cat(masks))
