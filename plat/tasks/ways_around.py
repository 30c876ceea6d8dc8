"""Ways between two poses on which a robot's links do not run into each other."""

import mujoco
import torch
from torch import Tensor

from plat.keyframes.chain_families import INSIDE
from plat.keyframes.partial import hands_of
from plat.motions.checks.collision import self_penetration
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_slerp

__all__ = ["WaysAround"]

# Poses between two that are looked at: hands that move by a meter move by a link's thickness from one to the next.
_LOOKED_AT = 12
# How the hands of both sides are moved midway, x ahead, y to the left, z up: in this order, and further and further,
# as far as these (rad) at the joint that moves most. All ways of one kind should be alike: they are to be learned.
_MOVES = (
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
_FURTHER = (0.2, 0.4, 0.6, 0.9, 1.2, 1.5)


class WaysAround:
    """Finds a pose to pass by where the straight line between two poses leads through the robot itself.

    Midway on the line, hands are moved apart, or one of them alone, or one ahead of or above the other, until both
    halves of the way are clear. The legs stay on the line.

    Args:
        robot: with two hands; of another one no way is found.

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

    def __init__(self, robot: Robot):
        self._model, self._data = robot.shared_model, mujoco.MjData(robot.shared_model)
        hands = hands_of(robot)
        self._hands = ForwardKinematics(robot, hands) if len(hands) == 2 and all(hands) else None
        legs = set(robot.leg_joints)
        self._moved = torch.tensor([joint not in legs for joint in range(robot.num_joints)])
        self._low, self._high = robot.joint_range.unbind(-1)

    def between(self, before: Tensor, after: Tensor) -> Tensor | None:
        """Return a pose ``[7 + J]`` to pass midway.

        Args:
            before, after: poses ``[7 + J]``.

        Returns:
            None where the straight line is clear, where no way was found, and where links are in each other in a pose
            itself.
        """
        if self._hands is None or torch.equal(before, after) or self._inside(torch.stack((before, after))):
            return None
        line = _line(before, after, _LOOKED_AT)
        if not self._inside(line):
            return None
        middle = line[_LOOKED_AT // 2 - 1]
        directions = self._directions(middle)
        for angle in _FURTHER:
            for direction in directions:
                passed = middle.clone()
                passed[7:] = (passed[7:] + angle * direction).clamp(self._low, self._high)
                halves = [_line(*half, _LOOKED_AT // 2) for half in ((before, passed), (passed, after))]
                if not self._inside(torch.cat((passed[None], *halves))):
                    return passed
        return None

    def _directions(self, pose: Tensor) -> list[Tensor]:
        """How joints ``[J]`` move most per way of the hands; 1 at the one that moves most."""
        assert self._hands is not None
        joints = pose[7:].clone().requires_grad_()
        # in the root's frame: ahead and to the sides are the robot's own
        upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
        places = self._hands(torch.zeros(3), upright, joints)[0]
        found = []
        for move in _MOVES:
            (slope,) = torch.autograd.grad((places * torch.tensor(move)).sum(), joints, retain_graph=True)
            slope = slope * self._moved
            found.append(slope / slope.abs().max().clamp_min(1e-6))
        return found

    def _inside(self, poses: Tensor) -> bool:
        """Whether links are in each other in one of some poses ``[n, 7 + J]``."""
        return any(self_penetration(self._model, pose, self._data) >= INSIDE for pose in poses.numpy())


def _line(before: Tensor, after: Tensor, parts: int) -> Tensor:
    """Poses ``[parts - 1, 7 + J]`` between two, evenly."""
    share = torch.arange(1, parts)[:, None] / parts
    poses = before.lerp(after, share)
    poses[:, 3:7] = quat_slerp(before[3:7], after[3:7], share[:, 0])
    return poses
