"""Playback of a policy on one clip, for pictures and videos."""

from collections.abc import Mapping

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.envs.transforms import NEXT_FRAME, CommandSchedule, Horizon, ScheduledStarts
from plat.evaluation.runner import Observe, make_evaluation_env
from plat.motions.library import MotionLibrary
from plat.rendering.playback import Playback
from plat.spec.timing import Timing, timing_of

__all__ = ["play"]


@torch.no_grad()
def play(
    policy: TensorDictModuleBase,
    library: MotionLibrary,
    clip: int,
    horizon: Horizon,
    *,
    seed: int = 0,
    dense: bool = False,
    goals: Mapping[str, int] = NEXT_FRAME,
    observe: Observe | None = None,
    timing: Timing | None = None,
    device: torch.device | str = "cpu",
) -> Playback:
    """Let a policy chase the keyframes of a clip, as in :func:`plat.evaluation.evaluate`.

    Args:
        policy: deterministic policy.
        library: motions.
        clip: number of the clip.
        horizon: range of the commands' lengths.
        seed: draws the commands.
        dense, goals, observe, timing: as for :func:`plat.evaluation.evaluate`.
        device: where the policy lives.
    """
    library = library.only(clip).to(device)
    timing = timing or timing_of(policy)
    schedule = CommandSchedule(library, horizon, seed)
    env = make_evaluation_env(
        library, schedule, 1, dense=dense, goals=goals, observe=observe, timing=timing, num_threads=1, device=device
    )
    rows: list[tuple[np.ndarray, np.ndarray, int, int, bool, np.ndarray]] = []
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        tensordict = env.reset()
        starts = next(transform for transform in env.transform if isinstance(transform, ScheduledStarts))
        while not starts.finished:
            target, steps_left = tensordict["command", "target_frame"], int(tensordict["command", "steps_left"])
            length = steps_left if not rows or rows[-1][2] <= 1 or rows[-1][4] else rows[-1][3]
            qpos = env.base_env.qpos[0].cpu().numpy()
            tensordict = env.step(policy(tensordict))
            reached_qpos = env.base_env.qpos[0].cpu().numpy()
            failed = bool(tensordict["next", "terminated"])
            rows.append((qpos, library.qpos(target)[0].cpu().numpy(), steps_left, length, failed, reached_qpos))
            tensordict = env.maybe_reset(env.step_mdp(tensordict))
    env.close()
    qpos, targets, steps, lengths, failures, reached = (np.array(column) for column in zip(*rows, strict=True))
    return Playback(qpos, targets, steps, lengths, failures, reached, library.dt)
