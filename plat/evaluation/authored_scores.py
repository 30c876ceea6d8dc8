"""Scores on authored keyframes: success rate, falls before the arrival, falls and steps during the hold."""

import logging
import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torchrl.envs import Transform

from plat.control.authored import FAMILIES, Authored, UndrawableError, author, resting_poses
from plat.control.feasibility import Feasibility
from plat.envs.reach import distances, down
from plat.envs.settings import ReachLimits
from plat.errors import RecordsError
from plat.evaluation.authored_rollout import AuthoredRollout, Pushes
from plat.evaluation.records import read_columns, write_columns
from plat.evaluation.report import Estimate, estimate, share
from plat.evaluation.score_table import AUTHORED_METRICS, table, with_conditions
from plat.files import replace_table
from plat.keyframes.chain_needs import lacking
from plat.motions import MotionLibrary
from plat.robots import Robot
from plat.spec.timing import Timing

__all__ = [
    "AuthoredRecords",
    "AuthoredScore",
    "author_families",
    "authored_table",
    "evaluate_authored",
    "no_chains",
    "remove_authored_csv",
    "write_authored_csv",
]

_LOGGER = logging.getLogger("plat.motions")
_HOLD_MEASURES = ("support_margin", "floating", "self_penetration", "floor_penetration")
_TABLE = ("policy", "family", "chains", "metric", "value", "low", "high")
_NEVER = torch.iinfo(torch.int64).max

Interval = tuple[float, float, float]
"""Percentage and its interval: value, low, high; nan where there was nothing to count."""


@dataclass
class AuthoredRecords:
    """Outcomes of C chains of K keyframes each.

    Attributes:
        family: of each chain, ``[C]``.
        sample: number of the sample that each chain is of ``[C]``: chains through the same poses are one.
        reached: in time, near enough and not fallen before ``[C, K]``.
        fell_before: fallen by the arrival ``[C, K]``; what is neither was late or off.
        root_error: distance of the root at arrival ``[C, K]`` (m), in what is commanded of it. As in the next
            two, 0 where nothing is.
        joint_error: mean absolute error of the commanded joints at arrival ``[C, K]`` (rad).
        body_error: largest distance of a commanded body at arrival ``[C, K]`` (m).
        feasible: without a concern of :class:`plat.control.Feasibility` ``[C, K]``.
        fell: at some moment, the hold included ``[C]``.
        fell_in_hold: for the first time after the last arrival ``[C]``.
        foot_travel: greatest distance of a foot in the hold from where it was when that had settled ``[C]`` (m).
        stepped: whether that is a step ``[C]``.
        in_pose: whether the robot was near enough to the last keyframe when feet began to be watched ``[C]``.
        at_rest: whether the last keyframe can be held at rest, and nothing pushed the robot ``[C]``.
    """

    family: list[str]
    sample: Tensor
    reached: Tensor
    fell_before: Tensor
    root_error: Tensor
    joint_error: Tensor
    body_error: Tensor
    feasible: Tensor
    fell: Tensor
    fell_in_hold: Tensor
    foot_travel: Tensor
    stepped: Tensor
    in_pose: Tensor
    at_rest: Tensor

    @property
    def held(self) -> Tensor:
        """Return the mask ``[C]`` of upright holds of a keyframe that was reached, and not left when feet were watched.

        A robot that walks on to a place that it did not reach in time holds nothing.
        """
        return ~self.fell & self.reached[:, -1] & self.in_pose

    def save(self, path: Path, about: Mapping[str, Any]) -> None:
        """Write the records and a description of them (JSON values) to a ``.safetensors`` file."""
        columns = {name: column for name, column in vars(self).items() if isinstance(column, Tensor)}
        write_columns(path, columns, {"family": self.family, "about": dict(about)})

    @classmethod
    def load(cls, path: Path) -> "tuple[AuthoredRecords, dict[str, Any]]":
        """Return the records of a file and their description.

        Raises:
            RecordsError: when the file cannot be read or is another kind of file.
        """
        columns, about = read_columns(path, dict)
        try:
            return cls(about["family"], **columns), about["about"]
        except (KeyError, TypeError):
            raise RecordsError(f"{str(path)!r}: not a file of authored records") from None


