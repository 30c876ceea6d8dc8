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

_Geom = mujoco.mjtGeom


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
        kind, size = model.geom_type[geoms][:, None], model.geom_size[geoms]
        ball = np.isin(kind, (_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE))
        long = np.isin(kind, (_Geom.mjGEOM_CAPSULE, _Geom.mjGEOM_CYLINDER))
        disc, egg, mesh = (kind == one for one in (_Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_ELLIPSOID, _Geom.mjGEOM_MESH))
        boxed = ~(ball | long | egg | mesh)
        # the box around it, whose middle need not be the geom's
        box = model.geom_aabb[geoms]
        self._radius = np.where(ball, size, 0.0)[:, 0]
        self._half = np.where(long, [0.0, 0.0, 1.0] * size[:, 1:2], np.where(boxed, box[:, 3:], 0.0))
        self._middle = np.where(boxed, box[:, :3], 0.0)
        self._disc, self._egg = np.where(disc, size, 0.0)[:, 0], np.where(egg, size, 0.0)
        self._hulls = {
            int(number): _hull(model, int(model.geom_dataid[geoms[number]])) for number in np.flatnonzero(mesh)
        }

    def lowest(self, data: mujoco.MjData) -> tuple[float, str]:
        """Return the height of the lowest point of all, and the body that it is of, in the pose that ``data`` has."""
        low = data.geom_xpos[self._geoms, 2] - self._below(data.geom_xmat[self._geoms, 6:9])
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
        return np.asarray(center[..., 2].numpy() - self._below(axes[..., 2, :].numpy()))

    def _below(self, up: np.ndarray) -> np.ndarray:
        """Return how far geoms go down from their centers ``[*B, G]`` (m), by the upward axis in each."""
        below = self._radius + (np.abs(up) * self._half - up * self._middle).sum(-1)
        below += self._disc * np.hypot(up[..., 0], up[..., 1]) + np.linalg.norm(up * self._egg, axis=-1)
        for number, corners in self._hulls.items():
            below[..., number] = -(up[..., number, :] @ corners.T).min(-1)
        return np.asarray(below)


def _hull(model: mujoco.MjModel, mesh: int) -> np.ndarray:
    """Return the corners of a mesh's convex hull ``[V, 3]`` (m), all of its vertices where MuJoCo has made none."""
    start, graph = int(model.mesh_vertadr[mesh]), int(model.mesh_graphadr[mesh])
    vertices = model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])].astype(np.float64)
    if graph < 0:
        return vertices
    # numbers of corners and faces, where the edges of each corner begin, and which vertex each is
    corners = int(model.mesh_graph[graph])
    return vertices[model.mesh_graph[graph + 2 + corners : graph + 2 + 2 * corners]]
