"""Geoms that collide, by MuJoCo's rule: one's ``contype`` shares a bit with the other one's ``conaffinity``."""

import mujoco
import numpy as np

__all__ = ["colliding_geoms", "touches_floor"]


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
