"""Which joints the columns of a file are that does not name them."""

from collections.abc import Sequence

import numpy as np

from plat.errors import MotionError
from plat.motions.formats.joint_orders import (
    JointOrderError,
    likely_order_of_some,
    sides_are_exchanged,
    with_sides_exchanged,
)
from plat.motions.formats.units import roughly_in_radians
from plat.robots.robot import Robot, without_side
from plat.words import counted

__all__ = ["OPTIONAL", "unnamed_joints", "without_wrists"]

OPTIONAL = ("waist_roll", "waist_pitch")
"""Joints of the waist that the G1 with 23 joints has not."""

# Median and mean absolute deviation of joints of the upper body (rad), left side, as retargeted people have them.
_USUAL = {
    "waist_yaw": (0.0, 0.10),
    "waist_roll": (0.0, 0.08),
    "waist_pitch": (0.08, 0.12),
    "shoulder_pitch": (0.10, 0.35),
    "shoulder_roll": (0.25, 0.25),
    "shoulder_yaw": (0.0, 0.35),
    "elbow": (0.60, 0.45),
    "wrist_roll": (0.0, 0.30),
}
_BEYOND = 20.0
# By how much less likely the larger robot's order has to be for the smaller one's to be it, and how much is no doubt of
# the larger one's. Of 2,750 clips in both orders 5 were mistaken for the other; between the figures it is
# undecided, which concerned one in eleven.
_UNLIKELY, _DOUBTFUL = 4.5, 0.4


def without_wrists(robot: Robot) -> list[str]:
    """Return the joints that the formats of ASAP and PBHC have, in the robot's order."""
    return [name for name in robot.joint_names if "wrist" not in name]


def unnamed_joints(angles: np.ndarray, robot: Robot, field: str) -> list[str]:
    """Return the joints that columns ``[T, n]`` are, in their order.

    All joints are in the robot's order. 23 joints of a G1 are either the 29 without the wrists, or those of the smaller
    G1, which has only waist yaw and wrist rolls. The order may be the robot's or another common one, with either side
    first. The poses tell which.

    Raises:
        MotionError: for another number of joints.
        JointOrderError: where the poses do not tell, or left and right are exchanged for some of the joints.
    """
    whole = list(robot.joint_names)
    cut = without_wrists(robot)
    small = [name for name in whole if ("wrist" not in name or name.endswith("wrist_roll")) and name not in OPTIONAL]
    if angles.shape[1] == len(whole):
        return whole
    if angles.shape[1] != len(cut):
        raise MotionError(
            f"{field!r} has {counted(angles.shape[1], 'joint')}, expected the {len(whole)} joints of {robot.name!r}, "
            f"or {len(cut)} without the wrists"
        )
    if len(small) != len(cut):
        return cut
    radians = roughly_in_radians(angles)
    order, _ = likely_order_of_some(radians, robot, (cut, small))
    cut, small = ([name for name in order if name in kind] for kind in (cut, small))
    evidence = _unlikeliness(radians, cut, robot) - _unlikeliness(radians, small, robot)
    if _DOUBTFUL < evidence < _UNLIKELY:
        raise JointOrderError(
            f"{field!r} has {len(cut)} joints without names: the {len(whole)} without wrists, or those of the G1 of "
            f"{len(small)}, with wrist rolls and of the waist the yaw alone? Both are plausible; name them in a header"
        )
    return _on_their_sides(radians, small if evidence >= _UNLIKELY else cut, robot)


def _on_their_sides(radians: np.ndarray, names: list[str], robot: Robot) -> list[str]:
    """Return names of the joints ``[T, n]`` with left for right where arms and legs show that they are exchanged."""
    joints = np.zeros((len(radians), robot.num_joints))
    joints[:, [robot.joint_names.index(name) for name in names]] = radians
    return with_sides_exchanged(names) if sides_are_exchanged(joints, robot) else names


def _unlikeliness(angles: np.ndarray, names: Sequence[str], robot: Robot) -> float:
    """Return minus the log-likelihood of poses, mean over frames, if these are the joints."""
    index = [robot.joint_names.index(name) for name in names]
    low, high = robot.joint_range.double().numpy()[index].T
    total = _BEYOND * float(np.maximum(low - angles, angles - high).clip(0).mean(0).sum())
    for column, name in enumerate(names):
        if without_side(name) in _USUAL:
            middle, spread = _USUAL[without_side(name)]
            if name.startswith("right") and name.endswith("roll"):
                middle = -middle
            total += float(np.abs(angles[:, column] - middle).mean() / spread + np.log(spread))
    return total
