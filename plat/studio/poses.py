"""Operations on whole poses: mirroring, placing, and dropping onto the floor."""

import mujoco
import numpy as np
import torch

from plat.motions import MotionClip, mirror_motion
from plat.robots.contact_geoms import touches_floor
from plat.robots.robot import Robot
from plat.rotations import quat_conjugate, quat_multiply, quat_yaw, yaw_multiply, yaw_rotate

__all__ = ["Floor", "mirrored", "placed", "symmetric"]


def placed(qpos: np.ndarray, origin: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return poses shifted over the floor and turned about the vertical, by one common transform.

    Args:
        qpos: poses ``[*T, 7 + J]``.
        origin: a pose ``[7 + J]`` that is to come to ``place``.
        place: the pose whose horizontal position and heading it is to have ``[7 + J]``.

    >>> from plat.robots import G1
    >>> there = G1.default_qpos.copy()
    >>> there[:2] = 2.0, 1.0
    >>> placed(G1.default_qpos, G1.default_qpos, there)[:3].round(2)
    array([2.  , 1.  , 0.76])
    """
    poses, first, last = (torch.from_numpy(np.asarray(pose, dtype=np.float64)) for pose in (qpos, origin, place))
    turn = quat_multiply(quat_yaw(last[3:7]), quat_conjugate(quat_yaw(first[3:7])))
    vertical = torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    root_pos = yaw_rotate(turn, poses[..., :3] - first[:3] * vertical) + last[:3] * vertical
    root_quat = yaw_multiply(turn, poses[..., 3:7])
    return torch.cat((root_pos, root_quat, poses[..., 7:]), -1).numpy()


def mirrored(qpos: np.ndarray, robot: Robot) -> np.ndarray:
    """Return the pose ``[7 + J]`` with left and right exchanged; the root keeps its position and heading.

    >>> from plat.robots import G1
    >>> bool(np.allclose(mirrored(G1.default_qpos, G1), G1.default_qpos))
    True
    """
    at_origin = placed(qpos, qpos, robot.default_qpos)
    image = mirror_motion(MotionClip("pose", at_origin[None], fps=1.0), robot).qpos[0]
    return placed(image, robot.default_qpos, qpos)


def symmetric(qpos: np.ndarray, side: str, robot: Robot) -> np.ndarray:
    """Return the pose ``[7 + J]`` with the joints of one side mirrored to the other; the rest stays.

    Args:
        qpos: pose.
        side: ``"left"`` or ``"right"``, which is copied.
        robot: the robot.

    >>> from plat.robots import G1
    >>> raised = G1.default_qpos.copy()
    >>> raised[7 + G1.joint_names.index("left_elbow")] = 1.0
    >>> float(symmetric(raised, "left", G1)[7 + G1.joint_names.index("right_elbow")])
    1.0
    """
    other = {"left": "right_", "right": "left_"}[side]
    image, result = mirrored(qpos, robot), np.array(qpos, dtype=np.float64)
    joints = [7 + joint for joint, name in enumerate(robot.joint_names) if name.startswith(other)]
    result[joints] = image[joints]
    return result


class Floor:
    """Floor contact of poses: clearance, and dropping onto the floor.

    Args:
        robot: its collision geoms count, feet and others alike.

    >>> from plat.robots import G1
    >>> raised = G1.default_qpos + np.eye(36)[2]
    >>> floor = Floor(G1)
    >>> round(floor.clearance(raised), 3), round(floor.clearance(floor.dropped(raised)), 3)
    (1.003, 0.0)
    """

    def __init__(self, robot: Robot):
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        self._floor = self._model.geom("floor").id
        self._solid = np.flatnonzero(touches_floor(self._model)).tolist()

    def clearance(self, qpos: np.ndarray) -> float:
        """Return the height of a pose's lowest point ``[7 + J]`` (m); negative below the floor."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        beyond = 1e3  # distances are capped there
        return min(
            mujoco.mj_geomDistance(self._model, self._data, self._floor, geom, beyond, None) for geom in self._solid
        )

    def dropped(self, qpos: np.ndarray) -> np.ndarray:
        """Return the pose with its lowest point on the floor."""
        result = np.array(qpos, dtype=np.float64)
        result[2] -= self.clearance(result)
        return result
