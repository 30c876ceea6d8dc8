"""Radar plot of the paper: one axis per horizon, one outline per policy."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from plat.errors import RecordsError
from plat.evaluation.score_table import HEADLINE, METRICS, Score
from plat.figures.style import PAGE, looks, paper_style, policies

__all__ = ["radar_plot"]


def radar_plot(scores: Sequence[Score], metrics: Sequence[str] = HEADLINE) -> Any:
    """Return a figure with one radar for each metric. Outward is better on each, so errors fall toward the rim.

    Args:
        scores: of any policies at three horizons or more; a policy that lacks a horizon is left out.
        metrics: names in :data:`plat.evaluation.METRICS`.

    Raises:
        RecordsError: for fewer than three horizons.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    horizons = list(dict.fromkeys(score.horizon for score in scores))
    if len(horizons) < 3:
        raise RecordsError(f"radar plot: horizons {horizons}, expected three or more")
    cells = {(score.policy, score.horizon): score for score in scores}
    names = [name for name in policies(scores) if all((name, horizon) in cells for horizon in horizons)]
    drawn = looks(policies(scores))
    angles = np.linspace(0, 2 * np.pi, len(horizons), endpoint=False)
    with paper_style() as plt:
        size = (PAGE / 3 * len(metrics), PAGE / 3 + 0.25)
        figure, panels = plt.subplots(1, len(metrics), figsize=size, subplot_kw={"projection": "polar"}, squeeze=False)
        for panel, metric in zip(panels[0], metrics, strict=True):
            factor = METRICS[metric].factor
            values = {
                name: [factor * cells[name, horizon].figures[metric].value for horizon in horizons] for name in names
            }
            worst, best, ticks = _range([value for row in values.values() for value in row], metric)
            for name, row in values.items():
                look = drawn[name]
                closed = [*row, row[0]]
                panel.plot(
                    [*angles, angles[0]],
                    closed,
                    look.dashes,
                    color=look.color,
                    linewidth=look.width,
                    marker=look.marker,
                    markersize=3,
                    label=name,
                    clip_on=False,
                )
            panel.set_theta_zero_location("N")
            panel.set_theta_direction(-1)
            panel.set_ylim(worst, best)
            panel.set_yticks(ticks, [""] * len(ticks))
            for tick in ticks:  # over the outlines, where matplotlib's own labels would be under them
                text = f"{tick:.4g}"
                panel.text(np.pi / len(horizons), tick, text, ha="center", va="center", zorder=5, **_RING_LABEL)
            panel.set_xticks(angles)
            panel.set_xticklabels([horizon.capitalize() for horizon in horizons])
            panel.tick_params(axis="x", pad=1)
            panel.spines["polar"].set_color("0.75")
            panel.set_title(METRICS[metric].heading, pad=8)
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, handlelength=2.4, columnspacing=1.2)
    return figure


_RING_LABEL: dict[str, Any] = {
    "fontsize": 6,
    "bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4},
}


def _range(values: Sequence[float], metric: str) -> tuple[float, float, list[float]]:
    """Return the values at center and rim, and the rings: round numbers around the values, none below 0."""
    finite = [value for value in values if math.isfinite(value)] or [0.0]
    low, high = min(finite), max(finite)
    spread = max(high - low, 10.0 ** -METRICS[metric].digits)
    power = 10.0 ** math.floor(math.log10(spread / 2))
    step = next(power * factor for factor in (1, 2, 5, 10) if spread <= 3 * power * factor)
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    rings = [ring * step for ring in range(first, last + 1)]
    # a ring's width beyond the worst value, so that no outline shrinks to a point
    if METRICS[metric].higher_is_better:
        return max(rings[0] - step, 0.0), rings[-1], [ring for ring in rings if ring > 0]
    return rings[-1] + step, rings[0], rings
