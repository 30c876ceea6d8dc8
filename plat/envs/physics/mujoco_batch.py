"""Batched MuJoCo physics: its native pool of threads over simulations, with torch tensors in and out."""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.envs.physics.protocol import Kinematics
from plat.envs.physics.transfer import to_device
from plat.errors import StateError
from plat.gpu import check_device
from plat.pools import available_cpus
from plat.robots.contact_geoms import colliding_geoms

__all__ = ["BatchedPhysics", "available_cpus"]

# The velocity stage makes body poses and velocities current with the new state; a persistent batch goes on
# from there in its next step, so it costs nothing extra.
_STAGE = mujoco.mjtStage.mjSTAGE_VEL

# Initial time of simulations (s): one with an earlier time was reset by MuJoCo.
_BEGINNING = 1.0

# Fields to bind at once: one that is first bound after a step holds zeros until the next.
_READ = ("xpos", "xquat", "cvel", "subtree_com", "actuator_force", "sensordata")


class BatchedPhysics:
    """Batched MuJoCo physics: ``num_sims`` copies of a model on a pool of CPU threads (``mujoco.batch``).

    It implements :class:`plat.envs.physics.Physics`, and gives access to any field of MuJoCo.

    Every reading method returns float32 copies on ``device``: MuJoCo's own arrays are live views, and a view
    stored in a rollout would change later.

    Args:
        model: compiled model with a free joint first.
        num_sims: number of simulations N.
        num_threads: size of the pool; None takes every CPU that this process may use.
        device: device of the returned tensors.

    >>> from plat.robots import G1
    >>> physics = BatchedPhysics(G1.model(), num_sims=2, num_threads=1)
    >>> physics.set_state(torch.arange(2), torch.as_tensor(G1.default_qpos).expand(2, -1), torch.zeros(2, 35))
    >>> physics.step(G1.default_joint_pos.expand(2, -1), nstep=4)
    >>> physics.state()[0].shape
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
        self.device = check_device(device)
        threads = num_threads or available_cpus()
        self.batch = self.make_batch(model, num_sims, min(threads, num_sims))
        self._qpos = self.batch.bind("qpos")
        self._qvel = self.batch.bind("qvel")
        ctrl = self.batch.bind("ctrl")
        self._ctrl = torch.from_numpy(ctrl)
        self._time = self.batch.bind("time")
        self._rest = [ctrl, self.batch.bind("qacc_warmstart")]
        self._time[:] = _BEGINNING
        self._diverged = torch.zeros(num_sims, dtype=torch.bool, device=self.device)
        for field in _READ:
            self.batch.bind(field)
        self._model_fields: dict[str, Tensor] = {}
        self._body_ids: dict[tuple[str, ...], list[int]] = {}
        adr, dim = model.sensor_adr, model.sensor_dim
        self._sensors = {model.sensor(i).name: slice(adr[i], adr[i] + dim[i]) for i in range(model.nsensor)}
        late = np.repeat(model.sensor_needstage == mujoco.mjtStage.mjSTAGE_ACC, dim)
        self._late = torch.from_numpy(late).to(self.device)
        self._stepped = torch.zeros(num_sims, dtype=torch.bool, device=self.device)
        """Simulations with forces of their own: what MuJoCo holds of others is left from a step before."""

    def make_batch(self, model: mujoco.MjModel, num_sims: int, num_threads: int) -> Any:
        """Return the pool: ``mujoco.batch.Batch``. A subclass may return another one with the same methods."""
        from mujoco.batch import Batch  # older MuJoCos, which other pools come with, lack it

        return Batch(model, num_sims, num_threads, persistent=True)

    @property
    def num_sims(self) -> int:
        """Return the number of simulations N."""
        return self.batch.nsim

    @property
    def num_threads(self) -> int:
        """Return the number of threads that step them."""
        return self.batch.nthread

    def read(self, field: str, index: Sequence[int] | None = None, ids: Tensor | None = None) -> Tensor:
        """Return a copy of an ``MjData`` field ``[N, ...]``, float32, on ``device``.

        Args:
            field: a name that ``mujoco.batch.Batch.bind`` accepts. One that no method of the protocol reads holds
                zeros between its first reading and the next :meth:`step` or :meth:`set_state`.
            index: picks rows of the field's first own dimension (body ids, say).
            ids: simulations ``[n]``, in which case the result is ``[n, ...]``; None for all.
        """
        array = self.batch.bind(field)
        if ids is not None:
            array = array[ids.cpu().numpy()]
        if index is not None:
            array = np.take(array, index, axis=1)
        return to_device(torch.from_numpy(array.astype(np.float32)), self.device)

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Hold the controls ``[N, nu]`` for ``nstep`` physics steps."""
        self._ctrl.copy_(ctrl)
        self.batch.step(nstep=nstep, stage=_STAGE)
        # MuJoCo silently resets a simulation with a bad state or a bad control to its start, upright, at time 0
        self._diverged = torch.from_numpy((self._time < _BEGINNING).reshape(-1)).to(self.device)
        self._stepped = torch.ones_like(self._stepped)

    def diverged(self) -> Tensor:
        """Return the mask ``[N]`` of simulations that MuJoCo gave up on in the last :meth:`step`."""
        return self._diverged

    def set_state(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations ``ids`` ``[n]`` into a state: ``qpos`` ``[n, nq]``, ``qvel`` ``[n, nv]``.

        Warm starts, controls, torques and contact forces go back to 0, and body poses become current.
        """
        rows = ids.cpu().numpy()
        if rows.size == 0:
            return
        # all state that a step depends on: clearing the rest of the simulation's memory would double the cost
        for values in self._rest:
            values[rows] = 0
        self._time[rows] = _BEGINNING
        self._qpos[rows] = qpos.cpu().numpy()
        self._qvel[rows] = qvel.cpu().numpy()
        self.batch.forward(ids=rows, stage=_STAGE)
        self._stepped = self._stepped.index_fill(0, ids.to(self.device), False)

    def state(self, ids: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return ``qpos`` ``[n, nq]`` and ``qvel`` ``[n, nv]``."""
        return self.read("qpos", ids=ids), self.read("qvel", ids=ids)

    def kinematics(self, bodies: Sequence[str], ids: Tensor | None = None) -> Kinematics:
        """Return poses and velocities of bodies, and joint torques."""
        rows = self._ids_of(bodies)
        pos_w = self.read("xpos", rows, ids)
        # MuJoCo's cvel is (angular, linear) about the center of mass of the whole tree
        spatial_vel = self.read("cvel", rows, ids)
        lever = pos_w - self.read("subtree_com", [1], ids)
        ang_vel_w = spatial_vel[..., :3]
        lin_vel_w = spatial_vel[..., 3:] + torch.linalg.cross(ang_vel_w, lever)
        quat_w, torque = self.read("xquat", rows, ids), self.read("actuator_force", ids=ids)
        torque = torch.where(self._has_forces(ids), torque, 0.0)
        return Kinematics(pos_w, quat_w, lin_vel_w, ang_vel_w, torque)

    def sensors(self, ids: Tensor | None = None) -> dict[str, Tensor]:
        """Return the readings ``[n, D]`` of every sensor by its name; forces are those of the last physics step."""
        readings = self.read("sensordata", ids=ids)
        readings = torch.where(self._has_forces(ids) | ~self._late, readings, 0.0)
        return {name: readings[:, columns] for name, columns in self._sensors.items()}

    def set_friction(self, ids: Tensor, bodies: Sequence[str], friction: Tensor) -> None:
        """Set the sliding friction ``[n]`` of all colliding geoms of some bodies."""
        model, rows = self.model, self._ids_of(bodies)
        geoms = [geom for geom in np.flatnonzero(colliding_geoms(model)).tolist() if model.geom_bodyid[geom] in rows]
        values = friction.cpu().double()
        self.model_field("geom_friction")[ids.cpu()[:, None], geoms, 0] = values[:, None]

    def set_com(self, ids: Tensor, body: str, shift: Tensor) -> None:
        """Shift the center of mass of a body by ``[n, 3]`` (m, body frame) from where the model has it."""
        (row,) = self._ids_of((body,))
        nominal = torch.from_numpy(self.model.body_ipos[row].copy())
        self.model_field("body_ipos")[ids.cpu(), row] = nominal + shift.cpu().double()

    def set_mass(self, ids: Tensor, body: str, change: Tensor) -> None:
        """Add ``[n]`` (kg) to the mass that the model gives a body, its inertia growing in proportion."""
        (row,) = self._ids_of((body,))
        nominal, inertia = float(self.model.body_mass[row]), torch.from_numpy(self.model.body_inertia[row].copy())
        factor = 1 + change.cpu().double() / nominal
        self.model_field("body_mass")[ids.cpu(), row] = nominal * factor
        self.model_field("body_inertia")[ids.cpu(), row] = inertia * factor[:, None]

    def set_gains(self, ids: Tensor, stiffness: Tensor, damping: Tensor) -> None:
        """Set gains of the motors relative to the model's: factors ``[n, J]`` on kp and kd."""
        rows = ids.cpu()
        kp = torch.from_numpy(self.model.actuator_gainprm[:, 0].copy()) * stiffness.cpu().double()
        kd = torch.from_numpy(-self.model.actuator_biasprm[:, 2]) * damping.cpu().double()
        self.model_field("actuator_gainprm")[rows, :, 0] = kp
        bias = self.model_field("actuator_biasprm")
        bias[rows, :, 1] = -kp
        bias[rows, :, 2] = -kd

    def push(self, ids: Tensor, velocity: Tensor) -> None:
        """Add to the velocity of the root ``[n, 6]``: linear (m/s, world), then angular (rad/s, root frame)."""
        self._qvel[ids.cpu().numpy(), :6] += velocity.cpu().numpy()

    def _has_forces(self, ids: Tensor | None) -> Tensor:
        """Return the mask ``[n, 1]`` of simulations that made a step in the state that they have."""
        stepped = self._stepped if ids is None else self._stepped[ids.to(self.device)]
        return stepped[:, None]

    def _ids_of(self, bodies: Sequence[str]) -> list[int]:
        names = tuple(bodies)
        if names not in self._body_ids:
            self._body_ids[names] = [self.model.body(name).id for name in names]
        return self._body_ids[names]

    def model_field(self, field: str) -> Tensor:
        """Return per-simulation values ``[N, ...]`` of an ``MjModel`` field, float64, shared with the simulations.

        Write into them in place; call :meth:`update_constants` after fields that others are derived from
        (masses, inertial frames).
        """
        if field not in self._model_fields:
            self._model_fields[field] = torch.from_numpy(self.batch.expand(field))
        return self._model_fields[field]

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which all simulations go on the same: MuJoCo's, and each one's model parameters."""
        fields = {name: values.clone() for name, values in self._model_fields.items()}
        return {"state": torch.from_numpy(self.batch.state.copy()), "fields": fields}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        Raises:
            StateError: when it is of another number of simulations, or of another model.
        """
        rows = state["state"].cpu().numpy()
        if rows.shape != self.batch.state.shape:
            raise StateError(
                f"physics: a state of {rows.shape[0]} simulations with {rows.shape[1]} numbers each, expected "
                f"{self.batch.state.shape[0]} with {self.batch.state.shape[1]}"
            )
        for name, values in state["fields"].items():
            self.model_field(name).copy_(values)
        self.batch.state[:] = rows
        self.batch.forward(stage=_STAGE)
        self._stepped = torch.zeros_like(self._stepped)

    def update_constants(self) -> None:
        """Recompute the constants that MuJoCo derives from the model (``mj_setConst``) in every simulation."""
        self.batch.set_const()
