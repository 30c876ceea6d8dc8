"""Resampling of clips to the control rate, and velocities by finite differences."""

import torch
from torch import Tensor

from plat.rotations import quat_conjugate, quat_multiply, quat_slerp, quat_to_rotvec

__all__ = ["finite_difference", "quat_finite_difference", "resample_qpos", "resampled_length"]


def resample_qpos(qpos: Tensor, fps: float, dt: float) -> Tensor:
    """Return poses every ``dt`` seconds from poses at ``fps``, from the first frame up to the last.

    Positions and joint angles are interpolated linearly, the root quaternion along the great arc.

    Args:
        qpos: ``[T, 7 + J]``, quaternion ``wxyz`` in columns 3 to 6.

    Returns:
        ``[floor((T - 1) / (fps * dt)) + 1, 7 + J]``.

    >>> qpos = torch.zeros(4, 36)
    >>> qpos[:, 3] = 1.0
    >>> qpos[:, 0] = torch.arange(4.0)
    >>> resample_qpos(qpos, fps=30.0, dt=0.02)[:, 0]
    tensor([0.0000, 0.6000, 1.2000, 1.8000, 2.4000, 3.0000])
    """
    count = resampled_length(len(qpos), fps, dt)
    position = (torch.arange(count, dtype=torch.float64) * (fps * dt)).clamp_max(len(qpos) - 1)
    before = position.long().clamp_max(len(qpos) - 2)
    weight = (position - before).to(qpos.dtype)
    start, end = qpos[before], qpos[before + 1]
    result = torch.lerp(start, end, weight[:, None])
    result[:, 3:7] = quat_slerp(start[:, 3:7], end[:, 3:7], weight)
    return result


def resampled_length(frames: int, fps: float, dt: float) -> int:
    """Return how many poses :func:`resample_qpos` returns for so many.

    >>> resampled_length(4, fps=30.0, dt=0.02)
    6
    """
    # the small margin keeps the last frame when (frames - 1) / fps is a multiple of dt up to rounding
    return int((frames - 1) / (fps * dt) + 1e-6) + 1


def finite_difference(values: Tensor, before: Tensor, after: Tensor, dt: float) -> Tensor:
    """Return central differences ``(values[after] - values[before]) / ((after - before) dt)``.

    Args:
        values: ``[F, ...]``.
        before: row ``[n]`` to the left of each wanted row, the row itself at the start of a clip.
        after: row ``[n]`` to the right, the row itself at the end of a clip.
    """
    span = ((after - before) * dt).to(values).view(-1, *[1] * (values.ndim - 1))
    return (values[after] - values[before]) / span


def quat_finite_difference(quat: Tensor, before: Tensor, after: Tensor, dt: float) -> Tensor:
    """Return angular velocities ``[n, ..., 3]`` (rad/s, **world** frame) of quaternions ``[F, ..., 4]``.

    See :func:`finite_difference` for ``before`` and ``after``.
    """
    turn = quat_to_rotvec(quat_multiply(quat[after], quat_conjugate(quat[before])))
    return turn / ((after - before) * dt).to(quat).view(-1, *[1] * (quat.ndim - 1))
