"""Plot of robustness: success against the strength of disturbances."""

from collections.abc import Sequence
from typing import Any

from plat.errors import RecordsError
from plat.evaluation.disturbance import STRENGTHS
from plat.evaluation.study import CurvePoint
from plat.figures.style import PAGE, in_legend, looks, paper_style

__all__ = ["robustness_plot"]

_SPAN = 5.0  # percent
_BANDS = 3  # policies: bands of more hide each other


def robustness_plot(points: Sequence[CurvePoint]) -> Any:
    """Return a figure with one panel for each disturbance: TKS@3 against its strength, a line per policy.

    Bands are 95 % intervals; of more than three policies, that of the first one alone. Friction falls from left to
    right, so that every disturbance grows to the right. The scale of each panel begins at its worst value, and spans
    5 % at least.

    Args:
        points: of any policies.

    Raises:
        RecordsError: without points.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    if not points:
        raise RecordsError("plot of robustness: no points, expected at least one")
    names = list(dict.fromkeys(point.disturbance for point in points))
    drawn = looks(list(dict.fromkeys(point.policy for point in points)))
    banded = list(drawn)[: None if len(drawn) <= _BANDS else 1]
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    with paper_style() as plt:
        size = (PAGE / 3 * columns, 1.8 * rows + 0.5)
        figure, panels = plt.subplots(rows, columns, figsize=size, squeeze=False)
        for panel in panels.flat[len(names) :]:
            panel.set_axis_off()
        for panel, name in zip(panels.flat, names, strict=False):
            strength = STRENGTHS[name]
            for policy, look in drawn.items():
                curve = [point for point in points if point.policy == policy and point.disturbance == name]
                curve.sort(key=lambda point: strength.values.index(point.strength))
                places = [point.strength for point in curve]
                panel.plot(
                    places,
                    [point.tks.value for point in curve],
                    look.dashes,
                    color=look.color,
                    linewidth=look.width,
                    marker=look.marker,
                    markersize=3,
                    label=in_legend(policy),
                )
                if policy in banded:
                    low, high = ([getattr(point.tks, end) for point in curve] for end in ("low", "high"))
                    panel.fill_between(places, low, high, color=look.color, alpha=0.12, linewidth=0)
            if strength.values[0] > strength.values[-1]:
                panel.invert_xaxis()
            worst = min(
                point.tks.low if point.policy in banded else point.tks.value
                for point in points
                if point.disturbance == name
            )
            span = max(100.0 - worst, _SPAN)
            panel.set_ylim(100.0 - 1.05 * span, 100.0 + 0.05 * span)
            panel.set_xlabel(f"{name} ({strength.unit})")
            panel.grid()
        for row in panels:
            row[0].set_ylabel("TKS@3 (%)")
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, handlelength=2.4)
    return figure
