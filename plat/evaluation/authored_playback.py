"""Playback of a policy on authored chains, for film strips."""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import Transform

from plat.control.authored import Authored
from plat.envs.reach import distances, down
from plat.envs.settings import ReachLimits
from plat.envs.state import GeneralizedState
from plat.evaluation.authored_rollout import AuthoredRollout, Pushes
from plat.motions import MotionLibrary
from plat.rendering.playback import Playback
from plat.robots import Robot

__all__ = ["play_authored"]


@torch.no_grad()
def play_authored(
    policy: TensorDictModuleBase,
    robot: Robot,
    chains: Sequence[Authored],
    *,
    limits: ReachLimits | None = None,
    observe: Callable[[MotionLibrary], Sequence[Transform]] | None = None,
    pushes: Pushes | None = None,
    device: torch.device | str = "cpu",
) -> list[Playback]:
    """Return a playback of a policy for each chain; the hold is one more command, which arrives at its end.

    A command fails as in the scores: the robot is off in its window, is not near enough at its arrival, or has fallen
    by then. An absurd action or a diverged simulation fails it as well. The hold is judged at its end, and has no
    window.

    Args:
        policy, robot, chains, observe, pushes, device: see :class:`plat.evaluation.authored_rollout.AuthoredRollout`.
        limits: when a keyframe is reached and when a robot has fallen.
    """
    limits = limits or ReachLimits()
    rollout = AuthoredRollout(policy, robot, chains, observe=observe, pushes=pushes, num_threads=1, device=device)
    bodies = torch.tensor([limits.bodies if chain.bodies is None else chain.bodies for chain in chains], device=device)
    before, after, failed = [], [], []
    missed = torch.zeros_like(rollout.arrivals, dtype=torch.bool)
    fell = torch.zeros(len(chains), dtype=torch.bool, device=device)
    for step in rollout:
        state, reference = step.after["state"], step.after["reference"]
        before.append(_qpos(GeneralizedState.from_entries(step.before)))
        after.append(_qpos(GeneralizedState.from_entries(step.after)))
        parts = rollout.commanded(step.number)
        near = distances(state, reference, parts).near(limits, bodies)
        fell |= down(state, rollout.lowest_root(step.number), robot, limits) | step.after["terminated"][:, 0]
        missed |= rollout.off_in_window(step, parts, limits.window)
        late = (missed & (rollout.arrivals == step.number)).any(1)
        failed.append((fell | ~near | late).cpu().numpy())
    qpos, reached, misses = (np.stack(values, 1) for values in (before, after, failed))
    ends = torch.cat((rollout.arrivals, rollout.ends[:, None]), 1).tolist()
    return [
        _playback(chain, ends[row], qpos[row], reached[row], misses[row], rollout.timing.control_dt)
        for row, chain in enumerate(chains)
    ]


def _playback(
    chain: Authored, ends: list[int], qpos: np.ndarray, after: np.ndarray, failed: np.ndarray, dt: float
) -> Playback:
    last = ends[-1]
    steps, edges = np.arange(last), np.array([0, *ends])
    command = np.searchsorted(edges, steps, side="right") - 1
    keyframes = [*chain.sequence.keyframes, chain.sequence.keyframes[-1]]
    arrives = np.isin(steps + 1, ends)
    return Playback(
        qpos=qpos[:last],
        target_qpos=np.stack([keyframes[index].qpos for index in command]),
        steps_left=edges[command + 1] - steps,
        command_length=np.diff(edges)[command],
        failed=failed[:last] & arrives,
        reached_qpos=after[:last],
        dt=dt,
    )


def _qpos(state: GeneralizedState) -> np.ndarray:
    return state.qpos.double().cpu().numpy()
