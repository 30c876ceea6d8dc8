"""Feasibility of keyframes: what a robot cannot do, measured before it tries.

The measures are necessary conditions on poses and times, without dynamics in between. A keyframe that passes all of
them may still be out of reach. One that fails is out of reach, or can only be approached, for a robot that comes to
rest in every keyframe. A robot that moves through them needs less speed, and no such acceleration.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from plat.bounds import Bounded, Range, check_robot, check_value
from plat.errors import KeyframeError
from plat.keyframes import Keyframe, KeyframeSequence
from plat.keyframes.keyframe import check_keyframe
from plat.keyframes.sequence import check_sequence
from plat.motions.checks.collision import link_contacts
from plat.motions.checks.feet import Soles
from plat.robots import Robot
from plat.spec.parts import Parts
from plat.words import beyond

__all__ = ["WAY_PARTS", "Concern", "Feasibility", "FeasibilityLimits", "repeats", "support_margin"]

WAY_PARTS = 12
"""Equal parts of the straight way between two poses; links are looked at where two of them meet."""


Limit: TypeAlias = Annotated[float, Range(0, infinite=True)]
"""Largest value that is not doubted; infinity doubts none."""


@dataclass(frozen=True)
class FeasibilityLimits(Bounded):
    """Values beyond which a keyframe is doubted.

    Speeds are the least peak from rest to rest, see :class:`Feasibility`.
    """

    joint_speed: Limit = 20.0
    """rad/s; limit of the G1's knee in Unitree's description"""
    root_speed: Limit = 3.5
    """m/s, horizontal; fast running of recorded people, retargeted to the G1, peaks at 3.7 to 4.3"""
    vertical_speed: Limit = 5.5
    """m/s of the root, up or down; jumps of the validation motions, retargeted to the G1, need up to 5.4"""
    clearance: Limit = 0.6
    """m; height of the whole robot above the floor, held or not; these jumps, and ASAP's, rise to 0.5"""
    root_acceleration: Limit = 9.81
    """m/s^2, horizontal; what a foot with a friction coefficient of 1 can push"""
    body_speed: Limit = 8.0
    """m/s of a body that a partial keyframe commands; faster than punches and kicks of the G1"""
    turn_speed: Limit = 6.0
    """rad/s of the root about any axis"""
    support_margin: float = 0.0
    """m; least distance of the center of mass inside the support polygon, for a pose that is held"""
    self_penetration: Limit = 0.02
    """m"""
    way_penetration: Limit = 0.02
    """m; links in each other on the straight way from the pose before, where neither pose has any"""
    floor_penetration: Limit = 0.03
    """m"""
    floating: Limit = 0.05
    """m; height of the lower sole above the floor, for a pose that is held"""


@dataclass(frozen=True)
class Concern:
    """One reason why a keyframe is doubted.

    Args:
        measure: the field of :class:`FeasibilityLimits` that is exceeded.
        subject: what it is about: a joint's name, names of two links, ``"root"``, ``"center of mass"``, ``"feet"``,
            ``"floor"``.
        value: measured, in the limit's unit.
        limit: its limit.
        words: a sentence for a person.
    """

    measure: str
    subject: str
    value: float
    limit: float
    words: str

    def __str__(self) -> str:
        return self.words


