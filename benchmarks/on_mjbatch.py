"""plat's environment with mjbatch in place of MuJoCo's own batch: ``python on_mjbatch.py ROBOTS current|old MOTIONS``.

Reads lines; collects a rollout for each and answers with its number of steps. For ``benchmarks/compare.py``.
"""

import sys
from typing import Any

import mjbatch
import mujoco
import numpy as np
from rivals import Setup, work_with_plat

from plat.envs import BatchedPhysics

_CURRENT = sys.argv[2] == "current"


class Batch(mjbatch.Batch):
    """``mjbatch.Batch`` with the interface of ``mujoco.batch.Batch`` that plat uses."""

    def __init__(self, model: mujoco.MjModel, nsim: int, nthread: int):
        # forward makes body poses and velocities current with the new state, as MuJoCo's own batch does
        super().__init__(model, nsim, nthread, forward=_CURRENT)
        self.nsim, self.nthread = nsim, nthread
        self._bound: dict[str, np.ndarray] = {}

    def bind(self, name: str) -> np.ndarray:
        """Return the live array of a field."""
        if name not in self._bound:
            self._bound[name] = super().bind(name)
        return self._bound[name]

    def step(self, nstep: int, stage: Any) -> None:
        """Step every simulation."""
        super().step(nstep=nstep)

    def reset(self, ids: np.ndarray, stage: Any) -> None:
        """Reset simulations."""
        super().reset(ids=ids)

    def forward(self, ids: np.ndarray, stage: Any) -> None:
        """Update outputs to the current state."""
        super().forward(ids=ids)


class MjbatchPhysics(BatchedPhysics):
    """Batched physics on mjbatch's pool."""

    def make_batch(self, model: mujoco.MjModel, num_sims: int, num_threads: int) -> Batch:
        """Return mjbatch's pool."""
        return Batch(model, num_sims, num_threads)


if __name__ == "__main__":
    setup = Setup(motions=tuple(sys.argv[3:]), num_envs=int(sys.argv[1]), num_singles=1)
    collect = work_with_plat(setup, learn=False, physics=MjbatchPhysics)
    for _ in sys.stdin:
        print(collect(), flush=True)
