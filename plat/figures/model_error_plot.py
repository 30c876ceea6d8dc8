"""Plot of a dynamics model's prediction error over the steps."""

from typing import Any

import torch

from plat.evaluation.model_error import ModelErrors
from plat.figures.style import PAGE, paper_style

__all__ = ["model_error_plot"]


def model_error_plot(errors: ModelErrors, dt: float = 0.02) -> Any:
    """Return a figure with one panel a quantity: error over imagined steps, beside that of a robot that stays put.

    Args:
        errors: of a model.
        dt: control step (s).

    Raises:
        RenderingError: when the extra ``plat-rl[figures]`` is not installed.
    """
    panels = (("root_pos", "root position (m)"), ("root_rot", "root orientation (rad)"), ("joint_pos", "joints (rad)"))
    time = dt * torch.arange(1, len(errors.root_pos) + 1)
    with paper_style() as plt:
        figure, axes = plt.subplots(1, len(panels), figsize=(PAGE, 2.0))
        for axis, (name, label) in zip(axes, panels, strict=True):
            axis.plot(time, getattr(errors, f"still_{name}").cpu(), "--", label="stays as it was")
            axis.plot(time, getattr(errors, name).cpu(), label="learned model")
            axis.set(xlabel="imagined time (s)", title=label, xlim=(0, float(time[-1])), ylim=(0, None))
            axis.grid()
        axes[0].legend()
    return figure
