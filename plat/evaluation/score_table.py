"""Scores of several policies as tables."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from plat.errors import RecordsError
from plat.evaluation.records import CommandRecords
from plat.evaluation.report import Estimate, as_runs, compare, report
from plat.files import replace_table
from plat.json_file import short
from plat.words import in_cell, percent

__all__ = [
    "AUTHORED_METRICS",
    "CLIP_METRICS",
    "COLUMNS",
    "GROUP_METRICS",
    "HEADLINE",
    "METRICS",
    "Difference",
    "Metric",
    "Score",
    "difference_table",
    "differences",
    "markdown",
    "metric_named",
    "metrics_table",
    "overview",
    "paired",
    "rows",
    "table",
    "with_conditions",
    "write_csv",
]


@dataclass(frozen=True)
class Metric:
    """Title, unit and digits of a metric of :func:`plat.evaluation.report` and :func:`plat.evaluation.report_clips`.

    Attributes:
        title: in tables.
        unit: that tables and figures show.
        digits: that they show.
        higher_is_better: or lower.
        factor: from the SI unit of reports and CSV files to the unit shown.

    >>> METRICS["mpkpe"].text(0.0478), METRICS["tks"].text(99.97)
    ('48', '99.9')
    """

    title: str
    unit: str
    digits: int
    higher_is_better: bool = False
    factor: float = 1.0

    @property
    def heading(self) -> str:
        """Return the title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def text(self, value: "float | Estimate", sign: str = "") -> str:
        """Return a value in the unit of tables; an estimate with its interval; a dash for what was not measured.

        A percentage is rounded as by :func:`plat.words.percent`, but for one with a sign, which is a difference. An
        interval without a width, as of one motion, or without known ends says nothing of others and is left out.
        """
        if isinstance(value, Estimate):
            if math.isnan(value.value):
                return "-"
            if value.low == value.value == value.high or math.isnan(value.low) or math.isnan(value.high):
                return self._rounded(value.value, sign)
            middle, low, high = (self._rounded(part, sign) for part in (value.value, value.low, value.high))
            return f"{middle} ({low}-{high})"
        return "-" if math.isnan(value) else self._rounded(value, sign)

    def _rounded(self, value: float, sign: str) -> str:
        if self.unit == "%" and not sign:
            return percent(value, self.digits)
        return f"{self.factor * value:{sign}.{self.digits}f}"


METRICS = {
    "tks": Metric("TKS@3", "%", 1, higher_is_better=True),
    "mpjpe": Metric("MPJPE@3", "rad", 3),
    "mpkpe": Metric("MPKPE@3", "mm", 0, factor=1000),
    "mpkpe_root": Metric("MPKPE@3 in the root frame", "mm", 0, factor=1000),
    "mpjpe_all": Metric("MPJPE@3, all commands", "rad", 3),
    "mpkpe_all": Metric("MPKPE@3, all commands", "mm", 0, factor=1000),
    "mpkpe_root_all": Metric("MPKPE@3 in the root frame, all commands", "mm", 0, factor=1000),
    "success_area": Metric("area under the success curve", "%", 1, higher_is_better=True),
    "fall_rate": Metric("falls", "%", 1),
    "action_change": Metric("change of action", "", 3),
    "joint_jerk": Metric("joint jerk", "rad/s³", 0),
    "foot_slip": Metric("foot slip", "m/s", 3),
}
"""All metrics of commands, in the order of the tables."""
CLIP_METRICS = {
    "clip_success": Metric("success", "%", 1, higher_is_better=True),
    "clip_progress": Metric("frames before a failure", "%", 1, higher_is_better=True),
    "clip_mpjpe": Metric("MPJPE", "rad", 3),
    "clip_mpkpe": Metric("MPKPE", "mm", 0, factor=1000),
    "clip_mpkpe_root": Metric("MPKPE in the root frame", "mm", 0, factor=1000),
    "vel_dist": Metric("vel_dist", "mm/frame", 2, factor=1000),
    "accel_dist": Metric("accel_dist", "mm/frame²", 2, factor=1000),
}
"""All metrics of whole clips."""
AUTHORED_METRICS = {
    "reached": Metric("keyframes reached", "%", 1, higher_is_better=True),
    "fell": Metric("chains with a fall", "%", 1),
    "fell_in_hold": Metric("falls while holding", "%", 1),
    "stepped": Metric("steps while holding", "%", 1),
    "late_or_off": Metric("keyframes late or off", "%", 1),
    "reached_feasible": Metric("feasible keyframes reached", "%", 1, higher_is_better=True),
}
"""All metrics of authored keyframes."""
GROUP_METRICS = METRICS | CLIP_METRICS | AUTHORED_METRICS
"""All that a group can be scored by."""
HEADLINE = ("tks", "mpjpe", "mpkpe")
"""The three metrics of the paper."""


def metric_named(name: str, known: Mapping[str, Metric] = MappingProxyType(METRICS)) -> Metric:
    """Return a metric by its name in :data:`METRICS` or another table of them.

    Raises:
        RecordsError: for another name, with those that there are.

    >>> metric_named("tks").heading
    'TKS@3 (%)'
    """
    if not isinstance(name, str) or name not in known:
        raise RecordsError(f"metric {short(name)}: expected one of {', '.join(known)}")
    return known[name]


