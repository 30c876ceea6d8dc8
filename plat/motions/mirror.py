"""Mirror images of motions: left and right exchanged."""

import numpy as np

from plat.errors import RobotError
from plat.motions.clip import MotionClip
from plat.robots import G1, Robot

__all__ = ["joint_symmetry", "mirror_motion"]

# The mirror is the plane y = 0. It turns a rotation about (x, y, z) into the same angle about (-x, y, -z).
_MIRRORED_AXIS = np.array([-1.0, 1.0, -1.0])
_SUFFIX = "_mirrored"


def mirror_motion(clip: MotionClip, robot: Robot = G1) -> MotionClip:
    """Return a clip's mirror image: left and right limbs exchanged, in a world with y reversed.

    Which joints change places follows from their names, their signs from their axes. The mirror image of the mirror
    image is the clip.

    Raises:
        RobotError: when the robot has no such symmetry.
        MotionError: for a clip that is none of the robot's.

    >>> qpos = G1.default_qpos[None].repeat(2, 0)
    >>> qpos[:, 7 + G1.joint_names.index("left_hip_roll")] = 0.3
    >>> mirrored = mirror_motion(MotionClip("split", qpos, 30.0))
    >>> mirrored.qpos[0, 7 + G1.joint_names.index("right_hip_roll")]
    np.float64(-0.3)
    """
    clip.check(robot, least=1)  # a pose has a mirror image, too
    partner, sign = joint_symmetry(robot)
    qpos = clip.qpos.copy()
    qpos[:, 1] *= -1
    qpos[:, 4:7] *= _MIRRORED_AXIS.astype(qpos.dtype)
    qpos[:, 7:] = clip.qpos[:, 7:][:, partner] * sign.astype(qpos.dtype)
    name = clip.name.removesuffix(_SUFFIX) if clip.name.endswith(_SUFFIX) else clip.name + _SUFFIX
    return MotionClip(name, qpos, clip.fps)


def joint_symmetry(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each joint ``[J]``, the joint whose angle it takes in the mirror, and the sign.

    Raises:
        RobotError: when the robot has no such symmetry.
    """
    swapped = {"left": "right", "right": "left"}
    names = ["_".join(swapped.get(word, word) for word in name.split("_")) for name in robot.joint_names]
    if names == list(robot.joint_names):
        raise RobotError(f"robot {robot.name!r}: no joint is called left_... or right_..., so none can change sides")
    if set(names) != set(robot.joint_names):
        raise RobotError(
            f"robot {robot.name!r}: joints without a partner {sorted(set(names) - set(robot.joint_names))}"
        )
    partner = np.array([robot.joint_names.index(name) for name in names])
    model = robot.shared_model
    axis = model.jnt_axis[1:]
    body = model.jnt_bodyid[1:]
    if not np.allclose(model.body_pos[body][partner] * [1, -1, 1], model.body_pos[body], atol=1e-3):
        raise RobotError(f"robot {robot.name!r}: its links are not symmetric about the plane y = 0")
    sign = (axis[partner] * _MIRRORED_AXIS * axis).sum(-1).round()
    if not np.allclose(axis[partner] * _MIRRORED_AXIS, sign[:, None] * axis, atol=1e-6):
        raise RobotError(f"robot {robot.name!r}: its joint axes are not symmetric about the plane y = 0")
    return partner, sign
