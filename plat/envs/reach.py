"""Distances from a keyframe in what it commands, and what counts as near, as far, and as fallen; for many robots."""

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from torch import Tensor

from plat.envs.settings import ReachLimits
from plat.robots.robot import Robot
from plat.rotations import quat_angle, quat_tilt
from plat.spec.proportions import in_proportion

__all__ = ["SAG", "Distances", "LowestRoot", "distances", "down"]

SAG = 0.05
"""How much a G1 may be below a keyframe's root and be no lower than it was told to (m)."""


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


@dataclass(frozen=True)
class LowestRoot:
    """How low and how tilted roots are commanded to be for now, of N robots.

    Attributes:
        height: of the root ``[N]`` (m).
        tilt: of the root ``[N]``, see :func:`plat.rotations.quat_tilt`: -1 upright, 0 lying, 1 upside down.
    """

    height: Tensor
    tilt: Tensor

    @classmethod
    def of(cls, pos: Tensor, quat: Tensor) -> "LowestRoot":
        """Return the lowest and most tilted of several roots, such as those at both ends of a command.

        Args:
            pos: their positions ``[N, M, 3]`` (m).
            quat: their orientations ``[N, M, 4]``, ``wxyz``.

        >>> standing_and_lying = torch.tensor([[[0.0, 0.0, 0.76], [0.0, 0.0, 0.1]]])
        >>> upright_and_tilted = torch.tensor([[[1.0, 0.0, 0.0, 0.0], [0.5**0.5, 0.0, 0.5**0.5, 0.0]]])
        >>> lowest = LowestRoot.of(standing_and_lying, upright_and_tilted)
        >>> round(float(lowest.height), 3), abs(round(float(lowest.tilt), 3))
        (0.1, 0.0)
        """
        return cls(pos[..., 2].amin(-1), quat_tilt(quat).amax(-1))


def down(state: TensorDictBase, lowest: LowestRoot, robot: Robot, limits: ReachLimits) -> Tensor:
    """Return the mask ``[N]`` of robots that lie: a low or tilted pelvis that was not commanded to be so.

    On its way up from a low keyframe, and down to one, a robot may be low at any time: it is told when to be there, not
    how. A keyframe is low from 5 cm above what is too low (of a standing height of 0.76 m), for robots sag.

    Args:
        state: as for :func:`distances`.
        lowest: of what is commanded for now.
        robot: gives the height at which it stands.
        limits: what is too low and too much tilt.
    """
    height, low = state["keypoint_pos_w"][:, 0, 2], limits.fallen_below(robot.root_height)
    meant = lowest.height < low + in_proportion(SAG, robot.root_height)
    return ((height < low) & ~meant) | (quat_tilt(state["keypoint_quat_w"][:, 0]) - lowest.tilt > limits.fallen_tilt)
