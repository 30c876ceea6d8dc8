"""Privileged goal-sequence encoder ``e_t = E_phi(g_t .. g_{t+Delta})``."""

from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

__all__ = ["GoalSequenceEncoder"]


class GoalSequenceEncoder(TensorDictModule):
    """Encodes a dense goal sequence of variable length: the last state of a GRU that runs over it.

    It recurs over the frames of the goal, not over the environment's time: each call starts from a zero state.

    Args:
        in_features: size of one goal frame.
        hidden_size: size of ``e``.
        in_keys: goals ``[*B, L, in_features]``, padded at the end, and their lengths ``[*B]`` (at least 1).
        out_key: code ``[*B, hidden_size]``.

    >>> import torch
    >>> encoder = GoalSequenceEncoder(80, 16)
    >>> goals = torch.randn(4, 11, 80)
    >>> code = encoder(goals, torch.tensor([11, 3, 1, 7]))
    >>> goals[1, 3:] = 99.0  # padding is never read
    >>> torch.equal(code, encoder(goals, torch.tensor([11, 3, 1, 7])))
    True
    """

    def __init__(
        self,
        in_features: int,
        hidden_size: int,
        in_keys: tuple[NestedKey, NestedKey] = (("privileged_goal", "frames"), ("privileged_goal", "length")),
        out_key: NestedKey = "goal_code",
    ):
        super().__init__(_LastState(in_features, hidden_size), in_keys=list(in_keys), out_keys=[out_key])


class _LastState(nn.Module):
    def __init__(self, in_features: int, hidden_size: int):
        super().__init__()
        self.embed = nn.Sequential(nn.Linear(in_features, hidden_size), nn.ELU())
        self.gru = nn.GRU(hidden_size, hidden_size, batch_first=True)

    def forward(self, frames: Tensor, length: Tensor) -> Tensor:
        states, _ = self.gru(self.embed(frames.flatten(0, -3)))
        last = (length.reshape(-1, 1, 1) - 1).expand(-1, 1, states.shape[-1])
        return states.gather(1, last)[:, 0].unflatten(0, frames.shape[:-2])
