"""What a policy does with keyframes, step by step."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.control import ChaseStep, StepErrors
from plat.envs.transforms import NEXT_FRAME, CommandSchedule, Horizon, ScheduledStarts
from plat.evaluation.runner import Observe, make_evaluation_env
from plat.keyframes import CONTROL_DT
from plat.motions.library import MotionLibrary

__all__ = ["Playback", "play", "record"]


@dataclass(frozen=True)
class Playback:
    """T control steps of one robot.

    Attributes:
        qpos: the robot ``[T, 7 + J]``.
        target_qpos: the commanded keyframe ``[T, 7 + J]``.
        steps_left: control steps to its arrival ``[T]``.
        command_length: control steps of the command in all ``[T]``.
        failed: whether the command was failed at this step ``[T]``.
        reached_qpos: the robot at the end of the step ``[T, 7 + J]``.
        dt: seconds a step.
    """

    qpos: np.ndarray
    target_qpos: np.ndarray
    steps_left: np.ndarray
    command_length: np.ndarray
    failed: np.ndarray
    reached_qpos: np.ndarray
    dt: float


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
    device: torch.device | str = "cpu",
) -> Playback:
    """Let a policy chase the keyframes of a clip, as in :func:`plat.evaluation.evaluate`.

    Args:
        policy: deterministic policy.
        library: motions.
        clip: number of the clip.
        horizon: range of the commands' lengths.
        seed: draws the commands.
        dense, goals, observe: as for :func:`plat.evaluation.evaluate`.
        device: where the policy lives.
    """
    library = library.only(clip).to(device)
    schedule = CommandSchedule(library, horizon, seed)
    env = make_evaluation_env(
        library, schedule, 1, dense=dense, goals=goals, observe=observe, num_threads=1, device=device
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


def record(steps: Iterable[tuple[ChaseStep, StepErrors]]) -> Playback:
    """Playback of a chase, with the errors that :class:`plat.control.KeyframeScorer` found; no step is left in a hold.

    >>> from plat.robots import G1
    >>> from plat.keyframes import KeyframeSequence, standing
    >>> from plat.modules import Expert
    >>> from plat.control import Chase, KeyframeScorer, PolicyController, Simulator
    >>> sequence = KeyframeSequence(G1, standing(G1), (standing(G1).at(0.1),))
    >>> chase = Chase(PolicyController(Expert(G1).deployed(), G1), sequence, Simulator(G1.model()))
    >>> scorer = KeyframeScorer(G1)
    >>> record((step, scorer.add(step)) for step in chase).steps_left
    array([5, 4, 3, 2, 1])
    """
    rows = [
        (
            step.before.qpos,
            step.command.keyframe.qpos,
            0 if step.holding else step.command.steps_left,
            step.command.length,
            errors.failed,
            step.after.qpos,
        )
        for step, errors in steps
    ]
    qpos, targets, steps_left, lengths, failed, reached = (np.array(column) for column in zip(*rows, strict=True))
    return Playback(qpos, targets, steps_left, lengths, failed, reached, CONTROL_DT)
