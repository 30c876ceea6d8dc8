"""MuJoCo Warp physics: robots on a GPU, with torch tensors that share its memory."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.envs.physics.protocol import Kinematics
from plat.errors import ConfigError, StateError
from plat.extras import importing
from plat.gpu import check_device
from plat.robots.contact_geoms import colliding_geoms

__all__ = ["WarpPhysics"]

# Fields of the model that each robot has its own values of.
_FIELDS = ("geom_friction", "body_ipos", "body_mass", "body_inertia", "actuator_gainprm", "actuator_biasprm")
# What a step depends on, and readings that are not made from it again.
_STATE = ("qpos", "qvel", "ctrl", "qacc_warmstart", "actuator_force")
# A state beyond this is none, as in MuJoCo (mjMAXVAL).
_BOUND = 1e10


class WarpPhysics:
    """MuJoCo Warp physics: ``num_sims`` copies of a model, in float32, on a GPU or, slowly, on the CPU.

    It implements :class:`plat.envs.physics.Physics`. Shapes in a step depend on the number of robots alone, so on a GPU
    steps are captured as CUDA graphs. Contacts and constraints have room for ``contacts`` and ``constraints`` a robot;
    those beyond are left out, and counted by :meth:`overflowed`.

    Args:
        model: compiled model with a free joint first.
        num_sims: number of simulations N.
        num_threads: has no meaning here.
        device: device of simulation and tensors.
        contacts: contacts that a robot has room for, on average over the robots.
        constraints: rows of constraints that a robot has room for.

    Raises:
        ConfigError: when mujoco-warp is not installed, or does not simulate such a model.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        num_sims: int,
        num_threads: int | None = None,
        device: torch.device | str = "cpu",
        *,
        contacts: int = 64,
        constraints: int = 384,
    ):
        with importing("warp", "physics 'warp' needs", ConfigError):
            import warp

            warp.config.log_level = max(warp.config.log_level, warp.LOG_WARNING)  # a line for each kernel
            import mujoco_warp
        self._warp, self._mujoco_warp = warp, mujoco_warp
        self.model = model
        self.device = check_device(device)
        with self._scope():
            try:
                self._model = mujoco_warp.put_model(model, batch_sizes=dict.fromkeys(_FIELDS, num_sims))
            except NotImplementedError as error:
                raise ConfigError(f"physics 'warp' does not simulate this robot's model: {error}") from error
            self._model.opt.warn_overflow = 0  # a line for each robot and step; overflowed() tells
            self._data = mujoco_warp.make_data(model, num_sims, nconmax=contacts, njmax=constraints)
            self._acceleration = warp.zeros_like(self._data.sensordata)
        self._fields = {name: warp.to_torch(getattr(self._model, name)) for name in _FIELDS}
        self._state = {name: warp.to_torch(getattr(self._data, name)) for name in _STATE}
        self._poses = {
            name: warp.to_torch(getattr(self._data, name)) for name in ("xpos", "xquat", "cvel", "subtree_com")
        }
        self._sensordata, self._felt = (warp.to_torch(a) for a in (self._data.sensordata, self._acceleration))
        self._overflow = warp.to_torch(self._data.overflow)
        self._diverged = torch.zeros(num_sims, dtype=torch.bool, device=self.device)
        self._graphs: dict[int, Any] = {}
        self._stale = True
        self._body_ids: dict[tuple[str, ...], Tensor] = {}
        adr, dim = model.sensor_adr, model.sensor_dim
        self._sensors = {model.sensor(i).name: slice(adr[i], adr[i] + dim[i]) for i in range(model.nsensor)}
        late = torch.zeros(model.nsensordata, dtype=torch.bool)
        for number in (model.sensor_needstage == mujoco.mjtStage.mjSTAGE_ACC).nonzero()[0]:
            late[adr[number] : adr[number] + dim[number]] = True
        self._late = late.to(self.device)
        self._refresh()

    @property
    def num_sims(self) -> int:
        """Return the number of simulations N."""
        return len(self._diverged)

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Hold the joint targets ``[N, J]`` (rad) for ``nstep`` physics steps."""
        self._state["ctrl"].copy_(ctrl)
        if self._stale:
            self._refresh()
        self._run(nstep, lambda: self._advance(nstep))
        qpos, qvel = self._state["qpos"], self._state["qvel"]
        # a comparison with what is not a number is false
        diverged = ~((qpos.abs() < _BOUND).all(-1) & (qvel.abs() < _BOUND).all(-1))
        if diverged.any():  # back to its start, as MuJoCo puts it: NaN would go on to observations and returns
            start = torch.from_numpy(self.model.qpos0).expand(int(diverged.sum()), -1)
            self.set_state(diverged.nonzero()[:, 0], start, torch.zeros(len(start), self.model.nv))
        self._diverged = diverged

    def diverged(self) -> Tensor:
        """Return the mask ``[N]`` of simulations that left all bounds in the last :meth:`step`."""
        return self._diverged

    def overflowed(self) -> Tensor:
        """Return the mask ``[N]`` of simulations that once had more contacts or constraints than there is room for."""
        return self._overflow != 0

    def set_state(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations ``ids`` ``[n]`` into a state: ``qpos`` ``[n, nq]``, ``qvel`` ``[n, nv]``.

        Warm starts, controls and contact sensors go back to 0, and body poses become current.
        """
        ids = ids.to(self.device)
        self._state["qpos"].index_copy_(0, ids, self._here(qpos))
        self._state["qvel"].index_copy_(0, ids, self._here(qvel))
        for values in (self._state["ctrl"], self._state["qacc_warmstart"], self._state["actuator_force"], self._felt):
            values.index_fill_(0, ids, 0.0)
        self._diverged = self._diverged.index_fill(0, ids, False)
        self._refresh()

    def state(self, ids: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return ``qpos`` ``[n, nq]`` and ``qvel`` ``[n, nv]``, float32."""
        return self._of(self._state["qpos"], ids), self._of(self._state["qvel"], ids)

    def kinematics(self, bodies: Sequence[str], ids: Tensor | None = None) -> Kinematics:
        """Return poses and velocities of bodies, and joint torques."""
        rows = self._ids_of(bodies)
        pos_w, quat_w, spatial_vel = (self._of(self._poses[name], ids)[:, rows] for name in ("xpos", "xquat", "cvel"))
        # the velocity is (angular, linear) about the center of mass of the whole tree
        lever = pos_w - self._of(self._poses["subtree_com"], ids)[:, 1:2]
        ang_vel_w = spatial_vel[..., :3].clone()
        lin_vel_w = spatial_vel[..., 3:] + torch.linalg.cross(ang_vel_w, lever)
        return Kinematics(pos_w, quat_w, lin_vel_w, ang_vel_w, self._of(self._state["actuator_force"], ids))

    def sensors(self, ids: Tensor | None = None) -> dict[str, Tensor]:
        """Return the readings ``[n, D]`` of every sensor by its name; contacts are those of the last physics step."""
        readings = torch.where(self._late, self._of(self._felt, ids), self._of(self._sensordata, ids))
        return {name: readings[:, columns] for name, columns in self._sensors.items()}

    def set_friction(self, ids: Tensor, bodies: Sequence[str], friction: Tensor) -> None:
        """Set the sliding friction ``[n]`` of all colliding geoms of some bodies."""
        model, rows = self.model, set(self._ids_of(bodies).tolist())
        geoms = [geom for geom in np.flatnonzero(colliding_geoms(model)).tolist() if model.geom_bodyid[geom] in rows]
        columns = torch.tensor(geoms, device=self.device)
        self._fields["geom_friction"][ids.to(self.device)[:, None], columns, 0] = self._here(friction)[:, None]
        self._stale = True

    def set_com(self, ids: Tensor, body: str, shift: Tensor) -> None:
        """Shift the center of mass of a body by ``[n, 3]`` (m, body frame) from where the model has it."""
        row = self.model.body(body).id
        nominal = self._here(torch.from_numpy(self.model.body_ipos[row].copy()))
        self._fields["body_ipos"][ids.to(self.device), row] = nominal + self._here(shift)
        self._stale = True

    def set_mass(self, ids: Tensor, body: str, change: Tensor) -> None:
        """Add ``[n]`` (kg) to the mass that the model gives a body, its inertia growing in proportion."""
        row = self.model.body(body).id
        nominal, inertia = float(self.model.body_mass[row]), self.model.body_inertia[row].copy()
        factor, rows = 1 + self._here(change) / nominal, ids.to(self.device)
        self._fields["body_mass"][rows, row] = nominal * factor
        self._fields["body_inertia"][rows, row] = self._here(torch.from_numpy(inertia)) * factor[:, None]
        self._stale = True

    def set_gains(self, ids: Tensor, stiffness: Tensor, damping: Tensor) -> None:
        """Set gains of the motors relative to the model's: factors ``[n, J]`` on kp and kd."""
        rows = ids.to(self.device)
        kp = self._here(torch.from_numpy(self.model.actuator_gainprm[:, 0].copy())) * self._here(stiffness)
        kd = self._here(torch.from_numpy(-self.model.actuator_biasprm[:, 2])) * self._here(damping)
        self._fields["actuator_gainprm"][rows, :, 0] = kp
        self._fields["actuator_biasprm"][rows, :, 1] = -kp
        self._fields["actuator_biasprm"][rows, :, 2] = -kd

    def push(self, ids: Tensor, velocity: Tensor) -> None:
        """Add to the velocity of the root ``[n, 6]``: linear (m/s, world), then angular (rad/s, root frame)."""
        self._state["qvel"][ids.to(self.device), :6] += self._here(velocity)
        self._stale = True

    def state_dict(self) -> dict[str, Any]:
        """Return the state from which all simulations go on the same, and each one's model parameters."""
        named = {"state": self._state | {"felt": self._felt}, "fields": self._fields}
        return {group: {name: values.clone() for name, values in each.items()} for group, each in named.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`.

        Raises:
            StateError: when it is of another number of simulations, or of another model or simulator.
        """
        ours = self._state | {"felt": self._felt} | self._fields
        loaded = {**state["state"], **state["fields"]} if isinstance(state["state"], Mapping) else {}
        for name, values in ours.items():
            if name not in loaded or loaded[name].shape != values.shape:
                was = tuple(loaded[name].shape) if name in loaded else "missing"
                raise StateError(f"physics 'warp': {name} of the state is {was}, expected {tuple(values.shape)}")
        for name, values in ours.items():
            values.copy_(loaded[name])
        self._refresh()

    def _advance(self, nstep: int) -> None:
        """Queue physics steps. Position and velocity stages are current before, and behind them again."""
        for number in range(nstep):
            self._mujoco_warp.step2(self._model, self._data)
            if number == nstep - 1:  # the next stage empties all sensors
                self._warp.copy(self._acceleration, self._data.sensordata)
            self._mujoco_warp.step1(self._model, self._data)

    def _refresh(self) -> None:
        """Make position and velocity stages current."""
        self._run(0, lambda: self._mujoco_warp.step1(self._model, self._data))
        self._stale = False

    def _run(self, key: int, queue: Callable[[], None]) -> None:
        """Run what ``queue`` queues: on a GPU as a graph, from the second time on."""
        with self._scope():
            if self.device.type != "cuda":
                queue()
            elif key in self._graphs:
                if self._graphs[key] is None:
                    with self._warp.ScopedCapture() as capture:
                        queue()
                    self._graphs[key] = capture.graph
                self._warp.capture_launch(self._graphs[key])
            else:
                queue()  # loads the kernels, which a capture cannot
                self._graphs[key] = None

    @contextmanager
    def _scope(self) -> Iterator[None]:
        """Work on this device, in the order of torch's own work."""
        if self.device.type != "cuda":
            with self._warp.ScopedDevice("cpu"):
                yield
            return
        with torch.cuda.device(self.device):
            stream = self._warp.stream_from_torch(torch.cuda.current_stream())
            with self._warp.ScopedDevice(stream.device), self._warp.ScopedStream(stream):
                yield

    def _ids_of(self, bodies: Sequence[str]) -> Tensor:
        names = tuple(bodies)
        if names not in self._body_ids:
            ids = [self.model.body(name).id for name in names]
            self._body_ids[names] = torch.tensor(ids, device=self.device)
        return self._body_ids[names]

    def _here(self, values: Tensor) -> Tensor:
        return values.to(self.device, torch.float32)

    def _of(self, values: Tensor, ids: Tensor | None) -> Tensor:
        """Return a copy of the rows of simulations ``ids``; of all when None."""
        return values.clone() if ids is None else values.index_select(0, ids.to(self.device))
