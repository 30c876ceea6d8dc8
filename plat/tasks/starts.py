"""Where episodes start, and how far off their reference."""

import torch
from torch import Tensor, nn

from plat.envs.state import GeneralizedState
from plat.envs.tracking import ResetNoise
from plat.motions.library import MotionLibrary
from plat.robots.robot import Robot
from plat.rotations import quat_from_rotvec, quat_multiply, quat_rotate, quat_rotate_inverse

__all__ = ["ClipStarts", "FailureWeights", "disturbed"]


class FailureWeights(nn.Module):
    """Draws places more often where episodes fail.

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

    def __init__(self, count: int, uniform: float = 0.3, memory: float = 2000.0):
        super().__init__()
        self.uniform = uniform
        self._kept = 1.0 - 1.0 / memory
        # as if each place had been failed at: nothing is known of it yet
        self.register_buffer("failures", torch.full((count,), 0.5))

    def draw(self, count: int) -> Tensor:
        """Places ``[count]``."""
        weights = self.uniform / len(self.failures) + (1 - self.uniform) * self.failures / self.failures.sum()
        return torch.multinomial(weights, count, replacement=True)

    def record(self, places: Tensor, amount: float = 0.2) -> None:
        """Count failures at places ``[n]``."""
        self.failures.index_add_(0, places, torch.full_like(places, amount, dtype=self.failures.dtype))
        self.failures.clamp_(0.02, 5.0)

    def forget(self) -> None:
        """Let a control step pass."""
        self.failures.mul_(self._kept).clamp_min_(0.02)


class ClipStarts(nn.Module):
    """Draws frames of a library, more often in the seconds before failures.

    Args:
        library: motions.
        frames_left: a start has at least this many frames of its clip to come, where the clip is that long.
        uniform: share of the draws that is uniform over seconds.

    Source: adaptive sampling of BeyondMimic, arXiv 2508.08241.
    """

    _bin_of_frame: Tensor
    _bin_start: Tensor
    _bin_size: Tensor
    _clip_of_bin: Tensor

    def __init__(self, library: MotionLibrary, frames_left: int = 10, uniform: float = 0.3):
        super().__init__()
        size = max(1, round(1.0 / library.dt))
        usable = (library.clip_length - frames_left).clamp_min(1)
        bins = (usable + size - 1) // size
        first = bins.cumsum(0) - bins
        clip = torch.repeat_interleave(torch.arange(len(bins), device=bins.device), bins)
        start = library.clip_start[clip] + (torch.arange(len(clip), device=bins.device) - first[clip]) * size
        within = torch.arange(len(library), device=bins.device) - library.clip_start[library.clip_of_frame]
        number = (within // size).minimum(bins[library.clip_of_frame] - 1)
        self.register_buffer("_bin_of_frame", first[library.clip_of_frame] + number, persistent=False)
        self.register_buffer("_bin_start", start, persistent=False)
        end = library.clip_start[clip] + usable[clip]
        self.register_buffer("_bin_size", (end - start).clamp_max(size), persistent=False)
        self.register_buffer("_clip_of_bin", clip, persistent=False)
        self.weights = FailureWeights(len(clip), uniform)

    def draw(self, count: int) -> Tensor:
        """Frames ``[count]``."""
        chosen = self.weights.draw(count)
        size = self._bin_size[chosen]
        return self._bin_start[chosen] + (torch.rand(count, device=size.device) * size).long().minimum(size - 1)

    def record(self, frame: Tensor) -> None:
        """Count failures at frames ``[n]``: what led to one may have begun in the second before."""
        place = self._bin_of_frame[frame]
        before = (place - 1).clamp_min(0)
        self.weights.record(place, 0.1)
        self.weights.record(torch.where(self._clip_of_bin[before] == self._clip_of_bin[place], before, place), 0.1)


def disturbed(state: GeneralizedState, noise: ResetNoise, robot: Robot) -> GeneralizedState:
    """States ``[n]`` with uniform noise on root, joint angles and velocities."""
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
