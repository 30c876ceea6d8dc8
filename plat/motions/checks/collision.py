"""Links of a robot that are inside each other."""

import mujoco
import numpy as np

__all__ = ["self_penetration"]


def self_penetration(model: mujoco.MjModel, qpos: np.ndarray, data: mujoco.MjData) -> float:
    """How deep two links are in each other in a pose, at most (m); 0 where none touch.

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
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    bodies = model.geom_bodyid[data.contact.geom]  # (contacts, 2)
    return float((-data.contact.dist[(bodies > 0).all(-1)]).max(initial=0.0))
