"""Plot of paired differences between policies."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plat.bounds import as_names
from plat.errors import RecordsError
from plat.evaluation.report import compare
from plat.evaluation.score_table import HEADLINE, METRICS, Score
from plat.figures.style import PAGE, looks, paper_style, policies

__all__ = ["difference_plot"]


def difference_plot(scores: Sequence[Score], ours: str, horizons: Sequence[str] = ("long", "mixed")) -> Any:
    """Return a figure of a policy's paired differences to each other one, with 95 % intervals, a panel per metric.

    Filled markers are beyond chance: their interval leaves out 0. Panels are turned so that a point to the right of 0
    is in favor of ``ours``.

    Args:
        scores: of any policies.
        ours: the policy that the others are subtracted from.
        horizons: which of the horizons; those that there are.

    Raises:
        RecordsError: when there is nothing to compare.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    mine = {score.horizon: score for score in scores if score.policy == ours}
    horizons = as_names(horizons)
    others = [score for score in scores if score.policy != ours and score.horizon in horizons and score.horizon in mine]
    if not others:
        raise RecordsError(f"plot of differences: no policy beside {ours!r} at the horizons {list(horizons)}")
    drawn = looks(policies(scores))
    labels = [f"{score.policy}, {score.horizon}" for score in others]
    figures = [compare(mine[score.horizon].records, score.records) for score in others]
    with paper_style() as plt:
        size = (PAGE, 0.6 + 0.19 * len(others))
        figure, panels = plt.subplots(1, len(HEADLINE), figsize=size, sharey=True, squeeze=False)
        for panel, name in zip(panels[0], HEADLINE, strict=True):
            metric = METRICS[name]
            for place, (score, found) in enumerate(zip(others, figures, strict=True)):
                value, low, high = metric.factor * np.array([found[name].value, found[name].low, found[name].high])
                look = drawn[score.policy]
                panel.plot([low, high], [place, place], color=look.color, linewidth=1.0)
                face = look.color if found[name].beyond_chance else "white"
                panel.plot(value, place, "o", color=look.color, markerfacecolor=face, markersize=3.5)
            panel.axvline(0, color="0.4", linewidth=0.6)
            panel.set_title(metric.heading, pad=3)
            if not metric.higher_is_better:
                panel.invert_xaxis()
            panel.grid(axis="x")
        panels[0][0].set_yticks(range(len(labels)), labels)
        panels[0][0].set_ylim(len(labels) - 0.5, -0.5)
        panels[0][len(HEADLINE) // 2].set_xlabel(f"{ours} minus each: to the right of 0 it is the better one")
    return figure
