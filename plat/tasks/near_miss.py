"""Cost of what counts as a miss: errors near the thresholds of evaluation, and just beyond them."""

import torch
from torch import Tensor

from plat.envs.settings import ReachLimits
from plat.envs.state import GeneralizedState
from plat.gpu import constant
from plat.robots.robot import Robot
from plat.tasks.distances import smooth_angle, smooth_length
from plat.tasks.partial_costs import joint_error, root_offset

__all__ = ["NearMiss", "end_effector_mask", "excess"]

# An error counts from this share of its threshold. Beyond so many thresholds it costs no more: who cannot be in time
# need not throw itself there.
_FROM, _TO = 0.6, 2.5


def excess(error: Tensor, limit: Tensor | float) -> Tensor:
    """Return how far errors are beyond 0.6 of a threshold, in thresholds, and 1.9 from 2.5 thresholds on.

    >>> excess(torch.tensor([0.1, 0.2, 9.0]), 0.2)
    tensor([0.0000, 0.4000, 1.9000])
    """
    return (error / limit).clamp(_FROM, _TO) - _FROM


def end_effector_mask(robot: Robot) -> Tensor:
    """Return the mask ``[K]`` of the end effectors among a robot's keypoints, float.

    >>> from plat.robots import G1
    >>> end_effector_mask(G1).sum()
    tensor(4.)
    """
    return torch.tensor([float(name in robot.end_effectors) for name in robot.keypoints])


class NearMiss:
    """Cost of coming near the thresholds by which a keyframe is missed.

    Along motions those are the thresholds of TKS, in every step of the arrival window: heights of anchor and end
    effectors, or of the bodies that a partial keyframe commands, and the root's orientation. Of authored keyframes
    they are those of *reached* as well, at the arrival: root, joints, commanded bodies and, of partial keyframes, the
    root's orientation. Along a dense reference every step counts like one of a window (:meth:`off_track`).

    Args:
        anchor: index of the anchor among the K keypoints.
        end_effectors: mask ``[K]``, float.
        window: steps of an arrival window.
        limits: thresholds.
    """

    def __init__(self, anchor: int, end_effectors: Tensor, window: int, limits: ReachLimits | None = None):
        self.limits = limits or ReachLimits()
        self.window = window
        self._whole = end_effectors.clone()
        self._whole[anchor] = 1.0

    def __call__(
        self,
        state: GeneralizedState,
        pose: GeneralizedState,
        points: Tensor,
        wanted: Tensor,
        parts: Tensor | None,
        *,
        reached_within: Tensor,
        arrives: Tensor,
    ) -> Tensor:
        """Return the cost ``[n]`` of a step in arrival windows.

        Args:
            state, pose: robots, and where they should be now.
            points, wanted: keypoints ``[n, K, 3]`` of both (m).
            parts: masks ``[n, J + K + 3]`` of what is commanded, float; None for whole keyframes.
            reached_within: largest distance ``[n]`` of a commanded body at arrival (m).
            arrives: robots ``[n]`` at the arrival of an authored keyframe.
        """
        limits, joints = self.limits, state.joint_pos.shape[-1]
        commanded = state.root_pos_w.new_ones(1, joints + points.shape[1] + 3) if parts is None else parts
        whole = commanded.all(-1, keepdim=True)
        bodies = torch.where(whole, 0.0, commanded[:, joints:-3])
        off = points - wanted
        angle = smooth_angle(state.root_quat_w, pose.root_quat_w)
        looked_at = torch.where(whole, constant(self._whole, points), bodies)
        missed = self._in_window(off, angle, looked_at, commanded[:, -1])
        late = (
            excess(smooth_length(root_offset(state, pose, commanded)), limits.root)
            + excess(joint_error(state, pose, commanded), limits.joints)
            + (excess(smooth_length(off), reached_within[:, None]) * bodies).sum(-1)
            + torch.where(whole[:, 0], 0.0, commanded[:, -1]) * excess(angle, limits.turn)
        )
        # an arrival is one step of the window: what counts there alone counts as much
        return missed + self.window * torch.where(arrives, late, 0.0)

    def off_track(self, state: GeneralizedState, reference: GeneralizedState, points: Tensor, wanted: Tensor) -> Tensor:
        """Return the cost ``[n]`` of a step along a dense reference, by the thresholds of TKS.

        Args:
            state, reference: robots, and where they should be now.
            points, wanted: keypoints ``[n, K, 3]`` of both (m).
        """
        angle = smooth_angle(state.root_quat_w, reference.root_quat_w)
        return self._in_window(points - wanted, angle, constant(self._whole, points), 1.0)

    def _in_window(self, off: Tensor, angle: Tensor, looked_at: Tensor, turned: Tensor | float) -> Tensor:
        """Cost ``[n]`` of keypoints ``[n, K, 3]`` that are off (m), of those looked at, and of an angle ``[n]``."""
        limits = self.limits.window
        heights = excess(off[..., 2].abs(), limits.end_effector_height)
        return (heights * looked_at).sum(-1) + turned * excess(angle, limits.anchor_rot_squared**0.5)
