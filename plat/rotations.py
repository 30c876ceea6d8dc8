r"""Rotations as unit quaternions in ``wxyz`` order, batched over leading dimensions.

A quaternion named ``a_quat_w`` turns vectors of frame ``a`` into the world frame:
``v_w = quat_rotate(a_quat_w, v_a)``. :mod:`plat.rotations_np` is the twin of this module for code without torch.
"""

import numpy as np
import torch
from torch import Tensor

from plat.gpu import constant, on_gpu, overhead_bound
from plat.precision import autocast

__all__ = [
    "matrix_to_sixd",
    "quat_angle",
    "quat_conjugate",
    "quat_from_rotvec",
    "quat_multiply",
    "quat_nlerp",
    "quat_rotate",
    "quat_rotate_inverse",
    "quat_slerp",
    "quat_tilt",
    "quat_to_matrix",
    "quat_to_rotvec",
    "quat_yaw",
    "rows_times_matrices",
    "yaw_multiply",
    "yaw_rotate",
]


_CONJUGATE = torch.tensor([1.0, -1, -1, -1])
# of the matrix that a product's left quaternion is to the right one, row by row
_PRODUCT_PARTS = torch.tensor([0, 1, 2, 3, 1, 0, 3, 2, 2, 3, 0, 1, 3, 2, 1, 0])
_PRODUCT_SIGNS = torch.tensor([1.0, -1, -1, -1, 1, 1, -1, 1, 1, 1, 1, -1, 1, -1, 1, 1])


def _matrix_of_products() -> Tensor:
    """Matrix ``[16, 9]`` that makes a rotation matrix less the identity of all products of a quaternion's entries."""
    signs = {
        (0, 0): {"yy": -2, "zz": -2}, (0, 1): {"xy": 2, "wz": -2}, (0, 2): {"xz": 2, "wy": 2},
        (1, 0): {"xy": 2, "wz": 2}, (1, 1): {"xx": -2, "zz": -2}, (1, 2): {"yz": 2, "wx": -2},
        (2, 0): {"xz": 2, "wy": -2}, (2, 1): {"yz": 2, "wx": 2}, (2, 2): {"xx": -2, "yy": -2},
    }  # fmt: skip
    out = torch.zeros(16, 9)
    for (row, column), products in signs.items():
        for pair, sign in products.items():
            out[4 * "wxyz".index(pair[0]) + "wxyz".index(pair[1]), 3 * row + column] = sign
    return out


_MATRIX_OF_PRODUCTS = _matrix_of_products()
_IDENTITY = torch.eye(3).flatten()


def quat_conjugate(quat: Tensor) -> Tensor:
    """Return the inverse of unit quaternions ``[*B, 4]``."""
    return quat * constant(_CONJUGATE, quat)


def quat_multiply(a: Tensor, b: Tensor) -> Tensor:
    """Return the Hamilton product ``a * b`` of ``[*B, 4]``: rotation by ``b``, then by ``a``.

    >>> half_turn = torch.tensor([0.0, 0.0, 0.0, 1.0])
    >>> quat_multiply(half_turn, half_turn).tolist()
    [-1.0, 0.0, 0.0, 0.0]
    """
    if overhead_bound(a):
        left = a.index_select(-1, constant(_PRODUCT_PARTS, a.device)) * constant(_PRODUCT_SIGNS, a)
        return (left.unflatten(-1, (4, 4)) * b[..., None, :]).sum(-1)
    aw, ax, ay, az = a.unbind(-1)
    bw, bx, by, bz = b.unbind(-1)
    return torch.stack(
        (
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ),
        -1,
    )


def quat_rotate(quat: Tensor, vec: Tensor) -> Tensor:
    """Rotate vectors ``[*B, 3]`` by quaternions ``[*B, 4]`` (leading dimensions broadcast).

    >>> quarter_turn_about_z = torch.tensor([0.5**0.5, 0.0, 0.0, 0.5**0.5])
    >>> quat_rotate(quarter_turn_about_z, torch.tensor([1.0, 0.0, 0.0])).round(decimals=4).tolist()
    [0.0, 1.0, 0.0]
    """
    if on_gpu(vec):
        return (quat_to_matrix(quat) * vec[..., None, :]).sum(-1)
    axis, vec = torch.broadcast_tensors(quat[..., 1:], vec)
    twice_cross = 2.0 * torch.linalg.cross(axis, vec)
    return torch.addcmul(vec, quat[..., :1], twice_cross) + torch.linalg.cross(axis, twice_cross)


