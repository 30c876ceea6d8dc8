"""Metrics of command records, with bootstrap confidence intervals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from plat.errors import RecordsError
from plat.evaluation.clip_records import CLIP_ERRORS, ClipRecords
from plat.evaluation.records import COMMANDED, STEP_METRICS, CommandRecords
from plat.json_file import short

__all__ = [
    "Estimate",
    "Penalties",
    "as_runs",
    "compare",
    "estimate",
    "report",
    "report_clips",
    "share",
    "success_curve",
]

_SHARES = ("tks", "fall_rate", "clip_success")
"""Metrics that are a share of what was tried, of commands or clips."""


@dataclass(frozen=True)
class Penalties:
    """Caps on a command's error in the metrics over all commands; a failed command counts as its cap."""

    joint_error: float = 0.5
    """rad"""
    keypoint_error: float = 1.0
    """m"""
    keypoint_error_root: float = 0.5
    """m"""


@dataclass(frozen=True)
class Estimate:
    """Metric with its 95 % bootstrap interval over motions."""

    value: float
    low: float
    high: float

    @property
    def beyond_chance(self) -> bool:
        """Return whether a difference's interval leaves 0 out; one that is not known does not."""
        return self.low > 0 or self.high < 0

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} ({self.low:{spec}}-{self.high:{spec}})"


def report(
    records: CommandRecords | Sequence[CommandRecords],
    penalties: Penalties | None = None,
    resamples: int = 1000,
    seed: int = 0,
) -> dict[str, Estimate]:
    """Return the metrics of timed keyframe tracking, with 95 % intervals.

    Args:
        records: of one policy, or one table for each of its training seeds; all of the same commands.
        penalties: errors that a failed command counts as in the metrics over all commands.
        resamples: number of bootstrap samples.
        seed: of the bootstrap.

    Returns:
        ``tks`` (%): TKS@3, commands that were not terminated; ``mpjpe`` (rad), ``mpkpe`` and ``mpkpe_root`` (m):
        errors over the commands that reached their window; ``mpjpe_all``, ``mpkpe_all``, ``mpkpe_root_all``: the same
        over all commands, each capped, and a failed one at its cap; ``fall_rate`` (%); ``success_area`` (%): area
        under :func:`success_curve`; ``action_change``, ``joint_jerk`` (rad/s^3), ``foot_slip`` (m/s): means over
        steps, of jerk over those with two more before them since the robot was reset. Of partial keyframes, errors are
        over the commands that command a joint, or a body, and in the root frame one beside the root; nan without any.
        The bootstrap resamples motions and training seeds; pieces of a motion stay together. Where all commands
        succeed, or none falls, samples are all alike, and the interval is that of :func:`share`.

    Raises:
        RecordsError: when the tables are of different commands, or of none.
    """
    return _estimates(_Table(as_runs(records, CommandRecords), penalties or Penalties()), resamples, seed)


def report_clips(
    records: ClipRecords | Sequence[ClipRecords], resamples: int = 1000, seed: int = 0
) -> dict[str, Estimate]:
    """Return the metrics of whole clips, with 95 % intervals.

    Args:
        records: of one policy, or one table for each of its training seeds; all of the same clips.
        resamples, seed: as in :func:`report`.

    Returns:
        ``clip_success`` (%): clips that were followed to the end; ``clip_progress`` (%): their frames before a failure;
        over these frames, ``clip_mpjpe`` (rad), ``clip_mpkpe`` and ``clip_mpkpe_root`` (m), ``vel_dist`` (m/frame) and,
        over all but a clip's first, ``accel_dist`` (m/frame²).

    Raises:
        RecordsError: when the tables are of different clips or of none, or judged by different rules.
    """
    return _estimates(_Table(as_runs(records, ClipRecords), Penalties()), resamples, seed)


def compare(
    ours: CommandRecords | Sequence[CommandRecords] | Sequence[ClipRecords],
    theirs: CommandRecords | Sequence[CommandRecords] | Sequence[ClipRecords],
    penalties: Penalties | None = None,
    resamples: int = 1000,
    seed: int = 0,
) -> dict[str, Estimate]:
    """Return the paired difference of two policies' metrics on the same commands.

    The bootstrap is paired: each sample has the same motions for both policies, and training seeds for each on its
    own. Differences between motions cancel, so its intervals are narrower than those of the policies would suggest.

    Args:
        ours: records of one policy, or one table for each of its training seeds.
        theirs: those of the other policy.
        penalties, resamples, seed: as in :func:`report`.

    Returns:
        For each metric of :func:`report` or :func:`report_clips`, ours minus theirs. Of one motion the ends of the
        interval are nan.

    Raises:
        RecordsError: when the records are of different commands, or of none.
    """
    tables = [_Table(as_runs(records), penalties or Penalties()) for records in (ours, theirs)]
    if tables[0].rule != tables[1].rule:
        raise RecordsError(f"clips judged by {tables[0].rule!r} and by {tables[1].rule!r}, expected one rule")
    if not torch.equal(tables[0].commands, tables[1].commands):
        raise RecordsError("records of different commands, expected the same commands for both policies")
    generator = torch.Generator().manual_seed(seed)
    # samples of one motion are all alike: of other motions they say nothing
    clip_weights = _draws(tables[0].num_motions, resamples if tables[0].num_motions > 1 else 0, generator)
    values = [table.figures() for table in tables]
    resampled = [table.resampled(clip_weights, generator) for table in tables]
    return {
        name: estimate(values[0][name] - values[1][name], resampled[0][name] - resampled[1][name]) for name in values[0]
    }


