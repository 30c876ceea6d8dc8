"""Left-right symmetry of a robot: which joints and keypoints change places in the mirror, and which turn the other way.

The mirror is the plane y = 0. It turns a rotation about (x, y, z) into the same angle about (-x, y, -z).
"""

import mujoco
import numpy as np

from plat.bounds import check_robot
from plat.errors import RobotError
from plat.robots.robot import Robot

__all__ = ["MIRRORED_AXIS", "joint_symmetry", "joints_at_zero", "keypoint_symmetry", "other_side"]

MIRRORED_AXIS = np.array([-1.0, 1.0, -1.0])
"""Signs of an axis of rotation in the mirror."""
_MIRRORED_PLACE = np.array([1.0, -1.0, 1.0])
# Descriptions are rounded: of places (m), and of axes.
_TOLERANCE = 1e-3


def joint_symmetry(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each joint ``[J]``, the joint whose angle it takes in the mirror, and the sign.

    Axes and positions of the joints are compared in the root's frame with all joints at 0. So the link frames of the
    two sides may be oriented in any way.

    Raises:
        RobotError: when the robot has no such symmetry.

    >>> from plat.robots import G1
    >>> partner, sign = joint_symmetry(G1)
    >>> left = G1.joint_names.index("left_hip_roll")
    >>> G1.joint_names[partner[left]], sign[left]
    ('right_hip_roll', np.float64(-1.0))
    """
    check_robot(robot)
    names = [other_side(name) for name in robot.joint_names]
    if names == list(robot.joint_names):
        raise RobotError(f"robot {robot.name!r}: no joint is called left_... or right_..., so none can change sides")
    if set(names) != set(robot.joint_names):
        raise RobotError(
            f"robot {robot.name!r}: joints without a partner {sorted(set(names) - set(robot.joint_names))}"
        )
    partner = np.array([robot.joint_names.index(name) for name in names])
    axis, place = joints_at_zero(robot)
    off = np.abs(place[partner] * _MIRRORED_PLACE - place).max(-1)
    sign = (axis[partner] * MIRRORED_AXIS * axis).sum(-1).round()
    turned = np.abs(axis[partner] * MIRRORED_AXIS - sign[:, None] * axis).max(-1)
    for what, difference in (("the place", off), ("the axis", turned)):
        if difference.max() > _TOLERANCE:
            joint = int(difference.argmax())
            raise RobotError(
                f"robot {robot.name!r}: with all joints at 0, {what} of {robot.joint_names[joint]!r} is not the mirror "
                f"image of that of {robot.joint_names[partner[joint]]!r}: it is not symmetric about the plane y = 0"
            )
    return partner, sign


def joints_at_zero(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return axis and place of each joint ``[J, 3]`` in the root's frame with all joints at 0.

    The place is that from the joint before (m), so that small differences do not add up along a limb.

    >>> from plat.robots import G1
    >>> axis, _ = joints_at_zero(G1)
    >>> axis[G1.joint_names.index("left_knee")].round(2).tolist()
    [0.0, 1.0, 0.0]
    """
    model = robot.shared_model
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    mujoco.mj_kinematics(model, data)
    bodies = model.jnt_bodyid[1:]
    before = model.body_parentid[bodies]
    while (fixed := (before > 0) & (model.body_jntnum[before] == 0)).any():
        before = np.where(fixed, model.body_parentid[before], before)
    return data.xaxis[1:].copy(), data.xpos[bodies] - data.xpos[before]


def keypoint_symmetry(robot: Robot) -> np.ndarray:
    """Return, for each keypoint ``[K]``, the keypoint whose place it takes in the mirror.

    Raises:
        RobotError: for a keypoint without a partner, and for feet that are not each other's.

    >>> from plat.robots import G1
    >>> len(keypoint_symmetry(G1))
    14
    """
    names = [other_side(name) for name in robot.keypoints]
    if alone := sorted(set(names) - set(robot.keypoints)):
        raise RobotError(f"robot {robot.name!r}: keypoints without a partner {alone}")
    left, right = robot.feet
    if other_side(left) != right:  # its other keypoints would stay where they are as well
        raise RobotError(
            f"robot {robot.name!r}: feet {left!r} and {right!r}, expected left_... and right_... to mirror"
        )
    return np.array([robot.keypoints.index(name) for name in names])


def other_side(name: str) -> str:
    """Return a name with left for right.

    >>> other_side("left_knee"), other_side("waist_yaw")
    ('right_knee', 'waist_yaw')
    """
    swapped = {"left": "right", "right": "left"}
    return "_".join(swapped.get(word, word) for word in name.split("_"))
