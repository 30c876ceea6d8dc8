"""Scene: robots, poses of keyframes, and how they stand. Needs the extra ``plat-rl[studio]``."""

from collections.abc import Callable, Collection, Coroutine, Sequence
from functools import cached_property
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np
import trimesh
import viser
from mjviser.conversions import merge_geoms

from plat.robots.contact_geoms import visual_groups
from plat.robots.robot import Robot
from plat.studio.checker import Stance

__all__ = ["Backdrop", "Bodies", "Figure", "RobotView", "StanceView", "coarse"]

CAMERA, LOOK_AT, FIELD_OF_VIEW = (2.1, -1.45, 1.15), (0.0, 0.0, 0.63), 45.0
"""Where the page looks from, at which point (m), and its vertical field of view (degrees)."""

# A body that moves and turns by less than this is not sent again (m, and entries of a quaternion).
_STILL = 1e-5
# Bodies of two figures that are nearer than this would flicker (m, and entries of a quaternion).
_SAME = 0.003
_SOLID, _FAINT = 1.0, 0.25
_GROUND = (160, 168, 178)
_INSIDE, _BALANCED, _PLUMB = (214, 54, 59), (18, 161, 94), (90, 100, 110)


class _Colors(NamedTuple):
    """Colors around the robot: of the horizon, and of the floor's plane, cells and sections; brightness of lights."""

    horizon: tuple[int, int, int]
    floor: tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
    light: float


_BRIGHT = _Colors((208, 217, 226), ((190, 199, 208), (172, 181, 190), (150, 160, 170)), 2.2)
_DARK = _Colors((27, 33, 38), ((58, 67, 76), (74, 84, 94), (92, 103, 114)), 1.9)


class Backdrop:
    """Sky, floor (under a node of the scene), lights, and a camera that looks at a robot at the origin.

    Args:
        server: the page.
        world: the node.
    """

    def __init__(self, server: viser.ViserServer, world: str):
        self._scene = scene = server.scene
        # an environment map would cost a browser without a GPU as much as all the rest
        scene.configure_environment_map(None)
        scene.configure_default_lights(enabled=False)
        self._sky = scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=_GROUND, intensity=2.2)
        self.sun = scene.add_light_directional("/sun", intensity=2.2, position=(1.5, -1.5, 4.0), cast_shadow=True)
        """The light that casts shadows."""
        self._floor = scene.add_grid(
            f"{world}/floor",
            width=40.0,
            height=40.0,
            cell_size=0.5,
            plane_opacity=1.0,
            fade_distance=25.0,
            shadow_opacity=0.3,
        )
        self.paint(dark=False)
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = CAMERA, LOOK_AT, float(np.radians(FIELD_OF_VIEW))

    def paint(self, dark: bool) -> None:
        """Set the colors for a page that is bright or dark."""
        colors = _DARK if dark else _BRIGHT
        self._scene.set_background_image(np.full((2, 2, 3), colors.horizon, dtype=np.uint8), format="png")
        self._floor.plane_color, self._floor.cell_color, self._floor.section_color = colors.floor
        self._sky.intensity = self.sun.intensity = colors.light


