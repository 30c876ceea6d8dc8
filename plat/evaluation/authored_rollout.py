"""Rollout of a policy on authored chains: one robot per chain, without resets."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, Transform, TransformedEnv, step_mdp
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.control.authored import Authored
from plat.entries import check_policy
from plat.envs.reach import LowestRoot
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import FirstFrames, KeyframeClock, KeyframeCommand, ReferenceMotion
from plat.envs.transforms.command import CommandSchedule
from plat.envs.transforms.settings import TerminationLimits
from plat.envs.transforms.terminations import off_pose
from plat.errors import KeyframeError
from plat.evaluation.finite import check_actions
from plat.json_file import short
from plat.motions import MotionClip, MotionLibrary
from plat.robots import Robot
from plat.spec.observation import optional_groups
from plat.spec.parts import Parts
from plat.spec.timing import Timing, timing_of

__all__ = ["AuthoredRollout", "AuthoredStep", "Pushes"]


@dataclass(frozen=True)
class Pushes:
    """Pushes of every robot at regular intervals, each in a horizontal direction of its own.

    Those of a chain depend on the seed, its family and its number alone: every policy meets the same ones, whatever
    other chains are beside it.

    Args:
        speed: change of the root's velocity (m/s).
        every: seconds in between.
        seed: draws the directions.

    >>> from plat.control.authored import author
    >>> from plat.robots import G1
    >>> one, other = author("steps", G1, count=2, seed=0)
    >>> pushes = Pushes(0.3)
    >>> torch.equal(pushes.along(other, 3)[:2], pushes.along(other, 2))
    True
    >>> torch.equal(pushes.along(one, 2), pushes.along(other, 2))
    False
    """

    speed: float
    every: float = 1.5
    seed: int = 0

    def along(self, chain: Authored, count: int) -> Tensor:
        """Return the first pushes along a chain: changes of the root's velocity ``[count, 6]`` (m/s, rad/s; world)."""
        seed = crc32(f"push: seed {self.seed}, family {chain.family}, chain {chain.number}".encode())
        drawn = torch.rand(count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        angle = 2 * torch.pi * drawn
        still = torch.zeros(count, 4, dtype=torch.float64)
        return self.speed * torch.cat((angle.cos()[:, None], angle.sin()[:, None], still), -1)


@dataclass(frozen=True)
class AuthoredStep:
    """Control step of all robots.

    Attributes:
        number: of the step, from 1.
        before: entries that the policy read.
        after: entries at the end of the step, ``"state"`` and ``"reference"`` among them.
    """

    number: int
    before: TensorDict
    after: TensorDict


class AuthoredRollout:
    """Rollout of a policy on authored chains.

    A robot begins at rest in its chain's start. In the hold its command is the last keyframe by the next step, over and
    over. Its reference is the straight line between keyframes. A policy that does not see which parts of a pose are
    commanded is shown the whole pose of a partial keyframe.

    Args:
        policy: deterministic policy that reads ``"robot"``, ``"goal"`` and ``"command"`` and writes ``action``.
        robot: that it drives.
        chains: of :func:`plat.control.author`; all with the same number of keyframes.
        observe: makes the transforms that show a policy what it reads beside those groups.
        pushes: of the robots; None for none.
        num_threads: threads of the physics pool.
        device: where the policy and tensors live.

    Raises:
        KeyframeError: for no chains, and chains of different lengths.
        ConfigError: for a policy that writes no ``action``.

    Attributes:
        timing: of the policy.
        library: the lines between keyframes as clips of equal length.
        arrivals: control step of each arrival ``[C, K]``.
        ends: last control step of each hold ``[C]``.
        parts: masks of what each keyframe commands ``[C, K, J + bodies + 3]``.
        lowest: roots that commands and holds tell a robot to have at the lowest ``[C, K + 1]``.
    """

    def __init__(
        self,
        policy: TensorDictModuleBase,
        robot: Robot,
        chains: Sequence[Authored],
        *,
        observe: Callable[[MotionLibrary], Sequence[Transform]] | None = None,
        pushes: Pushes | None = None,
        num_threads: int | None = None,
        device: torch.device | str = "cpu",
    ):
        check_policy(policy, "authored keyframes")
        _check_chains(chains)
        self.timing = timing_of(policy) or Timing()
        self._policy = policy
        dt = chains[0].sequence.timing.control_dt
        arrivals = [list(chain.sequence.arrival_steps) for chain in chains]
        ends = [steps[-1] + round(chain.hold / dt) for steps, chain in zip(arrivals, chains, strict=True)]
        self.library = _lines(robot, chains, max(ends), dt).to(device)
        self.arrivals, self.ends = torch.tensor(arrivals, device=device), torch.tensor(ends, device=device)
        self.parts = _parts(robot, chains).to(device)
        self.lowest = _lowest(chains, device)
        schedule = CommandSchedule.of_arrivals(self.library, _with_holds(arrivals, self.library))
        sees_parts = "parts" in optional_groups(getattr(policy, "in_keys", ()))
        if sees_parts and not bool(self.parts.all()):
            schedule = schedule.with_parts(_of_commands(self.parts, self.arrivals, schedule, self.library))
        num_parts = 0 if schedule.parts is None else self.parts.shape[-1]
        self._env = MotionTrackingEnv(self.library, len(chains), num_threads=num_threads, device=device)
        transforms: list[Transform] = [
            FirstFrames(self.library),
            ReferenceMotion(self.library),
            KeyframeClock(self.timing.window, num_parts),
            KeyframeCommand(self.library, schedule.horizon, schedule, timing=self.timing),
            *(() if observe is None else observe(self.library)),
        ]
        self._task = TransformedEnv(self._env, Compose(*transforms))
        self._chains = chains
        self._pushes = pushes

    def commanded(self, number: int) -> Tensor:
        """Return the masks ``[C, J + bodies + 3]`` of the commands that a step belongs to; held ones go on."""
        command = (self.arrivals < number).sum(-1).clamp_max(self.arrivals.shape[1] - 1)
        return self.parts[torch.arange(len(command), device=command.device), command]

    def lowest_root(self, number: int) -> LowestRoot:
        """Return the lowest roots ``[C]`` that robots are told to have in a step."""
        command = (self.arrivals < number).sum(-1)
        chain = torch.arange(len(command), device=command.device)
        return LowestRoot(self.lowest.height[chain, command], self.lowest.tilt[chain, command])

    def off_in_window(self, step: AuthoredStep, parts: Tensor, limits: TerminationLimits) -> Tensor:
        """Return in which arrival windows a robot is off in a step ``[C, K]``.

        Args:
            step: the step.
            parts: what is commanded in it, of :meth:`commanded`.
            limits: thresholds in a window.
        """
        # a window is the last steps of a command, the arrival among them
        in_window = (self.arrivals >= step.number) & (self.arrivals - step.number < self.timing.window)
        off = off_pose(step.after["state"], step.after["reference"], self.library.robot, limits, parts)
        return in_window & off[:, None]

    @torch.no_grad()
    def __iter__(self) -> Iterator[AuthoredStep]:
        """Yield the control steps to the end of the longest hold."""
        with set_exploration_type(ExplorationType.DETERMINISTIC):
            current = self._task.reset()
            pushes = None if self._pushes is None else self._draw_pushes(self._pushes)
            broken = torch.zeros_like(self.ends, dtype=torch.bool)
            for number in range(1, int(self.ends.max()) + 1):
                if pushes is not None and number in pushes:
                    self._env.physics.push(torch.arange(len(self.ends)), pushes[number])
                current = self._policy(current)
                check_actions(current["action"], ~broken)
                # it has fallen for good: what it is told next must not end the rollout of the others
                current["action"] = torch.where(broken[:, None], 0.0, current["action"])
                after = self._task.step(current)["next"]
                broken |= after["terminated"][:, 0]
                yield AuthoredStep(number, current, after)
                current = step_mdp(TensorDict({"next": after}, after.batch_size), exclude_done=True)

    def _draw_pushes(self, pushes: Pushes) -> dict[int, Tensor]:
        """Return the changes of root velocity ``[C, 6]`` by the step before which they happen."""
        every = max(1, round(pushes.every / self.timing.control_dt))
        steps = range(every, int(self.ends.max()) + 1, every)
        drawn = torch.stack([pushes.along(chain, len(steps)) for chain in self._chains], 1)
        return dict(zip(steps, drawn, strict=True))


def _check_chains(chains: Sequence[Authored]) -> None:
    """Raise an error for what cannot be rolled out side by side."""
    if not isinstance(chains, Sequence) or not all(isinstance(chain, Authored) for chain in chains):
        raise KeyframeError(f"authored keyframes: chains is {short(chains)}, expected those of plat.control.author")
    if not chains:
        raise KeyframeError("authored keyframes: no chains, expected at least one")
    lengths = sorted({len(chain.sequence) for chain in chains})
    if len(lengths) > 1:
        raise KeyframeError(
            f"authored keyframes: chains of {lengths[0]} to {lengths[-1]} keyframes, expected as many in each; for a "
            "policy whose commands are shorter than a family's, some of its intervals are split"
        )


def _lines(robot: Robot, chains: Sequence[Authored], last: int, dt: float) -> MotionLibrary:
    """Return lines between keyframes as clips of equal length."""
    # one more frame, so that no robot is at the end of its clip while another goes on
    frames = last + 2
    clips = [
        MotionClip(f"{number}", np.stack([chain.sequence.sample(step * dt).qpos for step in range(frames)]), 1 / dt)
        for number, chain in enumerate(chains)
    ]
    library = MotionLibrary.from_clips(clips, robot=robot, dt=dt)
    # the line moves from the first frame on, but the robot begins at rest
    for velocity in ("keypoint_lin_vel", "keypoint_ang_vel", "joint_vel"):
        library.frames[velocity][library.clip_start] = 0.0
    return library


def _parts(robot: Robot, chains: Sequence[Authored]) -> Tensor:
    """Return masks of what each keyframe commands ``[C, K, J + bodies + 3]``."""
    whole = Parts.all(robot)
    rows = [[(frame.commands or whole).values() for frame in chain.sequence.keyframes] for chain in chains]
    return torch.tensor(rows, dtype=torch.float32)


def _lowest(chains: Sequence[Authored], device: torch.device | str) -> LowestRoot:
    """Return the lowest roots of every command, between its ends, and of the hold ``[C, K + 1]``."""
    ends = []
    for sequence in (chain.sequence for chain in chains):
        of_commands = [sequence.ends(index) for index in range(len(sequence))]
        ends.append([*of_commands, (of_commands[-1][1],) * 2])
    pos, quat = (
        torch.tensor(np.array([[[getattr(pose, name) for pose in pair] for pair in chain] for chain in ends]))
        for name in ("root_pos", "root_quat")
    )
    return LowestRoot.of(pos.to(device, torch.float32), quat.to(device, torch.float32))


def _of_commands(parts: Tensor, arrivals: Tensor, schedule: CommandSchedule, library: MotionLibrary) -> Tensor:
    """Return the masks of every command of a schedule ``[M, J + bodies + 3]``."""
    first = schedule.first_frame.to(parts.device)
    chain = library.clip_of(first)
    begin = first - library.clip_start[chain]
    command = (arrivals[chain] <= begin[:, None]).sum(-1).clamp_max(parts.shape[1] - 1)
    return parts[chain, command]


def _with_holds(arrivals: Sequence[Sequence[int]], library: MotionLibrary) -> list[list[int]]:
    """Return the arrivals within each clip, and one at every further frame: the commands of the hold."""
    return [
        [*steps, *range(steps[-1] + 1, int(length))]
        for steps, length in zip(arrivals, library.clip_length.tolist(), strict=True)
    ]
