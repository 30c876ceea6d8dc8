"""Authored chains, looked up by the rows of their keyframes."""

import torch
from torch import Tensor, nn

from plat.envs.settings import ReachLimits
from plat.keyframes.chain_families import FAMILY_TABLE
from plat.tasks.chains import KeyframeChains

__all__ = ["ChainRows"]


class ChainRows(nn.Module):
    """What a task asks about authored chains. In a pose table their keyframes come after the frames of the motions.

    Args:
        chains: C chains of R keyframes in all.
        frames: number of frames.

    Attributes:
        first_row: row ``[C]`` that each chain begins with.
        duration: control steps ``[C]`` of each chain with the hold after it.
        moves: whether each chain ``[C]`` leads away from where it begins.
        roams: whether it leads out of reach ``[C]``, as those of the family ``far`` do.
        reached_within: largest distance ``[C]`` of a commanded body with which its keyframes are reached (m).

    >>> from plat.motions import MotionLibrary, generate_motions
    >>> from plat.tasks import draw_chains
    >>> library = MotionLibrary.from_clips(generate_motions("train", seconds=8))
    >>> rows = ChainRows(draw_chains(library, 2, ["steps"]), frames=1000)
    >>> rows.following(rows.first_row)[0].tolist() == (rows.first_row + 1).tolist()
    True
    """

    first_row: Tensor
    duration: Tensor
    moves: Tensor
    roams: Tensor
    reached_within: Tensor
    _chain: Tensor
    _next_row: Tensor
    _steps: Tensor

    def __init__(self, chains: KeyframeChains, frames: int):
        super().__init__()
        self._frames = frames
        within = [FAMILY_TABLE[name].bodies or ReachLimits().bodies for name in chains.family]
        for name, value in (
            ("first_row", chains.first_row + frames),
            ("duration", chains.duration),
            ("moves", chains.moves),
            ("roams", torch.tensor([name == "far" for name in chains.family])),
            ("reached_within", torch.tensor(within)),
            ("_chain", chains.chain),
            ("_next_row", chains.next_row + frames),
            ("_steps", chains.steps),
        ):
            self.register_buffer(name, value, persistent=False)

    def chain(self, goal: Tensor) -> Tensor:
        """Return the number ``[N]`` of the chain that rows ``[N]`` are of; 0 for frames of a motion."""
        return self._chain[self._row(goal)]

    def following(self, goal: Tensor) -> tuple[Tensor, Tensor]:
        """Return rows ``[N]`` that are commanded after rows ``[N]``, and in how many control steps."""
        row = self._next_row[self._row(goal)]
        return row, self._steps[self._row(row)]

    def _row(self, goal: Tensor) -> Tensor:
        return (goal - self._frames).clamp_min(0)