class Bodies:
    """Meshes of a robot's bodies, and their poses; shared by all that draw the robot.

    Args:
        robot: the robot.
        error: how far about a surface in the robot's colors may be from the true one (m). By default a G1 has a
            fifteenth of MuJoCo's triangles.
        figure_error: the same for surfaces in one color: a twenty-seventh.
    """

    def __init__(self, robot: Robot, error: float = 0.001, figure_error: float = 0.002):
        self._error, self._figure_error = error, figure_error
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        geoms: dict[int, list[int]] = {}
        shown = np.isin(self._model.geom_group, visual_groups(self._model)) & (self._model.geom_bodyid > 0)
        for geom in np.flatnonzero(shown).tolist():
            geoms.setdefault(int(self._model.geom_bodyid[geom]), []).append(geom)
        self.ids = list(geoms)
        self.names = [self._model.body(body).name for body in geoms]
        self._geoms = list(geoms.values())

    @cached_property
    def meshes(self) -> list[trimesh.Trimesh]:
        """Return the shape of each body in its colors."""
        light = ([_lighter(shape, self._error) for shape in shapes] for shapes in self._shapes)
        return [cast(trimesh.Trimesh, trimesh.util.concatenate(shapes)) for shapes in light]

    @cached_property
    def coarse_meshes(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return vertices and faces of each body's shape."""
        return [_merged([_coarse_mesh(shape, self._figure_error) for shape in shapes]) for shapes in self._shapes]

    @cached_property
    def _shapes(self) -> list[list[trimesh.Trimesh]]:
        """Shapes of each body's geoms, in the body's frame."""
        return [[merge_geoms(self._model, [part]) for part in parts] for parts in self._geoms]

    def placed(self, qpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions ``[B, 3]`` (m, world) and orientations ``[B, 4]`` of the bodies in a pose ``[7 + J]``."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self.ids], self._data.xquat[self.ids]


class RobotView:
    """Robot in its own colors.

    Args:
        server: the page.
        bodies: of the robot.
        name: of its node in the scene.
    """

    def __init__(self, server: viser.ViserServer, bodies: Bodies, name: str):
        self._server = server
        self._bodies = bodies
        self._root = server.scene.add_frame(name, show_axes=False)
        self._handles = [
            server.scene.add_mesh_trimesh(f"{name}/{body}", mesh)
            for body, mesh in zip(self._bodies.names, self._bodies.meshes, strict=True)
        ]
        self._sent = _Sent(self._handles)

    def show(self, qpos: np.ndarray | None) -> None:
        """Draw the robot in a pose ``[7 + J]``, or hide it."""
        with self._server.atomic():
            if self._root.visible != (qpos is not None):
                self._root.visible = qpos is not None
            if qpos is not None:
                self._sent.move(*self._bodies.placed(qpos))


class _Sent:
    """Poses of the bodies as they were sent last; only what has moved is sent again."""

    def __init__(self, handles: Sequence[viser.SceneNodeHandle]):
        self._handles = handles
        self._last = np.full((len(handles), 7), np.nan)

    def move(self, pos: np.ndarray, quat: np.ndarray) -> None:
        """Move the bodies to positions ``[B, 3]`` and orientations ``[B, 4]``."""
        now = np.concatenate((pos, quat), 1)
        away = np.abs(now - self._last)
        for number in np.flatnonzero(~(away.max(1) < _STILL)).tolist():
            handle, parts = self._handles[number], away[number]
            if not parts[:3].max() < _STILL:
                handle.position = now[number, :3]
            if not parts[3:].max() < _STILL:
                handle.wxyz = now[number, 3:]
            self._last[number] = now[number]


class Figure:
    """Robot of one color that shows a pose, in coarser meshes.

    Args:
        server: the page.
        bodies: of the robot.
        name: of its node in the scene.
        color: red, green, blue, 0 to 255.
        opacity: 0 to 1.
        clicked: given the name of a body that was clicked on.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        bodies: Bodies,
        name: str,
        color: tuple[int, int, int],
        opacity: float,
        clicked: Callable[[str], None] | None = None,
    ):
        self._server = server
        self._bodies = bodies
        self._color, self._opacity = color, opacity
        self._look: list[tuple[object, object]] = []
        self._root = server.scene.add_frame(name, show_axes=False, visible=False)
        self._pose: np.ndarray | None = None
        self._handles = []
        for body, (vertices, faces) in zip(self._bodies.names, bodies.coarse_meshes, strict=True):
            handle = server.scene.add_mesh_simple(
                f"{name}/{body}", vertices, faces, color=color, opacity=opacity, cast_shadow=False
            )
            if clicked is not None:
                handle.on_click(_clicker(body, clicked))
            self._handles.append(handle)
        self._sent = _Sent(self._handles)
        self._look = [(color, opacity)] * len(self._handles)

    def show(
        self,
        qpos: np.ndarray | None,
        color: tuple[int, int, int] | None = None,
        faint: Collection[str] = (),
        inside: Collection[str] = (),
        beside: np.ndarray | None = None,
    ) -> None:
        """Draw a pose, or hide it.

        Args:
            qpos: ``[7 + J]``, or None.
            color: by default the figure's own.
            faint: bodies that are only to be guessed.
            inside: bodies to be drawn in red.
            beside: pose of another figure ``[7 + J]``: bodies that are at its bodies' places are left out.
        """
        with self._server.atomic():
            if self._root.visible != (qpos is not None):
                self._root.visible = qpos is not None
            if qpos is None:
                return
            if self._pose is None or not np.array_equal(qpos, self._pose):
                self._pose = np.array(qpos)
                self._sent.move(*self._bodies.placed(qpos))
            if beside is not None:
                own, other = (np.concatenate(self._bodies.placed(pose), 1) for pose in (qpos, beside))
                for handle, away in zip(self._handles, np.abs(own - other).max(1).tolist(), strict=True):
                    _change(handle, "visible", away > _SAME)
            for index, (handle, body) in enumerate(zip(self._handles, self._bodies.names, strict=True)):
                shade = _INSIDE if body in inside else color or self._color
                opacity = self._opacity * (_FAINT if body in faint else _SOLID)
                if self._look[index] != (shade, opacity):
                    self._look[index] = shade, opacity
                    handle.color, handle.opacity = shade, opacity


class StanceView:
    """Support polygon and center of mass on the floor.

    Args:
        server: the page.
        name: of its node in the scene.
    """

    def __init__(self, server: viser.ViserServer, name: str):
        self._server, self._name = server, name
        scene = server.scene
        self._root = scene.add_frame(name, show_axes=False, visible=False)
        # each has a place of its own: what is moved as a whole is not made anew
        self._polygon = scene.add_frame(f"{name}/support", show_axes=False)
        self._center = scene.add_frame(f"{name}/center", show_axes=False)
        plumb = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.6]]], dtype=np.float32)
        scene.add_line_segments(f"{name}/center/plumb", plumb, _PLUMB, thickness=2.0, thickness_units="screen")
        self._spot = scene.add_icosphere(f"{name}/center/spot", 0.022, _PLUMB, cast_shadow=False)
        self._drawn: tuple[object, ...] = ()

    def show(self, stance: Stance | None) -> None:
        """Draw it, in green where the robot is balanced and in red where it is not; None hides it."""
        with self._server.atomic():
            _change(self._root, "visible", stance is not None)
            if stance is None:
                return
            balanced = stance.margin is not None and stance.margin >= 0
            color = _BALANCED if balanced else _INSIDE
            _change(self._spot, "color", color)
            self._center.position = np.array([*stance.center[:2], 0.006])
            _change(self._polygon, "visible", len(stance.support) > 0)
            if len(stance.support) == 0:
                return
            self._polygon.position = np.array([*stance.support[0], 0.006])
            corners = np.zeros((len(stance.support), 3), dtype=np.float32)
            corners[:, :2] = (stance.support - stance.support[0]).round(3)
            drawn = color, corners.tobytes()
            if self._drawn != drawn:
                self._drawn = drawn
                self._draw(np.stack((corners, np.roll(corners, -1, axis=0)), 1), color)

    def _draw(self, edges: np.ndarray, color: tuple[int, int, int]) -> None:
        # made anew under the same name: browsers draw the old lines for a while when only the points change
        colors = np.tile(np.array(color, dtype=np.uint8), (len(edges), 2, 1))
        name = f"{self._name}/support/edges"
        self._server.scene.add_line_segments(name, edges, colors, thickness=3.0, thickness_units="screen")


def _change(handle: Any, field: str, value: object) -> None:
    if getattr(handle, field) != value:
        setattr(handle, field, value)


def coarse(vertices: np.ndarray, faces: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a mesh with fewer triangles, by merging all vertices in a cell of a grid (vertex clustering).

    Args:
        vertices: ``[V, 3]`` (m).
        faces: ``[F, 3]``.
        cell: edge of a cell (m).

    Returns:
        Vertices, faces, and the number of a former vertex for each vertex.

    >>> box = trimesh.creation.box()
    >>> [part.shape for part in coarse(box.vertices, box.faces, 0.1)]
    [(8, 3), (12, 3), (8,)]
    """
    places = np.round(vertices / cell).astype(np.int64)
    cells, one, members = np.unique(places, axis=0, return_index=True, return_inverse=True)
    members = members.reshape(-1)
    merged = np.zeros((len(cells), 3))
    np.add.at(merged, members, vertices)
    merged /= np.bincount(members, minlength=len(cells))[:, None]
    corners = members[faces]
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(1)]  # those with an area
    _, first = np.unique(np.sort(corners, 1), axis=0, return_index=True)
    return merged.astype(np.float32), corners[np.sort(first)].astype(np.uint32), one


def _cell(mesh: trimesh.Trimesh, error: float) -> float:
    """Return the cell whose edges are chords of a shape that is as round as it is thick, to an error (m)."""
    thickness = np.sort(mesh.extents)
    return min(float(np.sqrt(4 * error * thickness[1])), 0.8 * float(thickness[0]))


def _coarse_mesh(mesh: trimesh.Trimesh, error: float) -> tuple[np.ndarray, np.ndarray]:
    return coarse(np.asarray(mesh.vertices), np.asarray(mesh.faces), _cell(mesh, error))[:2]


def _lighter(mesh: trimesh.Trimesh, error: float) -> trimesh.Trimesh:
    """Return a mesh with fewer triangles in the same colors; one with a texture stays as it is."""
    visual = mesh.visual
    if not isinstance(visual, trimesh.visual.ColorVisuals) or visual.kind != "vertex":
        return mesh
    vertices, faces, one = coarse(np.asarray(mesh.vertices), np.asarray(mesh.faces), _cell(mesh, error))
    return trimesh.Trimesh(vertices, faces, vertex_colors=visual.vertex_colors[one], process=False)


def _merged(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices and faces of several meshes as those of one."""
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces + offset for (_, faces), offset in zip(parts, first, strict=True)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces).astype(np.uint32)


def _clicker(body: str, clicked: Callable[[str], None]) -> Callable[[object], Coroutine[None, None, None]]:
    async def call(_: object) -> None:
        clicked(body)

    return call
