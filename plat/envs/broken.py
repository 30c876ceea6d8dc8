"""Robots whose actions or simulations are broken: found, counted, and the end of a run when it goes on."""

from collections.abc import Mapping

import torch
from torch import Tensor

from plat.errors import ActionError

__all__ = ["ABSURD_ACTION", "BrokenRobots", "absurd"]

ABSURD_ACTION = 1e4
"""Actions beyond this, or not finite, terminate their robot: motors saturate at a few units."""
# This many consecutive control steps with broken robots mean that the policy is broken.
_BROKEN_STEPS = 50


def absurd(action: Tensor) -> Tensor:
    """Return the mask ``[N]`` of robots whose action ``[N, J]`` is beyond :data:`ABSURD_ACTION`, or not finite.

    >>> absurd(torch.tensor([[0.5], [1e30], [torch.nan]])).tolist()
    [False, True, True]
    """
    return ~(action.abs() <= ABSURD_ACTION).all(-1)  # true for NaN as well


class BrokenRobots:
    """Detector of robots whose action is absurd or not finite, or whose simulation diverged.

    MuJoCo silently puts such a robot back to its start, upright.

    >>> broken = BrokenRobots()
    >>> broken.sound(torch.tensor([[0.5], [torch.nan]])).tolist()
    [[0.5], [0.0]]
    >>> broken.found(diverged=torch.tensor([False, False])).tolist(), broken.count
    ([False, True], 1)
    """

    def __init__(self) -> None:
        self.count = 0
        """How often a robot was broken."""
        self._told = 0
        self._steps = 0
        self._absurd: Tensor | None = None

    def state_dict(self) -> dict[str, int]:
        """Return the counts, from which a resumed run goes on."""
        return {"count": self.count, "told": self._told, "steps": self._steps}

    def load_state_dict(self, state: Mapping[str, int]) -> None:
        """Restore a state of :meth:`state_dict`."""
        self.count, self._told, self._steps = (int(state[name]) for name in ("count", "told", "steps"))

    def sound(self, action: Tensor) -> Tensor:
        """Return actions ``[N, J]`` with 0 for robots whose action is absurd, which :meth:`found` then names.

        They are float32, as an environment's entries are, and without a gradient: none leads through a simulation, and
        that of the last action would lead to all before it.
        """
        action = action.detach().float()
        self._absurd = absurd(action)
        return torch.where(self._absurd[:, None], 0.0, action)

    def found(self, diverged: Tensor) -> Tensor:
        """Return the mask ``[N]`` of robots that were broken in this step.

        Args:
            diverged: robots ``[N]`` whose simulation left all bounds.

        Raises:
            ActionError: when some robot was in each of the last 50 steps.
        """
        broken = diverged if self._absurd is None else self._absurd | diverged
        if not broken.any():
            self._steps = 0
            return broken
        self.count += int(broken.sum())
        self._steps += 1
        if self._steps >= _BROKEN_STEPS:
            raise ActionError(
                f"{int(broken.sum())} of {len(broken)} robots had actions that are not finite or beyond "
                f"{ABSURD_ACTION:g}, or left the simulation's bounds, and some did for {_BROKEN_STEPS} control steps "
                "in a row: the policy is broken"
            )
        return broken

    def pop(self) -> int:
        """Return how often a robot was broken since the last call."""
        new, self._told = self.count - self._told, self.count
        return new