class Feasibility:
    """Checks single keyframes and whole sequences.

    Speeds are the least peak that a move from rest to rest can have: twice the mean, by constant acceleration and
    constant deceleration. The acceleration is that of the same move, ``4 d / T**2``.

    Links are checked in the keyframe, and on the way there on which all joints move evenly. For a partial keyframe,
    these are the links between the root and the commanded bodies, as drawn, and those that commanded joints lead to.
    The others can move out of the way. A commanded body whose own joint only turns it in place, such as a hand, is
    checked on the way alone.

    Args:
        robot: the robot.
        limits: what is doubted.

    Raises:
        RobotError: for what is no robot.
        ConfigError: for what are no limits.

    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> stand = standing(G1)
    >>> away = Keyframe(1.0, stand.root_pos + [2.5, 0, 0], stand.root_quat, stand.joint_pos)
    >>> [concern.measure for concern in Feasibility(G1)(stand, away)]
    ['root_speed', 'root_acceleration']
    >>> Feasibility(G1)(stand, stand.at(0.5), held=True)
    ()
    """

    def __init__(self, robot: Robot, limits: FeasibilityLimits | None = None):
        check_robot(robot)
        check_value("Feasibility: limits", limits, FeasibilityLimits | None)
        self._robot = robot
        self.limits = limits or FeasibilityLimits()
        self._soles = Soles(robot)
        self._model = robot.shared_model
        self._data = mujoco.MjData(self._model)
        self._keypoints = [self._model.body(name).id for name in robot.keypoints]

    def __call__(self, before: Keyframe, after: Keyframe, *, held: bool = False) -> tuple[Concern, ...]:
        """Return what is doubtful about a keyframe; nothing where all is well.

        Args:
            before: the pose that the robot comes from, with its time.
            after: the keyframe; of a partial one only what it commands is measured.
            held: whether the robot stays in it, and so must balance there.

        Raises:
            KeyframeError: naming the field, for a pose that no keyframe file may hold (:meth:`Keyframe.checked`), or a
                keyframe that is not after the pose before it.
        """
        before, after = (self._checked(name, pose) for name, pose in (("before", before), ("after", after)))
        if not after.time > before.time:
            raise KeyframeError(f"after: time is {after.time} s, expected later than {before.time} s")
        others = self._pose(after, held) if after.whole else self._bodies(before, after)
        return (*self._move(before, after), *self._links(before, after), *others)

    def sequence(self, keyframes: KeyframeSequence) -> tuple[tuple[Concern, ...], ...]:
        """Return the concerns about each keyframe of a sequence.

        Held are the last one, and those that the next one repeats.

        Raises:
            KeyframeError: for a sequence of another robot.
        """
        check_sequence("keyframes", keyframes)
        following = (*keyframes.keyframes[1:], None)
        triples = zip(keyframes.arrived[:-1], keyframes.keyframes, following, strict=True)
        return tuple(self(before, now, held=after is None or repeats(now, after)) for before, now, after in triples)

    def _checked(self, name: str, pose: Keyframe) -> Keyframe:
        check_keyframe(name, pose)
        try:
            return pose.checked(self._robot)
        except KeyframeError as error:
            raise KeyframeError(f"{name}: {error}") from None

    def _move(self, before: Keyframe, after: Keyframe) -> list[Concern]:
        limits, seconds = self.limits, after.time - before.time
        commands = after.commands or Parts.all(self._robot)
        speeds = 2 * np.abs(after.joint_pos - before.joint_pos) / seconds * np.array(commands.joints)
        concerns = [
            Concern(
                "joint_speed",
                name,
                float(speed),
                limits.joint_speed,
                f"{name} would need {_needed(speed, limits.joint_speed, 'rad/s')}",
            )
            for name, speed in sorted(zip(self._robot.joint_names, speeds, strict=True), key=lambda pair: -pair[1])
            if speed > limits.joint_speed
        ]
        distance = float(np.linalg.norm(after.root_pos[:2] - before.root_pos[:2])) * commands.root[0]
        speed, acceleration = 2 * distance / seconds, 4 * distance / seconds**2
        rise = float(after.root_pos[2] - before.root_pos[2]) * commands.root[1]
        vertical = 2 * abs(rise) / seconds
        turn = 2 * _angle(before.root_quat, after.root_quat) / seconds * commands.root[2]
        for measure, value, limit, words in (
            ("root_speed", speed, limits.root_speed, f"{distance:.1f} m in {seconds:.2f} s takes {speed:.1f} m/s"),
            (
                "root_acceleration",
                acceleration,
                limits.root_acceleration,
                f"{distance:.1f} m in {seconds:.2f} s takes {acceleration:.0f} m/s^2, more than feet can push",
            ),
            (
                "vertical_speed",
                vertical,
                limits.vertical_speed,
                f"{abs(rise):.1f} m {'up' if rise > 0 else 'down'} in {seconds:.2f} s takes {vertical:.1f} m/s",
            ),
            (
                "turn_speed",
                turn,
                limits.turn_speed,
                f"the turn would need {_needed(turn, limits.turn_speed, 'rad/s')}",
            ),
        ):
            if value > limit:
                concerns.append(Concern(measure, "root", value, limit, words))
        return concerns

    def _bodies(self, before: Keyframe, after: Keyframe) -> list[Concern]:
        """Concerns about bodies and height that a partial keyframe commands; the rest is the policy's to choose."""
        assert after.commands is not None
        places = [self._places(pose) for pose in (before, after)]
        speeds = 2 * np.linalg.norm(places[1] - places[0], axis=-1) / (after.time - before.time)
        limits, concerns = self.limits, []
        for name, commanded, speed, height in zip(
            self._robot.keypoints, after.commands.bodies, speeds, places[1][:, 2], strict=True
        ):
            if commanded and speed > limits.body_speed:
                words = f"{name} would need {_needed(speed, limits.body_speed, 'm/s')}"
                concerns.append(Concern("body_speed", name, float(speed), limits.body_speed, words))
            if commanded and -height > limits.floor_penetration:
                concerns.append(self._sunk(name, -float(height)))
        sunk = -float(after.root_pos[2]) * after.commands.root[1]
        if sunk > limits.floor_penetration:
            concerns.append(self._sunk("root", sunk))
        above = float(after.root_pos[2] - self._robot.root_height) * after.commands.root[1]
        if above > limits.clearance:
            words = f"root is {100 * above:.0f} cm above where it is in standing, higher than a jump"
            concerns.append(Concern("clearance", "root", above, limits.clearance, words))
        return concerns

    def _sunk(self, name: str, depth: float) -> Concern:
        words = f"{name} is {100 * depth:.0f} cm inside the floor"
        return Concern("floor_penetration", name, depth, self.limits.floor_penetration, words)

    def _places(self, pose: Keyframe) -> NDArray[np.floating]:
        """Positions of the keypoints ``[K, 3]`` (m, world)."""
        self._data.qpos[:] = pose.qpos
        mujoco.mj_kinematics(self._model, self._data)
        return self._data.xpos[self._keypoints].copy()

    def _links(self, before: Keyframe, after: Keyframe) -> list[Concern]:
        """Concern about links that are in each other in a keyframe, or else on the straight way there."""
        limits = self.limits
        depth, one, other = self._deepest(after.joint_pos, self._placed_links(after.commands, as_drawn=False))
        if depth > limits.self_penetration:
            words = f"{one} and {other} are {100 * depth:.0f} cm inside each other"
            return [Concern("self_penetration", f"{one}, {other}", depth, limits.self_penetration, words)]
        # hands that only have to turn at the end of their way are in each other's way all the same before
        among = self._placed_links(after.commands, as_drawn=True)
        if any(self._deepest(pose.joint_pos, among)[0] > limits.self_penetration for pose in (before, after)):
            return []  # this was said of the keyframe before, or is how one was drawn
        shares = np.arange(1, WAY_PARTS) / WAY_PARTS
        way = before.joint_pos + shares[:, None] * (after.joint_pos - before.joint_pos)
        depth, one, other = max((self._deepest(joint_pos, among) for joint_pos in way), key=lambda found: found[0])
        if depth <= limits.way_penetration:
            return []
        words = f"{one} and {other} would get {100 * depth:.0f} cm into each other on the straight way there"
        return [Concern("way_penetration", f"{one}, {other}", depth, limits.way_penetration, words)]

    def _placed_links(self, commands: Parts | None, as_drawn: bool) -> NDArray[np.bool_]:
        """Which links are where they were drawn, as the root is ``[bodies]``: as all of a whole keyframe.

        Those between the root and a commanded body, and those that commanded joints alone lead to.

        Args:
            commands: None for a whole keyframe.
            as_drawn: with commanded bodies that their own joint turns about their place: a hand is free to do so.
        """
        model = self._model
        placed = np.ones(model.nbody, dtype=bool)
        if commands is None:
            return placed
        free = {int(body) for body, joint in zip(model.jnt_bodyid[1:], commands.joints, strict=True) if not joint}
        for body in range(2, model.nbody):
            placed[body] = placed[model.body_parentid[body]] and body not in free
        for name, commanded in zip(self._robot.keypoints, commands.bodies, strict=True):
            body = model.body(name).id if commanded else 0
            if not as_drawn and body in free and not model.jnt_pos[model.body_jntadr[body]].any():
                body = int(model.body_parentid[body])
            while body:
                placed[body] = True
                body = int(model.body_parentid[body])
        return placed

    def _deepest(self, joint_pos: NDArray[np.floating], among: NDArray[np.bool_]) -> tuple[float, str, str]:
        """How deep two of some links are in each other at most (m), and their names; 0 where none touch."""
        qpos = np.concatenate((self._robot.default_qpos[:7], joint_pos))
        bodies, depths = link_contacts(self._model, qpos, self._data)
        depths = np.where(among[bodies].all(-1), depths, 0.0)
        if depths.max(initial=0.0) <= 0:
            return 0.0, "", ""
        deepest = int(depths.argmax())
        one, other = (self._model.body(body).name for body in bodies[deepest])
        return float(depths[deepest]), one, other

    def _pose(self, pose: Keyframe, held: bool) -> list[Concern]:
        limits, concerns = self.limits, []
        self._data.qpos[:] = pose.qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        sunk = -self._floor_distance()
        if sunk > limits.floor_penetration:
            words = f"the robot is {100 * sunk:.0f} cm inside the floor"
            concerns.append(Concern("floor_penetration", "floor", sunk, limits.floor_penetration, words))
        points = self._soles.points(torch.from_numpy(pose.qpos)[None])[0].reshape(-1, 3).numpy()
        height = float(points[:, 2].min())
        if not held:
            # of a robot that lies or stands on its hands, other bodies are lowest
            lowest = min(height, float(self._data.xpos[self._keypoints, 2].min()))
            if lowest > limits.clearance:
                words = f"the robot is {100 * lowest:.0f} cm above the floor, higher than a jump"
                concerns.append(Concern("clearance", "floor", lowest, limits.clearance, words))
            return concerns
        if height > limits.floating:
            words = f"the feet are {100 * height:.0f} cm above the floor"
            return [*concerns, Concern("floating", "feet", height, limits.floating, words)]
        mujoco.mj_comPos(self._model, self._data)
        on_floor = points[points[:, 2] < height + limits.floating, :2]
        margin = support_margin(self._data.subtree_com[1, :2], on_floor)
        if margin < limits.support_margin:
            words = f"the center of mass is {-100 * margin:.0f} cm outside the feet: it would tip over"
            concerns.append(Concern("support_margin", "center of mass", margin, limits.support_margin, words))
        return concerns

    def _floor_distance(self) -> float:
        """Least distance of the robot's geoms from the floor (m), negative inside it; in the pose of ``_data``."""
        bodies = self._model.geom_bodyid[self._data.contact.geom]
        return float(self._data.contact.dist[(bodies == 0).any(-1)].min(initial=0.0))


