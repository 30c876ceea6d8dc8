"""Plots of a motion clip over time, with the limits of its checks."""

from typing import Any

import numpy as np
import torch

from plat.figures.pyplot import pyplot
from plat.motions.checks.feet import Soles
from plat.motions.checks.settings import ValidationLimits
from plat.motions.checks.validation import MotionReport
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot

__all__ = ["motion_plot"]

_NAMED = 5  # joints that come nearest to their limits have a color and a name


def motion_plot(
    clip: MotionClip, report: MotionReport, limits: ValidationLimits | None = None, robot: Robot = G1
) -> Any:
    """Return a figure of joint angles within their limits, heights of the soles, and speeds over time.

    Lines mark the limits of the checks, crosses the steps of one frame that the report found, and dotted lines the
    jumps of the root.

    Args:
        clip: the motion.
        report: of :func:`~plat.motions.validate_motion`, with the same limits.
        limits: of the checks, by default the default ones.
        robot: whose motion it is.

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.

    >>> from plat.motions import generate_motions, validate_motion
    >>> clip = generate_motions("val", 1)[0]
    >>> figure = motion_plot(clip, validate_motion(clip))
    >>> len(figure.axes), figure.axes[0].get_title() == clip.name
    (4, True)
    """
    limits = limits or ValidationLimits()
    time = np.arange(len(clip.qpos)) / clip.fps
    figure, panels = pyplot().subplots(3, 1, figsize=(9, 8), sharex=True, layout="constrained")
    _draw_joints(panels[0], time, clip, robot)
    _draw_soles(panels[1], time, clip, limits, robot)
    _draw_speeds(panels[2], time, clip, report, limits)
    for moment in report.jumps:
        for panel in panels:
            panel.axvline(moment, color="C3", linewidth=0.8, linestyle=":")
    return figure


def _draw_joints(panel: Any, time: np.ndarray, clip: MotionClip, robot: Robot) -> None:
    low, high = robot.joint_range.numpy().T
    share = (clip.qpos[:, 7:] - low) / (high - low)
    nearest = np.abs(share - 0.5).max(0).argsort()[-_NAMED:]
    for joint, name in enumerate(robot.joint_names):
        label = name.replace("_", " ") if joint in nearest else None
        panel.plot(time, share[:, joint], color=None if label else "0.8", label=label, zorder=2 if label else 1)
    panel.axhspan(0, 1, color="0.95", zorder=0)
    panel.set(ylabel="joint angle within its limits", ylim=(-0.15, 1.15))
    panel.set_title(clip.name, parse_math=False)  # a name is no formula
    panel.legend(fontsize=7, ncols=5, loc="lower center", frameon=False)


def _draw_soles(panel: Any, time: np.ndarray, clip: MotionClip, limits: ValidationLimits, robot: Robot) -> None:
    height = Soles(robot).points(torch.from_numpy(clip.qpos))[..., 2].amin(-1).numpy()
    for foot, side in enumerate(("left", "right")):
        panel.plot(time, 100 * height[:, foot], label=side)
    panel.axhline(0, color="0.3", linewidth=0.8)
    for value, told in ((limits.floating, "rests higher: repair"), (-limits.penetration, "lower: repair")):
        _draw_limit(panel, 100 * value, told)
    panel.set(ylabel="lowest point of the sole (cm)")
    panel.legend(fontsize=7, frameon=False)


def _draw_speeds(
    panel: Any, time: np.ndarray, clip: MotionClip, report: MotionReport, limits: ValidationLimits
) -> None:
    steps = np.diff(clip.qpos, axis=0) * clip.fps
    panel.plot(time[1:], np.abs(steps[:, 7:]).max(1), color="C2")
    _draw_limit(panel, limits.joint_speed, "faster: drop")
    _draw_limit(panel, limits.step_speed, "faster, and in one frame alone: repair")
    for step in report.steps:
        panel.plot((step.frame + 1) / clip.fps, step.speed, "x", color="C3")
    panel.set(ylabel="fastest joint (rad/s)", xlabel="s; dotted red: the root jumps")
    root = panel.twinx()
    root.plot(time[1:], np.linalg.norm(steps[:, :3], axis=1), color="C4", linewidth=1)  # limits are C3
    root.set_ylabel("root (m/s)", color="C4")


def _draw_limit(panel: Any, value: float, told: str) -> None:
    """Draw a limit of the checks, and what it means."""
    if np.isfinite(value):
        panel.axhline(value, color="C3", linewidth=0.8, linestyle="--")
        panel.annotate(
            told,
            (1, value),
            xycoords=panel.get_yaxis_transform(),
            xytext=(-4, 2),  # points
            textcoords="offset points",
            ha="right",
            fontsize=6,
            color="C3",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.5},  # curves run behind it
        )
