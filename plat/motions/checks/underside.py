"""Lowest points of a robot's parts: hands, knees, pelvis and trunk meet the floor as well as feet."""

import mujoco
import numpy as np
import torch

from plat.robots.contact_geoms import touches_floor
from plat.robots.kinematics import ForwardKinematics
from plat.robots.robot import Robot
from plat.rotations import quat_rotate, quat_to_matrix

__all__ = ["Underside"]

# Frames that are looked at in one go.
_CHUNK = 4096


class Underside:
    """Lowest points of a robot's collision geoms.

    Args:
        robot: whose.

    Attributes:
        bodies: name of the body of each geom.

    >>> from plat.robots import G1
    >>> underside = Underside(G1)
    >>> heights = underside.heights(G1.default_qpos[None])
    >>> underside.bodies[int(heights[0].argmin())].endswith("ankle_roll_link")
    True
    """

    def __init__(self, robot: Robot):
        model = robot.shared_model
        geoms = np.flatnonzero(touches_floor(model))
        self.bodies = [model.body(model.geom_bodyid[geom]).name for geom in geoms]
        names = list(dict.fromkeys(self.bodies))
        self._column = [names.index(body) for body in self.bodies]
        self._kinematics = ForwardKinematics(robot, tuple(names))
        self._num_joints = robot.num_joints
        self._place = torch.from_numpy(model.geom_pos[geoms])
        self._turn = torch.from_numpy(model.geom_quat[geoms])
        self._geoms = geoms
        size = model.geom_size[geoms]
        kind = model.geom_type[geoms]
        round_part = np.isin(kind, (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE))
        long = kind == mujoco.mjtGeom.mjGEOM_CAPSULE
        self._radius = np.where(round_part, size[:, 0], 0.0)
        # of anything that is no sphere or capsule the box around it
        box = np.where(kind[:, None] == mujoco.mjtGeom.mjGEOM_CYLINDER, size[:, [0, 0, 1]], size)
        self._half = np.where(round_part[:, None], long[:, None] * [0.0, 0.0, 1.0] * size[:, 1:2], box)

    def lowest(self, data: mujoco.MjData) -> tuple[float, str]:
        """Return the height of the lowest point of all, and the body that it is of, in the pose that ``data`` has."""
        axes = data.geom_xmat[self._geoms, 6:9]
        low = data.geom_xpos[self._geoms, 2] - (np.abs(axes) * self._half).sum(-1) - self._radius
        part = int(low.argmin())
        return float(low[part]), self.bodies[part]

    def heights(self, qpos: np.ndarray) -> np.ndarray:
        """Return how high the lowest point of each geom is ``[T, G]`` (m) in poses ``[T, 7 + J]``."""
        found = [
            self._heights(torch.from_numpy(part).double()) for part in np.array_split(qpos, -(-len(qpos) // _CHUNK))
        ]
        return np.concatenate(found)

    def _heights(self, qpos: torch.Tensor) -> np.ndarray:
        pos_w, quat_w = self._kinematics(*qpos.split((3, 4, self._num_joints), -1))
        pos_w, quat_w = pos_w[:, self._column], quat_w[:, self._column]
        center = pos_w + quat_rotate(quat_w, self._place.expand(len(qpos), -1, -1))
        axes = quat_to_matrix(quat_w) @ quat_to_matrix(self._turn)
        reach = (axes[..., 2, :].abs().numpy() * self._half).sum(-1) + self._radius
        return np.asarray(center[..., 2].numpy() - reach)
