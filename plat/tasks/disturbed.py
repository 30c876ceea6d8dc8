"""Randomized robots in learning by imagination: what the model is told of them, and what the policy is not."""

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.envs.state import joint_target
from plat.envs.transforms.settings import NoiseLevels
from plat.robots.robot import Robot
from plat.tasks.task import Task

__all__ = ["applied_action", "measuring", "shown", "told_to_model"]


def applied_action(memory: TensorDictBase, action: Tensor) -> Tensor:
    """Return the action ``[*B, J]`` that reaches the motors in this step: of a delayed robot its last one.

    Args:
        memory: before the step ``[*B]``.
        action: of the policy ``[*B, J]``.
    """
    delayed = memory.get("delayed", None)
    return action if delayed is None else torch.where(delayed[..., None], memory["last_action"], action)


def told_to_model(robot: Robot, steps: TensorDictBase, action: Tensor) -> tuple[Tensor, Tensor | None]:
    """Return what a dynamics model is told of simulated steps: joint targets that reached the motors, and physics.

    Args:
        robot: the robot.
        steps: with the task's ``memory`` where robots are randomized ``[*B]``.
        action: of the policy ``[*B, J]``.

    Returns:
        Targets ``[*B, J]`` (rad), and parameters ``[*B, P]``; None for nominal robots.
    """
    memory = steps.get("memory", None)
    if memory is None:
        return joint_target(robot, action), None
    return joint_target(robot, applied_action(memory, action)), memory.get("physics", None)


def shown(task: Task, state: object, memory: TensorDictBase) -> TensorDict:
    """Return what a task shows a policy, as the robot's biased encoders measure it."""
    observed = task.observe(state, memory)  # type: ignore[arg-type]
    bias = memory.get("encoder_bias", None)
    if bias is not None and ("robot", "joint_pos") in observed.keys(True):
        observed["robot", "joint_pos"] = observed["robot", "joint_pos"] + bias
    return observed


def measuring(actor: TensorDictModuleBase, levels: NoiseLevels) -> TensorDictSequential:
    """Add uniform noise to what an actor measures of its robot; for training, simulated and imagined.

    >>> from plat.modules import PlainPolicy
    >>> from plat.robots import G1
    >>> measuring(PlainPolicy(G1).deployed(), NoiseLevels()).out_keys
    ['action']
    """
    widths = vars(levels)
    seen = [key for key in actor.in_keys if isinstance(key, tuple) and key[0] == "robot" and widths.get(key[1])]
    noise = [TensorDictModule(_Uniform(widths[key[1]]), in_keys=[key], out_keys=[key]) for key in seen]
    return TensorDictSequential(*noise, actor, selected_out_keys=list(actor.out_keys))


class _Uniform(nn.Module):
    def __init__(self, width: float):
        super().__init__()
        self.width = width

    def forward(self, value: Tensor) -> Tensor:
        return value + self.width * (2 * torch.rand_like(value) - 1)
