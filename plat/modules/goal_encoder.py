"""Privileged goal-sequence encoder ``e_t = E_phi(g_t .. g_{t+Delta})``."""

from itertools import accumulate
from typing import Any

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import Count, check_value
from plat.entries import expects
from plat.errors import ObservationError, PlatError

__all__ = ["GoalSequenceEncoder"]


class GoalSequenceEncoder(TensorDictModule):
    """Encoder of a dense goal sequence of variable length: the last state of a GRU.

    It recurs over the frames of the goal, not over the environment's time: each call starts from a zero state.

    Args:
        in_features: size of one goal frame.
        hidden_size: size of ``e``.
        in_keys: normalized goals ``[*B, L, in_features]``, padded at the end, and their lengths ``[*B]`` (at least 1).
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
        in_keys: tuple[NestedKey, NestedKey] = (("privileged_goal", "normalized"), ("privileged_goal", "length")),
        out_key: NestedKey = "goal_code",
    ):
        check_value("goal encoder: in_features", in_features, Count)
        check_value("goal encoder: hidden_size", hidden_size, Count)
        super().__init__(_LastState(in_features, hidden_size), in_keys=list(in_keys), out_keys=[out_key])
        expects(self, {in_keys[0]: ("L", in_features)}, "goal encoder")


class _LastState(nn.Module):
    def __init__(self, in_features: int, hidden_size: int):
        super().__init__()
        self.embed = nn.Sequential(nn.Linear(in_features, hidden_size), nn.ELU())
        self.gru = nn.GRU(hidden_size, hidden_size)

    def forward(self, frames: Tensor, length: Tensor) -> Tensor:
        *batch, num_frames, size = frames.shape
        frames, length = frames.reshape(length.numel(), num_frames, size), length.flatten()
        # Longest first: a sequence that is over leaves the batch, so that little work is done for the padding. They
        # leave by sixteenths, for matrix products whose size is never the same cost more than they do to set up.
        order = length.argsort(descending=True)
        part = max(1, -(-len(length) // 16))
        going = (length[:, None] > torch.arange(num_frames, device=length.device)).sum(0)
        counts = (part * ((going + part - 1) // part)).clamp(max=len(length)).tolist()
        real = going.tolist()
        if real[:1] != [len(length)]:
            raise ObservationError("goal encoder: a goal sequence has no frames, expected a length of at least 1")
        weight_ih, weight_hh, bias_ih, bias_hh = self.gru.all_weights[0]
        index = torch.cat([num_frames * order[:count] + step for step, count in enumerate(counts)])
        embedded = self.embed(frames.flatten(0, 1).index_select(0, index))
        from_frames = nn.functional.linear(embedded, weight_ih, bias_ih)
        last = _Recurrence.apply(from_frames, weight_hh, bias_hh, counts, real)
        return last[order.argsort()].view(*batch, last.shape[-1])


class _Recurrence(torch.autograd.Function):
    """PyTorch's GRU equations from zero states over sequences, the longest first, and their gradient by hand.

    Autograd would keep each step's slices apart: written together, they are one matrix product for the weights and
    no copies in between. It all has the precision of ``from_frames``.

    Args:
        from_frames: linear maps of the frames ``[sum(counts), 3 H]``, all of the first step before those of the next.
        weight: of the linear map of the state ``[3 H, H]``.
        bias: of it ``[3 H]``.
        counts: rows of each step; the first one is the number of sequences B.
        going: how many of them, the first ones, are no padding.

    Returns the last states ``[B, H]``.
    """

    @staticmethod
    def forward(
        ctx: Any, from_frames: Tensor, weight: Tensor, bias: Tensor, counts: list[int], going: list[int]
    ) -> Tensor:
        weight, bias = weight.to(from_frames), bias.to(from_frames)
        sizes, at_least_float32 = [weight.shape[1]] * 3, torch.promote_types(from_frames.dtype, torch.float32)
        before, reset, keep, new, from_state = from_frames.new_empty(5, len(from_frames), sizes[0])
        state = from_frames.new_zeros(counts[0], sizes[0])
        for rows, count, real in _steps(counts, going):
            before[rows] = state[:count]
            from_frame = from_frames[rows].split(sizes, -1)
            to_reset, to_keep, from_state[rows] = nn.functional.linear(before[rows], weight, bias).split(sizes, -1)
            torch.add(from_frame[0], to_reset, out=reset[rows]).sigmoid_()
            torch.add(from_frame[1], to_keep, out=keep[rows]).sigmoid_()
            # PyTorch's tanh takes five times as long in half precision
            new[rows] = torch.addcmul(from_frame[2], reset[rows], from_state[rows]).to(at_least_float32).tanh_()
            torch.lerp(new[real], before[real], keep[real], out=state[: real.stop - real.start])
        ctx.save_for_backward(weight, before, reset, keep, new, from_state)
        ctx.counts, ctx.going = counts, going
        return state

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        if torch.is_grad_enabled():
            raise PlatError("goal encoder: its gradient has no gradient, expected create_graph=False")
        weight, before, reset, keep, new, from_state = ctx.saved_tensors
        sizes = [weight.shape[1]] * 3
        to_frames, to_states = weight.new_empty(2, len(new), sum(sizes))
        grad = grad.clone()
        for rows, count, real in reversed(_steps(ctx.counts, ctx.going)):
            here = grad[: real.stop - real.start]
            stays = here * keep[real]
            to_new = torch.ops.aten.tanh_backward(here - stays, new[real])
            to_keep = torch.ops.aten.sigmoid_backward(here * (before[real] - new[real]), keep[real])
            to_reset = torch.ops.aten.sigmoid_backward(to_new * from_state[real], reset[real])
            torch.cat((to_reset, to_keep, to_new), -1, out=to_frames[real])
            torch.cat((to_reset, to_keep, to_new * reset[real]), -1, out=to_states[real])
            for padded in (to_frames, to_states):
                padded[real.stop : rows.stop] = 0
            here.copy_(stays)
            grad[:count].addmm_(to_states[rows], weight)
        return to_frames, to_states.t() @ before, to_states.sum(0), None, None


def _steps(counts: list[int], going: list[int]) -> list[tuple[slice, int, slice]]:
    """Return, for each step, its rows, their number, and which of them are no padding."""
    begins = accumulate(counts, initial=0)
    return [
        (slice(begin, begin + count), count, slice(begin, begin + real))
        for begin, count, real in zip(begins, counts, going, strict=False)
    ]
