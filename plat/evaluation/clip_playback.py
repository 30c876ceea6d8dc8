"""Playback of a policy on one clip, for pictures and videos."""

from collections.abc import Mapping

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase

from plat.bounds import check_value
from plat.entries import check_policy
from plat.envs.state import GeneralizedState
from plat.envs.transforms import NEXT_FRAME, Horizon
from plat.evaluation.rollout import make_evaluation_env
from plat.evaluation.scoring import chosen_clips, schedule_of_clips
from plat.evaluation.setting import EvaluationSetting, Interface, Observe, ReferenceView
from plat.motions.library import MotionLibrary
from plat.rendering.playback import Playback
from plat.spec.timing import Timing, timing_of

__all__ = ["play"]


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
    interface: Interface = "next-frame",
    timing: Timing | None = None,
    device: torch.device | str = "cpu",
) -> Playback:
    """Return the playback of a policy that chases the keyframes of a clip, those of :func:`plat.evaluation.evaluate`.

    Args:
        policy: deterministic policy.
        library: all motions of the evaluation. A clip's commands depend on its number, so the clip alone has others.
        clip: number of the clip.
        horizon: range of the commands' lengths.
        seed: of the commands.
        dense, goals, observe, interface: how the policy is shown its reference, see
            :class:`plat.evaluation.ReferenceView`.
        timing: of the policy; None for the one that it carries.
        device: of the policy.

    Raises:
        ConfigError: for a policy that writes no ``action``, and what is no library.
        MotionError: for a clip that the library does not have.
    """
    check_policy(policy, "play")
    check_value("play: library", library, MotionLibrary)
    library, schedule = schedule_of_clips(library.to(device), horizon, seed, chosen_clips(library, [clip], "play"))
    timing = timing or timing_of(policy)
    setting = EvaluationSetting(seed=seed, timing=timing, num_threads=1, device=device)
    task = make_evaluation_env(library, schedule, 1, ReferenceView(dense, goals, observe, interface), setting)
    rows: list[tuple[np.ndarray, np.ndarray, int, int, bool, np.ndarray]] = []
    for step in task.steps(policy):
        target, steps_left = step["command", "target_frame"], int(step["command", "steps_left"])
        # a command begins after an arrival and after a failure
        length = steps_left if not rows or rows[-1][2] <= 1 or rows[-1][4] else rows[-1][3]
        qpos, reached_qpos = (_qpos(GeneralizedState.from_entries(entries)) for entries in (step, step["next"]))
        failed = bool(step["next", "terminated"])
        rows.append((qpos, library.qpos(target)[0].cpu().numpy(), steps_left, length, failed, reached_qpos))
    task.close()
    qpos, targets, steps, lengths, failures, reached = (np.array(column) for column in zip(*rows, strict=True))
    return Playback(qpos, targets, steps, lengths, failures, reached, library.dt)


def _qpos(state: GeneralizedState) -> np.ndarray:
    return state.qpos[0].double().cpu().numpy()
