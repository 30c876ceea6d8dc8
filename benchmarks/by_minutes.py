"""Figure of what was learned after how many minutes, from tables such as ``benchmarks/roads.py`` writes.

python benchmarks/by_minutes.py benchmarks/roads.csv --metrics tks --out docs/images/roads

A panel for each test, horizon and metric; a line for each road, from the least to the greatest of its seeds.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from plat.bounds import Bounded, Count
from plat.errors import RecordsError
from plat.evaluation.score_table import METRICS
from plat.figures.style import PAGE, Look, looks, paper_style, save_figure
from plat.runs import report_errors


@dataclass(kw_only=True)
class ByMinutesConfig(Bounded):
    """Settings of the figure of what was learned after how many minutes."""

    tables: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """tables with the columns test, horizon, road, metric, minutes, mean, low, high"""
    out: Path
    """figure to write, without its ending"""
    metrics: tuple[str, ...] = ()
    """metrics to draw; none for all that there are"""
    across: Count = 3
    """panels beside each other"""


@dataclass(frozen=True)
class Point:
    """Result of a road after some minutes: mean, least and greatest of its seeds, in the unit that is shown."""

    panel: tuple[str, str]
    road: str
    minutes: float
    mean: float
    low: float
    high: float


def read(tables: Sequence[Path], metrics: Sequence[str] = ()) -> list[Point]:
    """Return the points of tables, in their order.

    Raises:
        RecordsError: for a table that has not all columns or no rows of the metrics, naming it.
    """
    points = []
    for path in tables:
        try:
            with path.open(newline="") as file:
                rows = [row for row in csv.DictReader(file) if not metrics or row["metric"] in metrics]
            points += [_point(row) for row in rows]
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise RecordsError(f"{str(path)!r}: not a table of results by minutes ({error!r})") from error
        if not rows:
            raise RecordsError(f"{str(path)!r}: no rows of {', '.join(metrics) or 'any metric'}")
    return points


def _point(row: dict[str, str]) -> Point:
    known = METRICS.get(row["metric"])
    heading, factor = (row["metric"], 1.0) if known is None else (known.heading, known.factor)
    mean, low, high = (factor * float(row[name]) for name in ("mean", "low", "high"))
    return Point((f"{row['test']}, {row['horizon']}", heading), row["road"], float(row["minutes"]), mean, low, high)


def by_minutes(points: Sequence[Point], across: int = 3) -> Any:
    """Return a figure with one panel for each test, horizon and metric, and one line for each road.

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    panels: dict[tuple[str, str], dict[str, list[Point]]] = {}
    for point in sorted(points, key=lambda point: point.minutes):
        panels.setdefault(point.panel, {}).setdefault(point.road, []).append(point)
    order = list(dict.fromkeys(point.panel for point in points))
    drawn = looks(list(dict.fromkeys(point.road for point in points)))
    across = min(across, len(order))
    down = -(-len(order) // across)
    with paper_style() as plt:
        figure, axes = plt.subplots(down, across, figsize=(PAGE, 0.4 + 1.9 * down), squeeze=False)
        handles: dict[str, Any] = {}
        for panel, axis in zip(order, axes.flat, strict=False):
            of_road = panels[panel]
            handles |= {road: _line(axis, of_road[road], look) for road, look in drawn.items() if road in of_road}
            title, heading = panel
            axis.set(title=title, xlabel="minutes", ylabel=heading, xlim=(0, None))
            if "%" not in heading:
                axis.set_ylim(0, None)  # of an error or a count, a part would look like more than it is
            axis.grid(True)
        for axis in axes.flat[len(order) :]:
            axis.remove()
        figure.legend([handles[road] for road in drawn], list(drawn), loc="outside lower center", ncols=2)
    return figure


def _line(axis: Any, points: Sequence[Point], look: Look) -> Any:
    return axis.errorbar(
        [point.minutes for point in points],
        [point.mean for point in points],
        [[point.mean - point.low for point in points], [point.high - point.mean for point in points]],
        color=look.color,
        marker=look.marker,
        linestyle=look.dashes,
        linewidth=look.width,
        markersize=3.5,
        capsize=1.8,
    )


def main(config: ByMinutesConfig) -> list[Path]:
    """Draw the figure; return its files."""
    written = save_figure(by_minutes(read(config.tables, config.metrics), config.across), config.out)
    print("\n".join(map(str, written)))
    return written


if __name__ == "__main__":
    with report_errors():
        main(tyro.cli(ByMinutesConfig, description=__doc__))
