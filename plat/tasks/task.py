"""What a task is: functions of the robot's state and of a small memory, for simulated and imagined robots alike."""

from abc import abstractmethod
from typing import ClassVar

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.errors import TaskError
from plat.gpu import constant
from plat.robots.robot import Robot
from plat.spec.observation import as_observed
from plat.spec.proportions import in_proportion

__all__ = ["Task", "of_each", "remembered", "robot_entries", "started"]


class Task(nn.Module):
    """A task of N robots: where episodes start, what a policy sees, when commands follow, what a step costs.

    Everything is a function of the robots' :class:`plat.envs.GeneralizedState` ``[*N]`` and of the task's memory. That
    is a TensorDict ``[N]`` with at least the ``last_action`` ``[N, J]``. :class:`plat.tasks.SimulatedTask` runs the
    task on simulated robots, :class:`plat.objectives.ImaginationLoss` on imagined ones. In both a control step is
    :meth:`observe`, the policy, the robot's motion, :meth:`advance`, :meth:`cost` and :meth:`renew`.

    A subclass defines :meth:`start`, :meth:`observe` and :meth:`cost`, and what it needs of the rest. :meth:`cost` and
    :meth:`observe` are differentiable in the state. :meth:`advance` and :meth:`renew` are given copies of the memory,
    which they may write to. The others write to nothing that they are given.

    Args:
        robot: the robot.
        dt: control step (s).
    """

    static: ClassVar[bool] = False
    """Whether on a GPU it runs the same kernels whatever the states are, and copies nothing from the CPU; then
    imagination is captured as a CUDA graph (:class:`plat.objectives.GraphedLoss`)."""

    def __init__(self, robot: Robot, dt: float = 0.02):
        super().__init__()
        self.robot = robot
        self.dt = dt

    @abstractmethod
    def start(self, count: int) -> tuple[GeneralizedState, TensorDict]:
        """Return states and memories ``[count]`` that episodes start from."""

    @abstractmethod
    def observe(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Return the entries that the policy reads."""

    @abstractmethod
    def cost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the cost ``[N]`` of the control step that ended in a state."""

    def privileged(self, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
        """Return the group ``"privileged_goal"``: what only a posterior sees, and only in training.

        ``frames`` ``[N, L, F]`` are goals on the way to the keyframe, as :class:`plat.collectors.PrivilegedGoals` has
        them, and ``length`` ``[N]`` says how many of them count.
        """
        raise TaskError(f"{type(self).__name__} has no privileged goals: define privileged() to train a posterior")

    def reference(self, memory: TensorDictBase) -> Tensor | None:
        """Return joint angles ``[N, J]`` (rad) that lead to what is commanded, for the end of the step; None for none.

        A new policy learns them as joint targets while its model of the robot is no good yet
        (:class:`plat.objectives.ReferenceLoss`).
        """
        return None

    def advance(self, memory: TensorDictBase, action: Tensor) -> TensorDictBase:
        """Return the memory after a control step with ``action``: clocks go on, nothing new is commanded yet."""
        return memory.copy().set("last_action", action)

    def renew(self, memory: TensorDictBase, state: GeneralizedState) -> TensorDictBase:
        """Return the memory with a new command in the place of each that has ended, for robots in these states."""
        return memory

    def failed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of robots whose episode ends by failure.

        By default the root is below 0.4 m, of a robot whose root stands at 0.76 m; of others in proportion.
        """
        return state.root_pos_w[..., 2] < in_proportion(0.4, self.robot.root_height)

    def finished(self, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of robots whose episode ends because nothing is left to do."""
        return torch.zeros(memory.batch_size, dtype=torch.bool, device=memory["last_action"].device)

    def lost(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of imagined robots too far off to learn from; those that failed, by default."""
        return self.failed(state, memory)

    def missed(self, state: GeneralizedState, memory: TensorDictBase) -> Tensor:
        """Return the mask ``[N]`` of robots that missed what they were to do in this step; none by default."""
        return torch.zeros(memory.batch_size, dtype=torch.bool, device=memory["last_action"].device)

    def record_failures(self, memory: TensorDictBase) -> None:
        """Learn where robots ``[n]`` failed or missed something, to start more episodes there."""


def started(task: Task, count: int) -> tuple[GeneralizedState, TensorDict]:
    """Return the states and memories ``[count]`` that a task starts episodes from.

    Raises:
        TaskError: when they are none, or of another number of robots or joints.
    """
    start: object = task.start(count)
    state, memory = start if isinstance(start, tuple) and len(start) == 2 else (None, None)
    joints = (count, task.robot.num_joints)
    if (
        isinstance(state, GeneralizedState)
        and isinstance(memory, TensorDict)
        and memory.batch_size == state.root_pos_w.shape[:1] == (count,)
        and state.joint_pos.shape == joints
        and "last_action" in memory
        and memory["last_action"].shape == joints
    ):
        return state, memory
    raise TaskError(
        f"{type(task).__name__}.start({count}): expected a GeneralizedState of {count} robots and a TensorDict "
        f"[{count}] with their 'last_action' {list(joints)}"
    )


def remembered(task: Task, method: str, after: TensorDictBase, before: TensorDictBase) -> TensorDictBase:
    """Return the memory that a method of a task returned.

    Args:
        task: the task.
        method: ``advance`` or ``renew``.
        after: that it returned.
        before: memory that it was given ``[*N]``.

    Raises:
        TaskError: when it is none of these robots, as where a method writes in place and returns nothing.
    """
    if isinstance(after, TensorDictBase) and after.batch_size == before.batch_size:
        return after
    found = list(after.batch_size) if isinstance(after, TensorDictBase) else type(after).__name__
    raise TaskError(f"{type(task).__name__}.{method}() returns {found}, expected the memory {list(before.batch_size)}")


def of_each(task: Task, method: str, value: Tensor, memory: TensorDictBase) -> Tensor:
    """Return what a method of a task returned for each robot.

    Args:
        task: the task.
        method: ``cost``, or the name of one that returns a mask.
        value: that it returned.
        memory: of the robots ``[N]``.

    Raises:
        TaskError: when it is no cost, or mask, of shape ``[N]``. Another shape would be broadcast without a word.
    """
    mask, shape = method != "cost", memory.batch_size
    if isinstance(value, Tensor) and value.shape == shape and (value.dtype == torch.bool) == mask:
        return value
    found = f"{tuple(value.shape)}, {value.dtype}" if isinstance(value, Tensor) else type(value).__name__
    expected = "a mask, torch.bool," if mask else "costs"
    raise TaskError(f"{type(task).__name__}.{method}() returns {found}; expected {expected} of shape {tuple(shape)}")


def robot_entries(state: GeneralizedState, last_action: Tensor, robot: Robot) -> TensorDict:
    """Return group ``"robot"`` of the observation: what :class:`plat.envs.MotionTrackingEnv` measures without noise.

    >>> from plat.robots import G1
    >>> state = GeneralizedState.unpack(torch.nn.functional.pad(torch.ones(2, 1), (3, 67)))
    >>> robot_entries(state, torch.zeros(2, 29), G1)["gravity_b"][0].tolist()
    [0.0, 0.0, -1.0]
    """
    gravity_b, root_lin_vel_b = state.in_root_frame()
    quantities = {
        "joint_pos": state.joint_pos - constant(robot.default_joint_pos, state.joint_pos),
        "joint_vel": state.joint_vel,
        "root_ang_vel_b": state.root_ang_vel_b,
        "root_lin_vel_b": root_lin_vel_b,
        "gravity_b": gravity_b,
        "last_action": last_action,
    }
    return TensorDict(as_observed("robot", quantities), state.root_pos_w.shape[:-1], device=last_action.device)
