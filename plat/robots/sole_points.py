"""Points of the soles: where feet of spheres, capsules, cylinders, boxes or meshes touch the floor."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from plat.errors import RobotError
from plat.robots.robot import Robot
from plat.rotations_np import quat_to_matrix

__all__ = ["SOLE_GEOMS", "SolePoints", "sole_points", "touching_points"]

_Floats = NDArray[np.float64]
_Geom = mujoco.mjtGeom

SOLE_GEOMS = tuple(
    int(kind)
    for kind in (_Geom.mjGEOM_SPHERE, _Geom.mjGEOM_CAPSULE, _Geom.mjGEOM_CYLINDER, _Geom.mjGEOM_BOX, _Geom.mjGEOM_MESH)
)
"""MuJoCo's types of the geoms that have points."""

# A point this much above the lowest of its geom (m) touches as well when the foot is flat: soles are rounded.
_FLAT = 0.005
# Cosine of the largest angle (15 degrees) between the vertical and the axis of a foot's frame that is meant to be it:
# the foot of a default pose need not be quite level.
_ALONG = 0.966
# Points around the rim of a cylinder, and along the outline of a mesh.
_AROUND = 8


class SolePoints(NamedTuple):
    """Balls whose hull is the contact geometry of two feet, in the frames of the feet."""

    centers: _Floats
    """``[2, P, 3]`` (m)"""
    radii: _Floats
    """``[2, P]`` (m); 0 for corners"""


def sole_points(robot: Robot, model: mujoco.MjModel) -> SolePoints:
    """Return the balls whose hull is the contact geometry of the left and right foot.

    The center of a sphere, the ends of a capsule, points around both rims of a cylinder, the corners of a box and of
    the convex hull of a mesh: the lowest of them is the lowest of the foot. A mesh is taken by the points that lie
    farthest in some directions.

    Args:
        robot: the robot.
        model: of it.

    Raises:
        RobotError: for a foot without contact geoms, with others than the other one has, or of another kind.

    >>> from plat.robots import G1
    >>> centers, radii = sole_points(G1, G1.model())
    >>> centers.shape, radii[0].tolist()
    ((2, 4, 3), [0.005, 0.005, 0.005, 0.005])
    """
    feet = [[_points(robot, model, int(geom)) for geom in geoms] for geoms in robot.sole_geoms(model)]
    counts = [[len(points) for points, _ in foot] for foot in feet]
    if counts[0] != counts[1]:
        raise RobotError(
            f"robot {robot.name!r}: contact geoms of {robot.feet[0]!r} and {robot.feet[1]!r} are of different kinds, "
            "expected the same on each foot, in the same order"
        )
    centers = [np.concatenate([points for points, _ in foot]) for foot in feet]
    radii = [np.concatenate([np.full(len(points), radius) for points, radius in foot]) for foot in feet]
    return SolePoints(np.stack(centers), np.stack(radii))


def touching_points(robot: Robot, model: mujoco.MjModel) -> list[_Floats]:
    """Return the points of each foot that touch a level floor when the foot is flat ``[P, 3]`` (m, foot's frame).

    Down is the axis of the foot's frame that points down in the default pose. If that frame is tilted against the sole,
    it is the vertical of the default pose. From each geom, the points as low as its lowest are taken.

    Raises:
        RobotError: as :func:`sole_points`.

    >>> from plat.robots import G1
    >>> [points.shape for points in touching_points(G1, G1.model())]
    [(4, 3), (4, 3)]
    """
    data = mujoco.MjData(model)
    data.qpos[:] = robot.default_qpos
    mujoco.mj_kinematics(model, data)
    feet = []
    for foot, geoms in zip(robot.feet, robot.sole_geoms(model), strict=True):
        upward = data.body(foot).xmat.reshape(3, 3)[2]
        down = -upward
        axis = int(np.abs(upward).argmax())
        if abs(upward[axis]) > _ALONG:
            down = -np.sign(upward[axis]) * np.eye(3)[axis]
        touching = []
        for geom in geoms:
            centers, radius = _points(robot, model, int(geom))
            lowest = centers + radius * down
            depth = lowest @ down
            touching.append(lowest[depth >= depth.max() - _FLAT])
        feet.append(_distinct(np.concatenate(touching)))
    return feet


def _points(robot: Robot, model: mujoco.MjModel, geom: int) -> tuple[_Floats, float]:
    """Return the balls of a geom: centers ``[P, 3]`` in its body's frame and their radius (m)."""
    size = model.geom_size[geom]
    radius = 0.0
    match int(model.geom_type[geom]):
        case _Geom.mjGEOM_SPHERE:
            points, radius = np.zeros((1, 3)), float(size[0])
        case _Geom.mjGEOM_CAPSULE:
            points, radius = np.array([[0, 0, -size[1]], [0, 0, size[1]]]), float(size[0])
        case _Geom.mjGEOM_CYLINDER:
            angle = np.arange(_AROUND) * 2 * np.pi / _AROUND
            rim = size[0] * np.stack((np.cos(angle), np.sin(angle)), -1)
            points = np.concatenate([np.column_stack((rim, np.full(_AROUND, end))) for end in (-size[1], size[1])])
        case _Geom.mjGEOM_BOX:
            points = size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        case _Geom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            start = int(model.mesh_vertadr[mesh])
            points = _outline(model.mesh_vert[start : start + int(model.mesh_vertnum[mesh])].astype(np.float64))
        case _:
            body = model.body(model.geom_bodyid[geom]).name
            raise RobotError(
                f"robot {robot.name!r}: a contact geom of {body!r} is no sphere, capsule, cylinder, box or mesh"
            )
    turn = quat_to_matrix(model.geom_quat[geom])
    return model.geom_pos[geom] + points @ turn.T, radius


def _outline(vertices: _Floats) -> _Floats:
    """Return the vertices that are farthest in some directions: one for each, so that both feet have as many."""
    signs = (-1.0, 0.0, 1.0)
    directions = np.array([[x, y, z] for x in signs for y in signs for z in signs if any((x, y, z))])
    # toward the corners of each face, too: those of a sole lie around its lowest point
    steep = np.concatenate([directions * scale for scale in ((1, 1, 20), (1, 20, 1), (20, 1, 1))])
    directions = np.concatenate((directions, steep))
    return vertices[(vertices @ directions.T).argmax(0)]


def _distinct(points: _Floats) -> _Floats:
    """Return points without those that come twice, in their order."""
    _, first = np.unique(points.round(6), axis=0, return_index=True)
    return points[np.sort(first)]
