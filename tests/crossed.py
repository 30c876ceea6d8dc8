"""Poses whose arms are in each other's way."""

import numpy as np

from plat.keyframes import Keyframe
from plat.robots import G1


def forearms(time: float, left: float, right: float) -> Keyframe:
    """Both forearms before the chest, with angles of the elbows (rad): the straighter one is below the other."""
    qpos = G1.default_qpos.copy()
    for side, inward, elbow in (("left", -1.0, left), ("right", 1.0, right)):
        for joint, angle in (("shoulder_pitch", -0.6), ("shoulder_yaw", inward), ("elbow", elbow)):
            qpos[7 + G1.joint_names.index(f"{side}_{joint}")] = angle
    return Keyframe.from_qpos(time, np.asarray(qpos, dtype=np.float64))


ABOVE, BELOW = forearms(1.0, 0.0, 1.0), forearms(2.0, 1.0, 0.0)
"""The right forearm above the left one, and the other way round."""
