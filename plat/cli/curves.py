"""Draw the learning curves of runs, from their metrics.csv.

plat curves runs/expert --metrics terminations_per_second error/keypoint_aligned --out curves.png
"""

import csv
from pathlib import Path

from plat.cli.options import CurvesRecipe
from plat.errors import PlatError
from plat.figures import pyplot, write_figure
from plat.files import check_file
from plat.json_file import short


def read(run: Path, metric: str) -> tuple[list[float], list[float]]:
    """Minutes of training and values of a metric."""
    path = run / "metrics.csv"
    if not path.exists():
        raise PlatError(f"{str(path)!r}: no such file, expected the metrics of a run")
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.DictReader(file) if row.get(metric)]
        values = [(float(row["seconds"]) / 60, float(row[metric])) for row in rows]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise PlatError(f"{str(path)!r}: not the metrics of a run ({short(error)})") from None
    if not values:
        raise PlatError(f"{str(path)!r}: no values in a column {metric!r}")
    return [minutes for minutes, _ in values], [value for _, value in values]


def main(recipe: CurvesRecipe) -> None:
    """Run the recipe."""
    if not recipe.runs:
        raise PlatError("no runs: give run directories, as in plat curves runs/expert")
    if not recipe.metrics:
        raise PlatError("no metrics: give columns of metrics.csv, as in --metrics reward_per_second")
    check_file(recipe.out, suffixes=(".png", ".pdf", ".svg"))
    size = (4.5 * len(recipe.metrics), 3.2)
    figure, panels = pyplot().subplots(1, len(recipe.metrics), figsize=size, squeeze=False)
    for panel, metric in zip(panels[0], recipe.metrics, strict=True):
        for run in recipe.runs:
            minutes, values = read(run, metric)
            width = recipe.smooth
            smooth = [sum(values[max(0, i - width + 1) : i + 1]) / min(i + 1, width) for i in range(len(values))]
            panel.plot(minutes, smooth, label=run.name)
        panel.set(xlabel="minutes", title=metric.replace("_", " "), ylim=(0, None))
        panel.grid(alpha=0.3)
    panels[0][0].legend(frameon=False)
    figure.tight_layout()
    recipe.out.parent.mkdir(parents=True, exist_ok=True)
    write_figure(figure, recipe.out, dpi=130)
    print(f"wrote {recipe.out}")
