"""Pins: which parts of a pose a keyframe commands, by the handles that a person sees."""

from __future__ import annotations

from plat.keyframes import Keyframe, Parts
from plat.motions.retargeting.geometry import TRACKED
from plat.robots.robot import Robot
from plat.robots.symmetry import joint_symmetry, keypoint_symmetry

__all__ = ["PRESETS", "chosen", "faint_bodies", "mirrored_parts", "pin_bodies", "pinned", "preset", "toggled"]

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
    handles = PRESETS[name]
    if not handles:
        return None
    bodies = [_BODIES[handle] for handle in handles if handle in _BODIES]
    return Parts.only(robot, bodies=bodies, root=_ROOT if "pelvis" in handles else ())


def chosen(keyframe: Keyframe, robot: Robot) -> str | None:
    """Return the choice of :data:`PRESETS` that commands just what a keyframe does; None where none does.

    >>> from plat.robots import G1
    >>> from plat.keyframes import only
    >>> chosen(only(G1, 1.0, joints={"left_elbow": 1.0}), G1) is None
    True
    """
    commands = None if keyframe.whole else keyframe.commands
    return next((name for name in PRESETS if preset(name, robot) == commands), None)


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
    """Return what is commanded after a handle was pinned, or its pin taken out; all else stays.

    Of a whole pose the pinned handle is all that remains. Where nothing is left the whole pose is commanded.

    Args:
        keyframe: of which the handle is.
        handle: one of :data:`plat.studio.poser.HANDLES`; that of the head counts as the chest's, and
            that of the whole robot as the pelvis's.
        robot: the robot.
    """
    body = _BODIES.get({"head": "chest"}.get(handle, handle))
    parts = {} if keyframe.whole or keyframe.commands is None else keyframe.commands.names(robot)
    if body is None:
        parts["root"] = [] if parts.get("root") else [*_ROOT]
    else:
        parts["bodies"] = sorted({*parts.get("bodies", ())} ^ {body})
    return Parts.only(robot, **parts) if any(parts.values()) else None


def mirrored_parts(commands: Parts, robot: Robot) -> Parts:
    """Return what a mirrored keyframe commands: joints and bodies of the other side.

    Raises:
        RobotError: for a robot without such symmetry.

    >>> from plat.robots import G1
    >>> mirrored_parts(Parts.only(G1, joints=["left_elbow"]), G1).names(G1)["joints"]
    ['right_elbow']
    """
    partner, _ = joint_symmetry(robot)
    joints = tuple(commands.joints[joint] for joint in partner)
    return Parts(joints, tuple(commands.bodies[body] for body in keypoint_symmetry(robot)), commands.root)


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
