"""Templates: short motions to begin with, made of keyframes for the robot that is open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np

from plat.errors import StudioError
from plat.studio.poser import WHOLE, Frame, Poser
from plat.studio.timeline import Timeline

__all__ = ["TEMPLATES", "Step", "template"]

_HELD = ("left foot", "right foot", "pelvis")


@dataclass(frozen=True)
class Step:
    """Keyframe of a template: the pose that is selected, changed.

    Args:
        name: of the keyframe.
        interval: seconds from the pose before.
        hold: seconds that it is held.
        moved: handles that are moved one after the other, and how far forward, left and up in the robot's heading (m).
            Feet and pelvis are held meanwhile.
        bent: joints that then are at other angles (rad).
    """

    name: str
    interval: float
    hold: float = 0.0
    moved: tuple[tuple[str, tuple[float, float, float]], ...] = ()
    bent: Mapping[str, float] = field(default_factory=dict)


def template(name: str, timeline: Timeline, poser: Poser) -> Timeline:
    """Return a timeline with a template's keyframes after the selected pose, the first of them selected.

    Args:
        name: one of :data:`TEMPLATES`.
        timeline: is continued.
        poser: of the robot.

    Raises:
        StudioError: for another name.

    >>> from plat.robots import G1
    >>> template("squat", Timeline.empty(G1), Poser(G1)).labels
    ('start', '1 down', '2 up')
    """
    if name not in TEMPLATES:
        raise StudioError(f"template {name!r}, expected one of {', '.join(TEMPLATES)}")
    first, base = timeline.selected + 1, timeline.pose.qpos
    for step in TEMPLATES[name]:
        timeline = timeline.inserted(_changed(base, step, timeline, poser), step.interval, step.name, step.hold)
    return timeline.select(first)


def _changed(qpos: np.ndarray, step: Step, timeline: Timeline, poser: Poser) -> np.ndarray:
    for handle, by in step.moved:
        frames, shift = poser.frames(qpos), np.empty(3)
        mujoco.mju_rotVecQuat(shift, np.array(by), frames[WHOLE].quat)
        pos, quat = frames[handle]
        qpos = poser.dragged(qpos, handle, Frame(pos + shift, quat), {name: frames[name] for name in _HELD}, qpos)
    qpos = qpos.copy()
    for joint, angle in step.bent.items():
        qpos[7 + timeline.robot.joint_names.index(joint)] = angle
    return qpos


_RAISED = {"right_shoulder_pitch": -0.9, "right_shoulder_roll": -0.9, "right_elbow": -0.2}
_IN, _OUT = ({**_RAISED, "right_shoulder_yaw": yaw} for yaw in (-0.35, 0.35))
_ARMS = {f"{side}_shoulder_pitch": -0.9 for side in ("left", "right")}

TEMPLATES: dict[str, tuple[Step, ...]] = {
    "wave": (
        Step("arm up", 0.7, bent=_IN),
        Step("out 1", 0.4, bent=_OUT),
        Step("in 1", 0.4, bent=_IN),
        Step("out 2", 0.4, bent=_OUT),
        Step("in 2", 0.4, bent=_IN),
        Step("arm down", 0.7),
    ),
    # the pelvis goes back so that the weight stays over the feet
    "bow": (
        Step("bow", 0.8, hold=0.6, moved=(("pelvis", (-0.06, 0.0, -0.02)),), bent={"waist_pitch": 0.45}),
        Step("rise", 0.8),
    ),
    "squat": (
        Step("down", 0.8, hold=0.4, moved=(("pelvis", (-0.05, 0.0, -0.18)),), bent={"waist_pitch": 0.35, **_ARMS}),
        Step("up", 0.8),
    ),
    "side step": (
        Step("weight", 0.4, moved=(("pelvis", (0.0, -0.07, 0.0)),)),
        Step("lift", 0.3, moved=(("pelvis", (0.0, -0.07, 0.0)), ("left foot", (0.0, 0.1, 0.06)))),
        Step("apart", 0.4, moved=(("pelvis", (0.0, 0.1, 0.0)), ("left foot", (0.0, 0.2, 0.0)))),
        Step("together", 0.6, moved=((WHOLE, (0.0, 0.2, 0.0)),)),
    ),
    "reach": (
        Step("reach", 0.8, hold=0.5, moved=(("right hand", (0.25, 0.05, 0.35)),)),
        Step("back", 0.8),
    ),
}
"""Steps of each template."""
