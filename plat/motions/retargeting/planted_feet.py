"""Feet that stand where they stand: contact seen in the human's motion, and foot paths that keep still in it."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, uniform_filter1d

__all__ = ["contact_weight", "hold", "levelling", "lift", "pointing"]

# A toe lower than the first height and slower than the first speed is on the ground, beyond the second it is not
# (m above its lowest, m/s of the human).
_HEIGHTS = (0.02, 0.04)
_SPEEDS = (0.3, 0.7)
# Seconds over which its speed is measured: from one frame to the next at 240 Hz a tremble of a millimeter is 0.3 m/s.
_SPEED_TIME = 1 / 15
# A foot that turns slower than the first speed keeps its yaw while it stands, beyond the second it pivots (rad/s, over
# so many seconds, for captures tremble).
_PIVOTS = (0.25, 0.6)
_PIVOT_TIME = 0.2
# Seconds in which a foot comes back to the human's path after it was held.
_RETURN_TIME = 0.2
# Seconds in which a foot turns flat before it stands, and turns as the human's after it.
_LEVEL_TIME = 0.12
# Seconds over which a correction of the robot's height is spread.
_LIFT_TIME = 0.1
# How much more a still foot counts in contact than a path that is followed outside.
_STILLNESS = 1e4


def contact_weight(height: np.ndarray, position: np.ndarray, fps: float) -> np.ndarray:
    """Return how sure it is that a toe stands on the ground, ``[T]`` in 0..1.

    Args:
        height: above the ground ``[T]`` (m).
        position: of the toe ``[T, 3]`` (m).
        fps: frames a second.

    >>> still = np.zeros((4, 3))
    >>> contact_weight(np.array([0.0, 0.01, 0.03, 0.1]), still, 30.0).round(2).tolist()
    [1.0, 1.0, 0.5, 0.0]
    """
    speed = np.linalg.norm(_rate(position, _SPEED_TIME, fps), axis=1)
    weight = np.ones(len(height))
    for value, (low, high) in ((height, _HEIGHTS), (speed, _SPEEDS)):
        weight *= np.clip((high - value) / (high - low), 0, 1)
    return weight


def _rate(path: np.ndarray, seconds: float, fps: float) -> np.ndarray:
    """Return how fast ``[T, D]`` changes, over so long a time around each frame and at least to its neighbors."""
    reach = max(1, round(0.5 * seconds * fps))
    frames = np.arange(len(path))
    first, last = np.maximum(frames - reach, 0), np.minimum(frames + reach, len(path) - 1)
    return np.asarray((path[last] - path[first]) * fps / (last - first)[:, None])


def pointing(yaw: np.ndarray, pitch: np.ndarray, fps: float) -> np.ndarray:
    """Return how surely a foot that stands keeps its yaw ``[T]`` in 0..1, and does not pivot on its toe.

    Args:
        yaw: of the foot ``[T]`` (rad), without whole turns.
        pitch: of the foot ``[T]`` (rad); the yaw of a steep foot says little.
        fps: frames a second.

    >>> pointing(np.array([0.0, 0, 0, 0, 0, 0.1, 0.2, 0.3, 0.4]), np.zeros(9), 20.0).round(2).tolist()
    [1.0, 1.0, 1.0, 0.29, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    speed = np.abs(_rate(yaw[:, None], _PIVOT_TIME, fps)[:, 0]) * np.cos(pitch)
    low, high = _PIVOTS
    return np.asarray(np.clip((high - speed) / (high - low), 0, 1))


def levelling(contact: np.ndarray, fps: float) -> np.ndarray:
    """Return how far a foot is turned flat ``[T]`` in 0..1: not less than in contact, and not all of it in one frame.

    Args:
        contact: how sure it is that it stands ``[T]`` in 0..1.
        fps: frames a second.

    >>> levelling(np.array([0.0, 0, 0, 1, 1, 1, 0, 0, 0]), 20.0).round(2).tolist()
    [0.25, 0.75, 1.0, 1.0, 1.0, 1.0, 1.0, 0.75, 0.25]
    """
    reach = max(1, round(_LEVEL_TIME * fps))
    kernel = np.hanning(2 * reach + 1)
    padded = np.pad(maximum_filter1d(contact, 2 * reach + 1), reach, mode="edge")
    return np.asarray(np.maximum(contact, np.convolve(padded, kernel / kernel.sum(), mode="valid")))


def hold(path: np.ndarray, weight: np.ndarray, fps: float) -> np.ndarray:
    """Return the path nearest to another that moves as it does where ``weight`` is 0, and stands where it is 1.

    Minimizes, for every coordinate, ``sum_t a (x_t - path_t)^2 + k_t (dx_t - (1 - w_t) dpath_t)^2``, a tridiagonal
    system. The first term brings the result back to the path after contacts.

    Args:
        path: ``[T, D]``.
        weight: ``[T]`` in 0..1.
        fps: frames a second.

    >>> path = np.linspace(0, 1, 101)[:, None]
    >>> held = hold(path, (abs(path[:, 0] - 0.5) < 0.1).astype(float), fps=50.0)
    >>> bool(np.ptp(held[42:59]) < 1e-3), bool(abs(held - path).max() < 0.11)
    (True, True)
    """
    weight = np.minimum(weight[1:], weight[:-1])
    stiffness = 1.0 + _STILLNESS * weight
    step = (1.0 - weight)[:, None] * np.diff(path, axis=0)
    pull = (1.0 / (fps * _RETURN_TIME)) ** 2
    bands: NDArray[np.float64] = np.zeros((2, len(path)))
    bands[1] = pull
    bands[1, 1:] += stiffness
    bands[1, :-1] += stiffness
    bands[0, 1:] = -stiffness
    right = pull * path
    right[1:] += stiffness[:, None] * step
    right[:-1] -= stiffness[:, None] * step
    return np.asarray(solveh_banded(bands, right))


def lift(depth: np.ndarray, fps: float) -> np.ndarray:
    """Return the smooth height to raise a robot by so that nothing is below the ground.

    Args:
        depth: of the lowest point below the ground ``[T]`` (m), negative above it.
        fps: frames a second.

    >>> depth = np.array([-0.1, -0.1, -0.1, 0.03, -0.1, -0.1, -0.1])
    >>> lift(depth, 20.0).round(3).tolist()
    [0.0, 0.01, 0.02, 0.03, 0.02, 0.01, 0.0]
    """
    window = 2 * round(0.5 * _LIFT_TIME * fps) + 1
    # the mean over a window of the largest in a window is nowhere less than what is needed there
    return np.asarray(uniform_filter1d(maximum_filter1d(depth.clip(0), window), window))
