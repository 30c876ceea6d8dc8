"""Templates: short motions to begin with, made of keyframes for the robot that is open."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from plat.errors import StudioError
from plat.keyframes import Keyframe
from plat.studio.poser import Frame, Poser
from plat.studio.timeline import Timeline

__all__ = ["TEMPLATES", "template"]

Pose = np.ndarray
_FEET = ("left foot", "right foot")


@dataclass(frozen=True)
class _Step:
    name: str
    pose: Pose
    interval: float
    hold: float = 0.0


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
    first = timeline.selected + 1
    joints = {joint: number for number, joint in enumerate(timeline.robot.joint_names)}
    maker = _Maker(timeline.pose, poser, joints)
    for step in TEMPLATES[name](maker):
        timeline = timeline.inserted(step.pose, step.interval, step.name, step.hold)
    return timeline.select(first)


class _Maker:
    """Maker of poses near a pose."""

    def __init__(self, pose: Keyframe, poser: Poser, joints: Mapping[str, int]):
        self.base = pose.qpos
        self._poser, self._joints = poser, joints
        self._frames = poser.frames(self.base)

    def bent(self, angles: Mapping[str, float], base: Pose | None = None) -> Pose:
        """Return the pose with some joints at other angles (rad)."""
        qpos = (self.base if base is None else base).copy()
        for joint, angle in angles.items():
            qpos[7 + self._joints[joint]] = angle
        return qpos

    def moved(
        self, handle: str, forward: float = 0.0, left: float = 0.0, up: float = 0.0, base: Pose | None = None
    ) -> Pose:
        """Return the pose with a handle moved in the robot's heading (m), the other feet and the rest held."""
        qpos = self.base if base is None else base
        frames = self._poser.frames(qpos)
        w, _, _, z = qpos[3:7] / np.linalg.norm(qpos[[3, 6]])
        ahead = np.array([w * w - z * z, 2 * w * z, 0.0])
        shift = forward * ahead + left * np.array([-ahead[1], ahead[0], 0.0]) + up * np.array([0.0, 0.0, 1.0])
        held = {name: frames[name] for name in (*_FEET, "pelvis") if name != handle}
        target = Frame(frames[handle].pos + shift, frames[handle].quat)
        return self._poser.dragged(qpos, handle, target, held, qpos)


def _wave(maker: _Maker) -> list[_Step]:
    raised = {"right_shoulder_pitch": -0.9, "right_shoulder_roll": -0.9, "right_elbow": -0.2}
    left = maker.bent({**raised, "right_shoulder_yaw": -0.35})
    right = maker.bent({**raised, "right_shoulder_yaw": 0.35})
    steps = [_Step("arm up", left, 0.7)]
    for number in range(2):
        steps += [_Step(f"out {number + 1}", right, 0.4), _Step(f"in {number + 1}", left, 0.4)]
    return [*steps, _Step("arm down", maker.base, 0.7)]


def _bow(maker: _Maker) -> list[_Step]:
    # the pelvis goes back so that the weight stays over the feet
    bent = maker.bent({"waist_pitch": 0.45}, maker.moved("pelvis", forward=-0.06, up=-0.02))
    return [_Step("bow", bent, 0.8, hold=0.6), _Step("rise", maker.base, 0.8)]


def _squat(maker: _Maker) -> list[_Step]:
    low = maker.bent({"waist_pitch": 0.35}, maker.moved("pelvis", forward=-0.05, up=-0.18))
    arms = {f"{side}_shoulder_pitch": -0.9 for side in ("left", "right")}
    return [_Step("down", maker.bent(arms, low), 0.8, hold=0.4), _Step("up", maker.base, 0.8)]


def _side_step(maker: _Maker) -> list[_Step]:
    def shifted(pose: Pose, left: float) -> Pose:
        w, _, _, z = pose[3:7] / np.linalg.norm(pose[[3, 6]])
        return pose + np.concatenate((left * np.array([-2 * w * z, w * w - z * z]), np.zeros(len(pose) - 2)))

    weight = maker.moved("pelvis", left=-0.07)
    lifted = maker.moved("left foot", left=0.1, up=0.06, base=weight)
    spread = maker.moved("left foot", left=0.2, base=maker.moved("pelvis", left=0.1))
    return [
        _Step("weight", weight, 0.4),
        _Step("lift", lifted, 0.3),
        _Step("apart", spread, 0.4),
        _Step("together", shifted(maker.base, 0.2), 0.6),
    ]


def _reach(maker: _Maker) -> list[_Step]:
    return [
        _Step("reach", maker.moved("right hand", forward=0.25, left=0.05, up=0.35), 0.8, hold=0.5),
        _Step("back", maker.base, 0.8),
    ]


TEMPLATES: dict[str, Callable[[_Maker], list[_Step]]] = {
    "wave": _wave,
    "bow": _bow,
    "squat": _squat,
    "side step": _side_step,
    "reach": _reach,
}
"""Templates by name."""
