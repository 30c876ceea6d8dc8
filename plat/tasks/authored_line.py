"""The line between authored keyframes, which have no other reference."""

import torch
from tensordict import TensorDictBase
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.tasks.pose_table import PoseTable

__all__ = ["AuthoredLine"]


class AuthoredLine(nn.Module):
    """Where a robot is to be on its way from one authored keyframe to the next: straight, or by a pose midway.

    Memories are those of :class:`plat.tasks.TimedKeyframes`.

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

    def middle(self, memory: TensorDictBase) -> Tensor:
        """Rows ``[N]`` of the poses that are passed on the way to authored keyframes; -1 where the way is straight."""
        goal = memory["goal"]
        row = self._middle_row[(goal - self._frames).clamp_min(0)]
        return torch.where(memory["authored"] & (memory["before"] != goal), row, -1)

    def state(self, memory: TensorDictBase) -> GeneralizedState:
        """Pose on the line, at rest."""
        rows = self._between(memory)
        before, after, share = self._table.state(rows[0]), self._table.state(rows[1]), rows[2][:, None]
        same_side = (before.root_quat_w * after.root_quat_w).sum(-1, keepdim=True) >= 0
        turned = torch.where(same_side, after.root_quat_w, -after.root_quat_w)
        return after._replace(
            root_pos_w=before.root_pos_w.lerp(after.root_pos_w, share),
            root_quat_w=nn.functional.normalize(before.root_quat_w.lerp(turned, share), dim=-1),
            joint_pos=before.joint_pos.lerp(after.joint_pos, share),
        )

    def points(self, memory: TensorDictBase) -> Tensor:
        """Positions of the keypoints ``[N, K, 3]`` (m, world), on straight lines from pose to pose."""
        before, after, share = self._between(memory)
        return self._table.points(before).lerp(self._table.points(after), share[:, None, None])

    def _between(self, memory: TensorDictBase) -> tuple[Tensor, Tensor, Tensor]:
        """Rows ``[N]`` of the poses that robots are between, and how far (0 to 1) from the first to the second."""
        share = (1 - memory["steps_left"] / memory["length"]).clamp(0, 1).to(self._table.states.dtype)
        middle = self.middle(memory)
        around, second = middle >= 0, share >= 0.5
        before = torch.where(around & second, middle, memory["before"])
        after = torch.where(around & ~second, middle, memory["goal"])
        return before, after, torch.where(around, 2 * share - second.to(share), share)
