"""Teacher of stage 2: what labels the states that a student visits."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from tensordict.nn import TensorDictModuleBase
from torchrl.envs import Transform

from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot

__all__ = ["Teacher"]


@runtime_checkable
class Teacher(Protocol):
    """Dense tracker that labels the states of a keyframe environment with its actions.

    :class:`plat.modules.Expert` is one, and so is every released tracker of :mod:`plat.baselines`. Stage 2 needs
    nothing else of it.

    >>> from plat.modules import Expert, LatentPolicy
    >>> from plat.robots import G1
    >>> isinstance(Expert(G1), Teacher), isinstance(LatentPolicy(G1), Teacher)
    (True, False)
    """

    robot: Robot
    """Robot that it drives."""

    stateful: bool
    """Whether a label depends on the steps before. A stateful teacher labels while the robot is simulated; others label
    whole rollouts, and states in any order."""

    def references(self, library: MotionLibrary) -> Sequence[Transform]:
        """Return the transforms that show it its reference beside the student's keyframe.

        Args:
            library: motions of the environment, on its device.
        """
        ...

    def labels(self) -> TensorDictModuleBase:
        """Return the module that writes its action ``[*B, J]`` to ``expert_action``."""
        ...
