"""Reward terms: named, weighted functions of a step, and the transform that adds them up."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import torch
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.data import Composite
from torchrl.envs import Transform

from plat.bounds import NotEmpty, Range, check_value
from plat.envs.broken import absurd
from plat.envs.transforms.base import Statistics, check_step_entries
from plat.errors import TaskError

__all__ = ["Reward", "RewardFunction", "RewardGroup", "Rewards"]

RewardFunction: TypeAlias = Callable[[TensorDictBase, TensorDictBase], Tensor]
"""Maps the entries before and after a step to ``[N]``. Before, there is ``action`` as well; after, there are the group
``"reference"`` and, for keyframes, the flags of the ``"command"`` that the step belonged to."""


@dataclass(frozen=True)
class Reward:
    """Reward term: ``weight * function(before, after)`` per second.

    >>> upright = Reward("upright", 0.5, lambda before, after: -after["robot", "gravity_b"][:, 2])
    """

    name: str
    """name; its mean is logged as ``reward/NAME``"""
    weight: float
    """factor; a term of weight 0 is not computed"""
    function: RewardFunction
    """function to a value ``[N]`` of the entries before and after a step"""
    needs: tuple[NestedKey, ...] = ()
    """entries after a step that earlier transforms must write; checked when the task is built"""

    def __post_init__(self) -> None:
        check_value("reward: name", self.name, Annotated[str, NotEmpty()])
        check_value(f"reward {self.name!r}: weight", self.weight, float)
        if not callable(self.function):
            told = f"expected a function of the entries before and after a step, not {self.function!r:.60}"
            raise TaskError(f"reward {self.name!r}: {told}")

    def __call__(self, before: TensorDictBase, after: TensorDictBase) -> Tensor:
        """Compute the weighted term ``[N]``.

        Raises:
            TaskError: when it reads an entry that is not there, is no tensor, or is of another shape.
        """
        try:
            value = self.function(before, after)
        except KeyError as error:
            raise TaskError(f"reward {self.name!r} reads an entry that is not there: {error.args[0]}") from error
        if not isinstance(value, Tensor):
            expected = f"a tensor of shape {tuple(after.batch_size)}"
            raise TaskError(f"reward {self.name!r} is a {type(value).__name__}, expected {expected}")
        if value.shape != after.batch_size:
            raise TaskError(f"reward {self.name!r} has shape {tuple(value.shape)}, expected {tuple(after.batch_size)}")
        return self.weight * value


@dataclass(frozen=True)
class RewardGroup:
    """Group of reward terms with a common factor and bound."""

    weight: float
    """factor on their sum"""
    rewards: tuple[Reward, ...]
    """the terms"""
    floor: float | None = None
    """lower bound on the sum, for penalties: all terms are scaled alike to meet it; None for no bound"""

    def __post_init__(self) -> None:
        check_value("reward group: weight", self.weight, float)
        check_value("reward group: floor", self.floor, Annotated[float, Range(high=0)] | None)

    def terms(self, before: TensorDictBase, after: TensorDictBase) -> dict[str, Tensor]:
        """Compute the weighted terms ``[N]`` of a step, without the factor of the group."""
        terms = {reward.name: reward(before, after) for reward in self.rewards if reward.weight != 0}
        if not terms or self.floor is None:
            return terms
        total = torch.stack(list(terms.values())).sum(0)
        kept = torch.where(total < self.floor, self.floor / total, 1.0)
        return {name: value * kept for name, value in terms.items()}


class Rewards(Transform):
    """Transform that adds the reward of a step, times the control step, and logs the mean of each term.

    Put it after the transforms that write what the terms read, and before the next command is issued. A step with an
    absurd action, which terminates its robot (:mod:`plat.envs.broken`), is paid 0: terms of the action are not finite.

    Args:
        rewards: terms and groups of terms; one whose weight is 0 is left out.
        dt: control step (s).

    Raises:
        TaskError: when two terms have the same name, or one is no reward.
    """

    def __init__(self, rewards: Sequence[Reward | RewardGroup], dt: float):
        super().__init__()
        self.statistics = Statistics()
        if isinstance(rewards, Reward | RewardGroup):
            raise TaskError(f"rewards is a single {type(rewards).__name__}, expected several in a tuple")
        if strange := [reward for reward in rewards if not isinstance(reward, Reward | RewardGroup)]:
            raise TaskError(f"rewards hold {strange[0]!r}, expected each to be a Reward or a RewardGroup")
        groups = [reward if isinstance(reward, RewardGroup) else RewardGroup(1.0, (reward,)) for reward in rewards]
        self.groups = [group for group in groups if group.weight]
        """Groups of terms in the order in which they are added up."""
        self._dt = dt
        terms = [reward for group in self.groups for reward in group.rewards]
        names = [reward.name for reward in terms]
        if doubled := sorted({name for name in names if names.count(name) > 1}):
            raise TaskError(f"two rewards are called {doubled[0]!r}, expected names of their own")
        self._needs = tuple(dict.fromkeys(key for reward in terms if reward.weight for key in reward.needs))

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        unpaid = absurd(tensordict["action"])
        for group in self.groups:
            terms = group.terms(tensordict, next_tensordict)
            terms = {name: value.masked_fill(unpaid, 0.0) for name, value in terms.items()}
            for name, value in terms.items():
                self.statistics.add(f"reward/{name}", value)
            if terms:
                total = torch.stack(list(terms.values())).sum(0).detach()
                reward = next_tensordict["reward"]
                next_tensordict["reward"] = reward + ((group.weight * self._dt) * total[:, None]).to(reward)
        return next_tensordict

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Check that the entries that terms read are there."""
        check_step_entries("Rewards", self._needs, observation_spec)
        return observation_spec
