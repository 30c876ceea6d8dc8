"""Three numbers of an orientation, and what they may be."""

import numpy as np
import torch

from plat.rotations import quat_from_rotvec, quat_multiply

__all__ = ["EULER", "euler_to_quat", "turns_of_three"]

EULER = "Euler angles"
"""What three numbers usually are: turns about the fixed x, then y, then z axis."""


def euler_to_quat(angles: np.ndarray, order: str = "xyz") -> np.ndarray:
    """Return quaternions ``[T, 4]`` (``wxyz``) of turns about fixed axes, one after the other.

    Args:
        angles: about x, y and z ``[T, 3]`` (rad).
        order: of the axes; the reverse is that of turns about the body's own axes.
    """
    quat = torch.zeros(len(angles), 4, dtype=torch.float64)
    quat[:, 0] = 1.0
    for axis in map("xyz".index, order):
        turn = torch.zeros_like(quat)
        half = torch.from_numpy(0.5 * angles[:, axis])
        turn[:, 0], turn[:, 1 + axis] = half.cos(), half.sin()
        quat = quat_multiply(turn, quat)
    return quat.numpy()


def turns_of_three(values: np.ndarray) -> dict[str, np.ndarray]:
    """Return quaternions ``[T, 4]`` (``wxyz``) of columns that are called ``rx, ry, rz``, by what they may be.

    Args:
        values: ``[T, 3]`` (rad).

    >>> list(turns_of_three(np.zeros((2, 3))))
    ['Euler angles', 'rotation vectors', "Euler angles about the body's own axes"]
    """
    return {
        EULER: euler_to_quat(values),
        "rotation vectors": quat_from_rotvec(torch.from_numpy(values)).numpy(),
        "Euler angles about the body's own axes": euler_to_quat(values, "zyx"),
    }
