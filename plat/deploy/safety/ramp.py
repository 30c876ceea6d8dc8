"""Ramp of joint targets from the pose in which a robot is found to the pose in which its policy starts."""

import numpy as np
from numpy.typing import NDArray

from plat.deploy.state import Array

__all__ = ["Ramp"]


class Ramp:
    """Ramp between two poses: half a cosine, at rest at both ends.

    Args:
        start: joint angles at the beginning ``[J]`` (rad).
        end: joint angles at the end ``[J]`` (rad).
        seconds: that it takes.

    >>> Ramp(np.zeros(1), np.ones(1), 2.0)(1.0).round(3).tolist()
    [0.5]
    """

    def __init__(self, start: Array, end: Array, seconds: float):
        self._start, self._end = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
        self.seconds = seconds
        """Length (s)."""

    def __call__(self, elapsed: float) -> NDArray[np.float64]:
        """Return the targets ``[J]`` (rad) some seconds after the beginning."""
        share = min(max(elapsed / self.seconds, 0.0), 1.0)
        return self._start + 0.5 * (1.0 - np.cos(np.pi * share)) * (self._end - self._start)
