"""Plot of a metric by groups: families of motion, or bins of difficulty."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from plat.errors import RecordsError
from plat.evaluation.groups import GroupScore, metric_of
from plat.figures.style import PAGE, in_legend, looks, paper_style

__all__ = ["group_plot"]

_LETTERS = 110  # of names that stand side by side under a page's width


def group_plot(scores: Sequence[GroupScore], metric: str = "tks") -> Any:
    """Return a figure with a column per group: a point per policy, with its 95 % interval.

    Args:
        scores: of any policies.
        metric: name in :data:`plat.evaluation.METRICS`, :data:`plat.evaluation.CLIP_METRICS` or those of authored
            keyframes.

    Raises:
        RecordsError: without scores, and for another metric.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    if not scores:
        raise RecordsError("plot by groups: no scores, expected at least one")
    shown = metric_of(scores, metric)
    groups = {score.group: score.count for score in scores}
    drawn = looks(list(dict.fromkeys(score.policy for score in scores)))
    with paper_style() as plt:
        figure, panel = plt.subplots(figsize=(PAGE, 2.3 + 0.06 * len(drawn)))
        width = 0.8 / len(drawn)
        for number, (name, look) in enumerate(drawn.items()):
            found = {score.group: score.figures[metric] for score in scores if score.policy == name}
            places = [place for place, group in enumerate(groups) if group in found]
            figures = [found[group] for group in groups if group in found]
            values = shown.factor * np.array([figure.value for figure in figures])
            spread = shown.factor * np.array(
                [[one.value - one.low for one in figures], [one.high - one.value for one in figures]]
            )
            panel.errorbar(
                np.array(places) + (number + 0.5) * width - 0.4,
                values,
                spread.clip(0),
                fmt=look.marker,
                color=look.color,
                markersize=3.5,
                elinewidth=0.8,
                capsize=1.5,
                label=in_legend(name),
            )
        turned = len(groups) * max(map(len, groups)) > _LETTERS
        between = " " if turned else "\n"
        ticks = [f"{group.replace('_', ' ')}{between}({count})" for group, count in groups.items()]
        panel.set_xticks(range(len(groups)), ticks, **({"rotation": 40, "ha": "right"} if turned else {}))
        panel.set_xlim(-0.5, len(groups) - 0.5)
        panel.set_ylabel(shown.heading)
        panel.grid(axis="y")
        figure.legend(loc="outside lower center", ncols=4)
    return figure
