"""Geoms that collide, by MuJoCo's rule: one's ``contype`` shares a bit with the other one's ``conaffinity``.

And groups of geoms that are for the eye.
"""

import mujoco
import numpy as np

__all__ = ["colliding_geoms", "touches_floor", "visual_groups"]


def colliding_geoms(model: mujoco.MjModel) -> np.ndarray:
    """Return which geoms of a model collide with any others ``[ngeom]``.

    >>> from plat.robots import G1
    >>> colliding_geoms(G1.shared_model).shape == (G1.shared_model.ngeom,)
    True
    """
    return (model.geom_contype != 0) | (model.geom_conaffinity != 0)


def touches_floor(model: mujoco.MjModel) -> np.ndarray:
    """Return which geoms of a robot collide with the floor that its model stands on ``[ngeom]``.

    Args:
        model: of :meth:`plat.robots.Robot.model`.

    >>> from plat.robots import G1
    >>> model = G1.shared_model
    >>> touches = touches_floor(model)
    >>> bool(touches[model.geom("floor").id]), bool(touches[G1.sole_geoms(model)].all())
    (False, True)
    """
    floor = model.geom("floor").id
    types, affinities = model.geom_contype, model.geom_conaffinity
    meets = (types & affinities[floor]) | (types[floor] & affinities)
    return (meets != 0) & (model.geom_bodyid > 0)


def visual_groups(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the groups of the geoms that are drawn of a robot.

    Group 2 if the robot has geoms in it, as in MuJoCo Menagerie. Else 0 and 1, which MuJoCo's compiler makes of a URDF.
    All groups if the robot's geoms are in others alone.

    >>> from plat.robots import G1
    >>> visual_groups(G1.shared_model)
    (2,)
    """
    groups = set(model.geom_group[model.geom_bodyid > 0].tolist())
    if 2 in groups:
        return (2,)
    return tuple(sorted(groups & {0, 1})) or tuple(sorted(groups))
