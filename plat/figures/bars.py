"""Bar plot of an ablation with confidence intervals."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plat.bounds import as_names
from plat.errors import RecordsError
from plat.evaluation.score_table import HEADLINE, Score, metric_named
from plat.figures.style import PAGE, looks, paper_style, policies

__all__ = ["ablation_bars"]


def ablation_bars(scores: Sequence[Score], horizon: str, metrics: Sequence[str] = HEADLINE) -> Any:
    """Return a figure with one panel for each metric: bars from zero with values and 95 % intervals.

    Args:
        scores: of any policies.
        horizon: which of their horizons.
        metrics: names in :data:`plat.evaluation.METRICS`.

    Raises:
        RecordsError: when no policy was scored at the horizon, and for another metric, or none.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    rows = [score for score in scores if score.horizon == horizon]
    if not rows:
        raise RecordsError(
            f"bars: no score at horizon {horizon!r}, expected one of {sorted({s.horizon for s in scores})}"
        )
    drawn = looks(policies(scores))
    places = np.arange(len(rows))
    metrics = as_names(metrics)
    shown = {name: metric_named(name) for name in metrics}
    if not shown:
        raise RecordsError("bars: no metrics, expected at least one")
    with paper_style() as plt:
        size = (PAGE, 0.45 + 0.19 * len(rows))
        figure, panels = plt.subplots(1, len(metrics), figsize=size, sharey=True, squeeze=False)
        for panel, key in zip(panels[0], metrics, strict=True):
            metric, figures = shown[key], [row.figures[key] for row in rows]
            values = metric.factor * np.array([figure.value for figure in figures])
            spread = metric.factor * np.array([[f.value - f.low for f in figures], [f.high - f.value for f in figures]])
            colors = [drawn[row.policy].color for row in rows]
            # a mean of ratios may lie outside its percentile interval by a hair
            panel.barh(places, values, 0.72, color=colors, alpha=0.85, xerr=spread.clip(0), **_ERROR_BARS)
            highs = [100.0 if metric.unit == "%" else 0.0, *(metric.factor * figure.high for figure in figures)]
            top = np.nanmax(highs) or 1.0  # where every command failed there are no errors
            for place, figure_ in zip(places, figures, strict=True):
                panel.text(1.04 * top, place, metric.text(figure_.value), va="center", fontsize=7)
            panel.set_xlim(0, 1.02 * top)
            panel.set_title(f"{metric.heading} {'↑' if metric.higher_is_better else '↓'}", pad=3)
            panel.grid(axis="x")
            panel.set_axisbelow(True)
            panel.tick_params(axis="y", length=0)
        panels[0][0].set_yticks(places, [row.policy for row in rows])
        panels[0][0].invert_yaxis()
    return figure


_ERROR_BARS = {"ecolor": "0.15", "error_kw": {"elinewidth": 0.8, "capsize": 1.8, "capthick": 0.8}}