COLUMNS = ("policy", "horizon", "seeds", "metric", "value", "low", "high")
"""Of the table that :func:`rows` lists."""


@dataclass(frozen=True)
class Score:
    """Metrics of a policy at one horizon.

    Attributes:
        policy: its name in tables and figures.
        horizon: name of the horizon.
        records: the commands' records, one table a training seed.
        figures: their :func:`plat.evaluation.report`.
    """

    policy: str
    horizon: str
    records: tuple[CommandRecords, ...]
    figures: dict[str, Estimate]

    @classmethod
    def of(cls, policy: str, horizon: str, records: CommandRecords | Sequence[CommandRecords]) -> "Score":
        """Return the score of command records: of one table, or of one for each training seed."""
        runs = tuple(as_runs(records, CommandRecords))
        return cls(policy, horizon, runs, report(runs))


def rows(scores: Iterable[Score]) -> list[tuple[str, str, int, str, float, float, float]]:
    """Return one row for each policy, horizon and metric: training seeds, value and 95 % interval."""
    return [
        (score.policy, score.horizon, len(score.records), name, figure.value, figure.low, figure.high)
        for score in scores
        for name, figure in score.figures.items()
    ]


def write_csv(path: Path, scores: Iterable[Score], conditions: str = "") -> None:
    """Write :func:`rows` with six digits.

    Args:
        path: the file; it is replaced atomically or not at all.
        scores: the scores.
        conditions: what the test had of its own, in words: a last column. Without any there is no such column.
    """
    replace_table(path, *with_conditions(COLUMNS, rows(scores), conditions))


def with_conditions(
    columns: Sequence[str], found: Iterable[tuple[Any, ...]], conditions: str
) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
    """Return the columns and the rows of a table, with what its test had of its own in a last column, if anything.

    >>> with_conditions(("policy", "tks"), [("plat", 99.0)], "dense reference")
    (('policy', 'tks', 'conditions'), [('plat', 99.0, 'dense reference')])
    """
    told = (conditions,) if conditions else ()
    return (*columns, *("conditions" for _ in told)), [row + told for row in found]


def overview(scores: Sequence[Score]) -> str:
    """Return the headline metrics as a Markdown table, horizons side by side."""
    cells = {(score.policy, score.horizon): _headline(score) for score in scores}
    horizons = list(dict.fromkeys(score.horizon for score in scores))
    lines = [[" / ".join(METRICS[name].heading for name in HEADLINE), *horizons]]
    for policy in dict.fromkeys(score.policy for score in scores):
        lines.append([policy, *(cells.get((policy, horizon), "") for horizon in horizons)])
    return table(lines)


def markdown(scores: Sequence[Score]) -> str:
    """Return Markdown: headline metrics with horizons side by side, then all metrics, one table for each horizon."""
    parts = [overview(scores)]
    for horizon in dict.fromkeys(score.horizon for score in scores):
        parts.append(f"**{horizon}**\n\n{metrics_table([score for score in scores if score.horizon == horizon])}")
    return "\n\n".join(parts) + "\n"


def metrics_table(scores: Sequence[Score]) -> str:
    """Return all metrics of scores at one horizon as a Markdown table, policies side by side."""
    lines = [["", *(score.policy for score in scores)]]
    for name, metric in METRICS.items():
        lines.append([metric.heading, *(metric.text(score.figures[name]) for score in scores)])
    return table(lines)


@dataclass(frozen=True)
class Difference:
    """Paired difference of two policies at a horizon: ours minus theirs, see :func:`plat.evaluation.compare`."""

    ours: str
    policy: str
    horizon: str
    figures: Mapping[str, Estimate]


def paired(scores: Sequence[Score], ours: str) -> list[Difference]:
    """Return a policy's paired differences to each other one, at every horizon that it was scored at."""
    mine = {score.horizon: score for score in scores if score.policy == ours}
    return [
        Difference(ours, score.policy, score.horizon, compare(mine[score.horizon].records, score.records))
        for score in scores
        if score.policy != ours and score.horizon in mine
    ]


def difference_table(found: Sequence[Difference]) -> str:
    """Return paired differences as a Markdown table; empty without any.

    **Bold** where the interval excludes 0 and ours is the better one, *italic* where it is the worse.
    """
    if not found:
        return ""
    lines = [[f"{found[0].ours} minus", "horizon", *(METRICS[name].heading for name in HEADLINE)]]
    for difference in found:
        cells = (_difference(difference.figures[name], METRICS[name]) for name in HEADLINE)
        lines.append([difference.policy, difference.horizon, *cells])
    return table(lines) + "\n"


def differences(scores: Sequence[Score], ours: str) -> str:
    """Return :func:`difference_table` of :func:`paired`; empty where there are no scores of ``ours``."""
    return difference_table(paired(scores, ours))


def _difference(figure: Estimate, metric: Metric) -> str:
    value, low, high = (metric.text(part, "+") for part in (figure.value, figure.low, figure.high))
    text = f"{value} ({low} to {high})"
    if not figure.beyond_chance:
        return text
    return f"**{text}**" if (figure.value > 0) == metric.higher_is_better else f"*{text}*"


def _headline(score: Score) -> str:
    return " / ".join(METRICS[name].text(score.figures[name].value) for name in HEADLINE)


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows of cells as a Markdown table, without a line break at its end; the first row is its head."""
    head, *body = (f"| {' | '.join(map(in_cell, row))} |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])
