"""Scene: the robot, translucent keyframe poses, and handles to drag them by. Needs the extra ``plat-rl[studio]``."""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import viser
from mjviser.conversions import merge_geoms

from plat.robots.robot import Robot

__all__ = ["Ghosts", "RobotView", "set_the_stage"]

CAMERA, LOOK_AT = (2.2, -1.5, 1.25), (0.0, 0.0, 0.45)
"""Where the page looks from, and at which point (m)."""

_VISUAL_GROUP = 2


def set_the_stage(server: viser.ViserServer, world: str) -> None:
    """Add a floor (under a node of the scene), light, and a camera that looks at a robot at the origin."""
    server.scene.configure_environment_map("studio", environment_intensity=0.3)
    server.scene.set_background_image(np.full((2, 2, 3), (198, 209, 220), dtype=np.uint8), format="png")
    server.scene.add_grid(
        f"{world}/floor",
        width=40.0,
        height=40.0,
        cell_size=0.5,
        cell_color=(140, 150, 160),
        section_color=(118, 128, 138),
        plane_color=(158, 168, 178),
        plane_opacity=1.0,
        fade_distance=25.0,
        shadow_opacity=0.3,
    )
    server.initial_camera.position, server.initial_camera.look_at = CAMERA, LOOK_AT


class _Bodies:
    """Meshes of a robot's bodies, and their poses."""

    def __init__(self, robot: Robot):
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        geoms: dict[int, list[int]] = {}
        for geom in range(self._model.ngeom):
            if self._model.geom_group[geom] == _VISUAL_GROUP:
                geoms.setdefault(int(self._model.geom_bodyid[geom]), []).append(geom)
        self.ids = list(geoms)
        self.names = [self._model.body(body).name for body in geoms]
        self.meshes = [merge_geoms(self._model, list(parts)) for parts in geoms.values()]

    def placed(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions ``[B, 3]`` (m, world) and orientations ``[B, 4]`` of the bodies in a pose ``[7 + J]``."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self.ids], self._data.xquat[self.ids]


class RobotView:
    """Robot in its own colors.

    Args:
        server: the page.
        robot: the robot.
        name: of its node in the scene.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, name: str):
        self._server = server
        self._bodies = _Bodies(robot)
        self._handles = [
            server.scene.add_mesh_trimesh(f"{name}/{body}", mesh)
            for body, mesh in zip(self._bodies.names, self._bodies.meshes, strict=True)
        ]

    def show(self, qpos: np.ndarray) -> None:
        """Draw the robot in a pose ``[7 + J]``."""
        with self._server.atomic():
            for handle, pos, quat in zip(self._handles, *self._bodies.placed(qpos), strict=True):
                handle.position, handle.wxyz = pos, quat


class Ghosts:
    """Translucent robots of one color, any number of them.

    Args:
        server: the page.
        robot: the robot.
        name: of their node in the scene.
        color: red, green, blue, 0 to 255.
        opacity: 0 to 1.
    """

    def __init__(self, server: viser.ViserServer, robot: Robot, name: str, color: tuple[int, int, int], opacity: float):
        self._server = server
        self._bodies = _Bodies(robot)
        self._look: dict[str, Any] = {"batched_colors": color, "opacity": opacity, "lod": "off", "cast_shadow": False}
        self._name = name
        self._handles: list[viser.BatchedMeshHandle] = []
        self._poses = np.empty((0, len(robot.default_qpos)))

    def show(self, poses: Sequence[np.ndarray]) -> None:
        """Draw one robot for each pose ``[7 + J]``."""
        asked = np.array(poses).reshape(-1, self._poses.shape[1])
        if np.array_equal(asked, self._poses):
            return
        with self._server.atomic():
            if len(asked) != len(self._poses):
                self._remake(len(asked))
            self._poses = asked
            if not poses:
                return
            placed = [self._bodies.placed(qpos) for qpos in poses]
            pos, quat = (np.stack(parts, 1).astype(np.float32) for parts in zip(*placed, strict=True))
            for index, handle in enumerate(self._handles):
                handle.batched_positions, handle.batched_wxyzs = pos[index], quat[index]

    def _remake(self, count: int) -> None:
        for handle in self._handles:
            handle.remove()
        self._handles = []
        if count == 0:
            return
        for body, mesh in zip(self._bodies.names, self._bodies.meshes, strict=True):
            nowhere, upright = np.zeros((count, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
            self._handles.append(
                self._server.scene.add_batched_meshes_simple(
                    f"{self._name}/{body}", mesh.vertices, mesh.faces, upright, nowhere, **self._look
                )
            )