def quat_rotate_inverse(quat: Tensor, vec: Tensor) -> Tensor:
    """Rotate vectors ``[*B, 3]`` by the inverse of ``[*B, 4]``: from the world into a body's frame."""
    if on_gpu(vec):
        return (quat_to_matrix(quat) * vec[..., :, None]).sum(-2)
    return quat_rotate(quat_conjugate(quat), vec)


def quat_to_matrix(quat: Tensor) -> Tensor:
    """Return the rotation matrices ``[*B, 3, 3]`` of unit quaternions ``[*B, 4]``.

    Row vectors go the other way: ``v_w @ quat_to_matrix(a_quat_w)`` is ``v_a``. That form turns many
    points by one rotation in a single matrix product: :func:`rows_times_matrices`.
    """
    if overhead_bound(quat):
        products = (quat[..., :, None] * quat[..., None, :]).flatten(-2)
        with autocast(quat.device, "float32"):
            return (constant(_IDENTITY, quat) + products @ constant(_MATRIX_OF_PRODUCTS, quat)).unflatten(-1, (3, 3))
    w, x, y, z = quat.unbind(-1)
    xx, yy, zz = 2 * x * x, 2 * y * y, 2 * z * z
    xy, xz, yz = 2 * x * y, 2 * x * z, 2 * y * z
    wx, wy, wz = 2 * w * x, 2 * w * y, 2 * w * z
    return torch.stack(
        (1 - yy - zz, xy - wz, xz + wy, xy + wz, 1 - xx - zz, yz - wx, xz - wy, yz + wx, 1 - xx - yy), -1
    ).unflatten(-1, (3, 3))


def rows_times_matrices(vec: Tensor, matrix: Tensor) -> Tensor:
    """Compute ``vec @ matrix`` of row vectors ``[*B, K, 3]`` and ``[*B, 3, 3]`` (leading dimensions broadcast).

    >>> quarter_turn_about_z = quat_to_matrix(torch.tensor([0.5**0.5, 0.0, 0.0, 0.5**0.5]))
    >>> rows_times_matrices(torch.tensor([[0.0, 1.0, 0.0]]), quarter_turn_about_z).round(decimals=4).tolist()
    [[1.0, 0.0, 0.0]]
    """
    if vec.device.type == "cpu" and not (vec.requires_grad or matrix.requires_grad):
        # PyTorch takes five times as long as NumPy for many products this small
        return torch.from_numpy(np.matmul(vec.numpy(), matrix.numpy()))
    return vec @ matrix


def matrix_to_sixd(matrix: Tensor) -> Tensor:
    """Return the first two columns of ``[*B, 3, 3]`` as ``[*B, 6]``: the continuous 6D rotation.

    Source: Zhou et al., "On the Continuity of Rotation Representations in Neural Networks",
    arXiv 1812.07035.
    """
    return matrix[..., :2].transpose(-1, -2).flatten(-2)


def quat_from_rotvec(rotvec: Tensor) -> Tensor:
    """Return unit quaternions ``[*B, 4]`` of rotation vectors ``[*B, 3]`` (axis times angle, rad)."""
    half = 0.5 * torch.linalg.vector_norm(rotvec, dim=-1, keepdim=True)
    # sinc keeps the small-angle limit exact: sin(half) / (2 half) -> 1/2
    return torch.cat((half.cos(), 0.5 * torch.sinc(half / torch.pi) * rotvec), -1)


