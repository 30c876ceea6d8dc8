"""Links of a robot that are inside each other."""

import mujoco
import numpy as np

__all__ = ["link_contacts", "self_penetration"]


def self_penetration(model: mujoco.MjModel, qpos: np.ndarray, data: mujoco.MjData) -> float:
    """Return how deep two links are in each other in a pose, at most (m); 0 where none touch.

    Args:
        model: the robot; what belongs to the world's body is none of its links.
        qpos: the pose ``[7 + J]``.
        data: is given the pose; places of bodies and geoms in the world can be read from it afterwards.

    >>> from plat.robots import G1
    >>> folded = G1.default_qpos.copy()
    >>> folded[7 + G1.joint_names.index("left_shoulder_roll")] = -1.2
    >>> self_penetration(G1.shared_model, folded, mujoco.MjData(G1.shared_model)) > 0.01
    True
    """
    return float(link_contacts(model, qpos, data)[1].max(initial=0.0))


def link_contacts(model: mujoco.MjModel, qpos: np.ndarray, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of links that touch in a pose ``[n, 2]``, bodies of the model, and how deep ``[n]`` (m).

    Args:
        model, qpos, data: as of :func:`self_penetration`.
    """
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    bodies = model.geom_bodyid[data.contact.geom]  # (contacts, 2)
    links = (bodies > 0).all(-1)
    return bodies[links], -data.contact.dist[links]