@dataclass(frozen=True)
class AuthoredScore:
    """Percentages of a family, each with its 95 % bootstrap interval over samples.

    A sample is a chain, or all chains through the same poses: of ``hold`` there are no more than motions with a pose at
    rest. At 0 and 100 % the interval is that of :func:`share`. Of a single sample nothing follows for others: else it
    is 0 to 100 %.

    Args:
        family: its name.
        chains: how many.
        fell: of chains in which the robot fell at some moment: value, low, high.
        reached: of keyframes that were reached.
        late_or_off: of keyframes that were not, though the robot had not fallen.
        reached_feasible: of keyframes without a concern that were reached.
        fell_in_hold: of holds that began upright and ended in a fall.
        stepped: of holds (:attr:`AuthoredRecords.held`) of a pose that can be held at rest, those in which a foot left
            its place.
    """

    family: str
    chains: int
    fell: Interval
    reached: Interval
    late_or_off: Interval
    reached_feasible: Interval
    fell_in_hold: Interval
    stepped: Interval

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
        reached, feasible = records.reached[rows].double(), records.feasible[rows].double()
        neither = 1 - reached - records.fell_before[rows].double()
        resting = (records.held & records.at_rest)[rows].double()
        _, sample = torch.unique(records.sample[rows], return_inverse=True)
        count = int(sample.max()) + 1
        draws = torch.randint(count, (resamples, count), generator=torch.Generator().manual_seed(seed))
        ones = torch.ones_like(fell)

        def interval(top: Tensor, bottom: Tensor) -> Interval:
            zeros = torch.zeros(count, dtype=torch.float64)
            return _interval(zeros.index_add(0, sample, top), zeros.index_add(0, sample, bottom), draws)

        return cls(
            family,
            len(rows),
            interval(fell, ones),
            interval(reached.mean(1), ones),
            interval(neither.mean(1), ones),
            interval((reached * feasible).sum(1), feasible.sum(1)),
            interval(late, standing),
            interval(records.stepped[rows].double() * resting, resting),
        )


@torch.no_grad()
def evaluate_authored(
    policy: TensorDictModuleBase,
    robot: Robot,
    chains: Sequence[Authored],
    *,
    limits: ReachLimits | None = None,
    observe: Callable[[MotionLibrary], Sequence[Transform]] | None = None,
    pushes: Pushes | None = None,
    num_threads: int | None = None,
    device: torch.device | str = "cpu",
) -> AuthoredRecords:
    """Evaluate a policy on authored chains, see :class:`plat.evaluation.authored_rollout.AuthoredRollout`.

    Args:
        policy, robot, chains, observe, pushes, num_threads, device: of the rollout.
        limits: when a keyframe is reached and when a robot has fallen.

    >>> from plat.control.authored import author
    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> records = evaluate_authored(PlainPolicy(G1).deployed(), G1, author("arms", G1, count=2, seed=0))
    >>> records.reached.shape
    torch.Size([2, 5])
    """
    limits = limits or ReachLimits()
    rollout = AuthoredRollout(
        policy, robot, chains, observe=observe, pushes=pushes, num_threads=num_threads, device=device
    )
    arrivals, ends, timing = rollout.arrivals, rollout.ends, rollout.timing
    feet = [robot.keypoints.index(foot) for foot in robot.feet]
    settled = arrivals[:, -1] + round(limits.settling / timing.control_dt)
    missed = torch.zeros_like(arrivals, dtype=torch.bool)
    near = torch.zeros_like(arrivals, dtype=torch.bool)
    errors = {name: torch.zeros(arrivals.shape, device=device) for name in ("root", "joints", "bodies")}
    fell_at = torch.full_like(ends, _NEVER)
    bodies = torch.tensor([limits.bodies if chain.bodies is None else chain.bodies for chain in chains], device=device)
    foot_travel = torch.zeros(ends.shape, device=device)
    in_pose = torch.zeros_like(ends, dtype=torch.bool)
    places: Tensor | None = None
    for step in rollout:
        state, reference, number = step.after["state"], step.after["reference"], step.number
        parts = rollout.commanded(number)
        # MuJoCo puts a robot whose simulation diverged back to its start, upright
        broken = step.after["terminated"][:, 0]
        fallen = (down(state, rollout.lowest_root(number), robot, limits) | broken) & (number <= ends)
        fell_at = torch.where(fallen, fell_at.clamp_max(number), fell_at)
        missed |= rollout.off_in_window(step, parts, limits.window)
        now, watched = arrivals == number, (settled == number) & (number < ends)
        if bool(now.any() | watched.any()):
            away = distances(state, reference, parts)
            there = away.near(limits, bodies)
            near |= now & there[:, None]
            in_pose |= watched & there & ~fallen
            for name, values in errors.items():
                errors[name] = torch.where(now, getattr(away, name)[:, None], values)
        standing = state["keypoint_pos_w"][:, feet]
        places = standing if places is None else torch.where((number <= settled)[:, None, None], standing, places)
        travel = (standing - places).norm(dim=-1).amax(-1) * (number <= ends)
        foot_travel = torch.maximum(foot_travel, travel)
    fell = fell_at <= ends
    fell_before = fell_at[:, None] <= arrivals
    feasible, at_rest = _feasibility(robot, chains)
    return AuthoredRecords(
        [chain.family for chain in chains],
        sample=_samples(chains),
        reached=(near & ~missed & ~fell_before).cpu(),
        fell_before=fell_before.cpu(),
        root_error=errors["root"].cpu(),
        joint_error=errors["joints"].cpu(),
        body_error=errors["bodies"].cpu(),
        feasible=feasible,
        fell=fell.cpu(),
        fell_in_hold=(fell & (fell_at > arrivals[:, -1])).cpu(),
        foot_travel=foot_travel.cpu(),
        stepped=foot_travel.cpu() > limits.foot_travel,
        in_pose=in_pose.cpu(),
        at_rest=at_rest & (pushes is None),
    )


