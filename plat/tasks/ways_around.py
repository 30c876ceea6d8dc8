"""Ways between two poses on which a robot's links do not run into each other."""

import mujoco
import numpy as np
import torch
from torch import Tensor

from plat.keyframes.chain_families import INSIDE
from plat.keyframes.partial import hands_of
from plat.motions.checks.collision import self_penetration
from plat.robots.robot import Robot
from plat.rotations import quat_nlerp

__all__ = ["FURTHER", "MOVES", "WaysAround"]

# Poses between two that are looked at: hands that move by a meter move by a link's thickness from one to the next.
_LOOKED_AT = 12
MOVES = (
    ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.0, 0.0, 0.0)),
    ((0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ((1.0, 1.0, 0.0), (1.0, -1.0, 0.0)),
    ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)),
    ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)),
    ((1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
)
"""How the hands of both sides are moved midway, x ahead, y to the left, z up, in the order in which it is tried.

All ways of one kind should be alike: they are to be learned.
"""

FURTHER = (0.2, 0.4, 0.6, 0.9, 1.2, 1.5)
"""How far they are moved, further and further: the angle (rad) at the joint that moves most."""


class WaysAround:
    """Finds a pose to pass by where the straight line between two poses leads through the robot itself.

    Midway on the line, both hands are moved apart, or one alone, or one ahead of or above the other. The first move
    that leaves both halves of the way clear is taken. The legs stay on the line.

    Args:
        robot: with two hands; of another one no way is found.
        half_parts: equal parts of each half of a way around, at whose ends links are looked at.

    >>> from plat.robots import G1
    >>> def forearms(left, right):
    ...     pose = torch.as_tensor(G1.default_qpos, dtype=torch.float32).clone()
    ...     for side, inward, elbow in (("left", -1.0, left), ("right", 1.0, right)):
    ...         for joint, angle in (("shoulder_pitch", -0.6), ("shoulder_yaw", inward), ("elbow", elbow)):
    ...             pose[7 + G1.joint_names.index(f"{side}_{joint}")] = angle
    ...     return pose
    >>> ways, above, below = WaysAround(G1), forearms(0.0, 1.0), forearms(1.0, 0.0)
    >>> round(float((ways.between(above, below) - (above + below) / 2).abs().max()), 2)  # rad
    0.2
    >>> ways.between(above, above) is None
    True
    """

    def __init__(self, robot: Robot, half_parts: int = _LOOKED_AT // 2):
        self._half_parts = half_parts
        self._model, self._data = robot.shared_model, mujoco.MjData(robot.shared_model)
        self._hands = [self._model.body(hand).id for hand in hands_of(robot) if hand]
        legs = set(robot.leg_joints)
        self._moved = np.array([joint not in legs for joint in range(robot.num_joints)])
        self._low, self._high = robot.joint_range.double().unbind(-1)

    def between(self, before: Tensor, after: Tensor) -> Tensor | None:
        """Return a pose ``[7 + J]`` to pass midway.

        Args:
            before, after: poses ``[7 + J]``.

        Returns:
            None where the straight line is clear, where no way was found, and where links are in each other in a pose
            itself.
        """
        before, after = before.double(), after.double()
        if not self._hands or before.equal(after) or self._inside(torch.stack((before, after))):
            return None
        line = _line(before, after, _LOOKED_AT)
        if not self._inside(line):
            return None
        middle = line[_LOOKED_AT // 2 - 1]
        directions = self._directions(middle)
        for angle in FURTHER:
            for direction in directions:
                passed = middle.clone()
                passed[7:] = (passed[7:] + angle * direction).clamp(self._low, self._high)
                halves = [_line(a, b, self._half_parts) for a, b in ((before, passed), (passed, after))]
                if not self._inside(torch.cat((passed[None], *halves))):
                    return passed.float()
        return None

    def _directions(self, pose: Tensor) -> list[Tensor]:
        """How joints ``[J]`` move most per way of the hands; 1 at the one that moves most."""
        # in the root's frame: ahead and to the sides are the robot's own
        self._data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
        self._data.qpos[7:] = pose[7:].numpy()
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        slopes = np.empty((len(self._hands), 3, self._model.nv))
        for slope, hand in zip(slopes, self._hands, strict=True):
            mujoco.mj_jacBody(self._model, self._data, slope, None, hand)
        found = []
        for move in np.array(MOVES):
            direction = np.einsum("hi,hij->j", move, slopes)[6:] * self._moved
            found.append(torch.from_numpy(direction / max(float(np.abs(direction).max()), 1e-6)))
        return found

    def _inside(self, poses: Tensor) -> bool:
        """Whether links are in each other in one of some poses ``[n, 7 + J]``."""
        return any(self_penetration(self._model, pose, self._data) >= INSIDE for pose in poses.numpy())


def _line(before: Tensor, after: Tensor, parts: int) -> Tensor:
    """Poses ``[parts - 1, 7 + J]`` between two, evenly."""
    share = torch.arange(1, parts, dtype=before.dtype) / parts
    poses = before.lerp(after, share[:, None])
    poses[:, 3:7] = quat_nlerp(before[3:7], after[3:7], share)
    return poses
