"""Rotations in numpy: unit quaternions ``wxyz``, float64. The twin of :mod:`plat.rotations`, for code without torch."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "UNIT_TOLERANCE",
    "axis_rotation",
    "heading_pitch_roll",
    "quat_from_heading_pitch_roll",
    "quat_from_matrix",
    "quat_from_rotvec",
    "quat_multiply",
    "quat_slerp",
    "quat_to_matrix",
]

UNIT_TOLERANCE = 1e-2
"""A quaternion whose length is farther from 1 is a wrong column or a wrong order, not rounding."""

Array = NDArray[np.float64]


def quat_multiply(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the Hamilton product ``[*B, 4]``: the rotation ``b`` followed by ``a``. The twin of its namesake in torch.

    >>> quat_multiply([0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        -1,
    )


def quat_from_rotvec(rotvec: ArrayLike) -> Array:
    """Return the quaternions ``[*B, 4]`` of rotation vectors ``[*B, 3]`` (rad). The twin of its namesake in torch.

    >>> quat_from_rotvec([0.0, 0.0, np.pi]).round(3).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    half = 0.5 * np.asarray(rotvec, dtype=np.float64)
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    return np.concatenate((np.cos(angle), half * np.sinc(angle / np.pi)), -1)


def quat_slerp(a: ArrayLike, b: ArrayLike, weight: float) -> Array:
    """Return the point between unit quaternions ``[4]`` along the shorter arc. The twin of its namesake in torch.

    >>> half = quat_slerp([1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5)
    >>> half.round(3).tolist()
    [0.707, 0.0, 0.0, 0.707]
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = np.arccos(min(cosine, 1.0))
    # sinc, so that the limit of equal quaternions needs no case of its own
    ends = np.sinc(np.array([1 - weight, weight]) * angle / np.pi) * [1 - weight, weight]
    blend = ends[0] * a + ends[1] * b
    return blend / np.linalg.norm(blend)


def quat_to_matrix(quat: ArrayLike) -> Array:
    """Return the rotation matrix ``[3, 3]`` of a quaternion ``[4]`` of any length but 0.

    >>> quat_to_matrix([0.0, 0.0, 0.0, 2.0]).tolist()
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    # plain floats: for one rotation they are several times faster than arrays
    w, x, y, z = map(float, np.asarray(quat))
    s = 2.0 / math.fsum((w * w, x * x, y * y, z * z))
    return np.array(
        (
            (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
            (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
            (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
        )
    )


def axis_rotation(axis: int, angle: Array) -> Array:
    """Return rotation matrices ``[T, 3, 3]`` by angles ``[T]`` (rad) about the x, y or z axis (0, 1, 2).

    >>> (axis_rotation(2, np.array([np.pi / 2])) @ [1.0, 0.0, 0.0]).round(3).tolist()
    [[0.0, 1.0, 0.0]]
    """
    matrix = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[:, axis, axis] = 1
    matrix[:, i, i] = matrix[:, j, j] = np.cos(angle)
    matrix[:, j, i] = np.sin(angle)
    matrix[:, i, j] = -matrix[:, j, i]
    return matrix


def heading_pitch_roll(quat: ArrayLike) -> Array:
    """Return angles ``[3]`` (rad) with ``quat = Rz(heading) Ry(pitch) Rx(roll)``.

    >>> heading_pitch_roll([0.5**0.5, 0.0, 0.0, 0.5**0.5]).round(3).tolist()
    [1.571, 0.0, 0.0]
    """
    w, x, y, z = np.asarray(quat, dtype=np.float64)
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.array([heading, pitch, roll])


def quat_from_heading_pitch_roll(angles: ArrayLike) -> Array:
    """Return the quaternion ``[4]`` of angles ``[3]`` (rad), the inverse of :func:`heading_pitch_roll`."""
    heading, pitch, roll = np.asarray(angles, dtype=np.float64)
    tilt = quat_multiply(quat_from_rotvec([0.0, pitch, 0.0]), quat_from_rotvec([roll, 0.0, 0.0]))
    return quat_multiply(quat_from_rotvec([0.0, 0.0, heading]), tilt)


def quat_from_matrix(matrix: ArrayLike) -> Array:
    """Return the unit quaternions ``[*B, 4]`` of rotation matrices ``[*B, 3, 3]``; either of the two signs.

    Source: Shepperd, "Quaternion from rotation matrix", 1978.

    >>> quat_from_matrix(axis_rotation(2, np.array([np.pi]))).round(3).tolist()
    [[0.0, 0.0, 0.0, 1.0]]
    """
    m = np.asarray(matrix, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    rows = (
        (1 + xx + yy + zz, wx, wy, wz),
        (wx, 1 + xx - yy - zz, xy, xz),
        (wy, xy, 1 - xx + yy - zz, yz),
        (wz, xz, yz, 1 - xx - yy + zz),
    )
    # the outer product of the quaternion with itself, times 4: its longest row has the smallest error
    outer = np.stack([np.stack(row, -1) for row in rows], -2)
    longest = np.diagonal(outer, axis1=-2, axis2=-1).argmax(-1)
    quat = np.take_along_axis(outer, longest[..., None, None], -2)[..., 0, :]
    return quat / np.linalg.norm(quat, axis=-1, keepdims=True)
