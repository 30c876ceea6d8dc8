"""Smooth interpolation in time."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

__all__ = ["fade", "minimum_jerk", "moves", "quintic"]


def minimum_jerk(progress: np.ndarray) -> np.ndarray:
    """Return the position 0..1 of a minimum-jerk movement at ``progress`` 0..1 (clamped); Flash and Hogan, 1985.

    >>> minimum_jerk(np.array([-1.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    s = progress.clip(0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)


def moves(time: np.ndarray, start: float, changes: Sequence[tuple[float, float, float]]) -> np.ndarray:
    """Return a value ``[F]`` at times ``[F]`` (s) that starts at ``start`` and sums minimum-jerk changes.

    Args:
        time: ``[F]`` (s).
        start: value before the first change.
        changes: begin (s), duration (s) and amount of each. Changes may overlap; they add up.

    >>> moves(np.array([0.0, 1.5, 9.0]), 1.0, [(1.0, 1.0, 2.0), (4.0, 1.0, -3.0)]).tolist()
    [1.0, 2.0, 0.0]
    """
    return start + sum(
        (amount * minimum_jerk((time - begin) / duration) for begin, duration, amount in changes), np.zeros(len(time))
    )


def fade(time: np.ndarray, begin: float, end: float, edge: float) -> np.ndarray:
    """Return a weight ``[F]``: 1 between ``begin`` and ``end`` (s) with a soft edge (s) inside each, else 0."""
    return minimum_jerk((time - begin) / edge) * minimum_jerk((end - time) / edge)


def quintic(time: np.ndarray, knots: Sequence[tuple[float, float, float, float]]) -> np.ndarray:
    """Return a value ``[F]`` at times ``[F]`` (s) through knots, with continuous acceleration.

    Args:
        time: ``[F]`` (s).
        knots: time (s), value, speed and acceleration of each, in order; the value stays before the first and after the
            last.

    >>> fall = -9.81
    >>> height = quintic(np.array([0.0, 0.1, 0.2]), [(0.0, 0.0, 0.981, fall), (0.2, 0.0, -0.981, fall)])
    >>> height.round(5).tolist()
    [0.0, 0.04905, 0.0]
    """
    result = np.full(len(time), knots[0][1], dtype=np.float64)
    for (begin, x0, v0, a0), (end, x1, v1, a1) in pairwise(knots):
        span = max(end - begin, 1e-9)
        s = ((time - begin) / span).clip(0, 1)
        v0, v1, a0, a1 = v0 * span, v1 * span, a0 * span**2, a1 * span**2
        gap, lag, bend = x1 - x0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
        cubic, quartic, fifth = 10 * gap - 4 * lag + bend / 2, -15 * gap + 7 * lag - bend, 6 * gap - 3 * lag + bend / 2
        value = x0 + v0 * s + a0 / 2 * s**2 + cubic * s**3 + quartic * s**4 + fifth * s**5
        result = np.where(time >= begin, value, result)
    return result
