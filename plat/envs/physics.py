"""Many robots in one native thread pool: ``mujoco.batch.Batch`` with torch in and out."""

import os
from collections.abc import Sequence

import mujoco
import numpy as np
import torch
from mujoco.batch import Batch
from torch import Tensor

__all__ = ["BatchedPhysics", "available_cpus"]

# The velocity stage makes body poses and velocities current with the new state; a persistent batch goes on
# from there in its next step, so it costs nothing extra.
_STAGE = mujoco.mjtStage.mjSTAGE_VEL


class BatchedPhysics:
    """Simulates ``num_sims`` copies of a model on a pool of CPU threads.

    Every method that reads returns float32 copies on ``device``: MuJoCo's own arrays are live views, and a view
    kept in a rollout would change under its owner.

    Args:
        model: compiled model with a free joint first.
        num_sims: number of simulations N.
        num_threads: size of the pool; None takes every CPU that this process may use.
        device: where tensors are handed out.

    >>> from plat.robots import G1
    >>> physics = BatchedPhysics(G1.model(), num_sims=2, num_threads=1)
    >>> physics.set_state(torch.arange(2), torch.as_tensor(G1.default_qpos).expand(2, -1), torch.zeros(2, 35))
    >>> physics.step(G1.default_joint_pos.expand(2, -1), nstep=4)
    >>> physics.read("qpos").shape
    torch.Size([2, 36])
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        num_sims: int,
        num_threads: int | None = None,
        device: torch.device | str = "cpu",
    ):
        self.model = model
        self.device = torch.device(device)
        threads = num_threads or available_cpus()
        self.batch = Batch(model, num_sims, min(threads, num_sims), persistent=True)
        self._qpos = self.batch.bind("qpos")
        self._qvel = self.batch.bind("qvel")
        ctrl = self.batch.bind("ctrl")
        self._ctrl = torch.from_numpy(ctrl)
        self._rest = [ctrl, self.batch.bind("qacc_warmstart"), self.batch.bind("time")]
        self._model_fields: dict[str, Tensor] = {}

    @property
    def num_sims(self) -> int:
        """Number of simulations N."""
        return self.batch.nsim

    @property
    def num_threads(self) -> int:
        """Number of threads that step them."""
        return self.batch.nthread

    def read(self, field: str, index: Sequence[int] | None = None, ids: Tensor | None = None) -> Tensor:
        """Copy of an ``MjData`` field ``[N, ...]``, float32, on ``device``.

        Args:
            field: a name that ``mujoco.batch.Batch.bind`` accepts. A field that is read for the first time
                holds zeros until the next :meth:`step` or :meth:`set_state`.
            index: picks rows of the field's first own dimension (body ids, say).
            ids: simulations ``[n]``, in which case the result is ``[n, ...]``; None for all.
        """
        array = self.batch.bind(field)
        if ids is not None:
            array = array[ids.cpu().numpy()]
        if index is not None:
            array = np.take(array, index, axis=1)
        return torch.from_numpy(array.astype(np.float32)).to(self.device)

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Hold the controls ``[N, nu]`` for ``nstep`` physics steps."""
        self._ctrl.copy_(ctrl)
        self.batch.step(nstep=nstep, stage=_STAGE)

    def set_state(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations ``ids`` ``[n]`` into a state: ``qpos`` ``[n, nq]``, ``qvel`` ``[n, nv]``.

        Warm starts, controls and time go back to 0, and body poses become current.
        """
        rows = ids.cpu().numpy()
        if rows.size == 0:
            return
        # all that a step goes on from: clearing the rest of the simulation's memory as well would cost as much again
        for values in self._rest:
            values[rows] = 0
        self._qpos[rows] = qpos.cpu().numpy()
        self._qvel[rows] = qvel.cpu().numpy()
        self.batch.forward(ids=rows, stage=_STAGE)

    def add_velocity(self, ids: Tensor, delta: Tensor) -> None:
        """Add ``delta`` ``[n, nv]`` to the generalised velocities of simulations ``ids`` ``[n]``."""
        self._qvel[ids.cpu().numpy()] += delta.cpu().numpy()

    def model_field(self, field: str) -> Tensor:
        """Per-simulation values ``[N, ...]`` of an ``MjModel`` field, float64, shared with the simulations.

        Write into them in place; call :meth:`update_constants` after fields that others are derived from
        (masses, inertial frames).
        """
        if field not in self._model_fields:
            self._model_fields[field] = torch.from_numpy(self.batch.expand(field))
        return self._model_fields[field]

    def update_constants(self) -> None:
        """Recompute what MuJoCo derives from the model (``mj_setConst``) in every simulation."""
        self.batch.set_const()


def available_cpus() -> int:
    """Number of CPUs that this process may use."""
    # macOS and Windows have no affinity masks
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
