"""Pins: which parts of a pose a keyframe commands, by the handles that a person sees."""

from __future__ import annotations

from plat.keyframes import Keyframe, Parts
from plat.motions.retargeting.geometry import TRACKED
from plat.robots.robot import Robot
from plat.studio.poser import WHOLE

__all__ = ["PRESETS", "faint_bodies", "pin_bodies", "pinned", "preset", "toggled"]

_ROOT = ("horizontal", "height", "orientation")
_BODIES = {
    "chest": TRACKED["torso"],
    **{
        f"{side} {name}": TRACKED[f"{side}_{role}"]
        for side in ("left", "right")
        for name, role in (("hand", "wrist"), ("elbow", "elbow"), ("knee", "knee"), ("foot", "ankle"))
    },
}
_HANDS = ("left hand", "right hand")
PRESETS: dict[str, tuple[str, ...]] = {
    "whole pose": (),
    "hands": _HANDS,
    "hands and chest": (*_HANDS, "chest"),
    "hands and feet": (*_HANDS, "left foot", "right foot"),
    "place": ("pelvis",),
}
"""Pinned handles of each choice; none for the whole pose."""


def preset(name: str, robot: Robot) -> Parts | None:
    """Return what a choice of :data:`PRESETS` commands; None for the whole pose.

    >>> from plat.robots import G1
    >>> preset("hands", G1).names(G1)["bodies"]
    ['left_wrist_yaw_link', 'right_wrist_yaw_link']
    """
    return _parts(frozenset(PRESETS[name]), robot)


def pin_bodies() -> dict[str, str]:
    """Return the body that each handle's pin commands; that of the pelvis commands the root instead.

    >>> pin_bodies()["left foot"]
    'left_ankle_roll_link'
    """
    return dict(_BODIES)


def pinned(keyframe: Keyframe, robot: Robot) -> frozenset[str]:
    """Return the handles that a keyframe commands; all of them for a whole pose."""
    if keyframe.whole or keyframe.commands is None:
        return frozenset((*_BODIES, "pelvis", "head"))
    names = keyframe.commands.names(robot)
    handles = {handle for handle, body in _BODIES.items() if body in names["bodies"]}
    return frozenset(handles | ({"pelvis"} if names["root"] else set()))


def toggled(keyframe: Keyframe, handle: str, robot: Robot) -> Parts | None:
    """Return what is commanded after a handle was pinned, or its pin taken out.

    Of a whole pose the pinned handle is all that remains. Without any pin the whole pose is commanded.

    Args:
        keyframe: of which the handle is.
        handle: one of :data:`plat.studio.poser.HANDLES`; that of the head counts as the chest's, and
            that of the whole robot as the pelvis's.
        robot: the robot.
    """
    handle = {"head": "chest", WHOLE: "pelvis"}.get(handle, handle)
    before = frozenset() if keyframe.whole else pinned(keyframe, robot)
    return _parts(before ^ {handle}, robot)


def faint_bodies(keyframe: Keyframe, robot: Robot) -> frozenset[str]:
    """Return the bodies of the robot that a keyframe leaves to the policy; none for a whole pose."""
    if keyframe.whole or keyframe.commands is None:
        return frozenset()
    model, names = robot.shared_model, keyframe.commands.names(robot)
    commanded = {*names["bodies"], *([robot.keypoints[0]] if names["root"] else [])}
    for joint, number in zip(robot.joint_names, range(1, model.njnt), strict=True):
        if joint in names["joints"]:
            commanded.add(model.body(int(model.jnt_bodyid[number])).name)
    return frozenset(model.body(number).name for number in range(1, model.nbody)) - commanded


def _parts(handles: frozenset[str], robot: Robot) -> Parts | None:
    if not handles:
        return None
    bodies = [_BODIES[handle] for handle in handles if handle in _BODIES]
    return Parts.only(robot, bodies=bodies, root=_ROOT if "pelvis" in handles else ())
