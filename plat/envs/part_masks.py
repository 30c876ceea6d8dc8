"""Masks of partial keyframes: which parts of a pose are commanded, drawn for training."""

from collections.abc import Sequence

import torch
from torch import Tensor

from plat.bounds import Count, Seed, as_names, check_robot, check_value
from plat.errors import TaskError
from plat.robots.robot import Robot

__all__ = ["NUM_MASKS", "PART_KINDS", "draw_parts"]

NUM_MASKS = 801
"""Number of masks, the whole pose among them, that partial keyframes are drawn from in training."""

PART_KINDS = ("hands", "hands_and_head", "hands_and_feet", "root", "upper_body", "legs", "bodies", "joints")
"""Kinds of partial keyframes that are drawn."""


def draw_parts(
    robot: Robot, count: int, seed: int = 0, kinds: Sequence[str] = PART_KINDS, *, root: bool = True
) -> Tensor:
    """Draw masks of partial keyframes ``[count, J + K + 3]``, bool; the first is that of a whole pose.

    All kinds are equally frequent. Positions: of the hands; of hands and trunk, which carries the head; of hands and
    feet; of random bodies. Joints: of the upper body; of the legs; random ones. And the root alone. Beside any kind but
    the root alone, parts of the root are commanded in half of the masks.

    Args:
        robot: gives joints and bodies; kinds that it lacks are left out.
        count: number of masks.
        seed: of the draw.
        kinds: names of the kinds, some of :data:`PART_KINDS`.
        root: command parts of the root beside other kinds, in half of the masks.

    Raises:
        ConfigError: for a count or a seed that is none.
        TaskError: for an unknown kind, or when the robot has none of them.

    >>> from plat.robots import G1
    >>> parts = draw_parts(G1, 9)
    >>> parts.shape, bool(parts[0].all()), bool(parts.any(-1).all())
    (torch.Size([9, 46]), True, True)
    """
    check_robot(robot)
    check_value("partial keyframes: count", count, Count)
    check_value("partial keyframes: seed", seed, Seed)
    joints, bodies = robot.num_joints, len(robot.keypoints)
    generator = torch.Generator().manual_seed(seed)
    masks = torch.zeros(count, joints + bodies + 3, dtype=torch.bool)
    masks[0] = True
    known = _kinds(robot)
    kinds = as_names(kinds)
    unknown = [kind for kind in kinds if kind not in PART_KINDS]
    if unknown:
        raise TaskError(f"partial keyframes: kind {unknown[0]!r}, expected some of {', '.join(PART_KINDS)}")
    drawn = [known[kind] for kind in kinds if kind in known]
    if not drawn:
        raise TaskError(f"partial keyframes: robot {robot.name!r} has no {', '.join(kinds)}")
    for row in range(1, count):
        fixed, of_random = drawn[(row - 1) % len(drawn)]
        mask = masks[row]
        mask[fixed] = True
        if of_random:
            chosen = torch.rand(of_random[1] - of_random[0], generator=generator) < 0.3
            chosen[torch.randint(len(chosen), (), generator=generator)] = True
            mask[of_random[0] : of_random[1]] = chosen
        if root and not mask[-3:].any() and torch.rand((), generator=generator) < 0.5:
            mask[-3:] = torch.rand(3, generator=generator) < 0.5
    return masks


def _kinds(robot: Robot) -> dict[str, tuple[list[int], tuple[int, int] | None]]:
    """Return for each kind the flags that it sets, and the range of which it sets random ones."""
    joints, bodies = robot.num_joints, len(robot.keypoints)
    root = joints + bodies
    legs = set(robot.leg_joints)
    feet = [joints + robot.keypoints.index(foot) for foot in robot.feet]
    hands = [joints + index for index in robot.end_effector_indices if joints + index not in feet]
    fixed = {
        "hands": hands,
        "hands_and_head": [*hands, joints + robot.anchor_index] if hands else [],
        "hands_and_feet": hands + feet if hands else [],
        "root": [root, root + 1, root + 2],
        "upper_body": [joint for joint in range(joints) if joint not in legs],
        "legs": sorted(legs),
    }
    return {
        **{kind: (flags, None) for kind, flags in fixed.items() if flags},
        "bodies": ([], (joints, root)),
        "joints": ([], (0, joints)),
    }
