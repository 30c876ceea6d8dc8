"""The line between authored keyframes, which have no other reference."""

from typing import NamedTuple

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.rotations import quat_nlerp
from plat.tasks.pose_table import PoseTable

__all__ = ["AuthoredLine", "Way"]


class Way(NamedTuple):
    """Where N robots are on their way to authored keyframes.

    Attributes:
        before: row of the pose that each comes from, the keyframe before or the pose midway.
        after: row of the pose that it goes to.
        share: how far it is between the two, 0 to 1.
        around: whether there is a pose midway.
    """

    before: Tensor
    after: Tensor
    share: Tensor
    around: Tensor

    def at(self, rows: Tensor | slice) -> "Way":
        """Return that of some robots."""
        return Way(*(value[rows] for value in self))


class AuthoredLine(nn.Module):
    """Where a robot is to be on its way from one authored keyframe to the next: straight, or by a pose midway.

    Args:
        table: rows of motions, then of authored keyframes, then of the poses midway.
        middle_row: which of the poses midway ``[R]`` is passed on the way to each authored keyframe; -1 for none.
        frames: number of rows of motions.
    """

    _middle_row: Tensor

    def __init__(self, table: PoseTable, middle_row: Tensor, frames: int):
        super().__init__()
        self._table, self._frames = table, frames
        behind = frames + len(middle_row)
        self.register_buffer("_middle_row", torch.where(middle_row < 0, -1, middle_row + behind), persistent=False)

    def way(self, memory: TensorDictBase) -> Way:
        """Return where robots are, by their memories of :class:`plat.tasks.TimedKeyframes`."""
        before, goal = memory["before"], memory["goal"]
        middle = self._middle_row[(goal - self._frames).clamp_min(0)]
        around = (middle >= 0) & memory["authored"] & (before != goal)
        share = (1 - memory["steps_left"] / memory["length"]).clamp(0, 1).to(self._table.states.dtype)
        second = share >= 0.5
        return Way(
            torch.where(around & second, middle, before),
            torch.where(around & ~second, middle, goal),
            torch.where(around, 2 * share - second.to(share), share),
            around,
        )

    def state(self, way: Way) -> GeneralizedState:
        """Return the pose on the line, at rest."""
        before, after, share = self._table.state(way.before), self._table.state(way.after), way.share[:, None]
        return after._replace(
            root_pos_w=before.root_pos_w.lerp(after.root_pos_w, share),
            root_quat_w=quat_nlerp(before.root_quat_w, after.root_quat_w, way.share),
            joint_pos=before.joint_pos.lerp(after.joint_pos, share),
        )

    def points(self, way: Way) -> Tensor:
        """Return positions of the keypoints ``[N, K, 3]`` (m, world), on straight lines from pose to pose."""
        return self._table.points(way.before).lerp(self._table.points(way.after), way.share[:, None, None])
