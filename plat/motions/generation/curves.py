"""Smooth interpolation in time."""

from collections.abc import Sequence

import numpy as np

__all__ = ["fade", "minimum_jerk", "moves"]


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
