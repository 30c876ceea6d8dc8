"""Roots of partial keyframes: where a robot is, as far as the keyframes up to one of them say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plat.keyframes.keyframe import Keyframe

__all__ = ["as_arrived", "with_commanded_root"]


def with_commanded_root(before: Keyframe, after: Keyframe) -> Keyframe:
    """Return a keyframe with what it does not command of its root as in the one before it.

    >>> from plat.keyframes import only, standing
    >>> from plat.robots import G1
    >>> way, arm = only(G1, 1.0, root=(0.5, 0.0)), only(G1, 2.0, joints={"left_elbow": 1.0})
    >>> with_commanded_root(way, arm).root_pos.tolist()
    [0.5, 0.0, 0.76]
    """
    if after.commands is None:
        return after
    return replace(
        after,
        root_pos=np.where(after.commands.root_place, after.root_pos, before.root_pos),
        root_quat=after.root_quat if after.commands.root[2] else before.root_quat,
    )


def as_arrived(before: Keyframe, after: Keyframe) -> Keyframe:
    """Return a keyframe with its root where the robot probably is at the arrival.

    Commanded bodies have their places in the pose as it is drawn, so its root stays. Else it is that of
    :func:`with_commanded_root`.
    """
    bodies = after.commands is not None and any(after.commands.bodies)
    return after if bodies else with_commanded_root(before, after)
