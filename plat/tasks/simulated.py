"""Simulated robots with a task: a TorchRL environment."""

from typing import Any, Self

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Binary, Composite, Unbounded
from torchrl.envs import EnvBase

from plat.bounds import Count, Robots, check_value
from plat.entries import check_entries
from plat.envs.broken import BrokenRobots
from plat.envs.physics import BatchedPhysics, PhysicsFactory
from plat.envs.randomized_physics import RandomizedPhysics
from plat.envs.state import GeneralizedState
from plat.envs.transforms.settings import RandomizationRanges
from plat.gpu import check_device, check_stays
from plat.robots.robot import FootContacts
from plat.tasks.disturbed import advanced, estimated, motor_target, renewed, shown
from plat.tasks.starts import FailureWeights
from plat.tasks.task import Task, of_each, started

__all__ = ["SimulatedTask"]

_DONE_KEYS = ("done", "terminated", "truncated")


class SimulatedTask(EnvBase):
    """N simulated robots with a :class:`Task`. The reward of a step is its cost, negative.

    Beside the task's observation it writes ``robot_state``, the packed :class:`plat.envs.GeneralizedState`
    ``[N, 13 + 2 J]``, and the task's memory as the group ``"memory"``: what imagined rollouts start from. A robot whose
    action is absurd or not finite, or whose simulation diverges, is terminated.

    Args:
        task: the task.
        num_envs: number of robots N.
        decimation: physics steps a control step.
        feet: contact geometry of the soles, see :meth:`plat.robots.Robot.spec`.
        num_threads: threads of the physics pool; None takes all CPUs.
        device: where tensors live, and the physics if it can be there.
        randomization: ranges of the robots' physics and of pushes, drawn at every reset; None for the nominal robot.
            ``("next", "pushed")`` then says which steps no model can foresee.
        physics: factory of the physics, which becomes the attribute of that name.

    Raises:
        TaskError: by what it does, when a method of the task returns what it should not.

    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import DenseTracking
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> env = SimulatedTask(DenseTracking(library), num_envs=2)
    >>> env.rollout(3)["next", "robot_state"].shape
    torch.Size([2, 3, 71])
    """

    def __init__(
        self,
        task: Task,
        num_envs: int,
        *,
        decimation: int = 4,
        feet: FootContacts = "spheres",
        num_threads: int | None = None,
        device: torch.device | str = "cpu",
        randomization: RandomizationRanges | None = None,
        physics: PhysicsFactory = BatchedPhysics,
    ):
        check_value("environment: task", task, Task)
        check_value("environment: num_envs", num_envs, Robots)
        check_value("environment: decimation", decimation, Count)
        check_value("environment: num_threads", num_threads, Count | None)
        check_value("environment: randomization", randomization, RandomizationRanges | None)
        super().__init__(device=check_device(device), batch_size=torch.Size([num_envs]))
        self.task = task.to(device)
        model = task.robot.model(feet)
        model.opt.timestep = task.dt / decimation
        self.physics = physics(model, num_envs, num_threads, device)
        self.decimation = decimation
        self.draws: RandomizedPhysics | None = None
        """Draws of the robots' physics; None for the nominal robot."""
        if randomization is not None:
            self.draws = RandomizedPhysics(task.robot, self.physics, num_envs, randomization, task.dt)
        self.broken = BrokenRobots()
        """Finds robots to terminate because their action is absurd or their simulation diverged."""
        self._make_specs()

    def _make_specs(self) -> None:
        count, joints = self.batch_size, self.task.robot.num_joints
        example = self._entries(*self._start(torch.arange(count[0])))
        if self.draws is not None:
            example["pushed"] = torch.zeros(count, dtype=torch.bool, device=self.device)
        self.observation_spec = _spec_of(example)
        self.action_spec = Unbounded((*count, joints), device=self.device)
        self.reward_spec = Unbounded((*count, 1), device=self.device)
        flags = {key: Binary(1, (*count, 1), dtype=torch.bool, device=self.device) for key in _DONE_KEYS}
        self.full_done_spec = Composite(flags, shape=count, device=self.device)

    def _entries(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        return shown(self.task, state, memory).update({"robot_state": state.pack(), "memory": memory})

    def _start(self, ids: Tensor) -> tuple[GeneralizedState, TensorDict]:
        """States and memories of robots ``[n]`` that begin an episode."""
        state, memory = started(self.task, len(ids))
        if self.draws is not None:
            memory.update({key: value.to(self.device) for key, value in self.draws.draw(ids.cpu())._asdict().items()})
            memory["earlier_action"] = memory["last_action"]
        return state, memory

    def _state(self) -> GeneralizedState:
        return GeneralizedState.unpack(torch.cat(self.physics.state(), -1))

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        check_entries(tensordict, {"action": (*self.batch_size, self.task.robot.num_joints)}, "environment step")
        task, action = self.task, self.broken.sound(tensordict["action"])
        self.physics.step(motor_target(task.robot, tensordict["memory"], action), self.decimation)
        state = self._state()
        memory = advanced(task, tensordict["memory"], action, state)
        broken = self.broken.found(self.physics.diverged() | ~_finite(state))
        here = estimated(state, memory)
        cost = of_each(task, "cost", task.cost(here, memory), memory)
        failed = of_each(task, "failed", task.failed(here, memory), memory) | broken
        truncated = of_each(task, "finished", task.finished(memory), memory) & ~failed
        missed = of_each(task, "missed", task.missed(here, memory), memory)
        task.record_failures(memory[failed | (missed & ~broken)])
        due = None if self.draws is None else self.draws.push().to(self.device)
        if due is not None and len(due):
            state = self._state()
        out = self._entries(state, renewed(task, memory, estimated(state, memory)))
        if due is not None:
            out["pushed"] = torch.zeros(self.batch_size, dtype=torch.bool, device=self.device)
            out["pushed"][due] = True
        out["reward"] = -cost[:, None]
        out["terminated"], out["truncated"] = failed[:, None], truncated[:, None]
        out["done"] = out["terminated"] | out["truncated"]
        return out

    def _reset(self, tensordict: TensorDictBase | None = None, **_: object) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        everyone = torch.ones(self.batch_size, dtype=torch.bool, device=self.device)
        ids = (everyone if mask is None else mask.view(-1)).nonzero()[:, 0]
        state, memory = self._start(ids)
        self.physics.set_state(ids, state.qpos.double(), state.qvel.double())
        started = self._entries(state, memory)
        out = started.new_zeros(self.batch_size)  # the other robots' rows are never looked at
        out[ids] = started
        for key in _DONE_KEYS:
            out[key] = torch.zeros(*self.batch_size, 1, dtype=torch.bool, device=self.device)
        if self.draws is not None:
            out["pushed"] = torch.zeros(self.batch_size, dtype=torch.bool, device=self.device)
        return out

    def to(self, device: torch.device | str) -> Self:
        """Return the environment; its simulations stay on the device that they were made for.

        Raises:
            ConfigError: for another device.
        """
        check_stays(device, self.device, "environment")
        return self

    def get_extra_state(self) -> dict[str, Any]:
        """Return, for :meth:`state_dict`, the state of the simulations; the task's is beside it."""
        state = {"physics": self.physics.state_dict(), "broken": self.broken.state_dict()}
        return state if self.draws is None else {**state, "steps_to_push": self.draws.clock.steps.clone()}

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore what :meth:`get_extra_state` returned."""
        self.physics.load_state_dict(state["physics"])
        self.broken.load_state_dict(state["broken"])
        if self.draws is not None:
            self.draws.clock.steps = state["steps_to_push"].clone()

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            torch.manual_seed(seed)
            for part in self.task.modules():  # the same episodes follow the same seed, whatever failed before
                if isinstance(part, FailureWeights):
                    part.forget_all()


def _finite(state: GeneralizedState) -> Tensor:
    return state.pack().isfinite().all(-1)


def _spec_of(example: TensorDictBase) -> Composite:
    """A specification of entries like these, without bounds."""
    specs = {}
    for key, value in example.items():
        if isinstance(value, TensorDictBase):
            specs[key] = _spec_of(value)
        else:
            specs[key] = Unbounded(value.shape, dtype=value.dtype, device=value.device)
    return Composite(specs, shape=example.batch_size, device=example.device)
