"""What the partial keyframes of a task command."""

import torch
from torch import Tensor, nn

from plat.envs.part_masks import NUM_MASKS, draw_parts
from plat.robots.robot import Robot
from plat.tasks.chains import KeyframeChains

__all__ = ["KeyframeMasks"]


class KeyframeMasks(nn.Module):
    """Table of masks, and the draw of one for each new command.

    Args:
        robot: the robot.
        chains: authored chains, some of which are all commanded by one kind of mask.
        partial: share of the other keyframes that are partial.
        seed: draws the table.

    Attributes:
        table: masks ``[M, J + K + 3]``, float. The first commands all.
    """

    table: Tensor
    _of_chain: Tensor

    def __init__(self, robot: Robot, chains: KeyframeChains, partial: float, seed: int = 0):
        super().__init__()
        self._partial = partial
        kinds = sorted({kind for kind in chains.commands if kind})
        drawn = draw_parts(robot, NUM_MASKS, seed).float()
        rooted = drawn.clone()  # for chains that lead away: who is not told of the root does not know where to
        rooted[:, -3:] = 1.0
        of_kinds = [draw_parts(robot, 2, seed, [kind], root=False)[1:].float() for kind in kinds]
        self.register_buffer("table", torch.cat((drawn, rooted, *of_kinds)), persistent=False)
        row = {kind: 2 * NUM_MASKS + number for number, kind in enumerate(kinds)}
        of_chain = torch.tensor([row.get(kind, 0) for kind in chains.commands])
        self.register_buffer("_of_chain", of_chain, persistent=False)

    def draw(self, chain: Tensor, authored: Tensor, moves: Tensor) -> Tensor:
        """Return rows ``[N]`` of masks for new commands.

        Args:
            chain: that authored ones are of ``[N]``.
            authored: whether they are authored ``[N]``, or along a motion.
            moves: whether those chains lead away from where they begin ``[N]``.
        """
        row = torch.randint_like(chain, 1, NUM_MASKS)
        row = torch.where(authored & moves, row + NUM_MASKS, row)
        row = torch.where(torch.rand(row.shape, device=row.device) < self._partial, row, 0)
        return torch.where(authored & (self._of_chain[chain] > 0), self._of_chain[chain], row)
