"""Where the centre of mass must be for the robot not to tip over."""

import torch
from torch import Tensor

__all__ = ["com_from_zmp"]

_GRAVITY = 9.81


def com_from_zmp(zmp: Tensor, height: float, dt: float) -> Tensor:
    """Centre of mass whose zero-moment point follows ``zmp``.

    The linear inverted pendulum has its zero-moment point at ``c - (h / g) c''``. Discretised, with the motion at
    rest over its first and last point, that is a linear system in all frames at once; its solution leans into every
    step before it begins, as preview control does.

    Args:
        zmp: wanted zero-moment point ``[F, 2]`` (m).
        height: of the centre of mass above the floor (m).
        dt: seconds a frame.

    Returns:
        Horizontal centre of mass ``[F, 2]`` (m).

    Source: Kajita et al., "Biped walking pattern generation by using preview control of zero-moment point", 2003.

    >>> still = torch.full((20, 2), 0.1, dtype=torch.float64)
    >>> torch.allclose(com_from_zmp(still, 0.7, 0.02), still)
    True
    """
    count = len(zmp)
    coupling = height / (_GRAVITY * dt**2)
    system = torch.eye(count, dtype=zmp.dtype)
    inner = torch.arange(1, count - 1)
    system[inner, inner] += 2 * coupling
    system[inner, inner - 1] -= coupling
    system[inner, inner + 1] -= coupling
    return torch.linalg.solve(system, zmp)
