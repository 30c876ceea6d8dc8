"""Physics protocol: the interface between environments and their simulator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import torch
from torch import Tensor

__all__ = ["Kinematics", "Physics", "PhysicsFactory"]


@dataclass(frozen=True)
class Kinematics:
    """Poses and velocities of bodies, and torques of all joints, in float32. ``w`` is the world frame."""

    body_pos_w: Tensor
    """origins of the bodies ``[n, K, 3]`` (m)"""
    body_quat_w: Tensor
    """orientations ``[n, K, 4]``: ``wxyz``, body to world"""
    body_lin_vel_w: Tensor
    """velocities of the origins ``[n, K, 3]`` (m/s)"""
    body_ang_vel_w: Tensor
    """angular velocities ``[n, K, 3]`` (rad/s)"""
    joint_torque: Tensor
    """torques of the actuators ``[n, J]`` (N m)"""


class Physics(Protocol):
    """Protocol of a simulator of ``num_sims`` robots that share a model.

    All tensors are on the device that the physics was made for, and stay unchanged once returned. ``ids`` ``[n]`` are
    indices of simulations, without repetition; None stands for all. Readings belong to the last :meth:`step` or
    :meth:`set_state`.

    Bodies and sensors have the names of the model. A joint vector ``[J]`` is in the order of the model's hinges.
    """

    @property
    def num_sims(self) -> int:
        """Return the number of simulations N."""

    def step(self, ctrl: Tensor, nstep: int) -> None:
        """Hold the joint targets ``[N, J]`` (rad) for ``nstep`` physics steps. They must be finite."""

    def diverged(self) -> Tensor:
        """Return the mask ``[N]`` of simulations that left all bounds in the last :meth:`step`.

        Their state after it is meaningless, but finite; :meth:`set_state` restores them.
        """

    def set_state(self, ids: Tensor, qpos: Tensor, qvel: Tensor) -> None:
        """Put simulations into a state: ``qpos`` ``[n, 7 + J]`` and ``qvel`` ``[n, 6 + J]`` in MuJoCo's conventions.

        Earlier state is discarded, except for the parameters that the other setters changed.
        """

    def state(self, ids: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return ``qpos`` ``[n, 7 + J]`` and ``qvel`` ``[n, 6 + J]``, float32."""

    def kinematics(self, bodies: Sequence[str], ids: Tensor | None = None) -> Kinematics:
        """Return poses and velocities of bodies, and joint torques."""

    def sensors(self, ids: Tensor | None = None) -> dict[str, Tensor]:
        """Return the readings ``[n, D]`` of every sensor by its name, float32."""

    def set_friction(self, ids: Tensor, bodies: Sequence[str], friction: Tensor) -> None:
        """Set the sliding friction ``[n]`` of all colliding geoms of some bodies."""

    def set_com(self, ids: Tensor, body: str, shift: Tensor) -> None:
        """Shift the center of mass of a body by ``[n, 3]`` (m, body frame) from where the model has it."""

    def set_mass(self, ids: Tensor, body: str, change: Tensor) -> None:
        """Add ``[n]`` (kg) to the mass that the model gives a body, its inertia growing in proportion."""

    def set_gains(self, ids: Tensor, stiffness: Tensor, damping: Tensor) -> None:
        """Set gains of the motors relative to the model's: factors ``[n, J]`` on kp and kd."""

    def push(self, ids: Tensor, velocity: Tensor) -> None:
        """Add to the velocity of the root ``[n, 6]``: linear (m/s, world), then angular (rad/s, root frame)."""

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next :meth:`step` depends on, as tensors and numbers: states and parameters.

        A resumed training run goes on from it. A simulator without it cannot be resumed.
        """

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore a state of :meth:`state_dict`."""


class PhysicsFactory(Protocol):
    """Protocol of a factory for an environment's physics; a class such as :class:`plat.envs.BatchedPhysics` is one."""

    def __call__(
        self, model: mujoco.MjModel, num_sims: int, num_threads: int | None, device: torch.device | str
    ) -> Physics:
        """Create the physics.

        Args:
            model: compiled model with a free joint first.
            num_sims: number of simulations N.
            num_threads: number of CPU threads; None takes all CPUs.
            device: device of the returned tensors.
        """
