"""Masks of partial keyframes: which parts of a pose are commanded, drawn for training."""

import torch
from torch import Tensor

from plat.robots.robot import Robot

__all__ = ["NUM_MASKS", "PART_KINDS", "draw_parts"]

NUM_MASKS = 801
"""Number of masks, the whole pose among them, that partial keyframes are drawn from in training."""

PART_KINDS = ("hands", "hands_and_head", "hands_and_feet", "root", "upper_body", "legs", "bodies", "joints")
"""Kinds of partial keyframes that are drawn."""


def draw_parts(robot: Robot, count: int, seed: int = 0) -> Tensor:
    """Draw masks of partial keyframes ``[count, J + K + 3]``, bool; the first is that of a whole pose.

    Every kind is as frequent as the others: positions of the hands; of hands and trunk, which carries the head;
    of hands and feet; the root alone; the joints of the upper body; those of the legs; random bodies; random joints.
    Beside any kind but the root alone, parts of the root are commanded in half of the masks.

    Args:
        robot: gives joints and bodies; kinds that it lacks are left out.
        count: number of masks.
        seed: of the draw.

    >>> from plat.robots import G1
    >>> parts = draw_parts(G1, 9)
    >>> parts.shape, bool(parts[0].all()), bool(parts.any(-1).all())
    (torch.Size([9, 46]), True, True)
    """
    joints, bodies = robot.num_joints, len(robot.keypoints)
    generator = torch.Generator().manual_seed(seed)
    masks = torch.zeros(count, joints + bodies + 3, dtype=torch.bool)
    masks[0] = True
    kinds = _kinds(robot)
    for row in range(1, count):
        fixed, of_random = kinds[(row - 1) % len(kinds)]
        mask = masks[row]
        mask[fixed] = True
        if of_random:
            chosen = torch.rand(of_random[1] - of_random[0], generator=generator) < 0.3
            chosen[torch.randint(len(chosen), (), generator=generator)] = True
            mask[of_random[0] : of_random[1]] = chosen
        if not mask[-3:].any() and torch.rand((), generator=generator) < 0.5:
            mask[-3:] = torch.rand(3, generator=generator) < 0.5
    return masks


def _kinds(robot: Robot) -> list[tuple[list[int], tuple[int, int] | None]]:
    """Return for each kind the flags that it sets, and the range of which it sets random ones."""
    joints, bodies = robot.num_joints, len(robot.keypoints)
    root = joints + bodies
    legs = set(robot.leg_joints)
    upper = [joint for joint in range(joints) if joint not in legs]
    feet = [joints + robot.keypoints.index(foot) for foot in robot.feet]
    hands = [joints + index for index in robot.end_effector_indices if joints + index not in feet]
    trunk = [joints + robot.anchor_index]
    drawn: list[tuple[list[int], tuple[int, int] | None]] = [
        *((kind, None) for kind in (hands, hands + trunk, hands + feet) if hands),
        ([root, root + 1, root + 2], None),
        *((kind, None) for kind in (upper, sorted(legs)) if kind),
        ([], (joints, root)),
        ([], (0, joints)),
    ]
    return drawn
