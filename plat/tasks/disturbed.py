"""Randomized robots in learning by imagination: what the model is told of them, and what the policy is not."""

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.envs.drift import drifted, estimated_root
from plat.envs.randomized_physics import arriving
from plat.envs.state import GeneralizedState, joint_target
from plat.envs.transforms.settings import NoiseLevels
from plat.errors import TaskError
from plat.robots.robot import Robot
from plat.rotations import quat_rotate, quat_rotate_inverse
from plat.spec.observation import table
from plat.tasks.task import Task, remembered

__all__ = ["advanced", "estimated", "measuring", "motor_target", "renewed", "shown", "told_to_model"]


def motor_target(robot: Robot, memory: TensorDictBase, action: Tensor) -> Tensor:
    """Return the joint targets ``[*B, J]`` (rad, true angles) that the motors follow in this step.

    A late robot follows an action that it was given before. Motors read the same biased encoders as the policy.

    Args:
        robot: the robot.
        memory: before the step ``[*B]``.
        action: of the policy ``[*B, J]``.
    """
    if (delay := memory.get("delay", None)) is not None:
        action = arriving(delay, action, memory["last_action"], memory["earlier_action"])
    bias = memory.get("encoder_bias", None)
    target = joint_target(robot, action)
    return target if bias is None else target - bias


def advanced(task: Task, memory: TensorDictBase, action: Tensor, state: GeneralizedState) -> TensorDictBase:
    """Return a task's memory after a control step.

    It holds the action before the last where a robot may be that late, and how far its estimate has drifted.

    Args:
        task: the task.
        memory: before the step ``[*B]``.
        action: of the policy ``[*B, J]``.
        state: true state after the step ``[*B]``.

    Raises:
        TaskError: when the task returns no memory.
    """
    # a task may write in place to what it is given
    after = remembered(task, "advance", task.advance(memory.clone(), action), memory)
    if memory.get("earlier_action", None) is not None:
        after["earlier_action"] = memory["last_action"]
    if (drift := memory.get("drift", None)) is not None:
        after["drift"] = drifted(drift, memory["drift_rate"], state.root_quat_w, state.root_lin_vel_w, task.dt)
    return after


def renewed(task: Task, memory: TensorDictBase, state: GeneralizedState) -> TensorDictBase:
    """Return a task's memory ``[*B]`` with the commands that follow those that have ended.

    Args:
        task: the task.
        memory: after the step ``[*B]``.
        state: as the robots' estimators have it ``[*B]``.

    Raises:
        TaskError: when the task returns no memory.
    """
    return remembered(task, "renew", task.renew(memory.clone(), state), memory)


def estimated(state: GeneralizedState, memory: TensorDictBase) -> GeneralizedState:
    """Return the state ``[*B]`` in the world as the robot's estimator has it, which drifts from the true one.

    Keyframes are in this world, and in no other can a robot be on time: what it sees, what a step costs and when an
    episode ends are functions of it. Velocities and gravity in the root frame
    are the true ones.
    """
    drift = memory.get("drift", None)
    if drift is None:
        return state
    pos, quat = estimated_root(drift, state.root_pos_w, state.root_quat_w)
    lin_vel = quat_rotate(quat, quat_rotate_inverse(state.root_quat_w, state.root_lin_vel_w))
    return state._replace(root_pos_w=pos, root_quat_w=quat, root_lin_vel_w=lin_vel)


def told_to_model(
    robot: Robot, steps: TensorDictBase, action: Tensor, key: NestedKey = "memory"
) -> tuple[Tensor, Tensor | None]:
    """Return what a dynamics model is told of simulated steps: joint targets that reached the motors, and physics.

    Args:
        robot: the robot.
        steps: with the task's memory where robots are randomized ``[*B]``.
        action: of the policy ``[*B, J]``.
        key: of the memory.

    Returns:
        Targets ``[*B, J]`` (rad), and parameters ``[*B, P]``; None for nominal robots.
    """
    memory = steps.get(key, None)
    if memory is None:
        return joint_target(robot, action), None
    return motor_target(robot, memory, action), memory.get("physics", None)


_BIASED = {"encoder_bias": "joint_pos", "gyro_bias": "root_ang_vel_b", "velocity_bias": "root_lin_vel_b"}


def shown(task: Task, state: GeneralizedState, memory: TensorDictBase) -> TensorDict:
    """Return what a task shows a policy of a true state, as the robot's biased sensors and its estimator have it.

    Raises:
        TaskError: when that is no TensorDict of these robots.
    """
    observed = task.observe(estimated(state, memory), memory)
    if not isinstance(observed, TensorDictBase) or observed.batch_size != memory.batch_size:
        expected = f"a TensorDict {list(memory.batch_size)}"
        found = list(observed.batch_size) if isinstance(observed, TensorDictBase) else type(observed).__name__
        raise TaskError(f"{type(task).__name__}.observe() returns {found}, expected {expected}")
    for bias, entry in _BIASED.items():
        error = memory.get(bias, None)
        if error is not None and ("robot", entry) in observed.keys(True):
            observed["robot", entry] = observed["robot", entry] + table().entry("robot", entry).observed(error)
    return observed


def measuring(actor: TensorDictModuleBase, levels: NoiseLevels) -> TensorDictSequential:
    """Add uniform noise to what an actor measures of its robot; for training, simulated and imagined.

    Args:
        actor: reads entries of the group ``"robot"``.
        levels: half widths, in the units of the quantities; they are scaled as their entries in the observation table.

    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> measuring(PlainPolicy(G1).deployed(), NoiseLevels()).out_keys
    ['action']
    """
    widths = vars(levels)
    seen = [key for key in actor.in_keys if isinstance(key, tuple) and key[0] == "robot" and widths.get(key[1])]
    shown_widths = [table().entry(*key).observed(widths[key[1]]) for key in seen]
    noise = [
        TensorDictModule(_Uniform(width), in_keys=[key], out_keys=[key])
        for key, width in zip(seen, shown_widths, strict=True)
    ]
    return TensorDictSequential(*noise, actor, selected_out_keys=list(actor.out_keys))


class _Uniform(nn.Module):
    def __init__(self, width: float):
        super().__init__()
        self.width = width

    def forward(self, value: Tensor) -> Tensor:
        return value + self.width * (2 * torch.rand_like(value) - 1)
