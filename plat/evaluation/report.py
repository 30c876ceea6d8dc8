"""From records of commands to the figures of a table, with intervals."""

from dataclasses import dataclass

import torch
from torch import Tensor

from plat.evaluation.records import STEP_METRICS, CommandRecords

__all__ = ["Estimate", "Penalties", "report", "success_curve"]


@dataclass(frozen=True)
class Penalties:
    """Caps on a command's error where failed commands are counted in, and what a failed one counts as."""

    joint_error: float = 0.5
    """rad"""
    keypoint_error: float = 1.0
    """m"""
    keypoint_error_root: float = 0.5
    """m"""


@dataclass(frozen=True)
class Estimate:
    """A figure and its 95 % bootstrap interval over motions."""

    value: float
    low: float
    high: float

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} ({self.low:{spec}}-{self.high:{spec}})"


def report(
    records: CommandRecords, penalties: Penalties | None = None, resamples: int = 1000, seed: int = 0
) -> dict[str, Estimate]:
    """Figures of timed keyframe tracking.

    Returns:
        ``tks`` (%): TKS@3, commands that were not terminated; ``mpjpe`` (rad), ``mpkpe`` and ``mpkpe_root`` (m):
        errors over the commands that reached their window; ``mpjpe_all``, ``mpkpe_all``, ``mpkpe_root_all``: the same
        over all commands, each capped, and a failed one at its cap; ``fall_rate`` (%); ``success_area`` (%): area
        under :func:`success_curve`; ``action_change``, ``joint_jerk`` (rad/s^3), ``foot_slip`` (m/s): means over
        steps. The intervals come from drawing motions with replacement.
    """
    penalties = penalties or Penalties()
    every = torch.ones_like(records.steps)
    reached = records.window_steps > 0
    ratios: dict[str, tuple[Tensor, Tensor]] = {
        "tks": (100.0 * ~records.failed, every),
        "fall_rate": (100.0 * records.fell, every),
        "success_area": (100.0 * (1 - records.arrival_error.clamp_max(_LARGEST) / _LARGEST), every),
    }
    for name, short in (("joint_error", "mpjpe"), ("keypoint_error", "mpkpe"), ("keypoint_error_root", "mpkpe_root")):
        error, cap = records.window[name], getattr(penalties, name)
        ratios[short] = (error.nan_to_num(0.0) * reached, reached.double())
        capped = torch.where(records.failed, cap, error.nan_to_num(cap).clamp_max(cap))
        ratios[f"{short}_all"] = (capped, every)
    for name in STEP_METRICS:
        ratios[name] = (records.step[name], records.steps)
    clips, clip = torch.unique(records.clip, return_inverse=True)
    generator = torch.Generator().manual_seed(seed)
    draws = torch.randint(len(clips), (resamples, len(clips)), generator=generator)
    weights = torch.zeros(resamples, len(clips), dtype=torch.float64).scatter_add_(
        1, draws, torch.ones_like(draws, dtype=torch.float64)
    )
    return {name: _estimate(top.double(), bottom.double(), clip, weights) for name, (top, bottom) in ratios.items()}


_LARGEST = 0.5  # m: right end of the success curve


def success_curve(records: CommandRecords, points: int = 51) -> tuple[Tensor, Tensor]:
    """Share of commands whose world keypoint error at arrival is at most x, for x from 0 to 0.5 m.

    Returns:
        x ``[points]`` (m) and shares ``[points]`` in 0..1. A failed command is at no x.
    """
    thresholds = torch.linspace(0, _LARGEST, points, dtype=torch.float64)
    return thresholds, (records.arrival_error <= thresholds[:, None]).double().mean(-1)


def _estimate(top: Tensor, bottom: Tensor, clip: Tensor, weights: Tensor) -> Estimate:
    """``sum(top) / sum(bottom)`` and its interval when whole clips are drawn with ``weights`` ``[R, C]``."""
    count = weights.shape[1]
    top_of_clip = torch.zeros(count, dtype=torch.float64).index_add_(0, clip, top)
    bottom_of_clip = torch.zeros(count, dtype=torch.float64).index_add_(0, clip, bottom)
    resampled = (weights @ top_of_clip) / (weights @ bottom_of_clip)
    resampled = resampled[resampled.isfinite()]
    if len(resampled) == 0:
        return Estimate(float("nan"), float("nan"), float("nan"))
    low, high = torch.quantile(resampled, torch.tensor([0.025, 0.975], dtype=torch.float64)).tolist()
    return Estimate(float(top.sum() / bottom.sum()), low, high)
