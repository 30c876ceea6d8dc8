"""Disturbances of known strength: pushes, friction, payload, latency, motor gains and sensor noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any

import mujoco
import numpy as np
import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.bounds import Bounded, Natural, NonNegative, Range
from plat.envs.physics import BatchedPhysics, Physics, PhysicsFactory
from plat.envs.tracking import MotionTrackingEnv
from plat.envs.transforms import NoiseLevels
from plat.envs.transforms.settings import RandomizationRanges
from plat.evaluation.clip_draws import ClipDraws, ClipNoise, ClipSeeds, RandomizedClips
from plat.evaluation.names import DisturbanceName
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.spec.observation import table

__all__ = [
    "STRENGTHS",
    "Disturbance",
    "DisturbanceName",
    "Disturbed",
    "Strength",
    "disturbing",
    "is_undisturbed",
    "loaded_physics",
    "observing_noise",
]


@dataclass(frozen=True)
class Disturbance(Bounded):
    """Disturbance of fixed strength; the default changes nothing.

    Attributes:
        push: change of the root's horizontal velocity (m/s), in a random direction every 1 to 3 s.
        friction: sliding friction of the soles; None for the robot's own.
        payload: mass added at the anchor's center of mass (kg).
        latency: control steps by which joint targets arrive late.
        motors: half width of the relative error of each motor's stiffness and damping.
        noise: factor on the sensor noise of :class:`plat.envs.transforms.NoiseLevels`.

    Raises:
        ConfigError: for a strength that is negative or not finite, motors beyond 0.99, and parts of a control step.

    >>> Disturbance(push=0.5).push
    0.5
    """

    push: NonNegative = 0.0
    friction: NonNegative | None = None
    payload: NonNegative = 0.0
    latency: Natural = 0
    motors: Annotated[float, Range(0, 0.99)] = 0.0
    noise: NonNegative = 0.0


@dataclass(frozen=True)
class Strength:
    """Strengths of one disturbance, weakest first.

    Attributes:
        unit: with which a strength is labeled.
        values: what the unit counts. At 0 the robot is undisturbed, and friction of 0.8 is that of the G1's soles.
        to_field: factor from a value to the field of :class:`Disturbance`.
    """

    unit: str
    values: tuple[float, ...]
    to_field: float = 1.0

    def disturbance(self, name: DisturbanceName, value: float) -> Disturbance | None:
        """Return the disturbance of a strength; None for 0."""
        if value == 0:
            return None
        field = value * self.to_field
        fields: dict[str, Any] = {name: round(field) if name == "latency" else field}
        return Disturbance(**fields)


STRENGTHS: Mapping[DisturbanceName, Strength] = MappingProxyType(
    {
        "push": Strength("m/s", (0.0, 0.25, 0.5, 0.75, 1.0, 1.5)),
        "friction": Strength("coefficient", (0.8, 0.6, 0.4, 0.3, 0.2, 0.1)),
        "payload": Strength("kg", (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)),
        "latency": Strength("control steps", (0.0, 1.0, 2.0, 3.0, 4.0)),
        "motors": Strength("%", (0.0, 10.0, 20.0, 30.0, 40.0, 50.0), to_field=0.01),
        "noise": Strength("x training noise", (0.0, 1.0, 2.0, 3.0, 4.0)),
    }
)
"""Strengths of the robustness curves."""


def is_undisturbed(name: DisturbanceName, value: float, robot: Robot) -> bool:
    """Return whether a robot at some strength of a disturbance is as its description has it.

    >>> from plat.robots import G1
    >>> is_undisturbed("push", 0.0, G1), is_undisturbed("friction", 0.8, G1), is_undisturbed("friction", 0.6, G1)
    (True, True, False)
    """
    if name != "friction":
        return value == 0
    model = robot.shared_model
    return bool(np.allclose(model.geom_friction[robot.sole_geoms(model), 0], value))


_PUSH_INTERVAL = (1.0, 3.0)  # seconds


class Disturbed(ClipDraws):
    """Transform that pushes robots, delays their joint targets, and sets friction and motor gains of each clip.

    A late target is preceded by the pose that the robot starts in. The observed last action is the one that the
    policy gave, also for the transforms behind it: put it first.

    Args:
        env: simulated robots, whose physics it changes.
        disturbance: its strength.
        seeds: of the clips of the environment's library.
    """

    def __init__(self, env: MotionTrackingEnv, disturbance: Disturbance, seeds: ClipSeeds):
        super().__init__(env, seeds, _PUSH_INTERVAL if disturbance.push else None)
        self._disturbance = disturbance
        default = torch.zeros(env.num_envs, env.robot.num_joints, device=env.device)
        self._coming = [default] * disturbance.latency
        self._given = default

    def draw(self, ids: Tensor) -> None:
        env, strength = self._env[0], self._disturbance
        if strength.friction is not None:
            friction = torch.full((len(ids),), strength.friction, dtype=torch.float64)
            env.physics.set_friction(ids, env.robot.feet, friction)
        if strength.motors:
            draws = 2 * torch.rand(2, len(ids), env.robot.num_joints, dtype=torch.float64) - 1
            env.physics.set_gains(ids, *(1 + strength.motors * draws))

    def draw_pushes(self, count: int) -> Tensor:
        angle = 2 * torch.pi * torch.rand(count, dtype=torch.float64)
        push = torch.zeros(count, 6, dtype=torch.float64)
        push[:, 0], push[:, 1] = angle.cos(), angle.sin()
        return self._disturbance.push * push

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        if self._coming:
            robot, joint_pos = self._env[0].robot, tensordict_reset["state", "joint_pos"]
            start = (joint_pos - robot.default_joint_pos.to(joint_pos)) / robot.action_scale.to(joint_pos)
            mask = tensordict.get("_reset", None)
            rows = (
                torch.ones(len(start), 1, dtype=torch.bool, device=start.device) if mask is None else mask.view(-1, 1)
            )
            self._coming = [torch.where(rows, start, action) for action in self._coming]
        return tensordict_reset

    def _inv_call(self, tensordict: TensorDictBase) -> TensorDictBase:
        tensordict = super()._inv_call(tensordict)
        if self._coming:
            self._coming = [*self._coming, tensordict["action"]]
            self._given = tensordict["action"]
            tensordict["action"] = self._coming.pop(0)
        return tensordict

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        if self._coming:
            tensordict["action"] = self._given
            entry = table().entry("robot", "last_action")
            next_tensordict["robot", "last_action"] = entry.observed(self._given)
        return next_tensordict


def observing_noise(library: MotionLibrary, disturbance: Disturbance | None, seeds: ClipSeeds) -> list[Transform]:
    """Return the transform that adds a disturbance's sensor noise; none without it."""
    if disturbance is None or not disturbance.noise:
        return []
    return [ClipNoise(library, NoiseLevels().scaled(disturbance.noise), seeds)]


def disturbing(
    env: MotionTrackingEnv,
    randomization: RandomizationRanges | None,
    disturbance: Disturbance | None,
    seeds: ClipSeeds,
) -> Sequence[Transform]:
    """Return the transforms that randomize and disturb the robots of an environment, to stand before all others."""
    transforms: list[Transform] = [] if randomization is None else [RandomizedClips(env, randomization, seeds)]
    return transforms if disturbance is None else [*transforms, Disturbed(env, disturbance, seeds)]


def loaded_physics(robot: Robot, disturbance: Disturbance | None) -> PhysicsFactory:
    """Return the factory of a physics whose robots carry the disturbance's payload at their anchor."""
    if disturbance is None or not disturbance.payload:
        return BatchedPhysics
    payload = disturbance.payload

    def make(model: mujoco.MjModel, num_sims: int, num_threads: int | None, device: Any) -> Physics:
        model.body(robot.anchor).mass += payload
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return BatchedPhysics(model, num_sims, num_threads, device)

    return make
