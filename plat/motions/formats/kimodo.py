"""Archives that Kimodo and ARDY write of motions on the robot itself."""

from pathlib import Path

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.formats.common import MotionFile, ReadOptions, make_clip
from plat.motions.formats.links import link_count, qpos_of_links
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot

__all__ = ["has_links", "read_kimodo"]

KIMODO_FPS = 30.0
"""Frames a second of what Kimodo writes; its archives do not say it, ARDY's do."""

# Joints that are further than this from where the rotations lead (m, mean) belong to another robot or order.
_APART = 0.03


def has_links(arrays: dict[str, np.ndarray], robot: Robot) -> bool:
    """Return whether an archive holds rotations of as many links as the robot's skeleton has."""
    found = arrays.get("global_rot_mats")
    return found is not None and found.ndim == 4 and found.shape[1:] == (link_count(robot), 3, 3)


def read_kimodo(
    path: Path, arrays: dict[str, np.ndarray], fps: float, options: ReadOptions, notes: tuple[str, ...] = ()
) -> MotionFile:
    """Read ``global_rot_mats`` ``[T, L, 3, 3]`` with ``root_positions`` or ``posed_joints``.

    Raises:
        MotionError: where the rotations do not lead to the stored places of the joints.
    """
    rotations = arrays["global_rot_mats"].astype(np.float64)
    joints = arrays.get("posed_joints")
    root = arrays.get("root_positions", None if joints is None else joints[:, 0])
    if root is None or root.shape != (len(rotations), 3):
        raise MotionError("no array 'root_positions' or 'posed_joints' with the root's places beside 'global_rot_mats'")
    if not all(np.isfinite(part).all() for part in (rotations, root)):
        raise MotionError("'global_rot_mats' or the root's places hold a value that is not finite")
    if np.abs(np.linalg.det(rotations) - 1).max() > 0.1:
        raise MotionError("'global_rot_mats' holds matrices that are no rotations")
    robot = options.robot
    qpos = qpos_of_links(rotations, root.astype(np.float64), robot)
    if joints is not None and joints.shape == (*rotations.shape[:2], 3):
        apart = _distance(qpos, joints.astype(np.float64), robot)
        if apart > _APART:
            raise MotionError(
                f"its rotations put the joints {100 * apart:.0f} cm from 'posed_joints': is it of robot {robot.name!r}?"
            )
    fields = ("root_positions", "global_rot_mats[:, 0]")
    clip = make_clip(path.stem, qpos[:, :3], qpos[:, 3:7], qpos[:, 7:], fps, options, "wxyz", fields)
    return MotionFile(path, "Kimodo npz", [clip], notes, unheard=("quat_order",))


def _distance(qpos: np.ndarray, joints: np.ndarray, robot: Robot) -> float:
    """Return how far the stored joints are from the nearest link of the robot, mean over keypoints (m)."""
    poses = torch.from_numpy(qpos)
    pos_w, _ = ForwardKinematics(robot, robot.keypoints)(*poses.split((3, 4, robot.num_joints), -1))
    recorded = torch.from_numpy(joints[..., [2, 0, 1]].copy())
    return float(torch.cdist(pos_w, recorded).amin(-1).mean())