def author_families(
    robot: Robot, motions: MotionLibrary, count: int, seed: int = 0, timing: Timing | None = None
) -> list[Authored]:
    """Return ``count`` chains of every authored family that a policy of a timing can be given.

    ``far3s`` is left out when the longest command is shorter than its 3 s. So are families for which motions or robot
    lack something (:func:`plat.keyframes.chain_needs.lacking`), or whose poses the robot cannot take; a log line says
    so.

    Args:
        robot: whose keyframes they are.
        motions: source of resting poses.
        count: chains per family.
        seed: of the chains.
        timing: of the policy.
    """
    timing = timing or Timing()
    resting = resting_poses(motions)
    chains: list[Authored] = []
    for family in FAMILIES.values():
        if family.interval[1] > timing.longest:
            continue
        if lack := lacking(family, robot, resting):
            _LOGGER.warning("authored family %r needs %s; left out", family.name, lack)
            continue
        try:
            chains += author(family.name, robot, count, seed, resting, timing)
        except UndrawableError as error:
            _LOGGER.warning("%s: left out", error)
    return chains


def no_chains(timing: Timing) -> str:
    """Return why there are no chains for a policy of a timing, in words."""
    return f"no authored keyframes, which are up to 1 s apart: its longest command is {timing.longest:g} s"


_COLUMNS = {
    "fell": "fell %",
    "reached": "reached %",
    "reached_feasible": "reached of feasible %",
    "fell_in_hold": "fell while holding %",
    "stepped": "stepped while holding %",
}


def authored_table(records: AuthoredRecords) -> str:
    """Return the scores of every family as a Markdown table."""
    lines = [["family", "chains", *_COLUMNS.values()]]
    for family in dict.fromkeys(records.family):
        score = AuthoredScore.of(records, family)
        cells = (AUTHORED_METRICS[name].text(Estimate(*getattr(score, name))) for name in _COLUMNS)
        lines.append([family, str(score.chains), *cells])
    return table(lines) + "\n"


def write_authored_csv(path: Path, records: Mapping[str, AuthoredRecords], conditions: str = "") -> None:
    """Write the scores of every policy and family: a line per figure, with its interval.

    Args:
        path: the file; it is replaced atomically or not at all.
        records: by the names of the policies.
        conditions: what the test had of its own, in words: a last column. Without any there is no such column.
    """
    rows: list[tuple[object, ...]] = []
    for policy, of_policy in records.items():
        for family in dict.fromkeys(of_policy.family):
            score = AuthoredScore.of(of_policy, family)
            for name in ("fell", "reached", "late_or_off", "reached_feasible", "fell_in_hold", "stepped"):
                figures = ("" if math.isnan(value) else f"{value:.3f}" for value in getattr(score, name))
                rows.append((policy, family, score.chains, name, *figures))
    replace_table(path, *with_conditions(_TABLE, rows, conditions))


def remove_authored_csv(path: Path) -> None:
    """Remove a table that :func:`write_authored_csv` wrote; what else is called so stays."""
    with suppress(OSError):
        with path.open("rb") as file:
            head = file.readline(1000)
        if re.split(rb"[,\t\r\n]", head)[: len(_TABLE)] == [name.encode() for name in _TABLE]:
            path.unlink()


def _feasibility(robot: Robot, chains: Sequence[Authored]) -> tuple[Tensor, Tensor]:
    """Return which keyframes raise no concern ``[C, K]``, and which last ones can be held at rest ``[C]``."""
    feasibility = Feasibility(robot)
    feasible = [[not found for found in feasibility.sequence(chain.sequence)] for chain in chains]
    at_rest = []
    for chain in chains:
        # of a partial keyframe the whole pose that was drawn: there is at least that one
        last = replace(chain.sequence.keyframes[-1], commands=None)
        concerns = feasibility(last.at(0.0), last.at(1.0), held=True)
        at_rest.append(not any(concern.measure in _HOLD_MEASURES for concern in concerns))
    return torch.tensor(feasible), torch.tensor(at_rest)


def _samples(chains: Sequence[Authored]) -> Tensor:
    """Return the number of the sample that each chain is of ``[C]``: the same for chains of the same poses.

    Their times differ, but one pose that a robot falls in at all times is no more than one pose.
    """
    numbers: dict[tuple[str, bytes], int] = {}
    poses = (np.stack([keyframe.qpos for keyframe in chain.sequence.keyframes]).tobytes() for chain in chains)
    keys = zip((chain.family for chain in chains), poses, strict=True)
    return torch.tensor([numbers.setdefault(key, len(numbers)) for key in keys])


def _interval(top: Tensor, bottom: Tensor, draws: Tensor) -> Interval:
    """Return the share of samples' sums ``[S]`` (%), and its interval by the samples drawn ``[resamples, S]``."""
    value, trials = 100 * float(top.sum() / bottom.sum()), int((bottom > 0).sum())
    found = estimate(value, 100 * top[draws].sum(1) / bottom[draws].sum(1))
    if trials == 1 and 0 < value < 100:  # all resamples are that one
        return value, 0.0, 100.0
    found = share(found, trials)
    return found.value, found.low, found.high