def quat_to_rotvec(quat: Tensor) -> Tensor:
    """Return rotation vectors ``[*B, 3]`` (axis times angle in ``[0, pi]``, rad) of unit quaternions."""
    quat = torch.where(quat[..., :1] < 0, -quat, quat)
    sine = torch.linalg.vector_norm(quat[..., 1:], dim=-1, keepdim=True)
    angle = 2.0 * torch.atan2(sine, quat[..., :1])
    scale = torch.where(sine > 1e-7, angle / sine.clamp_min(1e-7), 2.0)
    return scale * quat[..., 1:]


def quat_angle(a: Tensor, b: Tensor) -> Tensor:
    """Return the angle ``[*B]`` (rad, in ``[0, pi]``) of the rotation that takes ``a`` to ``b``.

    >>> quat_angle(torch.tensor([1.0, 0, 0, 0]), torch.tensor([0.0, 0, 1, 0])).item()  # doctest: +ELLIPSIS
    3.14159...
    """
    # The chord between unit quaternions is 2 sin(angle / 4); b and -b are the same rotation. Accurate at small angles,
    # where the arc cosine of the dot product is not, and a quarter of the cost of the relative rotation.
    squared_chord = torch.minimum(_squared_norm(a - b), _squared_norm(a + b))
    return 4.0 * torch.asin(0.5 * squared_chord.sqrt())


def _squared_norm(quat: Tensor) -> Tensor:
    # component by component: reducing over a last dimension of 4 is several times slower
    w, x, y, z = quat.square().unbind(-1)
    return w + x + y + z


def quat_yaw(quat: Tensor) -> Tensor:
    """Return the heading of ``[*B, 4]``: its rotation about the world's vertical, as a quaternion."""
    w, x, y, z = quat.unbind(-1)
    half_yaw = 0.5 * torch.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    zero = torch.zeros_like(half_yaw)
    return torch.stack((half_yaw.cos(), zero, zero, half_yaw.sin()), -1)


def quat_tilt(quat: Tensor) -> Tensor:
    """Return the vertical component ``[*B]`` of gravity in the frame of a body ``[*B, 4]``: -1 when it is upright.

    >>> quat_tilt(torch.tensor([1.0, 0.0, 0.0, 0.0])).item()
    -1.0
    """
    return 2 * quat[..., 1:3].square().sum(-1) - 1


def yaw_multiply(yaw: Tensor, quat: Tensor) -> Tensor:
    """Compute ``quat_multiply(yaw, quat)`` for a rotation about the vertical ``[*B, 4]``, at a third of the cost."""
    w, x, y, z = quat.unbind(-1)
    cosine, sine = yaw[..., 0], yaw[..., 3]
    return torch.stack((cosine * w - sine * z, cosine * x - sine * y, cosine * y + sine * x, cosine * z + sine * w), -1)


def yaw_rotate(yaw: Tensor, vec: Tensor) -> Tensor:
    """Compute ``quat_rotate(yaw, vec)`` for a rotation about the vertical ``[*B, 4]``, at a third of the cost."""
    x, y, z = vec.unbind(-1)
    half_cosine, half_sine = yaw[..., 0], yaw[..., 3]
    cosine, sine = half_cosine.square() - half_sine.square(), 2 * half_cosine * half_sine
    return torch.stack((cosine * x - sine * y, sine * x + cosine * y, z.expand_as(cosine * x)), -1)


def quat_nlerp(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Interpolate between ``a`` and ``b`` ``[*B, 4]`` along the shorter arc, at no constant speed: faster than slerp.

    ``weight`` ``[*B]`` is in 0..1.

    >>> quat_nlerp(torch.tensor([1.0, 0, 0, 0]), torch.tensor([0, 0, 0, -1.0]), torch.tensor(0.5))
    tensor([ 0.7071,  0.0000,  0.0000, -0.7071])
    """
    same_side = (a * b).sum(-1, keepdim=True) >= 0
    return torch.nn.functional.normalize(a.lerp(torch.where(same_side, b, -b), weight[..., None]), dim=-1)


def quat_slerp(a: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Interpolate between ``a`` and ``b`` ``[*B, 4]`` along the shorter arc; ``weight`` ``[*B]`` in 0..1."""
    step = quat_to_rotvec(quat_multiply(quat_conjugate(a), b))
    return quat_multiply(a, quat_from_rotvec(weight[..., None] * step))
