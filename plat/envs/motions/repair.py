"""Repairs of clips: feet to the floor, joints into their limits, ends off."""

from typing import Literal

import numpy as np
import torch

from plat.envs.motions.clip import MotionClip
from plat.envs.motions.feet import Soles, ground_level, stance
from plat.envs.robot import G1, Robot
from plat.errors import MotionError

__all__ = ["Grounding", "clip_to_limits", "ground_feet", "trim_motion"]

Grounding = Literal["clip", "smooth"]

# Width of the mean over a floor that drifts (s).
_DRIFT_SECONDS = 0.3


def ground_feet(clip: MotionClip, how: Grounding = "clip", robot: Robot = G1) -> MotionClip:
    """The clip with its feet on the floor.

    Args:
        clip: a motion that floats or sinks.
        how: ``"clip"`` lowers or raises all frames alike, so that the lower foot rests at height 0 in the median.
            ``"smooth"`` follows a floor that drifts: its height is taken where the lower foot rests, carried on in
            between, so that jumps stay jumps, smoothed, and lowered where a foot would still be under it.
        robot: the robot.

    >>> qpos = G1.default_qpos[None].repeat(60, 0)
    >>> qpos[:, 2] += 0.1
    >>> lowered = ground_feet(MotionClip("floating", qpos, 30.0)).qpos[0, 2] - qpos[0, 2]
    >>> round(float(lowered), 2)
    -0.1
    """
    points = Soles(robot).points(torch.from_numpy(clip.qpos))
    resting = stance(points, clip.fps)
    if how == "clip" or not resting.any():
        level: float | np.ndarray = ground_level(points, clip.fps)
    else:
        low = points[..., 2].amin((-1, -2)).numpy()
        frames = np.arange(len(low))
        width = _DRIFT_SECONDS * clip.fps
        level = _smooth(np.interp(frames, frames[resting], low[resting]), width)
        # a foot that moves too fast to count as resting may still be lower than the floor between two rests
        sunk = np.maximum(level - low, 0)
        reach = _reach(width)
        windows = np.lib.stride_tricks.sliding_window_view(np.pad(sunk, reach, mode="edge"), 2 * reach + 1)
        level -= _smooth(windows.max(-1), width)
    qpos = clip.qpos.copy()
    qpos[:, 2] -= level
    return MotionClip(clip.name, qpos, clip.fps)


def clip_to_limits(clip: MotionClip, robot: Robot = G1) -> MotionClip:
    """The clip with every joint angle inside the joint's limits."""
    low, high = robot.joint_range.numpy().T
    return MotionClip(clip.name, np.concatenate((clip.qpos[:, :7], clip.qpos[:, 7:].clip(low, high)), 1), clip.fps)


def trim_motion(clip: MotionClip, start: float = 0.0, end: float = 0.0) -> MotionClip:
    """The clip without its first ``start`` and last ``end`` seconds.

    Raises:
        MotionError: when less than two frames would be left.
    """
    first, last = round(start * clip.fps), len(clip.qpos) - round(end * clip.fps)
    if start < 0 or end < 0 or last - first < 2:
        raise MotionError(
            f"motion {clip.name!r}: {clip.duration:.2f} s cannot lose {start} s at the start and {end} s at the end"
        )
    return MotionClip(clip.name, clip.qpos[first:last], clip.fps)


def _smooth(values: np.ndarray, width: float) -> np.ndarray:
    """Gaussian mean over about ``width`` frames; the ends are carried on."""
    reach = _reach(width)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / (0.5 * width)) ** 2)
    return np.convolve(np.pad(values, reach, mode="edge"), weight / weight.sum(), mode="valid")


def _reach(width: float) -> int:
    return max(1, round(width))
