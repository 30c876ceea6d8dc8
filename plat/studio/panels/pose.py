"""Panel of the selected pose: joint angles, root, and the handles to drag it by."""

from functools import partial
from math import ceil, floor
from typing import Any

import mujoco
import numpy as np
import viser

from plat.robots.robot import without_side
from plat.rotations_np import heading_pitch_roll, quat_from_heading_pitch_roll
from plat.studio.page import Page
from plat.studio.pins import PRESETS, chosen, pinned, preset
from plat.studio.poser import BALLS, HANDLES, WHOLE, Frame
from plat.studio.templates import TEMPLATES

__all__ = ["PosePanel"]

_LIMBS = {
    "Left arm": ("left_shoulder", "left_elbow", "left_wrist"),
    "Right arm": ("right_shoulder", "right_elbow", "right_wrist"),
    "Waist": ("waist",),
    "Left leg": ("left_hip", "left_knee", "left_ankle"),
    "Right leg": ("right_hip", "right_knee", "right_ankle"),
}
_POSITION_DIGITS = 3
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_HANDLE_COLOR, _CHOSEN_COLOR, _FREE_COLOR = (240, 140, 0), (28, 126, 214), (200, 205, 210)
_CUSTOM = "what is pinned"
_SIGHT = 15.0  # how far away the robot can be dragged (m)
_REACH = 0.27  # length of the arrows (m)
_DRAG = "drag"  # of what comes many times a second while something is dragged, only the last counts


