"""Randomized robots in learning by imagination: what the model is told of them, and what the policy is not."""

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn

from plat.envs.physics import Physics
from plat.envs.transforms.settings import NoiseLevels, RandomizationRanges
from plat.robots.robot import Robot
from plat.tasks.task import Task

__all__ = ["PhysicsDraws", "applied_action", "measuring", "num_physics", "shown"]


def num_physics(robot: Robot) -> int:
    """Return the number of parameters P that a dynamics model is told: friction, center of mass, motor gains.

    >>> from plat.robots import G1
    >>> num_physics(G1)
    62
    """
    return 4 + 2 * robot.num_joints


class PhysicsDraws:
    """Draws of the physics of N robots, and pushes.

    A robot's memory then holds ``physics`` ``[P]``, about -1 to 1 each, which the dynamics model is told. It also holds
    what is a matter of measuring and sending: ``encoder_bias`` ``[J]`` (rad), and ``delayed``, whether its targets
    arrive a control step late. The policy is shown none of them.

    Args:
        robot: the robot.
        physics: its simulations.
        count: of robots N.
        ranges: of the parameters.
        dt: control step (s).
    """

    def __init__(self, robot: Robot, physics: Physics, count: int, ranges: RandomizationRanges, dt: float):
        self._robot = robot
        self._physics = physics
        self._ranges = ranges
        self._dt = dt
        self.steps_to_push = self._draw_intervals(count)
        """Control steps until each robot is pushed."""

    def draw(self, ids: Tensor) -> dict[str, Tensor]:
        """Draw the physics of robots ``[n]`` that begin an episode; return the entries of their memories."""
        ranges, robot, count = self._ranges, self._robot, len(ids)
        drawn = 2 * torch.rand(count, num_physics(robot)) - 1
        friction, com, stiffness, damping = drawn.double().split((1, 3, robot.num_joints, robot.num_joints), -1)
        low, high = ranges.foot_friction
        self._physics.set_friction(ids, robot.feet, (0.5 * (low + high) + 0.5 * (high - low) * friction)[:, 0])
        self._physics.set_com(ids, robot.anchor, com * torch.tensor(ranges.torso_com, dtype=torch.float64))
        self._physics.set_gains(ids, 1 + ranges.motor_gain * stiffness, 1 + ranges.motor_gain * damping)
        self.steps_to_push[ids.cpu()] = self._draw_intervals(count)
        return {
            "physics": drawn,
            "encoder_bias": ranges.encoder_bias * (2 * torch.rand(count, robot.num_joints) - 1),
            "delayed": torch.rand(count) < ranges.control_delay,
        }

    def push(self) -> Tensor:
        """Push the robots whose time has come; return the mask ``[N]`` of them."""
        self.steps_to_push -= 1
        pushed = self.steps_to_push <= 0
        due = pushed.nonzero()[:, 0]
        if len(due):
            ranges = self._ranges
            widths = torch.tensor((*ranges.push_lin_vel, *ranges.push_ang_vel), dtype=torch.float64)
            self._physics.push(due, widths * (2 * torch.rand(len(due), 6, dtype=torch.float64) - 1))
            self.steps_to_push[due] = self._draw_intervals(len(due))
        return pushed

    def _draw_intervals(self, count: int) -> Tensor:
        low, high = (seconds / self._dt for seconds in self._ranges.push_interval)
        return (low + (high - low) * torch.rand(count)).long().clamp_min(1)


def applied_action(memory: TensorDictBase, action: Tensor) -> Tensor:
    """Return the action ``[*B, J]`` that reaches the motors in this step: of a delayed robot its last one.

    Args:
        memory: before the step ``[*B]``.
        action: of the policy ``[*B, J]``.
    """
    delayed = memory.get("delayed", None)
    return action if delayed is None else torch.where(delayed[..., None], memory["last_action"], action)


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
