"""Dense goals: the reference a few frames ahead."""

from collections.abc import Mapping
from types import MappingProxyType

from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform

from plat.bounds import Natural, check_value
from plat.envs.goals import robot_centric_goal
from plat.envs.transforms.base import ObservationTransform
from plat.motions.library import MotionLibrary
from plat.spec.observation import entry_shapes

__all__ = ["NEXT_DENSE_FRAME", "NEXT_FRAME", "DenseGoal"]

NEXT_FRAME: Mapping[str, int] = MappingProxyType({"goal": 1})
"""What a dense tracker is shown by default: groups by name, and how many frames ahead each is."""

NEXT_DENSE_FRAME: Mapping[str, int] = MappingProxyType({"dense_goal": 1})
"""The same beside a keyframe, for the expert that labels."""


class DenseGoal(ObservationTransform):
    """Transform that adds ``g_{t+k}``, the reference ``k`` frames ahead in the robot's frame; it holds a clip's last
    frame.

    Reads ``("motion", "frame")``, ``("estimate", "root_pos_w")`` and ``("estimate", "root_quat_w")``; writes the
    entries of :func:`plat.envs.robot_centric_goal` in ``group``.

    Args:
        library: motions.
        group: name of the group that is written.
        ahead: number of frames k, at least 0.
    """

    def __init__(self, library: MotionLibrary, group: str = "goal", ahead: int = 1):
        check_value(f"goal {group!r}: frames ahead", ahead, Natural)
        super().__init__(
            in_keys=[("motion", "frame"), ("estimate", "root_pos_w"), ("estimate", "root_quat_w")],
            out_shapes={(group, key): shape for key, shape in entry_shapes("goal", library.robot).items()},
        )
        self._library = library
        self._group = group
        self._ahead = ahead

    @classmethod
    def of_groups(cls, library: MotionLibrary, goals: Mapping[str, int]) -> list[Transform]:
        """Return a transform for each group, given by name with its number of frames ahead."""
        return [cls(library, group, ahead) for group, ahead in goals.items()]

    def compute(self, tensordict: TensorDictBase) -> dict[NestedKey, Tensor]:
        frame = tensordict["motion", "frame"]
        target = self._library.poses((frame + self._ahead).minimum(self._library.last_of(frame)))
        goal = robot_centric_goal(target, tensordict["estimate", "root_pos_w"], tensordict["estimate", "root_quat_w"])
        return {(self._group, key): value for key, value in goal.items()}
