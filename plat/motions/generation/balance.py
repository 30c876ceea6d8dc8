"""Balance: center of mass from the zero-moment point, and the zero-moment point of the whole body."""

import mujoco
import numpy as np
import torch
from torch import Tensor

__all__ = ["InvertedPendulum", "zero_moment_point"]

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
    data = mujoco.MjData(model)
    flags = int(model.opt.disableflags)
    model.opt.disableflags = flags | mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    between = np.zeros((len(qpos) + 1, model.nv))  # velocities before and after every frame
    for frame in range(1, len(qpos)):
        mujoco.mj_differentiatePos(model, between[frame], dt, qpos[frame - 1], qpos[frame])
    result = np.empty((len(qpos), 2))
    for frame, pose in enumerate(qpos):
        data.qpos[:] = pose
        rest = frame in (0, len(qpos) - 1)
        data.qvel[:] = 0.0 if rest else (between[frame] + between[frame + 1]) / 2
        data.qacc[:] = 0.0 if rest else (between[frame + 1] - between[frame]) / dt
        mujoco.mj_inverse(model, data)
        force, moment = data.qfrc_inverse[:3], data.xmat[1].reshape(3, 3) @ data.qfrc_inverse[3:6]
        x, y, z = pose[:3]
        result[frame] = x - (moment[1] + z * force[0]) / force[2], y + (moment[0] - z * force[1]) / force[2]
    model.opt.disableflags = flags
    return result
