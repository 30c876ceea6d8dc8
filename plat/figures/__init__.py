"""Figures of a paper (extra ``plat-rl[figures]``)."""

from plat.figures.bars import ablation_bars
from plat.figures.differences import difference_plot
from plat.figures.film_strip import film_strip
from plat.figures.groups import group_plot
from plat.figures.horizon import horizon_plot
from plat.figures.motion_plot import motion_plot
from plat.figures.motion_sheet import motion_sheet
from plat.figures.pyplot import pyplot, write_figure
from plat.figures.radar import radar_plot
from plat.figures.robustness import robustness_plot
from plat.figures.skeleton import draw_skeleton
from plat.figures.style import save_figure
from plat.figures.success import success_plot

__all__ = [
    "ablation_bars",
    "difference_plot",
    "draw_skeleton",
    "film_strip",
    "group_plot",
    "horizon_plot",
    "motion_plot",
    "motion_sheet",
    "pyplot",
    "radar_plot",
    "robustness_plot",
    "save_figure",
    "success_plot",
    "write_figure",
]
