"""Targets above the floor: of hands, elbows, knees and pelvis as well as feet."""

import numpy as np

from plat.motions.retargeting.geometry import TRACKED
from plat.motions.retargeting.targets import Targets
from plat.robots.contact_geoms import touches_floor
from plat.robots.robot import Robot

__all__ = ["above_floor"]


def above_floor(targets: Targets, robot: Robot) -> dict[str, float]:
    """Raise targets of pelvis, knees, elbows and wrists to where these bodies lie on the floor.

    Args:
        targets: are changed.
        robot: whose bodies they are.

    Returns:
        role to how far its target was below that, at most (m), of those that were.
    """
    model = robot.shared_model
    raised = {}
    for role, places in targets.positions.items():
        if role.endswith("ankle"):
            continue
        body = model.body(TRACKED[role]).id
        radii = model.geom_size[(model.geom_bodyid == body) & touches_floor(model), 0]
        if len(radii) == 0:
            continue
        low = float(radii.min())
        depth = low - float(places[:, 2].min())
        if depth > 0:
            raised[role] = depth
            targets.positions[role] = np.column_stack((places[:, :2], places[:, 2].clip(low)))
    return raised
