"""Reach of a walk: a keyframe that is too far away for the time left is shown nearer."""

from collections.abc import Sequence

import torch
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn

from plat.bounds import Positive, check_value
from plat.entries import Shape, expects
from plat.modules.lead import moved_keyframe
from plat.modules.settings import WalkingReach
from plat.spec.observation import Entry, as_entries, entries_of, quantities

__all__ = ["KeyframeReach", "WalkingReach"]


class KeyframeReach(TensorDictModule):
    r"""Keyframe within reach: shows a policy no keyframe farther away than a robot gets in the time left.

    A policy that is sent 2 m away within a second throws itself there and falls. It arrives too late anyhow: better it
    walks. The way ``d`` to the keyframe's root, along the x and y axes of the robot's, is shortened to

    .. math::
        m + \min(v t + \tfrac{1}{2} a t^2, \; \max(v, v_{max}) \, t)

    with ``t`` the time left and ``v`` the robot's velocity along the way, at least 0. So a robot that runs is shown
    keyframes as far as it runs. The axes are those of the root as it is tilted: they are level only where it is
    upright. What a partial keyframe does not command stays 0, and where it commands no horizontal position nothing is
    moved. It writes to a group of its own: ``"near_goal"``.

    Args:
        reach: acceleration ``a``, speed ``v_max`` and margin ``m``.
        horizon: longest time to a keyframe (s), in units of which ``("command", "horizon")`` is.
        parts: whether the policy sees which parts are commanded (group ``"parts"``).

    >>> KeyframeReach(WalkingReach(), horizon=1.0).out_keys
    [('near_goal', 'root_pos_b'), ('near_goal', 'keypoint_pos_b')]
    """

    def __init__(self, reach: WalkingReach, horizon: float, parts: bool = False):
        check_value("reach: reach", reach, WalkingReach)
        check_value("reach: horizon", horizon, Positive)
        moved = ("root_pos_b", "keypoint_pos_b")
        in_keys: list[NestedKey] = [
            *(("goal", key) for key in moved),
            ("command", "horizon"),
            ("robot", "root_lin_vel_b"),
            *([("parts", "bodies"), ("parts", "root")] if parts else []),
        ]
        out_keys: list[NestedKey] = [("near_goal", key) for key in moved]
        super().__init__(_Nearer(reach, horizon, entries_of(in_keys)), in_keys=in_keys, out_keys=out_keys)
        shapes: tuple[Shape, ...] = ((3,), ("3 K",), (1,), (3,), ("K",), (3,))
        expects(self, dict(zip(in_keys, shapes, strict=False)), "reach")


class _Nearer(nn.Module):
    def __init__(self, reach: WalkingReach, horizon: float, entries: Sequence[Entry]):
        super().__init__()
        self._entries = tuple(entries)
        self.reach = reach
        self.horizon = horizon

    def forward(self, *observed: Tensor) -> tuple[Tensor, ...]:
        root, keypoints, time_left, velocity, *parts = quantities(self._entries, observed)
        bodies, commanded = parts or (None, None)
        reach, time, way = self.reach, time_left * self.horizon, root[..., :2]
        # the square is bounded before its root: the gradient at a distance of 0 would be infinite
        distance = way.square().sum(-1, keepdim=True).clamp_min(1e-8).sqrt()
        speed = ((velocity[..., :2] * way).sum(-1, keepdim=True) / distance).clamp_min(0.0)
        gained = speed * time + 0.5 * reach.acceleration * time.square()
        farthest = reach.margin + torch.minimum(gained, speed.clamp_min(reach.speed) * time)
        shift = nn.functional.pad(((farthest / distance).clamp_max(1.0) - 1.0) * way, (0, 1))
        return as_entries(self._entries, moved_keyframe(root, keypoints, shift, bodies, commanded))
