"""Draws of a robot's physics, and the clock of its pushes, for every environment that randomizes them."""

from typing import NamedTuple

import torch
from torch import Tensor

from plat.envs.physics import Physics
from plat.envs.transforms.settings import RandomizationRanges
from plat.robots.robot import Robot

__all__ = ["PhysicsDraw", "PushClock", "RandomizedPhysics", "arriving", "num_physics"]


def num_physics(robot: Robot) -> int:
    """Return the number of parameters P of a draw: friction, center of mass, motor gains, mass.

    >>> from plat.robots import G1
    >>> num_physics(G1)
    63
    """
    return 5 + 2 * robot.num_joints


def arriving(delay: Tensor, action: Tensor, last: Tensor, earlier: Tensor) -> Tensor:
    """Return the action ``[*B, J]`` that reaches the motors, of those given now, a control step and two steps ago.

    Args:
        delay: control steps by which it is late ``[*B]``, 0 to 2.
        action: given now.
        last: given a control step ago.
        earlier: given two ago.
    """
    late = delay[..., None]
    return torch.where(late == 0, action, torch.where(late == 1, last, earlier))


class PushClock:
    """Clock that says when each of N robots is pushed, at random intervals.

    Args:
        interval: shortest and longest time between pushes (s).
        dt: control step (s).
        count: robots N.

    Attributes:
        steps: control steps until each robot's next push ``[N]``.
    """

    def __init__(self, interval: tuple[float, float], dt: float, count: int):
        self._low, self._high = (seconds / dt for seconds in interval)
        self.steps = self._draw(count)

    def restart(self, ids: Tensor) -> None:
        """Draw the intervals of robots ``[n]`` anew."""
        self.steps[ids] = self._draw(len(ids))

    def tick(self) -> Tensor:
        """Let a control step pass; return the robots that are due ``[n]``. Restart them when they are pushed."""
        self.steps -= 1
        return (self.steps <= 0).nonzero()[:, 0]

    def _draw(self, count: int) -> Tensor:
        return (self._low + (self._high - self._low) * torch.rand(count)).long().clamp_min(1)


class PhysicsDraw(NamedTuple):
    """Draw of the physics of n robots.

    Attributes:
        physics: friction, center of mass, stiffness, damping and mass ``[n, P]``, each from -1 to 1 within its range.
            At 0 all but friction are the robot's own; it is the middle of its range (0.75 of 0.3 to 1.2, where the
            G1's soles have 0.8), or the robot's own where it has none.
        encoder_bias: constant error of each joint encoder ``[n, J]`` (rad).
        gyro_bias: constant error of the angular velocity ``[n, 3]`` (rad/s).
        velocity_bias: error of the estimated linear velocity ``[n, 3]`` (m/s, root frame).
        delay: control steps by which the joint targets arrive late ``[n]``, 0 to 2.
        drift: offset of the estimated position and heading as the episode begins ``[n, 4]`` (m, rad).
        drift_rate: what it grows by ``[n, 3]`` (m/m, m/m, rad/s), see :func:`plat.envs.drift.drifted`.
    """

    physics: Tensor
    encoder_bias: Tensor
    gyro_bias: Tensor
    velocity_bias: Tensor
    delay: Tensor
    drift: Tensor
    drift_rate: Tensor


class RandomizedPhysics:
    """Randomized physics of N robots: draws it where episodes begin, and pushes the robots.

    Args:
        robot: the robot.
        physics: its simulations, which are changed.
        count: robots N.
        ranges: of the parameters.
        dt: control step (s).

    Attributes:
        clock: of the pushes.

    Source: the randomization of BeyondMimic, arXiv 2508.08241.
    """

    def __init__(self, robot: Robot, physics: Physics, count: int, ranges: RandomizationRanges, dt: float):
        self._robot = robot
        self._physics = physics
        self._ranges = ranges
        self._load = min(ranges.torso_mass, 0.5 * float(robot.shared_model.body(robot.anchor).mass[0]))
        self.clock = PushClock(ranges.push_interval, dt, count)

    def draw(self, ids: Tensor) -> PhysicsDraw:
        """Set the physics of robots ``[n]``, on the CPU, to random values; return them."""
        ranges, robot, count = self._ranges, self._robot, len(ids)
        joints = robot.num_joints
        friction = torch.rand(count, 1, dtype=torch.float64)
        if ranges.foot_friction is None:
            friction.fill_(0.5)
        else:
            low, high = ranges.foot_friction
            self._physics.set_friction(ids, robot.feet, (low + (high - low) * friction)[:, 0])
        com = torch.zeros(count, 3, dtype=torch.float64)
        if any(ranges.torso_com):
            com = _uniform(count, 3)
            self._physics.set_com(ids, robot.anchor, torch.tensor(ranges.torso_com, dtype=torch.float64) * com)
        stiffness, damping = _uniform(count, joints), _uniform(count, joints)
        self._physics.set_gains(ids, 1 + ranges.motor_gain * stiffness, 1 + ranges.motor_gain * damping)
        encoder_bias = (ranges.encoder_bias * _uniform(count, joints)).float()
        delay = (torch.rand(count) < ranges.control_delay).long()
        self.clock.restart(ids)
        # drawn where they are asked for alone: draws of earlier versions with the same seed stay as they were
        if ranges.longer_delay:
            delay += delay * (torch.rand(count) < ranges.longer_delay)
        mass = torch.zeros(count, 1, dtype=torch.float64)
        if ranges.torso_mass:
            mass = _uniform(count, 1)
            self._physics.set_mass(ids, robot.anchor, self._load * mass[:, 0])
        gyro_bias, velocity_bias = (
            (width * _uniform(count, 3)).float() if width else torch.zeros(count, 3)
            for width in (ranges.gyro_bias, ranges.velocity_bias)
        )
        drift, drift_rate = torch.zeros(count, 4), torch.zeros(count, 3)
        if ranges.height_error:
            drift[:, 2] = ranges.height_error * _uniform(count)
        if ranges.position_drift:
            drift_rate[:, :2] = ranges.position_drift * _uniform(count, 2)
        if ranges.heading_drift:
            drift_rate[:, 2] = ranges.heading_drift * _uniform(count)
        physics = torch.cat((2 * friction - 1, com, stiffness, damping, mass), -1).float()
        return PhysicsDraw(physics, encoder_bias, gyro_bias, velocity_bias, delay, drift, drift_rate)

    def push(self) -> Tensor:
        """Let a control step pass, and push the robots that are due ``[n]``; return them."""
        due = self.clock.tick()
        if len(due):
            self._physics.push(due, self.draw_pushes(len(due)))
            self.clock.restart(due)
        return due

    def draw_pushes(self, count: int) -> Tensor:
        """Return random changes of root velocity ``[count, 6]`` (m/s in the world, rad/s in the root's frame)."""
        ranges = self._ranges
        widths = torch.tensor((*ranges.push_lin_vel, *ranges.push_ang_vel), dtype=torch.float64)
        return widths * _uniform(count, 6)


def _uniform(*shape: int) -> Tensor:
    return 2 * torch.rand(shape, dtype=torch.float64) - 1
