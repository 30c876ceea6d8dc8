"""Whether left is left: arms hang outward, and legs stand apart."""

import numpy as np

from plat.robots.robot import Robot

__all__ = ["EXCHANGED", "apart"]

EXCHANGED = -0.2
"""Roll of the left shoulder over that of the right one (rad, mean) below which left and right are exchanged.

Of 365 clips (Bandai-Namco, CMU, HDM05, SIE, ASE, ASAP, PBHC) the lowest is -0.11 and the median of the sets 0.4 to 1.4.
"""


def apart(joint_pos: np.ndarray, robot: Robot, part: str) -> float | None:
    """Return how much further out a joint of the left side is turned than that of the right, mean over frames (rad).

    Args:
        joint_pos: ``[T, J]`` in the robot's order.
        robot: whose joints they are.
        part: the joint without its side, such as ``shoulder_roll``. Outward is where its range is wider.

    Returns:
        None where the robot has no such joints, their ranges do not say which way is outward, or there are no frames.

    >>> from plat.robots import G1
    >>> round(apart(G1.default_qpos[None, 7:], G1, "shoulder_roll"), 3)
    0.4
    """
    names = [f"{side}_{part}" for side in ("left", "right")]
    if not set(names) <= set(robot.joint_names) or not len(joint_pos):
        return None
    index = [robot.joint_names.index(name) for name in names]
    left, right = robot.joint_range.double().numpy()[index].mean(1)
    if left == right:
        return None
    return float(np.sign(left - right) * (joint_pos[:, index[0]] - joint_pos[:, index[1]]).mean())