_LARGEST = 0.5  # m: right end of the success curve


def success_curve(records: CommandRecords | Sequence[CommandRecords], points: int = 51) -> tuple[Tensor, Tensor]:
    """Return the fraction of commands whose world keypoint error at arrival is at most x, for x from 0 to 0.5 m.

    Returns:
        x ``[points]`` (m) and fractions ``[points]`` in 0..1. A failed command counts at no x; one that commands no
        body does not count.

    Raises:
        RecordsError: for what are no records of commands.
    """
    runs = as_runs(records, CommandRecords)
    error = torch.cat([run.arrival_error[run.commanded["bodies"]] for run in runs])
    thresholds = torch.linspace(0, _LARGEST, points, dtype=torch.float64)
    return thresholds, (error <= thresholds[:, None]).double().mean(-1)


class _Table:
    """Numerators and denominators of each metric, summed over the commands of a motion: ``[runs, motions]``."""

    def __init__(self, runs: "list[CommandRecords] | list[ClipRecords]", penalties: Penalties):
        self.commands = _commands(runs[0])
        if not self.commands.shape[1]:
            raise RecordsError("records of no commands or clips, expected at least one")
        rules = {run.rule if isinstance(run, ClipRecords) else None for run in runs}
        if len(rules) != 1:
            raise RecordsError(f"clips judged by the rules {sorted(map(str, rules))}, expected one rule")
        self.rule = rules.pop()
        if any(not torch.equal(_commands(run), self.commands) for run in runs):
            raise RecordsError("records of different commands, expected the same commands for every training seed")
        motions, rows = torch.unique(self.commands[-1], return_inverse=True)
        self.num_motions = len(motions)
        ratios = [_clip_ratios(run) if isinstance(run, ClipRecords) else _ratios(run, penalties) for run in runs]
        self._num_runs = len(runs)
        self._sums: dict[str, tuple[Tensor, ...]] = {}
        for name in ratios[0]:
            zeros = torch.zeros(len(runs), self.num_motions, dtype=torch.float64)
            parts = (torch.stack([ratio[name][part].double() for ratio in ratios]) for part in (0, 1))
            self._sums[name] = tuple(zeros.index_add(1, rows, part) for part in parts)

    def figures(self) -> dict[str, float]:
        """Return each metric."""
        return {name: float(top.sum() / bottom.sum()) for name, (top, bottom) in self._sums.items()}

    def trials(self, name: str) -> int:
        """Return what a metric is a share of: how many commands or clips of each run."""
        return int(self._sums[name][1][0].sum())

    def resampled(self, clip_weights: Tensor, generator: torch.Generator) -> dict[str, Tensor]:
        """Return each metric ``[resamples]`` with motions resampled as given and training seeds resampled here."""
        run_weights = _draws(self._num_runs, len(clip_weights), generator)
        return {
            name: ((run_weights @ top) * clip_weights).sum(-1) / ((run_weights @ bottom) * clip_weights).sum(-1)
            for name, (top, bottom) in self._sums.items()
        }


def _commands(records: CommandRecords | ClipRecords) -> Tensor:
    """Return what makes the rows of two tables the same ``[3, M]``: their clips, lengths, and source motions."""
    length = records.length if isinstance(records, CommandRecords) else records.frames
    source = records.clip if records.source is None else records.source
    return torch.stack([records.clip.double(), length.double(), source.double()])


