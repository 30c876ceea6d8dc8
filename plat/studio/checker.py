"""Checker of poses while they are made: what the robot cannot do, in words and for the picture."""

from dataclasses import dataclass

import mujoco
import numpy as np
import torch

from plat.control import Feasibility
from plat.control.feasibility import repeats, support_margin
from plat.keyframes import Keyframe, Parts
from plat.motions.checks.feet import Soles
from plat.robots.robot import Robot
from plat.studio.timeline import Timeline

__all__ = ["Checker", "Stance", "Verdict", "convex_hull"]

_ON_FLOOR = 0.015
"""Height of a point of a sole that still counts as on the floor (m)."""


@dataclass(frozen=True)
class Verdict:
    """What is to be said about one keyframe.

    Args:
        words: reasons to doubt it, the gravest first; empty where there are none.
        joint: the joint, of those that are commanded, that has to be fastest on the way; empty where none moves.
        speed: its least peak speed (rad/s).
        share: that speed as a share of what a joint can do.
    """

    words: tuple[str, ...]
    joint: str
    speed: float
    share: float


@dataclass(frozen=True)
class Stance:
    """How a robot would stand in a pose.

    Args:
        center: center of mass ``[3]`` (m, world).
        support: corners of the support polygon ``[P, 2]`` (m, world), counterclockwise; empty in the air.
        margin: how far the center of mass is inside it (m), negative outside; None in the air.
        feet: whether the left and the right foot are on the floor.
        inside: bodies whose shapes are inside each other.
        sunk: how deep the robot is in the floor (m); 0 where that is not to be doubted.
    """

    center: np.ndarray
    support: np.ndarray
    margin: float | None
    feet: tuple[bool, bool]
    inside: frozenset[str]
    sunk: float = 0.0

    @property
    def words(self) -> str:
        """Return the stance in a line."""
        inside = f", inside each other: {', '.join(sorted(self.inside))}" if self.inside else ""
        if self.sunk:
            return f"{100 * self.sunk:.0f} cm inside the floor{inside}"
        if self.margin is None:
            return f"no foot on the floor{inside}"
        standing = {(True, True): "both feet", (True, False): "left foot", (False, True): "right foot"}[self.feet]
        if self.margin >= 0:
            return f"on {standing}, balanced with {100 * self.margin:.0f} cm to spare{inside}"
        return f"on {standing}, {-100 * self.margin:.0f} cm out of balance{inside}"


class Checker:
    """Checker of keyframes and poses; verdicts are kept until their keyframes change.

    Args:
        robot: the robot.

    >>> from plat.robots import G1
    >>> far = G1.default_qpos + 3 * np.eye(36)[0]
    >>> Checker(G1).timeline(Timeline.empty(G1).inserted(far, 1.0))[0].words[0]
    '3.0 m in 1.00 s takes 6.0 m/s'
    """

    def __init__(self, robot: Robot):
        self._robot = robot
        self._feasibility = Feasibility(robot)
        self._soles = Soles(robot)
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        self._known: dict[tuple[bytes, bytes, Parts | None, float, bool], Verdict] = {}
        self._start: tuple[bytes, Verdict] | None = None

    def timeline(self, timeline: Timeline) -> tuple[Verdict, ...]:
        """Return the verdict on each keyframe; those that are held or repeated, and the last one, must be balanced."""
        known, verdicts, following = {}, [], (*timeline.keyframes[1:], None)
        for (before, frame), hold, after in zip(timeline.ways, timeline.holds, following, strict=False):
            held = hold > 0 or after is None or repeats(frame, after)
            # not of the keyframe itself, which an edit of another one makes anew
            key = before.qpos.tobytes(), frame.qpos.tobytes(), frame.commands, round(frame.time - before.time, 6), held
            verdict = self._known.get(key) or self._verdict(before, frame, held)
            known[key] = verdict
            verdicts.append(verdict)
        self._known = known
        return tuple(verdicts)

    def start(self, start: Keyframe) -> Verdict:
        """Return the verdict on a start: a robot at rest must be able to stay in it."""
        key = start.qpos.tobytes()
        if self._start is None or self._start[0] != key:
            self._start = key, self._verdict(start.at(0.0), start.at(1.0), held=True)
        return self._start[1]

    def stance(self, qpos: np.ndarray) -> Stance:
        """Return how the robot would stand in a pose ``[7 + J]``."""
        model, data = self._model, self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        bodies = model.geom_bodyid[data.contact.geom].reshape(-1, 2)
        limits, of_robot = self._feasibility.limits, (bodies > 0).all(-1)
        deep = of_robot & (data.contact.dist < -limits.self_penetration)
        sunk = -float(data.contact.dist[~of_robot].min(initial=0.0))
        inside = frozenset(model.body(int(body)).name for body in np.unique(bodies[deep]))
        points = self._soles.points(torch.from_numpy(np.asarray(qpos, dtype=np.float64))[None])[0].numpy()
        down = points[..., 2] < _ON_FLOOR
        support = convex_hull(points[down][:, :2])
        center = data.subtree_com[1].copy()
        margin = support_margin(center[:2], support) if len(support) else None
        feet = bool(down[0].any()), bool(down[1].any())
        return Stance(center, support, margin, feet, inside, sunk if sunk > limits.floor_penetration else 0.0)

    def _verdict(self, before: Keyframe, after: Keyframe, held: bool) -> Verdict:
        concerns = self._feasibility(before, after, held=held)
        speeds = 2 * np.abs(after.joint_pos - before.joint_pos) / (after.time - before.time)
        if after.commands is not None:
            speeds *= after.commands.joints
        worst = int(speeds.argmax())
        speed = float(speeds[worst])
        share = speed / self._feasibility.limits.joint_speed
        return Verdict(tuple(map(str, concerns)), self._robot.joint_names[worst] if speed else "", speed, share)


def convex_hull(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points ``[P, 2]``, counterclockwise, by Andrew's monotone chain.

    >>> convex_hull(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5]])).tolist()
    [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    """
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.array(ordered).reshape(-1, 2)

    def chain(sequence: list[tuple[float, float]]) -> list[tuple[float, float]]:
        corners: list[tuple[float, float]] = []
        for point in sequence:
            while len(corners) >= 2 and _turn(corners[-2], corners[-1], point) <= 0:
                corners.pop()
            corners.append(point)
        return corners[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Return twice the area of a triangle, positive counterclockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
