"""Success rate against the threshold on keypoint error."""

from collections.abc import Sequence
from typing import Any

from plat.bounds import as_names
from plat.errors import RecordsError
from plat.evaluation.report import success_curve
from plat.evaluation.score_table import Score
from plat.figures.style import COLUMN, PAGE, in_legend, looks, paper_style, policies

__all__ = ["success_plot"]

_SHORT = 20  # letters of a policy's name


def success_plot(scores: Sequence[Score], horizons: Sequence[str]) -> Any:
    """Return a figure of success rates with one panel for each horizon.

    A curve is the fraction of commands whose world keypoint error at arrival is at most x mm.

    The legend gives the area under each curve (% of the whole).

    Args:
        scores: of any policies.
        horizons: which of their horizons.

    Raises:
        RecordsError: without horizons, or when no policy was scored at one of them.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    there = sorted({score.horizon for score in scores})
    horizons = as_names(horizons)
    if not horizons or not set(horizons) <= set(there):
        raise RecordsError(f"success plot: horizons {list(horizons)}, expected one or more of {there}")
    drawn = looks(policies(scores))
    # two columns of longer names are wider than a panel, which would shrink for them
    columns = 2 if max(map(len, drawn)) <= _SHORT else 1
    with paper_style() as plt:
        width = COLUMN if len(horizons) == 1 else PAGE / 2 * len(horizons)
        figure, panels = plt.subplots(
            1, len(horizons), figsize=(width, 2.4 + 0.15 * len(drawn) / columns), sharey=True, squeeze=False
        )
        for panel, horizon in zip(panels[0], horizons, strict=True):
            for score in (score for score in scores if score.horizon == horizon):
                meters, share = (part.numpy() for part in success_curve(score.records, points=251))
                look, area = drawn[score.policy], score.figures["success_area"].value
                label = f"{in_legend(score.policy)} ({area:.1f})"
                panel.plot(1000 * meters, 100 * share, look.dashes, color=look.color, linewidth=look.width, label=label)
            panel.set(xlim=(0, 1000 * meters[-1]), ylim=(0, 101), xlabel="world keypoint error at arrival (mm)")
            panel.set_title(horizon.capitalize(), pad=3)
            panel.grid()
            panel.legend(
                loc="upper center",
                bbox_to_anchor=(0.5, -0.2),
                ncols=columns,
                handlelength=2.0,
                columnspacing=0.8,
                fontsize=6,
            )
        panels[0][0].set_ylabel("commands (%)")
    return figure
