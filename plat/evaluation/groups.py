"""Scores by groups of commands or clips: families of motion, bins of difficulty."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch

from plat.errors import RecordsError
from plat.evaluation.clip_records import ClipRecords
from plat.evaluation.records import CommandRecords
from plat.evaluation.report import Estimate, as_runs, report, report_clips
from plat.evaluation.score_table import GROUP_METRICS, Metric, metric_named, table
from plat.words import counted

__all__ = ["GroupScore", "group_table", "metric_of", "score_groups"]


@dataclass(frozen=True)
class GroupScore:
    """Metrics of a policy on one group.

    Attributes:
        policy: its name.
        test: horizon of the commands, or success rule of whole clips.
        group: its name.
        count: commands or clips in it.
        figures: their report.
    """

    policy: str
    test: str
    group: str
    count: int
    figures: Mapping[str, Estimate]


def score_groups(
    policy: str,
    test: str,
    runs: Sequence[CommandRecords] | Sequence[ClipRecords],
    labels: Sequence[str],
    order: Sequence[str] = (),
    resamples: int = 1000,
) -> list[GroupScore]:
    """Return the scores of every group that has a command or clip.

    Args:
        policy: name of the policy.
        test: horizon or rule.
        runs: records, one table per training seed.
        labels: group of each row of the records.
        order: of the groups; those that are not in it follow by name.
        resamples: of the bootstrap.

    Raises:
        RecordsError: for no records, and when there are not as many labels as rows.
    """
    runs = as_runs(runs)
    for run in runs:
        if len(labels) != len(run.clip):
            raise RecordsError(
                f"{counted(len(labels), 'label')} for {counted(len(run.clip), 'row')} of records, expected one each"
            )
    groups = [name for name in order if name in labels] + sorted(set(labels) - set(order))
    scores = []
    for group in groups:
        rows = torch.tensor([label == group for label in labels])
        parts: list[Any] = [run.of_rows(rows) for run in runs]
        scores.append(GroupScore(policy, test, group, int(rows.sum()), _report(parts, resamples)))
    return scores


def _report(parts: list[Any], resamples: int) -> dict[str, Estimate]:
    return (report_clips if isinstance(parts[0], ClipRecords) else report)(parts, resamples=resamples)


def metric_of(scores: Sequence[GroupScore], metric: str) -> Metric:
    """Return a metric that all groups are scored by.

    Raises:
        RecordsError: for another one, with those that they are scored by.
    """
    known = {name: one for name, one in GROUP_METRICS.items() if all(name in score.figures for score in scores)}
    return metric_named(metric, known)


def group_table(scores: Sequence[GroupScore], metric: str = "tks") -> str:
    """Return one metric as a Markdown table: a row per policy, a column per group with its count.

    Raises:
        RecordsError: for a metric that the groups are not scored by.
    """
    shown = metric_of(scores, metric)
    columns = {score.group: score.count for score in scores}
    head = [shown.heading, *(f"{group} ({count})" for group, count in columns.items())]
    rows = [head]
    for policy in dict.fromkeys(score.policy for score in scores):
        cells = {score.group: shown.text(score.figures[metric]) for score in scores if score.policy == policy}
        rows.append([policy, *(cells.get(group, "") for group in columns)])
    return table(rows) + "\n"
