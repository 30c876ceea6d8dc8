"""Privileged critic of stages 1 and 3."""

from collections.abc import Sequence

from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import nn

from plat.entries import expects
from plat.modules.networks import mlp
from plat.modules.normalizer import ObservationNormalizer
from plat.robots.robot import Robot
from plat.spec.observation import observation_widths, privileged_keys

__all__ = ["Critic"]


class Critic(nn.Module):
    """State-value function ``V(s)`` that sees privileged entries beside the policy's own.

    Args:
        robot: the robot.
        keys: entries that the policy sees.
        hidden: sizes of the hidden layers.

    >>> from plat.robots import G1
    >>> from plat.spec.observation import student_keys
    >>> Critic(G1, student_keys(), hidden=(16,)).head().out_keys
    ['state_value']
    """

    def __init__(self, robot: Robot, keys: Sequence[NestedKey], hidden: tuple[int, ...] = (512, 256, 128)):
        super().__init__()
        keys = [*keys, *privileged_keys()]
        widths = observation_widths(keys, robot)
        size = sum(widths)
        self.normalizer = ObservationNormalizer(keys, size, widths=widths)
        self.network = mlp(size, hidden, 1)

    def observe(self) -> TensorDictModule:
        """Return the module that writes the normalized ``critic_observation``."""
        return self.normalizer.using(out_key="critic_observation")

    def head(self) -> TensorDictModule:
        """Return the module that writes ``state_value`` ``[*B, 1]`` of a ``critic_observation``."""
        head = TensorDictModule(self.network, in_keys=["critic_observation"], out_keys=["state_value"])
        return expects(head, {"critic_observation": (len(self.normalizer.mean),)}, "critic")
