"""Observation noise."""

from dataclasses import dataclass

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.robot import Robot
from plat.envs.transforms.base import ObservationTransform

__all__ = ["NoiseLevels", "ObservationNoise"]


@dataclass(frozen=True)
class NoiseLevels:
    """Half widths of the uniform noise on what the robot measures."""

    joint_pos: float = 0.01
    """rad"""
    joint_vel: float = 0.5
    """rad/s"""
    root_ang_vel_b: float = 0.2
    """rad/s"""
    root_lin_vel_b: float = 0.1
    """m/s; G1 has no sensor for it, so a deployed estimate is noisy too"""
    gravity_b: float = 0.05


class ObservationNoise(ObservationTransform):
    """Adds uniform noise to the measured entries of the group ``"robot"``; put it last.

    Args:
        robot: gives the number of joints.
        levels: half widths.
    """

    def __init__(self, robot: Robot, levels: NoiseLevels | None = None):
        self._levels = levels or NoiseLevels()
        self._names = ("joint_pos", "joint_vel", "root_ang_vel_b", "root_lin_vel_b", "gravity_b")
        shapes = {("robot", name): (robot.num_joints if name.startswith("joint") else 3,) for name in self._names}
        super().__init__(in_keys=list(shapes), out_shapes=shapes)

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        return {
            ("robot", name): value + getattr(self._levels, name) * (2 * torch.rand_like(value) - 1)
            for name in self._names
            for value in (tensordict["robot", name],)
        }
