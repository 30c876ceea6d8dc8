"""Distances from a keyframe in what it commands, and what counts as near, as far, and as fallen; for many robots."""

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.settings import ReachLimits
from plat.robots.robot import Robot
from plat.rotations import quat_angle

__all__ = ["Distances", "distances", "down"]


@dataclass(frozen=True)
class Distances:
    """Distances of N robots from poses, in the parts that are commanded.

    Attributes:
        root: distance of the root ``[N]`` (m).
        joints: mean absolute joint error ``[N]`` (rad).
        bodies: largest distance of a body ``[N]`` (m).
        turn: angle between the root's orientations ``[N]`` (rad).
        whole: whether the whole pose is commanded ``[N]``.
    """

    root: Tensor
    joints: Tensor
    bodies: Tensor
    turn: Tensor
    whole: Tensor

    def near(self, limits: ReachLimits, bodies: Tensor | float | None = None) -> Tensor:
        """Return the mask ``[N]`` of robots that are near enough.

        Of a whole pose, root and joints count. Of a partial one, all that it commands does.

        Args:
            limits: how near is near enough.
            bodies: largest distance of a body (m), ``[N]`` or one for all; None for that of the limits.
        """
        pose = (self.root <= limits.root) & (self.joints <= limits.joints)
        parts = (self.bodies <= (limits.bodies if bodies is None else bodies)) & (self.turn <= limits.turn)
        return pose & (self.whole | parts)


def distances(state: TensorDictBase, reference: TensorDictBase, parts: Tensor | None = None) -> Distances:
    """Return the distances of robots from poses.

    Args:
        state: with ``keypoint_pos_w`` ``[N, K, 3]`` (m), ``keypoint_quat_w`` ``[N, K, 4]``, the root first, and
            ``joint_pos`` ``[N, J]`` (rad).
        reference: the same of the poses.
        parts: masks ``[N, J + K + 3]`` of what is commanded: joints, bodies, and the root's horizontal position,
            height and orientation. None for whole poses.
    """
    apart = state["keypoint_pos_w"] - reference["keypoint_pos_w"]
    angles = (state["joint_pos"] - reference["joint_pos"]).abs()
    turn = quat_angle(state["keypoint_quat_w"][:, 0], reference["keypoint_quat_w"][:, 0])
    count, joints = angles.shape
    if parts is None:
        parts = torch.ones(count, joints + apart.shape[1] + 3, device=angles.device)
    commanded = (parts > 0).to(angles)
    wanted, root = commanded[:, :joints], commanded[:, [-3, -3, -2]]
    return Distances(
        root=(apart[:, 0] * root).norm(dim=-1),
        joints=(angles * wanted).sum(-1) / wanted.sum(-1).clamp_min(1.0),
        bodies=(apart.norm(dim=-1) * commanded[:, joints:-3]).amax(-1),
        turn=turn * commanded[:, -1],
        whole=commanded.bool().all(-1),
    )


def down(
    state: TensorDictBase, reference: TensorDictBase, robot: Robot, limits: ReachLimits, parts: Tensor | None = None
) -> Tensor:
    """Return the mask ``[N]`` of robots that lie: a low or tilted pelvis that was not commanded to be so.

    How a pose is drawn excuses nothing: a root whose height or orientation is not commanded has to be up.

    Args:
        state: as for :func:`distances`.
        reference: the pose that the robot should have for now.
        robot: gives the height at which it stands.
        limits: what is too low and too much tilt.
        parts: as for :func:`distances`.
    """
    height, wanted = state["keypoint_pos_w"][:, 0, 2], reference["keypoint_pos_w"][:, 0, 2]
    # the vertical component of the root's z axis is 1 - 2 (x^2 + y^2)
    up, wanted_up = (1 - 2 * group["keypoint_quat_w"][:, 0, 1:3].square().sum(-1) for group in (state, reference))
    low = limits.fallen_below(robot.root_height)
    meant = wanted < low
    if parts is not None:
        # the root is the first of the bodies, and the place of a body has a height
        root = -3 - state["keypoint_pos_w"].shape[1]
        meant &= (parts[:, -2] > 0) | (parts[:, root] > 0)
        wanted_up = torch.where(parts[:, -1] > 0, wanted_up, 1.0)
    return ((height < low) & ~meant) | ((wanted_up - up) > limits.fallen_tilt)
