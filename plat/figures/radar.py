"""Radar plot of the paper: one axis per horizon, one outline per policy."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from plat.bounds import as_names
from plat.errors import RecordsError
from plat.evaluation.score_table import HEADLINE, METRICS, Score, metric_named
from plat.figures.style import PAGE, in_legend, looks, paper_style, policies

__all__ = ["radar_plot"]


def radar_plot(scores: Sequence[Score], metrics: Sequence[str] = HEADLINE) -> Any:
    """Return a figure with one radar for each metric. Outward is better on each, so errors fall toward the rim.

    Where errors, or what is missing to 100 %, differ by more than a factor of five, the scale is logarithmic: rows that
    are good stay apart, and rows that are bad stay in the picture.

    Args:
        scores: of any policies at three horizons or more; a policy that lacks a horizon is left out.
        metrics: names in :data:`plat.evaluation.METRICS`.

    Raises:
        RecordsError: for fewer than three horizons, when every policy lacks one, and for another metric, or none.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    horizons = list(dict.fromkeys(score.horizon for score in scores))
    if len(horizons) < 3:
        raise RecordsError(f"radar plot: horizons {horizons}, expected three or more")
    cells = {(score.policy, score.horizon): score for score in scores}
    names = [name for name in policies(scores) if all((name, horizon) in cells for horizon in horizons)]
    if not names:
        raise RecordsError(f"radar plot: no policy was scored at all of {horizons}, expected at least one")
    drawn = looks(policies(scores))
    angles = np.linspace(0, 2 * np.pi, len(horizons), endpoint=False)
    metrics = as_names(metrics)
    if not [metric_named(name) for name in metrics]:
        raise RecordsError("radar plot: no metrics, expected at least one")
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
                    label=in_legend(name),
                    clip_on=False,
                )
            panel.set_theta_zero_location("N")
            panel.set_theta_direction(-1)
            if spread_out([value for row in values.values() for value in row], metric):
                worst, best, ticks = _log_range([value for row in values.values() for value in row], metric)
                panel.set_yscale("function", functions=_shortfall_scale(metric))
            panel.set_ylim(worst, best)
            panel.set_yticks(ticks, [""] * len(ticks))
            for tick in ticks:  # over the outlines, where matplotlib's own labels would be under them
                text = f"{tick:.4g}"
                panel.text(np.pi / len(horizons), tick, text, ha="center", va="center", zorder=5, **_RING_LABEL)
            panel.set_xticks(angles)
            panel.set_xticklabels([horizon.capitalize() for horizon in horizons])
            panel.tick_params(axis="x", pad=1)
            for angle, label in zip(angles, panel.get_xticklabels(), strict=True):
                side = round(math.sin(angle), 6)  # beside the rim, and not across it
                label.set_horizontalalignment("center" if side == 0 else "left" if side > 0 else "right")
            panel.spines["polar"].set_color("0.75")
            panel.set_title(METRICS[metric].heading, pad=8)
        handles, labels = panels[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, handlelength=2.4, columnspacing=1.2)
    return figure


_RING_LABEL: dict[str, Any] = {
    "fontsize": 6,
    "bbox": {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4},
}


_SPREAD = 5.0  # factor between errors from which the scale is logarithmic
_LEAST = {"%": 0.1}  # shortfall (%) at which the logarithmic scale ends; of errors it is the smallest value


def _shortfall(value: Any, metric: str) -> Any:
    """Return an error as it is, and what is missing to 100 of a percentage."""
    return 100.0 - value if METRICS[metric].higher_is_better else value


def spread_out(values: Sequence[float], metric: str) -> bool:
    """Return whether errors, or what is missing to 100 %, differ by more than a factor of five.

    >>> spread_out([99.9, 99.0], "tks"), spread_out([95.0, 93.0], "tks"), spread_out([50.0, 900.0], "mpkpe")
    (True, False, True)
    """
    found = [_shortfall(value, metric) for value in values if math.isfinite(value)]
    least = max(min(found, default=1.0), _LEAST.get(METRICS[metric].unit, 1e-6))
    return max(found, default=1.0) > _SPREAD * least


def _shortfall_scale(metric: str) -> tuple[Any, Any]:
    """Return the functions to and from a logarithmic scale of :func:`_shortfall`, which grows with the metric."""
    sign = -1.0 if METRICS[metric].higher_is_better else 1.0
    least = _LEAST.get(METRICS[metric].unit, 1e-6)

    def forward(value: Any) -> Any:
        return sign * np.log10(np.maximum(_shortfall(np.asarray(value, float), metric), least))

    def backward(scaled: Any) -> Any:
        return _shortfall(10.0 ** (sign * np.asarray(scaled, float)), metric)

    return forward, backward


def _log_range(values: Sequence[float], metric: str) -> tuple[float, float, list[float]]:
    """Return the values at center and rim, and the rings: shortfalls of 1, 2 or 5 times a power of ten."""
    least = _LEAST.get(METRICS[metric].unit, 1e-6)
    found = [max(_shortfall(value, metric), least) for value in values if math.isfinite(value)]
    low, high = min(found), 1.3 * max(found)
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    round_numbers = [factor * 10.0**power for power in powers for factor in (1, 2, 5)]
    inside = [number for number in round_numbers if low * 0.999 <= number <= high]
    rings = inside[:: -(-len(inside) // 5)] or [high]
    center, rim, *ticks = (float(_shortfall(number, metric)) for number in (high, low, *rings))
    return center, rim, ticks


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
        return max(rings[0] - step, 0.0), max(rings[-1], step), [ring for ring in rings if ring > 0]
    return rings[-1] + step, rings[0], rings
