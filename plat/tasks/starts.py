"""Where episodes start, and how far off their reference."""

from typing import Annotated

import torch
from torch import Tensor, nn

from plat.bounds import Count, Fraction, Natural, Range, check_value
from plat.envs.state import GeneralizedState
from plat.envs.tracking import ResetNoise
from plat.motions.bins import ClipBins
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate, quat_rotate_inverse

__all__ = ["ClipStarts", "FailureWeights", "disturbed"]

# Places whose failures are added up, and those that are forgotten at in one step.
_BLOCK = 256
_AT_ONCE = 1 << 16
# As if each place had been failed at: nothing is known of it yet.
_UNKNOWN = 0.5


class FailureWeights(nn.Module):
    """Draws places more often where episodes fail.

    A place takes 4 bytes. Places are summed in blocks of 256, and a draw picks a block and then the place in it. So
    its time hardly depends on their number. Of more than 65,536 places, a step forgets at a part, by as much more.

    Args:
        count: number of places P.
        uniform: share of the draws that is uniform.
        memory: failures are forgotten by ``1 / e`` in this many calls of :meth:`forget`.

    >>> weights = FailureWeights(3, uniform=0.0)
    >>> weights.record(torch.full((1000,), 2))
    >>> bool((weights.draw(100) == 2).float().mean() > 0.5)
    True
    """

    failures: Tensor
    turn: Tensor
    _sums: Tensor

    def __init__(self, count: int, uniform: float = 0.3, memory: float = 2000.0):
        super().__init__()
        check_value("starts: count", count, Count)
        check_value("starts: uniform", uniform, Fraction)
        check_value("starts: memory", memory, Annotated[float, Range(1)])
        self.uniform = uniform
        self._kept = 1.0 - 1.0 / memory
        self._turns = -(-count // _AT_ONCE)
        self.register_buffer("failures", torch.full((count,), _UNKNOWN))
        # whose turn it is to be forgotten; part of the state only where there is more than one
        self.register_buffer("turn", torch.zeros((), dtype=torch.int64), persistent=self._turns > 1)
        self.register_buffer("_sums", torch.zeros(-(-count // _BLOCK)), persistent=False)
        self._add_up()
        self.register_load_state_dict_post_hook(_add_up_again)

    def draw(self, count: int) -> Tensor:
        """Return places ``[count]``."""
        device, places = self.failures.device, len(self.failures)
        anywhere = torch.randint(places, (count,), device=device)
        return torch.where(torch.rand(count, device=device) < self.uniform, anywhere, self._draw_failures(count))

    def record(self, places: Tensor, amount: float = 0.2) -> None:
        """Count failures at places ``[n]``."""
        self.failures.index_add_(0, places, torch.full_like(places, amount, dtype=self.failures.dtype))
        self.failures[places] = self.failures[places].clamp(0.02, 5.0)
        block = places // _BLOCK
        self._sums[block] = self._of_blocks(block).sum(-1)

    def forget_all(self) -> None:
        """Begin anew."""
        self.failures.fill_(_UNKNOWN)
        self.turn.zero_()
        self._add_up()

    def forget(self) -> None:
        """Let a control step pass."""
        begin = int(self.turn) * _AT_ONCE if self._turns > 1 else 0
        part = self.failures[begin : begin + _AT_ONCE]
        part.mul_(self._kept**self._turns).clamp_min_(0.02)
        self._add_up(begin // _BLOCK, -(-(begin + len(part)) // _BLOCK))
        if self._turns > 1:
            self.turn.add_(1).remainder_(self._turns)

    def _draw_failures(self, count: int) -> Tensor:
        """Places ``[count]`` in proportion to their failures."""
        edges = self._sums.double().cumsum(0)
        level = torch.rand(count, dtype=torch.float64, device=edges.device) * edges[-1]
        block = torch.searchsorted(edges, level, right=True).clamp_max(len(edges) - 1)
        within = self._of_blocks(block).double().cumsum(-1)
        # sums are rounded otherwise than these are: at an edge, the level is one of the block's all the same
        level = (level - edges[block] + self._sums[block]).clamp_min(0)
        chosen = torch.searchsorted(within, level[:, None], right=True)[:, 0].clamp_max(_BLOCK - 1)
        return (block * _BLOCK + chosen).clamp_max(len(self.failures) - 1)

    def _of_blocks(self, block: Tensor) -> Tensor:
        """Failures ``[n, 256]`` of blocks ``[n]``; 0 behind the last place."""
        place = block[:, None] * _BLOCK + torch.arange(_BLOCK, device=block.device)
        return self.failures[place.clamp_max(len(self.failures) - 1)] * (place < len(self.failures))

    def _add_up(self, begin: int = 0, end: int | None = None) -> None:
        """Add up blocks ``begin`` to ``end``."""
        end = len(self._sums) if end is None else end
        values = self.failures[begin * _BLOCK : end * _BLOCK]
        missing = (end - begin) * _BLOCK - len(values)
        self._sums[begin:end] = nn.functional.pad(values, (0, missing)).view(-1, _BLOCK).sum(-1)


def _add_up_again(weights: nn.Module, _: object) -> None:
    """Follow a state that was loaded."""
    assert isinstance(weights, FailureWeights)
    weights._add_up()


class ClipStarts(nn.Module):
    """Draws frames of a library, more often in the seconds before failures.

    Args:
        library: motions.
        frames_left: a start has at least this many frames of its clip to come, where the clip is that long.
        uniform: share of the draws that is uniform over seconds.

    Source: adaptive sampling of BeyondMimic, arXiv 2508.08241.
    """

    def __init__(self, library: MotionLibrary, frames_left: int = 10, uniform: float = 0.3):
        super().__init__()
        check_value("starts: library", library, MotionLibrary)
        check_value("starts: frames_left", frames_left, Natural)
        self.bins = ClipBins(library, frames_left, max(1, round(1.0 / library.dt)), whole_clips=True)
        self.weights = FailureWeights(self.bins.count, uniform)

    def draw(self, count: int) -> Tensor:
        """Return the frames ``[count]``."""
        return self.bins.draw_within(self.weights.draw(count))

    def record(self, frame: Tensor) -> None:
        """Count failures at frames ``[n]``: what led to one may have begun in the second before."""
        self.weights.record(self.bins.of_frame(frame), 0.1)
        self.weights.record(self.bins.of_frame(frame, back=1), 0.1)

    def last_of(self, frame: Tensor) -> Tensor:
        """Return the last frames of the clips of frames ``[*B]``."""
        return self.bins.last_of(frame)


def disturbed(state: GeneralizedState, noise: ResetNoise, robot: Robot) -> GeneralizedState:
    """Return states ``[n]`` with uniform noise on root, joint angles and velocities."""
    count, device = len(state.root_pos_w), state.root_pos_w.device

    def uniform(*half_widths: float) -> Tensor:
        return (2 * torch.rand(count, len(half_widths), device=device) - 1) * torch.tensor(half_widths, device=device)

    quat = quat_multiply(quat_from_rotvec(uniform(noise.roll_pitch, noise.roll_pitch, noise.yaw)), state.root_quat_w)
    ang_vel_w = quat_rotate(state.root_quat_w, state.root_ang_vel_b)
    ang_vel_w = ang_vel_w + uniform(noise.root_ang_vel_rp, noise.root_ang_vel_rp, noise.root_ang_vel_yaw)
    limits = robot.joint_range.to(device)
    joint_pos = state.joint_pos + uniform(*[noise.joint_pos] * robot.num_joints)
    return GeneralizedState(
        state.root_pos_w + uniform(noise.root_pos_xy, noise.root_pos_xy, noise.root_pos_z),
        quat,
        joint_pos.clamp(limits[:, 0], limits[:, 1]),
        state.root_lin_vel_w + uniform(noise.root_lin_vel_xy, noise.root_lin_vel_xy, noise.root_lin_vel_z),
        quat_rotate_inverse(quat, ang_vel_w),
        state.joint_vel,
    )
