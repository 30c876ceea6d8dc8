"""Scores on authored keyframes: success rate, falls before the arrival, and falls during the hold."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Compose, Transform, TransformedEnv, step_mdp
from torchrl.envs.utils import ExplorationType, set_exploration_type

from plat.control.authored import FAMILIES, Authored, author, resting_poses
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import FirstFrames, KeyframeClock, KeyframeCommand, ReferenceMotion
from plat.envs.transforms.command import CommandSchedule
from plat.envs.transforms.terminations import TerminationLimits, off_pose
from plat.errors import RecordsError
from plat.evaluation.finite import check_actions
from plat.motions import MotionClip, MotionLibrary
from plat.robots import Robot
from plat.spec.timing import Timing, timing_of

__all__ = [
    "AuthoredRecords",
    "AuthoredScore",
    "ReachLimits",
    "authored_table",
    "evaluate_authored",
    "evaluate_families",
]


@dataclass(frozen=True)
class ReachLimits:
    """Thresholds of success at a keyframe, and of a fall."""

    root: float = 0.2
    """m: distance of the root at arrival"""
    joints: float = 0.2
    """rad: mean absolute joint error at arrival"""
    fallen_height: float = 0.4
    """m: a pelvis below this has fallen, unless it is commanded to be there"""
    fallen_tilt: float = 0.7
    """1: so much more vertical tilt than commanded, in gravity's component along the root's z, is a fall"""
    window: TerminationLimits = TerminationLimits()
    """thresholds of every step of the arrival window"""


@dataclass
class AuthoredRecords:
    """Outcomes of C chains of K keyframes each.

    Attributes:
        family: of each chain, ``[C]``.
        reached: in time, near enough and not fallen before ``[C, K]``.
        root_error: distance of the root at arrival ``[C, K]`` (m).
        joint_error: mean absolute joint error at arrival ``[C, K]`` (rad).
        fell: at some moment, the hold included ``[C]``.
        fell_in_hold: for the first time after the last arrival ``[C]``.
    """

    family: list[str]
    reached: Tensor
    root_error: Tensor
    joint_error: Tensor
    fell: Tensor
    fell_in_hold: Tensor


@dataclass(frozen=True)
class AuthoredScore:
    """Percentages of a family, each with its 95 % bootstrap interval over chains.

    Args:
        family: its name.
        chains: how many.
        fell: of chains in which the robot fell at some moment: value, low, high.
        reached: of keyframes that were reached.
        fell_in_hold: of holds that began upright and ended in a fall.
    """

    family: str
    chains: int
    fell: tuple[float, float, float]
    reached: tuple[float, float, float]
    fell_in_hold: tuple[float, float, float]

    @classmethod
    def of(cls, records: AuthoredRecords, family: str, resamples: int = 1000, seed: int = 0) -> "AuthoredScore":
        """Return the score of one family.

        Raises:
            RecordsError: when no chain is of it.
        """
        rows = [row for row, name in enumerate(records.family) if name == family]
        if not rows:
            raise RecordsError(f"authored family {family!r}: no records, expected one of {sorted(set(records.family))}")
        fell, late = records.fell[rows].double(), records.fell_in_hold[rows].double()
        standing = 1 - fell + late  # chains that were upright when the hold began
        reached = records.reached[rows].double().mean(1)
        draws = torch.randint(len(rows), (resamples, len(rows)), generator=torch.Generator().manual_seed(seed))
        ones = torch.ones_like(fell)
        return cls(
            family,
            len(rows),
            _interval(fell, ones, draws),
            _interval(reached, ones, draws),
            _interval(late, standing, draws),
        )


@torch.no_grad()
def evaluate_authored(
    policy: TensorDictModuleBase,
    robot: Robot,
    chains: Sequence[Authored],
    *,
    limits: ReachLimits | None = None,
    observe: Callable[[MotionLibrary], Sequence[Transform]] | None = None,
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
) -> AuthoredRecords:
    """Evaluate a policy on authored chains, one robot per chain, without resets.

    A robot begins at rest in the chain's start. In the hold its command is the last keyframe by the next step,
    over and over. Between keyframes it is compared with the straight line between them.

    Args:
        policy: deterministic policy that reads ``"robot"``, ``"goal"`` and ``"command"`` and writes ``action``.
        robot: that it drives.
        chains: of :func:`plat.control.author`; all with the same number of keyframes.
        limits: when a keyframe is reached and when a robot has fallen.
        observe: makes the transforms that show a policy what it reads beside those groups.
        num_threads: threads of the physics pool.
        device: where the policy and tensors live.

    >>> from plat.control.authored import author
    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> records = evaluate_authored(PlainPolicy(G1).deployed(), G1, author("arms", G1, count=2, seed=0))
    >>> records.reached.shape
    torch.Size([2, 5])
    """
    limits = limits or ReachLimits()
    timing = timing_of(policy) or Timing()
    library, arrivals, ends = _library(robot, chains)
    schedule = CommandSchedule.of_arrivals(library.to(device), _with_holds(arrivals, library))
    env = MotionTrackingEnv(library, len(chains), num_threads=num_threads, device=device)
    transforms: list[Transform] = [
        FirstFrames(env.library),
        ReferenceMotion(env.library),
        KeyframeClock(timing.window),
        KeyframeCommand(env.library, schedule.horizon, schedule, timing=timing),
        *(() if observe is None else observe(env.library)),
    ]
    task = TransformedEnv(env, Compose(*transforms))
    arrival_steps, end_steps = torch.tensor(arrivals, device=device), torch.tensor(ends, device=device)
    count, keyframes = arrival_steps.shape
    missed = torch.zeros(count, keyframes, dtype=torch.bool, device=device)
    root_error = torch.zeros(count, keyframes, device=device)
    joint_error = torch.zeros(count, keyframes, device=device)
    fell_at = torch.full((count,), torch.iinfo(torch.int64).max, device=device)
    with set_exploration_type(ExplorationType.DETERMINISTIC):
        current = task.reset()
        for step in range(1, int(end_steps.max()) + 1):
            current = policy(current)
            check_actions(current["action"])
            after = task.step(current)["next"]
            state, reference = after["state"], after["reference"]
            fallen = _fallen(state, reference, limits) & (step <= end_steps)
            fell_at = torch.where(fallen, fell_at.clamp_max(step), fell_at)
            # a window is the last steps of a command, the arrival among them
            in_window = (arrival_steps - step >= 0) & (arrival_steps - step < timing.window)
            off = off_pose(state, reference, robot, limits.window)
            missed |= in_window & off[:, None]
            now = arrival_steps == step
            distance = (state["keypoint_pos_w"][:, 0] - reference["keypoint_pos_w"][:, 0]).norm(dim=-1)
            angles = (state["joint_pos"] - reference["joint_pos"]).abs().mean(-1)
            root_error = torch.where(now, distance[:, None], root_error)
            joint_error = torch.where(now, angles[:, None], joint_error)
            current = step_mdp(TensorDict({"next": after}, after.batch_size), exclude_done=True)
    near = (root_error <= limits.root) & (joint_error <= limits.joints)
    fell = fell_at <= end_steps
    return AuthoredRecords(
        [chain.family for chain in chains],
        (near & ~missed & (fell_at[:, None] > arrival_steps)).cpu(),
        root_error.cpu(),
        joint_error.cpu(),
        fell.cpu(),
        (fell & (fell_at > arrival_steps[:, -1])).cpu(),
    )


def evaluate_families(
    policy: TensorDictModuleBase,
    robot: Robot,
    motions: MotionLibrary,
    count: int,
    seed: int = 0,
    *,
    observe: Callable[[MotionLibrary], Sequence[Transform]] | None = None,
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
) -> AuthoredRecords:
    """Return records of ``count`` chains of every authored family.

    Families of resting poses are left out when the motions have none, and ``far3s`` when the policy's longest command
    is shorter than its 3 s.

    Args:
        policy, robot, observe, num_threads, device: as for :func:`evaluate_authored`.
        motions: source of resting poses.
        count: chains per family.
        seed: of the chains; the same for every policy.
    """
    timing = timing_of(policy) or Timing()
    resting = resting_poses(motions)
    chains = [
        chain
        for family in FAMILIES.values()
        if family.interval[1] <= timing.longest and not (family.resting and len(resting) == 0)
        for chain in author(family.name, robot, count, seed, resting, timing)
    ]
    return evaluate_authored(policy, robot, chains, observe=observe, num_threads=num_threads, device=device)


def authored_table(records: AuthoredRecords) -> str:
    """Return the scores of every family as a Markdown table."""
    lines = ["| family | chains | fell % | reached % | fell while holding % |", "|---|---|---|---|---|"]
    for family in dict.fromkeys(records.family):
        score = AuthoredScore.of(records, family)
        cells = ("{:.1f} ({:.1f}-{:.1f})".format(*figure) for figure in (score.fell, score.reached, score.fell_in_hold))
        lines.append(f"| {family} | {score.chains} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _fallen(state: TensorDict, reference: TensorDict, limits: ReachLimits) -> Tensor:
    """Return the mask ``[N]`` of robots with a low or tilted pelvis that was not commanded to be so."""
    height, wanted = state["keypoint_pos_w"][:, 0, 2], reference["keypoint_pos_w"][:, 0, 2]
    # the vertical component of the root's z axis is 1 - 2 (x^2 + y^2)
    up, wanted_up = (1 - 2 * group["keypoint_quat_w"][:, 0, 1:3].square().sum(-1) for group in (state, reference))
    low = (height < limits.fallen_height) & (wanted >= limits.fallen_height)
    return low | ((wanted_up - up) > limits.fallen_tilt)


def _library(robot: Robot, chains: Sequence[Authored]) -> tuple[MotionLibrary, list[list[int]], list[int]]:
    """Return lines between keyframes as clips of equal length, arrival steps ``[C][K]`` and last steps ``[C]``."""
    dt = chains[0].sequence.timing.control_dt
    arrivals = [list(chain.sequence.arrival_steps) for chain in chains]
    ends = [steps[-1] + round(chain.hold / dt) for steps, chain in zip(arrivals, chains, strict=True)]
    # one more frame, so that no robot is at the end of its clip while another goes on
    frames = max(ends) + 2
    clips = [
        MotionClip(f"{number}", np.stack([chain.sequence.sample(step * dt).qpos for step in range(frames)]), 1 / dt)
        for number, chain in enumerate(chains)
    ]
    return MotionLibrary.from_clips(clips, robot=robot, dt=dt), arrivals, ends


def _with_holds(arrivals: Sequence[Sequence[int]], library: MotionLibrary) -> list[list[int]]:
    """Return the arrivals within each clip, and one at every further frame: the commands of the hold."""
    return [
        [*steps, *range(steps[-1] + 1, int(length))]
        for steps, length in zip(arrivals, library.clip_length, strict=True)
    ]


def _interval(top: Tensor, bottom: Tensor, draws: Tensor) -> tuple[float, float, float]:
    value = 100 * float(top.sum() / bottom.sum().clamp_min(1e-9))
    resampled = 100 * top[draws].sum(1) / bottom[draws].sum(1).clamp_min(1e-9)
    low, high = torch.quantile(resampled, torch.tensor([0.025, 0.975], dtype=torch.float64)).tolist()
    return value, low, high
