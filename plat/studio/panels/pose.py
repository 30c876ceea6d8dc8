"""Panel of the selected pose: joint angles, root, and the handles to drag it by."""

from math import ceil, floor

import numpy as np
import viser

from plat.robots.robot import without_side
from plat.rotations_np import heading_pitch_roll, quat_from_heading_pitch_roll
from plat.studio.page import Page
from plat.studio.poser import HANDLES, Frame

__all__ = ["PosePanel"]

_LIMBS = {
    "Left arm": ("left_shoulder", "left_elbow", "left_wrist"),
    "Right arm": ("right_shoulder", "right_elbow", "right_wrist"),
    "Waist": ("waist",),
    "Left leg": ("left_hip", "left_knee", "left_ankle"),
    "Right leg": ("right_hip", "right_knee", "right_ankle"),
}
_POSITION_DIGITS = 3
_HANDLE_COLOR, _CHOSEN_COLOR = (240, 140, 0), (28, 126, 214)


class PosePanel:
    """Panel with joint sliders, numbers for the root, and a gizmo on one of the handles.

    Args:
        page: the page.
        world: parent node of everything in the scene.
    """

    def __init__(self, page: Page, world: str):
        self._page, session, gui = page, page.session, page.gui
        self._handle = gui.add_dropdown(
            "Drag by", tuple(HANDLES), initial_value="left hand", hint="Or click on one of the orange balls."
        )
        page.when_changed(self._handle)
        with gui.add_folder("Hold while dragging"):
            self._hold = {
                part: gui.add_checkbox(part, initial_value=part != "hands") for part in ("feet", "pelvis", "hands")
            }
        page.buttons("Put", {"On floor": session.drop, "Feet flat": session.flatten_feet, "Standing": session.stand})
        self.all_keyframes = gui.add_checkbox("Show all keyframes", initial_value=True)
        page.when_changed(self.all_keyframes)
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
        self._gizmo = page.server.scene.add_transform_controls(f"{world}/gizmo", scale=0.22, depth_test=False)
        self._gizmo.on_update(self._dragged)
        self._dragging = False
        self._balls = {name: self._ball(world, name) for name in HANDLES}

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
        self._page.when_changed(slider, lambda: self._page.session.set_joint(joint, slider.value))
        return slider

    def _ball(self, world: str, name: str) -> viser.IcosphereHandle:
        node = f"{world}/handles/{name.replace(' ', '_')}"
        ball = self._page.server.scene.add_icosphere(node, 0.035, _HANDLE_COLOR, opacity=0.8, cast_shadow=False)

        def choose() -> None:
            self._handle.value = name

        async def clicked(_: viser.SceneNodePointerEvent[viser.IcosphereHandle]) -> None:
            self._page.desk.ask(choose)

        ball.on_click(clicked)
        return ball

    def _move(self) -> None:
        root = self._page.session.timeline.pose.qpos[:7]
        shown = root[:3].round(_POSITION_DIGITS)
        root[:3] += np.subtract(self._position.value, shown)  # what was not touched keeps all its digits
        self._page.session.set_root(root, gesture="position")

    def _turn(self) -> None:
        root = self._page.session.timeline.pose.qpos[:7]
        root[3:] = quat_from_heading_pitch_roll(np.radians(self._angles.value))
        self._page.session.set_root(root, gesture="angles")

    async def _dragged(self, event: viser.TransformControlsEvent) -> None:
        tasks = {"start": self._grab, "update": self._drag, "end": self._release}
        self._page.desk.ask(tasks[event.phase], once=event.phase == "update")

    def _grab(self) -> None:
        held = {"feet": ("left foot", "right foot"), "pelvis": ("pelvis",), "hands": ("left hand", "right hand")}
        self._page.session.grab(
            self._handle.value, [name for part, box in self._hold.items() if box.value for name in held[part]]
        )
        self._dragging = True

    def _drag(self) -> None:
        self._page.session.drag(Frame(self._gizmo.position.copy(), self._gizmo.wxyz.copy()))

    def _release(self) -> None:
        self._page.session.release()
        self._dragging = False

    def show(self) -> None:
        """Update sliders, numbers and handles."""
        session = self._page.session
        qpos = session.timeline.pose.qpos
        for joint, slider in self._sliders.items():
            slider.value = min(max(round(float(qpos[7 + joint]), 2), slider.min), slider.max)
        self._position.value = tuple(qpos[:3].round(_POSITION_DIGITS).tolist())
        self._angles.value = tuple(np.degrees(heading_pitch_roll(qpos[3:7])).round(1).tolist())
        frames = session.poser.frames(qpos)
        for name, ball in self._balls.items():
            ball.visible = not session.playing
            ball.position = frames[name].pos
            ball.color = _CHOSEN_COLOR if name == self._handle.value else _HANDLE_COLOR
        self._gizmo.visible = not session.playing
        if not self._dragging:  # the mouse has it
            self._gizmo.position, self._gizmo.wxyz = frames[self._handle.value]
