"""Which order a file's quaternions have, from what they do to the robot."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import torch

from plat.errors import MotionError
from plat.motions.checks.feet import Soles, lowest_step
from plat.motions.formats.common import QuatOrder, ReadOptions
from plat.motions.formats.joint_orders import (
    breadth_first,
    in_robot_order,
    likely_order,
    sides_are_exchanged,
    with_sides_exchanged,
)
from plat.motions.formats.units import roughly_in_radians
from plat.rotations import quat_rotate

__all__ = [
    "QuatOrder",
    "choose_quat_order",
    "detect_joint_order",
    "detect_quat_order",
    "settle_joint_order",
    "settle_quat_order",
]

# The motion that looks wrong must cost this much more than the one that looks right. Measured on 301 clips of human
# motion in both orders and at headings of 0, 180 degrees and at random: none was taken for the other, 0.1 % refused.
_MARGIN = 0.5
# The same where a format or a header says otherwise.
_OVERRULING = 1.0
# What a radian beyond the joints' limits costs (summed over joints, mean over frames), and the most that counts. With
# it, of 149 clips none was taken for one with its joints in the other order, nor the other way round.
_BEYOND, _MOST_BEYOND = 10.0, 0.3
# Frames that are looked at, in blocks of so many: kinematics takes 20 KB a frame, 9 GB for an hour at 120 Hz.
_MOST_FRAMES, _BLOCK = 10_000, 100


def detect_quat_order(qpos: np.ndarray, fps: float, soles: Soles) -> QuatOrder | None:
    """Return the order of columns 3 to 6, or None where both orders make a plausible motion.

    The largest component is no evidence: ``(0, 0, 0, 1)`` is no rotation in ``xyzw`` and a heading of 180 degrees in
    ``wxyz``. Evidence is that a person is upright, stands on flat soles, and does not slide on them.

    Args:
        qpos: ``[T, 7 + J]`` with quaternions of unit length in either order.
        fps: frames a second.
        soles: of the robot.
    """
    evidence = _evidence(qpos, fps, soles)
    if abs(evidence) < _MARGIN:
        return None
    return "wxyz" if evidence > 0 else "xyzw"


def settle_quat_order(
    read: Callable[[QuatOrder], np.ndarray], fps: float, soles: Soles, stated: QuatOrder
) -> tuple[QuatOrder, list[str]]:
    """Return the stated order of quaternions, or the other one where only that makes a plausible motion; and notes.

    Args:
        read: makes the motion ``[T, 7 + J]`` of quaternions in an order, with its axes and units, or raises a
            ``MotionError``.
        fps: frames a second.
        soles: of the robot.
        stated: by the format or a header.

    Raises:
        MotionError: as ``read`` does for the stated order.
    """
    other: QuatOrder = "xyzw" if stated == "wxyz" else "wxyz"
    as_stated = read(stated)
    try:
        turned = read(other)
    except MotionError:
        return stated, []
    if _cost(as_stated, fps, soles) - _cost(turned, fps, soles) < _OVERRULING:
        return stated, []
    return other, [f"quaternion {other}: {stated}, as it should be, makes no plausible motion"]


def _evidence(qpos: np.ndarray, fps: float, soles: Soles) -> float:
    """Return how much stranger the motion is with columns 3 to 6 as ``xyzw`` than as ``wxyz``."""
    as_wxyz = torch.from_numpy(np.asarray(qpos, dtype=np.float64))
    as_xyzw = as_wxyz.clone()
    as_xyzw[:, 3:7] = as_wxyz[:, [6, 3, 4, 5]]
    return _strangeness(as_xyzw, fps, soles) - _strangeness(as_wxyz, fps, soles)


def detect_joint_order(
    qpos: np.ndarray, other: np.ndarray, options: ReadOptions, quat_order: QuatOrder | None
) -> Literal["this", "other"] | None:
    """Return which of two orders of joints makes the plausible motion, or None where both do.

    Args:
        qpos: the motion in one order of joints ``[T, 7 + J]``.
        other: the same in another one.
        options: give robot and soles.
        quat_order: of both; None where it is not known, and columns 3 to 6 may hold either.
    """

    def cost(motion: np.ndarray) -> float:
        poses = torch.from_numpy(np.asarray(motion, dtype=np.float64))
        turned = poses.clone()
        turned[:, 3:7] = poses[:, [6, 3, 4, 5]]
        looked_at = (poses, turned) if quat_order is None else (poses,)
        low, high = options.robot.joint_range.double().unbind(-1)
        beyond = (low - poses[:, 7:]).maximum(poses[:, 7:] - high).clamp_min(0).mean(0).sum()
        strange = min(_strangeness(one, 30.0, options.soles) for one in looked_at)
        return strange + _BEYOND * min(float(beyond), _MOST_BEYOND)

    evidence = cost(other) - cost(qpos)
    if abs(evidence) < _OVERRULING:
        return None
    return "this" if evidence > 0 else "other"


def settle_joint_order(
    joints: np.ndarray,
    read: Callable[[np.ndarray], np.ndarray],
    options: ReadOptions,
    quat_order: QuatOrder | None,
) -> tuple[list[str], list[str]]:
    """Return the joints that columns are whose order nothing states, and notes.

    Orders that are tried are the robot's, breadth first, alphabetical and some more, each also with the right side
    before the left. Poses tell them apart, and for a robot whose usual poses are not known limits and soles.

    Args:
        joints: angles ``[T, J]``.
        read: makes the motion ``[T, 7 + J]`` of joints in the robot's order, or raises a ``MotionError``.
        options: give robot and soles.
        quat_order: of the motion; None where it is not known.

    Raises:
        JointOrderError: where the order cannot be determined, or left and right are exchanged for some of the joints.
    """
    robot = options.robot
    if not np.isfinite(joints).all():
        return list(robot.joint_names), []  # the clip's check tells where
    radians = roughly_in_radians(joints)
    found = likely_order(radians, robot)
    listed, notes = found or _settle_depth(joints, read, options, quat_order)
    if not sides_are_exchanged(in_robot_order(radians, listed, robot), robot):
        return listed, notes
    return with_sides_exchanged(listed), [
        *notes,
        "joints numbered with the right side first: only so do arms and legs stand apart",
    ]


def _settle_depth(
    joints: np.ndarray,
    read: Callable[[np.ndarray], np.ndarray],
    options: ReadOptions,
    quat_order: QuatOrder | None,
) -> tuple[list[str], list[str]]:
    """Return the joints that columns are which are numbered depth or breadth first, and notes."""
    own, listed = list(options.robot.joint_names), breadth_first(options.robot)
    try:
        alternative = read(in_robot_order(joints, listed, options.robot))
    except MotionError:
        return own, []
    try:
        plain = read(joints)
    except MotionError:
        found: Literal["this", "other"] | None = "other"
    else:
        found = detect_joint_order(plain, alternative, options, quat_order)
    if found != "other":
        return own, []
    return listed, ["joints numbered breadth first: only so do they keep to their limits and the feet stand"]


def choose_quat_order(as_wxyz: np.ndarray, as_xyzw: np.ndarray, fps: float, soles: Soles) -> QuatOrder | None:
    """Return the order whose motion is plausible, or None where both are; see :func:`detect_quat_order`.

    Args:
        as_wxyz: the motion ``[T, 7 + J]``, read with one order.
        as_xyzw: the same, read with the other.
        fps: frames a second.
        soles: of the robot.
    """
    costs = [_cost(qpos, fps, soles) for qpos in (as_wxyz, as_xyzw)]
    if abs(costs[1] - costs[0]) < _MARGIN:
        return None
    return "wxyz" if costs[0] < costs[1] else "xyzw"


def _cost(qpos: np.ndarray, fps: float, soles: Soles) -> float:
    return _strangeness(torch.from_numpy(qpos.astype(np.float64)), fps, soles)


def _some_frames(qpos: torch.Tensor) -> torch.Tensor:
    """Return blocks of frames all over a long motion, or a shorter one as it is: what they show is alike."""
    if len(qpos) <= _MOST_FRAMES:
        return qpos
    starts = torch.linspace(0, len(qpos) - _BLOCK, _MOST_FRAMES // _BLOCK).long()
    return qpos[(starts[:, None] + torch.arange(_BLOCK)).flatten()]


def _strangeness(qpos: torch.Tensor, fps: float, soles: Soles) -> float:
    """How little a motion looks like a person's: three terms that are of order one for a wrong heading."""
    qpos = _some_frames(qpos)
    up = quat_rotate(qpos[:, 3:7], qpos.new_tensor([0.0, 0.0, 1.0]))[:, 2]
    points = soles.points(qpos)
    height = points[..., 2]
    lower = height.amin(-1).argmin(-1)  # (T,): the foot that carries the weight
    sole = height[torch.arange(len(height)), lower]
    unevenness = (sole.amax(-1) - sole.amin(-1)).median()
    before, after = lowest_step(points)
    slip = ((after - before)[:, :2].norm(dim=-1) * fps).median()
    return float(3 * (1 - up.mean()) + 3 * unevenness + (slip + 0.01).log())
