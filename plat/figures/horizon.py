"""Plot of success against the time that a command gives."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import torch

from plat.errors import RecordsError
from plat.evaluation.records import CommandRecords
from plat.evaluation.score_table import Score
from plat.figures.style import PAGE, in_legend, looks, paper_style, policies

__all__ = ["horizon_plot"]

_EDGES = (0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0)  # seconds; behind them every half second
_SPREAD = 5.0  # factor between errors from which the scale is logarithmic
_LEAST_SPAN = 5.0  # percent


def horizon_plot(scores: Sequence[Score], dt: float = 0.02) -> Any:
    """Return a figure of TKS@3 and of the mean position error against the commands' time, one line per policy.

    Commands of all horizons are pooled and binned by their length, up to the longest of them. The error counts failed
    commands at 1 m. Its scale is logarithmic where errors differ by more than a factor of five.

    Args:
        scores: of any policies.
        dt: control step (s).

    Raises:
        RecordsError: without scores.
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    if not scores:
        raise RecordsError("plot over horizons: no scores, expected at least one")
    drawn = looks(policies(scores))
    with paper_style() as plt:
        size = (PAGE, 2.2 + 0.075 * len(drawn))
        figure, (success, error) = plt.subplots(1, 2, figsize=size)
        for name, look in drawn.items():
            runs = [run for score in scores if score.policy == name for run in score.records]
            times, shares, errors = _binned(runs, dt)
            for panel, values in ((success, shares), (error, errors)):
                panel.plot(
                    times,
                    values,
                    look.dashes,
                    color=look.color,
                    linewidth=look.width,
                    marker=look.marker,
                    markersize=3,
                    label=in_legend(name),
                )
        success.set(xlabel="time of the command (s)", ylabel="TKS@3 (%)", xlim=(0, None))
        low, high = success.get_ylim()
        wider = max(0.0, _LEAST_SPAN - (high - low)) / 2
        success.set_ylim(max(low - wider, -1.0), min(high + wider, 101.0))  # there is no share beyond 100 %
        error.set(xlabel="time of the command (s)", ylabel="MPKPE@3, all commands (mm)", xlim=(0, None), ylim=(0, None))
        drawn_errors = [value for line in error.lines for value in line.get_ydata() if value > 0]
        if max(drawn_errors, default=1.0) > _SPREAD * min(drawn_errors, default=1.0):
            error.set_ylim(0.8 * min(drawn_errors), 1.25 * max(drawn_errors))
            error.set_yscale("log")
            error.yaxis.set_major_locator(plt.LogLocator(subs=(1.0, 2.0, 5.0)))
            error.yaxis.set_major_formatter("{x:g}")
            error.yaxis.set_minor_locator(plt.NullLocator())
        for panel in (success, error):
            panel.grid()
        handles, labels = success.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, handlelength=2.4)
    return figure


def _binned(runs: Sequence[CommandRecords], dt: float) -> tuple[list[float], list[float], list[float]]:
    """Return the middle of each bin that has commands, TKS@3 (%) and the error (mm) in it."""
    seconds = torch.cat([run.length for run in runs]) * dt
    failed = torch.cat([run.failed for run in runs])
    error = torch.cat([run.window["keypoint_error"] for run in runs]).nan_to_num(1.0).clamp_max(1.0)
    error = torch.where(failed, 1.0, error)
    commanded = torch.cat([run.commanded["bodies"] for run in runs])
    times, shares, errors = [], [], []
    halves = math.ceil(2 * (float(seconds.max()) - _EDGES[-1] - 1e-6)) if len(seconds) else 0
    for low, high in pairwise((*_EDGES, *(_EDGES[-1] + 0.5 * (half + 1) for half in range(halves)))):
        rows = (seconds > low + 1e-6) & (seconds <= high + 1e-6)
        if rows.any():
            times.append((low + high) / 2)
            shares.append(100 * float((~failed[rows]).double().mean()))
            errors.append(1000 * float(error[rows & commanded].mean()))
    return times, shares, errors
