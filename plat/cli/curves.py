"""Draw the learning curves of runs, from their metrics.csv.

plat curves runs/expert --metrics terminations_per_second value_loss --out curves.png
"""

import csv
from collections.abc import Sequence
from pathlib import Path

from plat.cli.options import CurvesRecipe
from plat.errors import PlatError
from plat.figures import pyplot, write_figure
from plat.figures.style import in_legend
from plat.files import check_file
from plat.json_file import short

DEFAULTS = (
    "terminations_per_second",
    "failures_per_second",
    "error/keypoint_aligned",
    "simulated_cost",
    "prior_error",
    "error",
)
"""Columns that say how a run goes; those that it has are drawn when none is named."""


def read(run: Path, metric: str) -> tuple[list[float], list[float]]:
    """Return minutes of training and values of a metric."""
    rows = _rows(run)
    try:
        values = [(float(row["seconds"]) / 60, float(row[metric])) for row in rows if row.get(metric)]
    except (KeyError, TypeError, ValueError) as error:
        raise _damaged(run, error) from None
    if not values:
        raise PlatError(f"{_file(run)}: no values in a column {metric!r}, expected {_choice(rows)}")
    return [minutes for minutes, _ in values], [value for _, value in values]


def shown_by_default(runs: Sequence[Path]) -> dict[str, list[Path]]:
    """Return the columns of :data:`DEFAULTS` that there are, each with the runs that have it."""
    having: dict[str, list[Path]] = {metric: [] for metric in DEFAULTS}
    for run in runs:
        rows = _rows(run)
        shown = [metric for metric in DEFAULTS if metric in _columns(rows)]
        if not shown:
            raise PlatError(f"{_file(run)}: which columns? Expected --metrics with {_choice(rows)}")
        for metric in shown:
            having[metric].append(run)
    return {metric: others for metric, others in having.items() if others}


def _rows(run: Path) -> list[dict[str, str]]:
    path = run / "metrics.csv"
    if not path.exists():
        raise PlatError(f"{_file(run)}: no such file, expected the metrics of a run")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))
    except (OSError, ValueError, csv.Error) as error:
        raise _damaged(run, error) from None


def _columns(rows: Sequence[dict[str, str]]) -> list[str]:
    """Return the names of the columns with values, apart from that of the time."""
    names = dict.fromkeys(name for row in rows for name, cell in row.items() if name and cell)
    return [name for name in names if name != "seconds"]


def _choice(rows: Sequence[dict[str, str]]) -> str:
    return f"some of {', '.join(_columns(rows))}" if _columns(rows) else "a run with rows"


def _file(run: Path) -> str:
    return repr(str(run / "metrics.csv"))


def _damaged(run: Path, error: Exception) -> PlatError:
    return PlatError(f"{_file(run)}: not the metrics of a run ({short(error)})")


def main(recipe: CurvesRecipe) -> None:
    """Run the recipe."""
    if not recipe.runs:
        raise PlatError("no runs: give run directories, as in plat curves runs/expert")
    check_file(recipe.out, suffixes=(".png", ".pdf", ".svg"))
    runs = list({run.resolve(): run for run in recipe.runs}.values())  # each once, as in plat evaluate
    shown = dict.fromkeys(recipe.metrics, runs) or shown_by_default(runs)
    names = [run.name for run in runs]
    figure, panels = pyplot().subplots(1, len(shown), figsize=(4.5 * len(shown), 3.2), squeeze=False)
    for panel, (metric, having) in zip(panels[0], shown.items(), strict=True):
        for run in having:
            minutes, values = read(run, metric)
            width = recipe.smooth
            smooth = [sum(values[max(0, i - width + 1) : i + 1]) / min(i + 1, width) for i in range(len(values))]
            panel.plot(minutes, smooth, label=in_legend(run.name if names.count(run.name) == 1 else str(run)))
        panel.set(xlabel="minutes", title=metric.replace("_", " "))
        if min(min(line.get_ydata()) for line in panel.lines) >= 0:
            panel.set_ylim(0, None)
        panel.grid(alpha=0.3)
        for text in panel.legend(frameon=False).get_texts():
            text.set_parse_math(False)  # a name is no formula
    figure.tight_layout()
    recipe.out.parent.mkdir(parents=True, exist_ok=True)
    write_figure(figure, recipe.out, dpi=130)
    print(f"wrote {recipe.out}")