def support_margin(point: NDArray[np.floating], support: NDArray[np.floating] | Sequence[Sequence[float]]) -> float:
    """Return how far a point is inside the convex hull of others (m), negative outside it.

    It is the least value of the hull's support function about the point, over 720 directions.

    Args:
        point: ``[2]`` (m).
        support: contact points ``[P, 2]`` (m).

    >>> square = [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    >>> round(support_margin(np.zeros(2), square), 3), round(support_margin(np.array([1.5, 0]), square), 3)
    (1.0, -0.5)
    """
    angles = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    directions = np.stack((np.cos(angles), np.sin(angles)))
    return float(((np.asarray(support) - point) @ directions).max(0).min())


def repeats(one: Keyframe, other: Keyframe) -> bool:
    """Return whether two keyframes command the same pose, which the robot then holds from one to the other.

    >>> from plat.keyframes import standing
    >>> from plat.robots import G1
    >>> repeats(standing(G1).at(1.0), standing(G1).at(2.0))
    True
    """
    same = one.commands == other.commands or (one.whole and other.whole)
    return same and np.allclose(one.qpos, other.qpos, atol=1e-6)


def _needed(speed: float, limit: float, unit: str) -> str:
    """Return a speed with one decimal, or more where it would read as the limit that it is beyond, and the limit."""
    return f"{beyond(speed, limit, digits=1).removesuffix('.0')} {unit}, expected at most {limit:g}"


def _angle(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Angle between two orientations (rad)."""
    return float(2 * np.arccos(min(abs(float(a @ b)), 1.0)))
