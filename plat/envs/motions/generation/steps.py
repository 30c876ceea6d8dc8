"""Footsteps: where the feet are and where the weight is while a robot walks."""

from dataclasses import dataclass

import torch
from torch import Tensor

from plat.envs.motions.generation.curves import minimum_jerk

__all__ = ["Footstep", "Walk", "plan_walk"]

LEFT, RIGHT = 0, 1


@dataclass(frozen=True)
class Footstep:
    """One foot goes to a place: ``foot`` (0 left, 1 right), ``x``, ``y`` (m) and ``yaw`` (rad) in the world."""

    foot: int
    x: float
    y: float
    yaw: float


@dataclass(frozen=True)
class Walk:
    """Feet and weight of a walk, frame by frame.

    Attributes:
        foot_pos: ``[F, 2, 3]``: x, y (m) and height above the floor of the left and right sole.
        foot_yaw: ``[F, 2]`` (rad).
        zmp: wanted zero-moment point ``[F, 2]`` (m).
    """

    foot_pos: Tensor
    foot_yaw: Tensor
    zmp: Tensor


def plan_walk(
    start: Tensor,
    footsteps: list[Footstep],
    *,
    step_time: float,
    double_support: float,
    clearance: float,
    sole_center: float,
    rest: float,
    dt: float,
) -> Walk:
    """Frames of a walk that begins and ends at rest.

    Args:
        start: x (m), y (m) and yaw (rad) of the left and right foot ``[2, 3]``.
        footsteps: in order.
        step_time: seconds a step.
        double_support: share of it with both feet on the floor.
        clearance: height of the swinging sole in mid-swing (m).
        sole_center: how far the middle of the sole lies before the ankle (m); the weight goes there.
        rest: seconds of standing before the first step and after the last.
        dt: seconds a frame.
    """
    count = round((2 * rest + len(footsteps) * step_time) / dt) + 1
    time = torch.arange(count, dtype=torch.float64) * dt
    foot = start.double().expand(count, 2, 3).clone()
    height = torch.zeros(count, 2, dtype=torch.float64)
    place = start.double().clone()
    weight = _sole(place, sole_center).mean(0)
    zmp = weight.expand(count, 2).clone()
    shift = double_support * step_time
    for index, step in enumerate(footsteps):
        begin = rest + index * step_time
        target = torch.tensor([step.x, step.y, step.yaw], dtype=torch.float64)
        swing = (time - begin - shift) / (step_time - shift)
        foot[:, step.foot] += minimum_jerk(swing)[:, None] * (target - place[step.foot])
        inside = swing.clamp(0, 1)
        height[:, step.foot] += clearance * 16 * (inside * (1 - inside)) ** 2
        place[step.foot] = target
        # the weight goes onto the standing foot while both are down, and stays there during the swing
        stance = _sole(place, sole_center)[1 - step.foot]
        zmp += ((time - begin) / shift).clamp(0, 1)[:, None] * (stance - weight)
        weight = stance
    middle = _sole(place, sole_center).mean(0)
    end = rest + len(footsteps) * step_time
    zmp += ((time - end) / max(shift, 0.3)).clamp(0, 1)[:, None] * (middle - weight)
    return Walk(torch.cat((foot[..., :2], height[..., None]), -1), foot[..., 2], zmp)


def _sole(place: Tensor, sole_center: float) -> Tensor:
    """Middle of each sole ``[2, 2]`` of feet at ``[2, 3]``."""
    heading = torch.stack((place[:, 2].cos(), place[:, 2].sin()), -1)
    return place[:, :2] + sole_center * heading
