"""Scores of several policies as tables."""

import csv
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from plat.evaluation.records import CommandRecords
from plat.evaluation.report import Estimate, compare, report
from plat.files import replace_file

__all__ = [
    "CLIP_METRICS",
    "COLUMNS",
    "HEADLINE",
    "METRICS",
    "Metric",
    "Score",
    "differences",
    "markdown",
    "rows",
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

    >>> METRICS["mpkpe"].text(0.0478)
    '48'
    """

    title: str
    unit: str
    digits: int
    higher_is_better: bool = False
    factor: float = 1.0

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def text(self, value: "float | Estimate", sign: str = "") -> str:
        """Return a value in the unit of tables; an estimate with its interval; a dash for what was not measured."""
        if math.isnan(value.value if isinstance(value, Estimate) else value):
            return "-"
        if isinstance(value, Estimate):
            value = Estimate(*(self.factor * part for part in (value.value, value.low, value.high)))
        else:
            value = self.factor * value
        return f"{value:{sign}.{self.digits}f}"


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
HEADLINE = ("tks", "mpjpe", "mpkpe")
"""The three metrics of the paper."""
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
    def of(cls, policy: str, horizon: str, records: Sequence[CommandRecords]) -> "Score":
        """Return the score of command records."""
        return cls(policy, horizon, tuple(records), report(records))


def rows(scores: Iterable[Score]) -> list[tuple[str, str, int, str, float, float, float]]:
    """Return one row for each policy, horizon and metric: training seeds, value and 95 % interval."""
    return [
        (score.policy, score.horizon, len(score.records), name, figure.value, figure.low, figure.high)
        for score in scores
        for name, figure in score.figures.items()
    ]


def write_csv(path: Path, scores: Iterable[Score]) -> None:
    """Write :func:`rows` with six digits."""
    lines = [[f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows(scores)]

    def write(part: Path) -> None:
        with part.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(lines)

    replace_file(path, write)


def markdown(scores: Sequence[Score]) -> str:
    """Return Markdown: headline metrics with horizons side by side, then all metrics, one table for each horizon."""
    cells = {(score.policy, score.horizon): _headline(score) for score in scores}
    horizons = list(dict.fromkeys(score.horizon for score in scores))
    overview = [[" / ".join(METRICS[name].heading for name in HEADLINE), *horizons]]
    for policy in dict.fromkeys(score.policy for score in scores):
        overview.append([policy, *(cells.get((policy, horizon), "") for horizon in horizons)])
    parts = [_table(overview)]
    for horizon in horizons:
        columns = [score for score in scores if score.horizon == horizon]
        rows = [["", *(score.policy for score in columns)]]
        for name, metric in METRICS.items():
            rows.append([metric.heading, *(metric.text(score.figures[name]) for score in columns)])
        parts.append(f"**{horizon}**\n\n{_table(rows)}")
    return "\n\n".join(parts) + "\n"


def differences(scores: Sequence[Score], ours: str) -> str:
    """Return a Markdown table of a policy's paired differences to each other one, see :func:`plat.evaluation.compare`.

    Ours minus theirs, with the interval of the difference; **bold** where that excludes 0 and ours is the better one,
    *italic* where it is the worse. Empty where there are no scores of ``ours``.
    """
    mine = {score.horizon: score for score in scores if score.policy == ours}
    others = [score for score in scores if score.policy != ours and score.horizon in mine]
    if not others:
        return ""
    lines = [[f"{ours} minus", "horizon", *(METRICS[name].heading for name in HEADLINE)]]
    for score in others:
        figures = compare(mine[score.horizon].records, score.records)
        cells = (_difference(figures[name], METRICS[name]) for name in HEADLINE)
        lines.append([score.policy, score.horizon, *cells])
    return _table(lines) + "\n"


def _difference(figure: Estimate, metric: Metric) -> str:
    value, low, high = (metric.text(part, "+") for part in (figure.value, figure.low, figure.high))
    text = f"{value} ({low} to {high})"
    if figure.low <= 0 <= figure.high:
        return text
    return f"**{text}**" if (figure.value > 0) == metric.higher_is_better else f"*{text}*"


def _headline(score: Score) -> str:
    return " / ".join(METRICS[name].text(score.figures[name].value) for name in HEADLINE)


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])
