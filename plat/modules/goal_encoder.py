"""Privileged goal-sequence encoder ``e_t = E_phi(g_t .. g_{t+Delta})``."""

import torch
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
        self.gru = nn.GRU(hidden_size, hidden_size)

    def forward(self, frames: Tensor, length: Tensor) -> Tensor:
        *batch, num_frames, _ = frames.shape
        frames, length = frames.flatten(0, -3), length.flatten()
        # Longest first: a sequence that is over leaves the batch, so that little work is done for the padding. They
        # leave by eighths, for matrix products whose size is never the same cost more than they do to set up.
        order = length.argsort(descending=True)
        eighth = -(-len(length) // 8)
        going = (length[:, None] > torch.arange(num_frames, device=length.device)).sum(0)
        counts = (eighth * ((going + eighth - 1) // eighth)).clamp(max=len(length)).tolist()
        weight_ih, weight_hh, bias_ih, bias_hh = self.gru.all_weights[0]
        index = torch.cat([num_frames * order[:count] + step for step, count in enumerate(counts)])
        embedded = self.embed(frames.flatten(0, 1).index_select(0, index))
        from_frames = nn.functional.linear(embedded, weight_ih, bias_ih).split(counts)
        state = frames.new_zeros(len(frames), self.gru.hidden_size)
        over = []
        for step, from_frame in enumerate(from_frames):
            over.append(state[len(from_frame) :])
            state = state[: len(from_frame)]
            from_state = nn.functional.linear(state, weight_hh, bias_hh)
            next_state = _gru_update(from_frame, from_state, state)
            state = torch.where((length[order[: len(state)]] > step)[:, None], next_state, state)
        last = torch.cat([state, *reversed(over)])
        return last[order.argsort()].unflatten(0, batch)


def _gru_update(from_frame: Tensor, from_state: Tensor, state: Tensor) -> Tensor:
    """PyTorch's GRU equations: next state ``[B, H]`` from both linear maps ``[B, 3 H]`` and the state."""
    sizes = (2 * state.shape[-1], state.shape[-1])
    (frame_gates, frame_new), (state_gates, state_new) = from_frame.split(sizes, -1), from_state.split(sizes, -1)
    reset, keep = torch.sigmoid(frame_gates + state_gates).chunk(2, -1)
    new = torch.tanh(torch.addcmul(frame_new, reset, state_new))
    return new + keep * (state - new)
