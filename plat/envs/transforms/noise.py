"""Observation noise."""

from dataclasses import asdict

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor

from plat.envs.transforms.base import ObservationTransform
from plat.envs.transforms.settings import NoiseLevels
from plat.robots.robot import Robot
from plat.spec.observation import table

__all__ = ["NoiseLevels", "ObservationNoise"]


class ObservationNoise(ObservationTransform):
    """Observation noise: adds uniform noise to the measured entries of the group ``"robot"``. Put it last.

    Noise is of the measured quantity: it is scaled as its entry in the observation table is.

    Args:
        robot: gives the number of joints.
        levels: half widths, in the units of the quantities; None for the default ones.
    """

    def __init__(self, robot: Robot, levels: NoiseLevels | None = None):
        entries = {entry.name: entry for entry in table().entries("robot")}
        levels = levels or NoiseLevels()
        half_widths = {name: entries[name].observed(width) for name, width in asdict(levels).items() if name in entries}
        sizes = {name: robot.num_joints if name.startswith("joint") else 3 for name in half_widths}
        shapes: dict[NestedKey, tuple[int, ...]] = {("robot", name): (size,) for name, size in sizes.items()}
        super().__init__(in_keys=list(shapes), out_shapes=shapes)
        self._sizes = list(sizes.values())
        every = torch.cat([torch.full((size,), half_widths[name]) for name, size in sizes.items()])
        self.register_buffer("_half_widths", every, persistent=False)

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        values = torch.cat([tensordict[key] for key in self.out_keys], -1)
        noisy = values + self._half_widths * (2 * self.draw(tensordict, values) - 1)
        return dict(zip(self.out_keys, noisy.split(self._sizes, -1), strict=True))

    def draw(self, tensordict: TensorDictBase, values: Tensor) -> Tensor:
        """Return random numbers from 0 to 1, one for each measured value ``[n, S]``."""
        return torch.rand_like(values)