class PosePanel:
    """Panel with joint sliders, numbers for the root, and a gizmo on one of the handles.

    Args:
        page: the page.
        world: parent node of everything in the scene.
    """

    def __init__(self, page: Page, world: str):
        self._page, session, gui = page, page.session, page.gui
        self._world_axes = False
        self._joint: int | None = None
        self._arrows = False
        self._grabbed: tuple[Frame, float] | None = None
        self._ringed = 0  # number of the pose whose joint is turned
        self._template = gui.add_dropdown("Begin with", tuple(TEMPLATES), hint="Keyframes after the selected one.")
        page.buttons("", {"Add template": lambda: session.insert_template(self._template.value)})
        self._handle = gui.add_dropdown(
            "Drag by",
            (*HANDLES, WHOLE),
            initial_value="left hand",
            hint="Or drag a ball; a click shows its arrows.",
        )
        page.when_changed(self._handle, self._choose)
        self._options = {
            "one limb only": gui.add_checkbox("One limb only", initial_value=False, hint="Nothing else moves along."),
            "symmetric": gui.add_checkbox("Symmetric", initial_value=False, hint="The other side does the same."),
            "axes": gui.add_checkbox("World axes", initial_value=False, hint="Else those of the limb. Key: W"),
        }
        for option, box in self._options.items():
            page.when_changed(box, partial(self._set_option, option))
        self._commands = gui.add_dropdown(
            "Commands", (*PRESETS, _CUSTOM), hint="The rest is faint: the policy chooses it. Key P pins a handle."
        )
        page.when_changed(self._commands, self._set_commands)
        with gui.add_folder("Hold while dragging"):
            self._hold = {
                part: gui.add_checkbox(part, initial_value=part != "hands")
                for part in ("feet", "pelvis", "chest", "hands")
            }
        page.buttons("Put", {"On floor": session.drop, "Feet flat": session.flatten_feet, "Standing": session.stand})
        page.buttons("Way", {"Lead around": session.lead_around})
        self.robot_hidden = gui.add_checkbox("Hide the robot", initial_value=False, hint="While posing. Key: H")
        self.onion = gui.add_checkbox(
            "Neighbors", initial_value=True, hint="The poses before (blue) and after (orange). Key: O"
        )
        for box in (self.robot_hidden, self.onion):
            page.when_changed(box)
        with gui.add_folder("Pelvis", expand_by_default=False):
            self._position = gui.add_vector3("x, y, z (m)", (0.0, 0.0, 0.0), step=0.01)
            self._angles = gui.add_vector3("heading, pitch, roll (deg)", (0.0, 0.0, 0.0), step=1.0)
        page.when_changed(self._position, self._move)
        page.when_changed(self._angles, self._turn)
        self._sliders: dict[int, viser.GuiSliderHandle[float]] = {}
        for limb, starts in _LIMBS.items():
            with gui.add_folder(limb, expand_by_default=False):
                for joint, name in enumerate(session.robot.joint_names):
                    if name.startswith(starts):
                        self._sliders[joint] = self._slider(joint, name)
        scene = page.server.scene
        self._gizmo = scene.add_transform_controls(
            f"{world}/gizmo", scale=_REACH, line_width=4.0, depth_test=False, disable_sliders=True
        )
        self._ring = scene.add_transform_controls(
            f"{world}/ring",
            scale=_REACH,
            line_width=5.0,
            depth_test=False,
            active_axes=(True, True, False),
            disable_axes=True,
            disable_sliders=True,
            visible=False,
        )
        self._pulled_from = np.zeros(3)
        self._gizmo.on_update(self._dragged)
        self._ring.on_update(self._turned)
        self._dragging = False
        self._balls = {name: self._ball(world, name) for name in (*HANDLES, WHOLE)}

    def pin(self) -> None:
        """Pin the chosen handle, or take out its pin."""
        self._page.session.pin(self._handle.value)

    def _set_commands(self, name: str) -> None:
        session = self._page.session
        if name != _CUSTOM:
            session.edit(session.timeline.commanding(preset(name, session.robot)))

    def _show_commands(self) -> frozenset[str]:
        """Show what is commanded; return the pinned handles."""
        session = self._page.session
        self._page.fill(self._commands, chosen(session.timeline.pose, session.robot) or _CUSTOM)
        return pinned(session.timeline.pose, session.robot)

    def toggle_axes(self) -> None:
        """Exchange the world's axes and the limb's."""
        self._set_option("axes", not self._world_axes)
        self._options["axes"].value = self._world_axes
        self._arrows = True

    def _set_option(self, option: str, on: bool) -> None:
        if option == "axes":
            self._world_axes = on
        else:
            setattr(self._page.session, {"one limb only": "limb_only"}.get(option, option), on)

    def _choose(self, handle: str, arrows: bool = True) -> None:
        self._handle.value, self._joint, self._arrows = handle, None, arrows

    def click_body(self, body: str) -> None:
        """Select the joint that moves a body; the pelvis, which none moves, becomes the handle."""
        model = self._page.session.robot.shared_model
        number = model.body(body).id
        joints = [joint for joint in range(1, model.njnt) if model.jnt_bodyid[joint] == number]
        if joints:
            self._joint = joints[0] - 1
        else:
            self._choose("pelvis")

    def _slider(self, joint: int, name: str) -> viser.GuiSliderHandle[float]:
        low, high = self._page.session.robot.joint_range[joint].tolist()
        slider = self._page.gui.add_slider(
            without_side(name),
            min=ceil(100 * low) / 100,
            max=floor(100 * high) / 100,
            step=0.01,
            initial_value=0.0,
            hint=name,
        )
        self._page.when_changed(slider, partial(self._page.session.set_joint, joint))
        return slider

    def _ball(self, world: str, name: str) -> viser.IcosphereHandle:
        node = f"{world}/handles/{name.replace(' ', '_')}"
        size = 0.026 if name.endswith(("elbow", "knee")) else 0.033
        ball = self._page.server.scene.add_icosphere(node, size, _HANDLE_COLOR, opacity=0.85, cast_shadow=False)

        def choose() -> None:
            self._choose(name)

        async def clicked(_: viser.SceneNodePointerEvent[viser.IcosphereHandle]) -> None:
            self._page.desk.ask(choose)

        async def dragged(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            if event.phase == "start":
                self._pulled_from = np.array(event.start_position)
            end = np.array(event.end_position)
            if name == WHOLE:
                end = _on_level(end, event.client.camera.position, self._pulled_from[2])
            pulled = end - self._pulled_from
            tasks = {"start": lambda: self._grab_ball(name), "update": lambda: self._pull(pulled), "end": self._release}
            self._page.desk.ask(tasks[event.phase], _DRAG if event.phase == "update" else None)

        ball.on_click(clicked)
        ball.on_drag(dragged)
        return ball

    def _move(self, position: tuple[float, float, float]) -> None:
        root = self._page.session.timeline.pose.qpos[:7]
        moved = np.subtract(position, _shown_position(root))
        root[:3] += moved  # what was not touched keeps all its digits
        self._page.session.set_root(root, gesture=("position", *np.flatnonzero(moved)))

    def _turn(self, angles: tuple[float, float, float]) -> None:
        root = self._page.session.timeline.pose.qpos[:7]
        turned = np.subtract(angles, _shown_angles(root))
        root[3:] = quat_from_heading_pitch_roll(np.radians(angles))
        self._page.session.set_root(root, gesture=("angles", *np.flatnonzero(turned)))

    async def _dragged(self, event: viser.TransformControlsEvent) -> None:
        there = Frame(self._gizmo.position.copy(), self._gizmo.wxyz.copy())
        tasks = {"start": self._grab, "update": lambda: self._drag(there), "end": self._release}
        self._page.desk.ask(tasks[event.phase], _DRAG if event.phase == "update" else None)

    def _grab(self) -> None:
        held = {"feet": ("left foot", "right foot"), "pelvis": ("pelvis",), "hands": ("left hand", "right hand")}
        if self._handle.value.endswith(("hand", "elbow")):  # else it is what moves
            held["chest"] = ("chest",)
        session = self._page.session
        self._grabbed = session.poser.frames(session.timeline.pose.qpos)[self._handle.value], 0.0
        session.grab(
            self._handle.value, [name for part, box in self._hold.items() if box.value for name in held.get(part, ())]
        )
        self._dragging = True

    def _drag(self, there: Frame) -> None:
        pos, quat = there
        if self._world_axes and self._grabbed is not None:
            quat = _multiplied(quat, self._grabbed[0].quat)  # the gizmo began upright
        self._page.session.drag(Frame(pos, quat))

    def _grab_ball(self, name: str) -> None:
        self._choose(name, arrows=False)  # they would be in the way of the next drag
        self._grab()

    def _pull(self, pulled: np.ndarray) -> None:
        if self._grabbed is not None:
            pos, quat = self._grabbed[0]
            self._page.session.drag(Frame(pos + pulled, quat))

    def _release(self) -> None:
        self._page.session.release()
        self._dragging = False

    async def _turned(self, event: viser.TransformControlsEvent) -> None:
        quat = self._ring.wxyz.copy()
        tasks = {"start": self._grab_joint, "update": lambda: self._turn_joint(quat), "end": self._release}
        self._page.desk.ask(tasks[event.phase], _DRAG if event.phase == "update" else None)

    def _grab_joint(self) -> None:
        if self._joint is not None:
            self._page.session.begin_drag()
            timeline = self._page.session.timeline
            self._grabbed = self._ring_frame(timeline.pose.qpos), float(timeline.pose.joint_pos[self._joint])
            self._ringed, self._dragging = timeline.selected, True

    def _turn_joint(self, quat: np.ndarray) -> None:
        meant = self._ringed == self._page.session.timeline.selected  # else another pose was selected meanwhile
        if meant and self._joint is not None and self._grabbed is not None:
            frame, angle = self._grabbed
            conjugate = frame.quat * [1.0, -1.0, -1.0, -1.0]
            turn = _multiplied(conjugate, quat)
            turned = 2 * np.arctan2(turn[3], turn[0])
            turned = (turned + np.pi) % (2 * np.pi) - np.pi
            self._page.session.set_joint(self._joint, angle + float(turned))

    def _ring_frame(self, qpos: np.ndarray) -> Frame:
        """Return the frame of the selected joint, its axis along z."""
        assert self._joint is not None
        return self._page.session.poser.joint_frame(qpos, self._joint)

    def show(self) -> None:
        """Update sliders, numbers and handles."""
        session = self._page.session
        qpos = session.timeline.pose.qpos
        for joint, slider in self._sliders.items():
            self._page.fill(slider, min(max(round(float(qpos[7 + joint]), 2), slider.min), slider.max))
        self._page.fill(self._position, _shown_position(qpos))
        self._page.fill(self._angles, _shown_angles(qpos))
        frames = session.poser.frames(qpos)
        posing = not session.playback.playing and session.shows_selected
        pins = self._show_commands()
        for name, ball in self._balls.items():
            _set(ball, "visible", posing)
            ball.position = _beside(frames[name], BALLS[name.split()[-1]])
            chosen = name == self._handle.value and self._joint is None
            commanded = name in pins or (name == WHOLE and "pelvis" in pins)
            _set(ball, "color", _CHOSEN_COLOR if chosen else _HANDLE_COLOR if commanded else _FREE_COLOR)
        _set(self._gizmo, "visible", posing and self._joint is None and self._arrows)
        _set(self._gizmo, "disable_rotations", self._handle.value.endswith(("elbow", "knee")))  # those are points
        _set(self._ring, "visible", posing and self._joint is not None)
        if self._dragging:  # the mouse has it
            return
        pos, quat = frames[self._handle.value]
        self._gizmo.position, self._gizmo.wxyz = pos, _UPRIGHT if self._world_axes else quat
        if self._joint is not None:
            self._ring.position, self._ring.wxyz = self._ring_frame(qpos)

    @property
    def words(self) -> str:
        """Return what is selected, in a line."""
        session = self._page.session
        if self._joint is None:
            return ""
        low, high = session.robot.joint_range[self._joint].tolist()
        angle = float(session.timeline.pose.joint_pos[self._joint])
        return f"{session.robot.joint_names[self._joint]} {angle:.2f} rad ({low:.2f} to {high:.2f})"


def _shown_position(root: np.ndarray) -> tuple[float, ...]:
    return tuple(root[:3].round(_POSITION_DIGITS).tolist())


def _shown_angles(root: np.ndarray) -> tuple[float, ...]:
    return tuple(np.degrees(heading_pitch_roll(root[3:7])).round(1).tolist())


def _set(handle: Any, field: str, value: Any) -> None:
    if getattr(handle, field) != value:
        setattr(handle, field, value)


def _on_level(point: np.ndarray, camera: np.ndarray, height: float) -> np.ndarray:
    """Return where the ray from a camera through a point is at a height (m), or as far as one can see."""
    ray, rise = point - camera, height - camera[2]
    share = rise / ray[2] if rise * ray[2] > 0 else np.inf
    far = _SIGHT / max(float(np.linalg.norm(ray[:2])), 1e-6)
    return np.array([*(camera + min(share, far) * ray)[:2], height])


def _beside(frame: Frame, offset: tuple[float, float, float]) -> np.ndarray:
    turned = np.empty(3)
    mujoco.mju_rotVecQuat(turned, np.array(offset), frame.quat)
    return frame.pos + turned


def _multiplied(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    product = np.empty(4)
    mujoco.mju_mulQuat(product, np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64))
    return product