def _ratios(records: CommandRecords, penalties: Penalties) -> dict[str, tuple[Tensor, Tensor]]:
    """Return each metric's numerator and denominator ``[M]``."""
    every = torch.ones_like(records.steps)
    reached = records.window_steps > 0
    at_arrival = records.commanded["bodies"]
    area = 100.0 * (1 - records.arrival_error.nan_to_num(_LARGEST).clamp_max(_LARGEST) / _LARGEST)
    ratios: dict[str, tuple[Tensor, Tensor]] = {
        "tks": (100.0 * ~records.failed, every),
        "fall_rate": (100.0 * records.fell, every),
        "success_area": (area * at_arrival, every * at_arrival),
    }
    for (part, name), metric in zip(COMMANDED.items(), ("mpjpe", "mpkpe", "mpkpe_root"), strict=True):
        error, cap, commanded = records.window[name], getattr(penalties, name), records.commanded[part]
        measured = reached & ~error.isnan()
        ratios[metric] = (error.nan_to_num(0.0) * measured, measured.double())
        capped = torch.where(records.failed, cap, error.nan_to_num(cap).clamp_max(cap))
        ratios[f"{metric}_all"] = (capped * commanded, every * commanded)
    for name in STEP_METRICS:
        ratios[name] = (records.step[name], records.steps)
    assert records.jerk_steps is not None  # counted where it was not given
    ratios["joint_jerk"] = (records.step["joint_jerk"], records.jerk_steps)
    return ratios


def _clip_ratios(records: ClipRecords) -> dict[str, tuple[Tensor, Tensor]]:
    """Return each metric's numerator and denominator ``[C]``."""
    every = torch.ones_like(records.frames)
    metrics = ("clip_mpjpe", "clip_mpkpe", "clip_mpkpe_root", "vel_dist", "accel_dist")
    ratios = {name: (records.errors[error], records.tracked) for name, error in zip(metrics, CLIP_ERRORS, strict=True)}
    return {
        "clip_success": (100.0 * ~records.failed, every),
        "clip_progress": (100.0 * records.tracked, records.frames),
        **ratios,
        # a clip's first displacement has none before it that it could differ from
        "accel_dist": (records.errors["accel_dist"], (records.tracked - 1).clamp_min(0)),
    }


def as_runs(records: Any, *kinds: type) -> Any:
    """Return records as a list, one table for each training seed; of some kinds, or of either."""
    kinds = kinds or (CommandRecords, ClipRecords)
    runs = [records] if isinstance(records, kinds) else list(records) if isinstance(records, Iterable) else None
    if runs is None or not all(isinstance(run, kinds) for run in runs):
        expected = " or ".join(kind.__name__ for kind in kinds)
        raise RecordsError(f"records are {short(records)}, expected {expected}, or a list of them")
    if not runs:
        raise RecordsError("no records, expected those of at least one run")
    return runs


def _estimates(table: _Table, resamples: int, seed: int) -> dict[str, Estimate]:
    generator = torch.Generator().manual_seed(seed)
    clip_weights = _draws(table.num_motions, resamples, generator)
    resampled = table.resampled(clip_weights, generator)
    figures = {name: estimate(value, resampled[name]) for name, value in table.figures().items()}
    if table.num_motions > 1:
        shares = {name: share(figures[name], table.trials(name)) for name in _SHARES if name in figures}
        figures.update(shares)
    return figures


def _draws(count: int, resamples: int, generator: torch.Generator) -> Tensor:
    """Return how often each of ``count`` items is resampled ``[resamples, count]``."""
    draws = torch.randint(count, (resamples, count), generator=generator)
    ones = torch.ones_like(draws, dtype=torch.float64)
    return torch.zeros(resamples, count, dtype=torch.float64).scatter_add_(1, draws, ones)


def estimate(value: float, resampled: Tensor) -> Estimate:
    """Return a value with its interval; resamples without anything to count, which are not finite, are left out.

    Args:
        value: of the metric.
        resampled: values of the bootstrap ``[resamples]``.
    """
    resampled = resampled[resampled.isfinite()]
    if len(resampled) == 0:
        return Estimate(value, float("nan"), float("nan"))
    low, high = torch.quantile(resampled, torch.tensor([0.025, 0.975], dtype=torch.float64)).tolist()
    return Estimate(value, low, high)


def share(found: Estimate, trials: int) -> Estimate:
    """Return the estimate of a share (%) with an interval that has a width also at 0 and 100 %.

    Where every trial had the same outcome, so have all samples of them: their bootstrap is sure of what it cannot know.
    The other end is then the share with which that outcome has a chance of 2.5 %, trials being independent. Those of
    one motion are not: the interval is this wide at least.

    Args:
        found: estimate by the bootstrap.
        trials: how many there were.

    Source: Clopper and Pearson 1934, "The use of confidence or fiducial limits", of which this is the case at the ends.

    >>> print(f"{share(Estimate(0.0, 0.0, 0.0), 100):.1f}")
    0.0 (0.0-3.6)
    """
    unseen = 100 * (1 - 0.025 ** (1 / trials)) if trials else 0.0
    if found.value == 0:
        return replace(found, high=max(found.high, unseen))
    if found.value == 100:
        return replace(found, low=min(found.low, 100 - unseen))
    return found
