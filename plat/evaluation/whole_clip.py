"""Whole-clip success: every clip once from its first frame, judged by a rule that others publish by."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, TransformedEnv

from plat.bounds import check_value
from plat.entries import check_policy
from plat.envs.transforms import (
    NEXT_FRAME,
    CommandSchedule,
    FirstFrames,
    Horizon,
    KeyframeClock,
    KeyframeCommand,
    KeyframeMetrics,
    ReferenceMotion,
)
from plat.envs.transforms.command import check_timing
from plat.errors import ConfigError
from plat.evaluation.clip_draws import ClipSeeds
from plat.evaluation.clip_records import CLIP_ERRORS, ClipRecords
from plat.evaluation.disturbance import disturbing, observing_noise
from plat.evaluation.finite import check_actions
from plat.evaluation.rollout import policy_steps, simulated_robots
from plat.evaluation.scoring import chosen_clips, schedule_of_clips
from plat.evaluation.setting import EvaluationSetting, Interface, Observe, ReferenceView
from plat.evaluation.success_rules import rule_named
from plat.motions.library import MotionLibrary
from plat.spec.timing import Timing, timing_of

__all__ = ["evaluate_clips"]


def evaluate_clips(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    rule: str,
    horizon: Horizon | None = None,
    setting: EvaluationSetting | None = None,
    *,
    dense: bool = False,
    goals: Mapping[str, int] = NEXT_FRAME,
    observe: Observe | None = None,
    interface: Interface = "next-frame",
    clips: Sequence[int] | None = None,
    progress: Callable[[float], None] | None = None,
    **conditions: Any,
) -> ClipRecords:
    """Return records of whole clips: a robot per clip, from its first frame until it fails or the clip ends.

    Nothing puts a robot back on its reference, so position errors add up over a clip.

    Args:
        policy: deterministic policy, as for :func:`plat.evaluation.evaluate`.
        library: motions, of the robot that the policy drives.
        rule: name in :data:`plat.evaluation.success_rules.RULES`; it stands in the records.
        horizon: range of the commands' lengths; None for 1 to 50 control steps. What is left at a clip's end is one
            more command, however short. With ``dense`` the policy does not see the commands.
        setting: conditions.
        dense, goals, observe, interface: how the policy is shown its reference, see
            :class:`plat.evaluation.ReferenceView`.
        clips: numbers of the clips to follow; None for all.
        progress: called after each step with the fraction that is done.
        conditions: fields of :class:`plat.evaluation.EvaluationSetting` that replace those of ``setting``.

    Raises:
        ConfigError: for partial keyframes, which no rule judges, and a policy that writes no ``action``.
        RecordsError: for an unknown rule.
        ActionError: when the policy gives an action that is not finite.
        PlatError: when motions or horizon do not fit the policy's timing.

    >>> from plat.modules import Expert
    >>> from plat.motions import generate_motions
    >>> from plat.robots import G1
    >>> library = MotionLibrary.from_clips(generate_motions("val", seconds=8))
    >>> records = evaluate_clips(Expert(G1).deployed(), library, "humantracker", dense=True)
    >>> records.rule, len(records.clip) == library.num_clips
    ('humantracker', True)
    """
    judge = rule_named(rule)
    check_value("evaluate_clips: library", library, MotionLibrary)
    check_value("evaluate_clips: setting", setting, EvaluationSetting | None)
    setting = replace(setting or EvaluationSetting(), **conditions)
    if setting.partial is not None:
        raise ConfigError(f"partial is {setting.partial!r}: a whole clip is judged by whole poses, expected None")
    check_policy(policy, "evaluate_clips")
    timing = setting.timing or timing_of(policy) or Timing(control_dt=library.dt)
    setting = replace(setting, timing=timing)
    horizon = horizon or Horizon(1, min(50, timing.max_steps))
    check_timing(library, horizon, timing)
    library = library.to(setting.device)
    view = ReferenceView(dense, goals, observe, interface)
    chosen = chosen_clips(library, clips, "evaluate_clips")
    # longest first: robots of a batch then end at about the same time
    chosen.sort(key=lambda clip: (-int(library.clip_length[clip]), clip))
    total = sum(int(library.clip_length[clip]) - 1 for clip in chosen)
    parts, done = [], 0
    for first in range(0, len(chosen), setting.num_envs):
        batch = chosen[first : first + setting.num_envs]
        motions, schedule = schedule_of_clips(library, horizon, setting.seed, batch, whole=True)

        def told(fraction: float, motions: MotionLibrary = motions, done: int = done) -> None:
            if progress is not None:
                progress((done + fraction * (len(motions) - motions.num_clips)) / total)

        with torch.random.fork_rng(devices=[]):
            # for a policy that draws; another for each batch
            torch.default_generator.manual_seed(setting.seed + 1_000_003 * min(batch))
            part = _follow(policy, motions, batch, schedule, judge.failed, view, setting, timing, told)
        part["clip"] = torch.tensor(batch)
        parts.append(part)
        done += len(motions) - motions.num_clips
    columns = {name: torch.cat([part[name] for part in parts]) for name in parts[0]}
    order = columns["clip"].argsort()
    return ClipRecords.from_columns({name: column[order] for name, column in columns.items()}, rule)


def _follow(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    clips: Sequence[int],
    schedule: CommandSchedule,
    failed_by: Callable[..., Tensor],
    view: ReferenceView,
    setting: EvaluationSetting,
    timing: Timing,
    progress: Callable[[float], None],
) -> dict[str, Tensor]:
    """Return the columns of :class:`ClipRecords` for the clips of a library, which have these numbers among all."""
    env = simulated_robots(library, library.num_clips, setting)
    seeds = ClipSeeds(setting.seed, clips)
    task = TransformedEnv(
        env,
        Compose(
            *disturbing(env, setting.randomization, setting.disturbance, seeds),
            ReferenceMotion(env.library),
            KeyframeClock(timing.window),
            KeyframeMetrics(env.library),
            FirstFrames(env.library),
            KeyframeCommand(env.library, schedule.horizon, schedule, view.command_group, timing),
            *view.transforms(env.library),
            *observing_noise(env.library, setting.disturbance, seeds),
        ),
    )
    steps = (library.clip_length - 1).to(env.device)
    count = len(steps)
    alive = torch.ones(count, dtype=torch.bool, device=env.device)  # changed in place: two functions look at it
    failed = torch.zeros_like(alive)
    tracked = torch.zeros(count, dtype=torch.float64, device=env.device)
    errors = {name: torch.zeros_like(tracked) for name in CLIP_ERRORS}
    velocity: Tensor | None = None

    def checked(tensordict: TensorDictBase) -> TensorDictBase:
        tensordict = policy(tensordict)
        check_actions(tensordict["action"], alive)
        return tensordict

    def finished() -> bool:
        return not bool(alive.any())

    for number, step in enumerate(policy_steps(checked, task, finished), 1):
        before, after = step["state"], step["next", "state"]
        reference = step["next", "reference"]
        fell = alive & (failed_by(after, reference, env.robot) | step["next", "terminated"][:, 0])
        failed |= fell
        counted = alive & ~fell
        offset = (after["keypoint_pos_w"] - before["keypoint_pos_w"]) - (
            reference["keypoint_pos_w"] - library.poses(step["motion", "frame"])["keypoint_pos"]
        )
        values = {name: step["next", "metrics", name][:, 0] for name in CLIP_ERRORS[:3]}
        values["vel_dist"] = offset.norm(dim=-1).mean(-1)
        change = torch.zeros_like(offset) if velocity is None else offset - velocity
        values["accel_dist"] = change.norm(dim=-1).mean(-1)
        velocity = offset
        for name, value in values.items():
            errors[name] += torch.where(counted, value, 0.0).double()
        tracked += counted
        alive &= counted & (number < steps)
        progress(float((tracked.sum() + (steps - tracked)[~alive].sum()) / steps.sum()))
    env.close()
    columns = {"frames": steps.double(), "tracked": tracked, "failed": failed}
    columns |= {f"errors.{name}": total for name, total in errors.items()}
    return {name: column.cpu() for name, column in columns.items()}
