"""Smooth interpolation in time."""

from collections.abc import Sequence

from torch import Tensor

__all__ = ["hold_and_move", "minimum_jerk"]


def minimum_jerk(progress: Tensor) -> Tensor:
    """Position 0..1 of a minimum-jerk movement at ``progress`` 0..1 (clamped); Flash and Hogan, 1985.

    >>> import torch
    >>> minimum_jerk(torch.tensor([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    s = progress.clamp(0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def hold_and_move(time: Tensor, points: Sequence[tuple[float, float, Tensor]], start: Tensor) -> Tensor:
    """A value that moves to one point after another and holds there.

    Args:
        time: ``[F]`` (s).
        points: begin (s), duration (s) and target ``[n]`` of each movement, in order and not overlapping.
        start: value ``[n]`` before the first movement.

    Returns:
        ``[F, n]``.
    """
    value, last = start.expand(len(time), -1).clone(), start
    for begin, duration, target in points:
        value += minimum_jerk((time - begin) / duration)[:, None] * (target - last)
        last = target
    return value
