"""Where the soles of a motion are: what order detection, checks and repairs are measured by."""

import numpy as np
import torch
from torch import Tensor

from plat.bounds import check_robot
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.robots.sole_points import sole_points
from plat.rotations import quat_rotate

__all__ = [
    "CONTACT_HEIGHT",
    "Soles",
    "contact_slip",
    "foot_steps",
    "ground_level",
    "in_contact",
    "lowest_step",
    "stance",
]

# A foot that carries weight rests: slower than this for _REST_SECONDS to both sides. In free fall a point is that slow
# for 2 * 0.25 / 9.81 = 0.05 s, so the top of a jump is not taken for a stance.
_REST_SPEED = 0.25
_REST_SECONDS = 0.05
CONTACT_HEIGHT = 0.02
"""A foot whose lowest point is this close to the level that the feet rest on is in contact (m)."""
# Frames worked on at a time: kinematics takes kilobytes for each, and an hour has hundreds of thousands.
_CHUNK = 16384


class Soles:
    """The contact points of a robot's feet: centers of spheres, ends of capsules, corners of boxes and meshes.

    Args:
        robot: the robot.

    Attributes:
        robot: the same.

    >>> from plat.robots import G1
    >>> qpos = torch.from_numpy(G1.default_qpos)[None]
    >>> Soles(G1).points(qpos).shape
    torch.Size([1, 2, 4, 3])
    """

    def __init__(self, robot: Robot):
        check_robot(robot)
        self.robot = robot
        centers, radii = sole_points(robot, robot.shared_model)
        self._points_b = torch.from_numpy(centers)  # (2, P, 3)
        self._radius = torch.from_numpy(radii)  # (2, P)
        self._kinematics = ForwardKinematics(robot, robot.feet)
        self._num_joints = robot.num_joints

    def points(self, qpos: Tensor) -> Tensor:
        """Return the lowest point of each part of each foot ``[T, 2, P, 3]`` (m, world) of poses ``[T, 7 + J]``."""
        return self.points_of(*self.feet(qpos))

    def feet(self, qpos: Tensor) -> tuple[Tensor, Tensor]:
        """Return places ``[T, 2, 3]`` (m, world) and orientations ``[T, 2, 4]`` of the feet in poses ``[T, 7 + J]``."""
        parts = [self._kinematics(*part.double().split((3, 4, self._num_joints), -1)) for part in qpos.split(_CHUNK)]
        return torch.cat([pos_w for pos_w, _ in parts]), torch.cat([quat_w for _, quat_w in parts])

    def points_of(self, pos_w: Tensor, quat_w: Tensor) -> Tensor:
        """Return the lowest point of each part of each foot, as :meth:`points`, of feet as :meth:`feet` gives them."""
        return torch.cat([self._points(*part) for part in zip(pos_w.split(_CHUNK), quat_w.split(_CHUNK), strict=True)])

    def _points(self, pos_w: Tensor, quat_w: Tensor) -> Tensor:
        points = pos_w[:, :, None] + quat_rotate(quat_w[:, :, None], self._points_b)
        points[..., 2] -= self._radius
        return points


def stance(points: Tensor, fps: float) -> Tensor:
    """Return whether the lower foot rests ``[T]``, by the speed of its lowest point, of the points of :class:`Soles`.

    A foot that floats rests as well as one on the floor, so this finds the frames in which a foot should be on it.
    """
    lowest, following = lowest_step(points)
    slow = (following - lowest).norm(dim=-1) * fps < _REST_SPEED
    reach = max(1, round(_REST_SECONDS * fps))
    # a frame rests when the steps around it are slow
    padded = torch.nn.functional.pad((~slow).float(), (reach, reach))
    return torch.nn.functional.max_pool1d(padded[None], 2 * reach, 1)[0] == 0


def ground_level(points: Tensor, fps: float, lowest: np.ndarray | None = None) -> float:
    """Return the height of the lower foot while it rests, median (m): where a clip believes that the floor is.

    A clip in which no foot ever rests is measured by its lowest frame.

    Args:
        points: as :class:`Soles` gives them.
        fps: frames a second.
        lowest: height of the robot's lowest part ``[T]`` (m), for who lies or kneels; else that of the soles counts.
    """
    low = points[..., 2].amin((-1, -2))
    if lowest is not None:
        low = low.minimum(torch.from_numpy(lowest).to(low))
    resting = stance(points, fps)
    return float(low[resting].median() if resting.any() else low.min())


def contact_slip(points: Tensor, level: float, fps: float) -> float:
    """Return how fast the lowest point of the steadier foot goes sideways, mean over frames in contact (m/s).

    Args:
        points: as :class:`Soles` gives them.
        level: height that the feet rest on (m); a point within 2 cm of it is in contact.
        fps: frames a second.
    """
    before, after = foot_steps(points)
    contact = in_contact(before, after, level)
    speed = (after - before)[..., :2].norm(dim=-1) * fps
    speed = speed.where(contact, torch.inf).amin(0)
    return float(speed[contact.any(0)].mean()) if contact.any() else 0.0


def foot_steps(points: Tensor) -> tuple[Tensor, Tensor]:
    """Return the lowest point of each foot in all frames but the last, and a frame later: ``[2, T - 1, 3]`` each."""
    feet = points.transpose(0, 1)  # (2, T, P, 3)
    lowest = feet[:, :-1, :, 2].argmin(-1)[..., None, None].expand(-1, -1, 1, 3)
    return feet[:, :-1].gather(2, lowest)[:, :, 0], feet[:, 1:].gather(2, lowest)[:, :, 0]


def in_contact(before: Tensor, after: Tensor, level: float) -> Tensor:
    """Return whether points ``[*B, 3]`` are within 2 cm of the level that the feet rest on (m), and a frame later."""
    return (before[..., 2] < level + CONTACT_HEIGHT) & (after[..., 2] < level + CONTACT_HEIGHT)


def lowest_step(points: Tensor) -> tuple[Tensor, Tensor]:
    """Return the lowest of all points in all frames but the last, and that point a frame later: ``[T - 1, 3]`` each."""
    flat = points.flatten(1, 2)
    lowest = flat[:-1, :, 2].argmin(-1)
    rows = torch.arange(len(flat) - 1)
    return flat[rows, lowest], flat[rows + 1, lowest]
