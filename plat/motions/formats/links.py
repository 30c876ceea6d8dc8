"""World rotations of a robot's links to joint angles and back, as Kimodo and ARDY store the motions of robots.

Their world has the y axis up and z forward. Their skeletons have the root, a joint of each of the robot's in its own
order, and ends of feet and hands behind the last joint of a limb.

Source: nv-tlabs/kimodo, ``kimodo/exports/mujoco.py`` and ``kimodo/skeleton/definitions.py`` (34 joints of the G1).
"""

import mujoco
import numpy as np

from plat.robots.robot import Robot
from plat.rotations_np import quat_from_matrix, quat_multiply

__all__ = ["link_count", "links_of_qpos", "qpos_of_links", "world_rotations"]

# joints that an end follows: the toes and the hand
_BEFORE_ENDS = ("ankle_roll", "wrist_yaw")
# from MuJoCo's axes (x forward, z up) to those of the files (z forward, y up)
_AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])


def link_count(robot: Robot) -> int:
    """Return how many joints the skeleton of a robot has.

    >>> from plat.robots import G1
    >>> link_count(G1)
    34
    """
    return 1 + len(_with_ends(robot))


def qpos_of_links(rotations: np.ndarray, root_pos: np.ndarray, robot: Robot) -> np.ndarray:
    """Return the motion ``[T, 7 + J]`` of links; what does not turn about a joint's axis is left out.

    Args:
        rotations: link to world ``[T, L, 3, 3]``, with L as :func:`link_count` says.
        root_pos: ``[T, 3]`` (m).
        robot: whose links they are.
    """
    quats = quat_from_matrix(_AXES.T @ rotations @ _AXES)
    angles = np.zeros((len(rotations), robot.num_joints))
    for joint, (link, parent, offset, axis) in enumerate(_tree(robot)):
        local = quat_multiply(_inverse(offset), quat_multiply(_inverse(quats[:, parent]), quats[:, link]))
        turn = 2 * np.arctan2(local[:, 1:] @ axis, local[:, 0])
        angles[:, joint] = np.arctan2(np.sin(turn), np.cos(turn))
    root = quats[:, 0] * np.where(quats[:, :1, 0] < 0, -1, 1)
    return np.concatenate((root_pos @ _AXES, root, angles), 1)


def links_of_qpos(qpos: np.ndarray, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Return local rotations of links as quaternions ``[T, L, 4]``, each to its parent, and places of the root.

    The inverse of :func:`qpos_of_links`, which takes rotations to the world.

    Args:
        qpos: the motion ``[T, 7 + J]``.
        robot: whose motion it is.
    """
    turn = quat_from_matrix(_AXES)
    local = np.tile([1.0, 0.0, 0.0, 0.0], (len(qpos), link_count(robot), 1))
    local[:, 0] = quat_multiply(turn, quat_multiply(qpos[:, 3:7], _inverse(turn)))
    for joint, (link, _, offset, axis) in enumerate(_tree(robot)):
        half = 0.5 * qpos[:, 7 + joint, None]
        hinge = quat_multiply(offset, np.concatenate((np.cos(half), np.sin(half) * axis), 1))
        local[:, link] = quat_multiply(turn, quat_multiply(hinge, _inverse(turn)))
    return local, qpos[:, :3] @ _AXES.T


def world_rotations(local: np.ndarray, robot: Robot) -> np.ndarray:
    """Return rotations of links to the world ``[T, L, 3, 3]`` of quaternions to their parents ``[T, L, 4]``.

    Args:
        local: as :func:`links_of_qpos` returns them.
        robot: whose links they are.
    """
    parents = {link: parent for link, parent, *_ in _tree(robot)}
    world = local.copy()
    for link in range(1, local.shape[1]):
        # an end follows the link before it
        world[:, link] = quat_multiply(world[:, parents.get(link, link - 1)], local[:, link])
    w, x, y, z = np.moveaxis(world, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _with_ends(robot: Robot) -> list[int | None]:
    """Return the robot's joints by index, and None for an end, as the skeleton lists them behind the root."""
    listed: list[int | None] = []
    for joint, name in enumerate(robot.joint_names):
        listed += [joint, None] if name.endswith(_BEFORE_ENDS) else [joint]
    return listed


def _tree(robot: Robot) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """Return link, parent link, rotation of the link at angle 0 and axis of each of the robot's joints."""
    model: mujoco.MjModel = robot.shared_model
    links = {joint: link for link, joint in enumerate(_with_ends(robot), start=1) if joint is not None}
    joint_of_body = {int(model.jnt_bodyid[joint + 1]): joint for joint in links}
    rows = []
    for joint in range(robot.num_joints):
        body = int(model.jnt_bodyid[joint + 1])
        parent, offset = int(model.body_parentid[body]), model.body_quat[body]
        while parent > 1 and parent not in joint_of_body:  # a body without a joint moves with its parent
            offset = quat_multiply(model.body_quat[parent], offset)
            parent = int(model.body_parentid[parent])
        rows.append(
            (links[joint], links[joint_of_body[parent]] if parent > 1 else 0, offset, model.jnt_axis[joint + 1])
        )
    return rows


def _inverse(quat: np.ndarray) -> np.ndarray:
    return quat * np.array([1.0, -1.0, -1.0, -1.0])
