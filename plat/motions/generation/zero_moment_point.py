"""Balance: center of mass from the zero-moment point, and the zero-moment point of the whole body."""

import mujoco
import numpy as np
import torch
from torch import Tensor

__all__ = ["InvertedPendulum", "VaryingPendulum", "ground_reaction", "zero_moment_point", "zmp_of"]

_GRAVITY = 9.81


class InvertedPendulum:
    """Center-of-mass trajectory whose zero-moment point follows a given one.

    The linear inverted pendulum has its zero-moment point at ``c - (h / g) c''``. Discretized, with the motion at
    rest over its first and last point, that is a linear system in all frames at once. Its solution anticipates every
    step, as preview control does.

    Args:
        count: number of frames F.
        height: of the center of mass above the floor (m).
        dt: seconds per frame.

    Source: Kajita et al., "Biped walking pattern generation by using preview control of zero-moment point", 2003.

    >>> still = np.full((20, 2), 0.1)
    >>> np.allclose(InvertedPendulum(20, 0.7, 0.02).com(still), still)
    True
    """

    def __init__(self, count: int, height: float, dt: float):
        coupling = height / (_GRAVITY * dt**2)
        system = torch.eye(count, dtype=torch.float64)
        inner = torch.arange(1, count - 1)
        system[inner, inner] += 2 * coupling
        system[inner, inner - 1] -= coupling
        system[inner, inner + 1] -= coupling
        self._factors = torch.linalg.lu_factor(system)

    def com(self, zmp: np.ndarray) -> np.ndarray:
        """Return the horizontal center of mass ``[F, 2]`` (m) for a zero-moment point ``[F, 2]`` (m)."""
        solution: Tensor = torch.linalg.lu_solve(*self._factors, torch.from_numpy(zmp))
        return solution.numpy()


def zero_moment_point(model: mujoco.MjModel, qpos: np.ndarray, dt: float) -> np.ndarray:
    """Compute the zero-moment point, where the ground reaction has no horizontal moment, by the dynamics of all bodies.

    Velocities and accelerations are finite differences; MuJoCo's inverse dynamics without contacts give the force
    and the moment on the root that the motion needs, and these must come from the ground.

    Args:
        model: a robot with a free joint first.
        qpos: ``[F, nq]``, evenly spaced in time.
        dt: seconds a frame.

    Returns:
        ``[F, 2]`` (m, world); the first and the last frame are taken to be at rest.

    Source: Vukobratovic and Borovac, "Zero-moment point - thirty five years of its life", 2004.
    """
    force, moment = ground_reaction(model, qpos, dt)
    return zmp_of(force, moment, qpos)


def zmp_of(force: np.ndarray, moment: np.ndarray, qpos: np.ndarray, least: float | None = None) -> np.ndarray:
    """Return the zero-moment point ``[F, 2]`` (m) of a ground reaction as :func:`ground_reaction` gives it.

    A vertical force under ``least`` (N) is taken to be that much, for in flight there is no such point.
    """
    x, y, z = qpos[:, :3].T
    vertical = force[:, 2] if least is None else np.maximum(force[:, 2], least)
    return np.stack(
        (x - (moment[:, 1] + z * force[:, 0]) / vertical, y + (moment[:, 0] - z * force[:, 1]) / vertical), -1
    )


def ground_reaction(model: mujoco.MjModel, qpos: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the force ``[F, 3]`` (N) and the moment about the root ``[F, 3]`` (N m, world) that a motion needs.

    Arguments as for :func:`zero_moment_point`.
    """
    data = mujoco.MjData(model)
    flags = int(model.opt.disableflags)
    model.opt.disableflags = flags | mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    between = np.zeros((len(qpos) + 1, model.nv))  # velocities before and after every frame
    for frame in range(1, len(qpos)):
        mujoco.mj_differentiatePos(model, between[frame], dt, qpos[frame - 1], qpos[frame])
    force, moment = np.empty((len(qpos), 3)), np.empty((len(qpos), 3))
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        rest = frame in (0, len(qpos) - 1)
        data.qvel[:] = 0.0 if rest else (between[frame] + between[frame + 1]) / 2
        data.qacc[:] = 0.0 if rest else (between[frame + 1] - between[frame]) / dt
        mujoco.mj_inverse(model, data)
        force[frame], moment[frame] = data.qfrc_inverse[:3], data.xmat[1].reshape(3, 3) @ data.qfrc_inverse[3:6]
    model.opt.disableflags = flags
    return force, moment


class VaryingPendulum:
    """Horizontal center of mass over a given zero-moment point, where its height is given and varies.

    With height ``z`` the pendulum obeys ``c'' = (z'' + g) / z (c - p)``. In flight ``z'' = -g``, and the center of mass
    goes straight on. The motion is at rest over its first and last point.

    Args:
        height: of the center of mass above the floor ``[F]`` (m).
        dt: seconds per frame.

    >>> still = np.full((20, 2), 0.1)
    >>> np.allclose(VaryingPendulum(np.full(20, 0.7), 0.02).com(still), still)
    True
    """

    def __init__(self, height: np.ndarray, dt: float):
        vertical = np.zeros(len(height))
        vertical[1:-1] = np.diff(height, n=2) / dt**2
        self.load = (vertical / _GRAVITY + 1).clip(0)
        """Vertical force ``[F]``, in units of weight."""
        self._coupling = self.load * _GRAVITY / height * dt**2

    def com(self, zmp: np.ndarray) -> np.ndarray:
        """Return the horizontal center of mass ``[F, 2]`` (m) for a zero-moment point ``[F, 2]`` (m)."""
        bands = np.ones((3, len(zmp)))
        bands[1] = -2 - self._coupling
        right = -self._coupling[:, None] * zmp
        for end, inner in ((0, (0, 1)), (-1, (2, -2))):
            bands[1, end], bands[inner], right[end] = 1.0, 0.0, zmp[end]
        return _solve_tridiagonal(bands, right)


def _solve_tridiagonal(bands: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve for ``[F, K]``; ``bands`` ``[3, F]``: above (its column), on and below the diagonal, as LAPACK has them."""
    above, middle, below = bands
    count = len(right)
    factor, solution = np.zeros(count), np.array(right, dtype=np.float64)
    pivot = middle[0]
    solution[0] /= pivot
    for row in range(1, count):
        factor[row] = above[row] / pivot
        pivot = middle[row] - below[row - 1] * factor[row]
        solution[row] = (solution[row] - below[row - 1] * solution[row - 1]) / pivot
    for row in range(count - 2, -1, -1):
        solution[row] -= factor[row + 1] * solution[row + 1]
    return solution
