"""Keyframe: a pose, whole or in parts, and its arrival time."""

from __future__ import annotations  # the types of motions and robots bring torch with them

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from plat.bounds import check_robot, is_finite
from plat.errors import KeyframeError
from plat.files import readable
from plat.json_file import short
from plat.rotations_np import UNIT_TOLERANCE, quat_slerp
from plat.spec.parts import Parts

if TYPE_CHECKING:
    from plat.motions.clip import MotionClip
    from plat.robots.robot import Robot

__all__ = [
    "HIGHEST",
    "Keyframe",
    "RobotJoints",
    "check_keyframe",
    "check_keyframes",
    "check_time",
    "check_whole",
    "interpolate",
    "standing",
]

HIGHEST = 5.0
"""No robot's root is this far above or below the floor (m)."""

# No root is this far from the origin along x or y (m): it is meant in millimeters, or in coordinates of a map.
_FARTHEST = 1000.0
# Latest time of a keyframe (s): later ones would be split into millions of commands.
_LONGEST = 86_400.0
# Tolerance for a rounded angle at its limit (rad).
_RANGE_TOLERANCE = 1e-3


class RobotJoints(Protocol):
    """Protocol of the robot data that keyframes need; :class:`plat.robots.Robot` has it."""

    @property
    def name(self) -> str:
        """Return the robot's name in keyframe files."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the J joints in the order of every joint vector."""

    @property
    def joint_range(self) -> Any:
        """Return lower and upper limits ``[J, 2]`` (rad), an array or a tensor."""

    @property
    def keypoints(self) -> tuple[str, ...]:
        """Return the names of the K bodies whose positions a partial keyframe may command."""

    @property
    def default_qpos(self) -> np.ndarray:
        """Return the default pose at the origin ``[7 + J]``: root position, quaternion ``wxyz``, joint angles."""


@dataclass(frozen=True, eq=False)
class Keyframe:
    """Pose with an arrival time. It commands the whole pose, or the parts that ``commands`` names.

    The values that a partial keyframe does not command are shown to nobody but people: they are how it is drawn.

    Args:
        time: seconds since the start of the sequence.
        root_pos: position of the root ``[3]`` (m, world).
        root_quat: orientation of the root ``[4]``, ``wxyz``, root to world.
        joint_pos: joint angles ``[J]`` (rad, the robot's joint order).
        name: label in tables and messages.
        commands: parts that are commanded; None for the whole pose. See :func:`plat.keyframes.only` for a short way.

    >>> from plat.robots import G1
    >>> Keyframe.from_qpos(0.5, G1.default_qpos, name="stand").root_pos
    array([0.  , 0.  , 0.76])
    """

    time: float
    root_pos: np.ndarray
    root_quat: np.ndarray
    joint_pos: np.ndarray
    name: str | None = None
    commands: Parts | None = None

    @classmethod
    def from_qpos(cls, time: float, qpos: np.ndarray, name: str | None = None) -> Keyframe:
        """Return the keyframe of a MuJoCo position vector ``[7 + J]``; its values are copied.

        Raises:
            KeyframeError: for what is no vector of numbers.
        """
        try:
            values = np.array(qpos, dtype=np.float64)
        except (OverflowError, TypeError, ValueError):
            values = np.empty(())
        if values.ndim != 1:
            raise KeyframeError(f"qpos is {short(qpos)}, expected numbers: root position, quaternion, joint angles")
        return cls(time, values[:3], values[3:7], values[7:], name)

    @classmethod
    def from_motion(cls, motion: MotionClip, time: float, robot: Robot, name: str | None = None) -> Keyframe:
        """Return the pose of a motion clip at a time (s), in the clip's world frame, see :func:`interpolate`.

        Raises:
            MotionError: when the clip is broken.
            KeyframeError: for a time outside the clip.
        """
        if not hasattr(motion, "checked"):
            raise KeyframeError(
                f"motion is {short(motion)}, expected a MotionClip, as plat.motions.load_motions reads it"
            )
        clip = motion.checked(robot)
        # the small margin admits times that equal the clip's end up to rounding
        check_time(time, f"motion {clip.name!r}: time")
        if not 0 <= time <= clip.duration + 1e-6:
            raise KeyframeError(f"motion {clip.name!r}: no time {time:g} s, expected 0 to {clip.duration:g} s")
        row = min(int(time * clip.fps), len(clip.qpos) - 2)
        first, second = (cls.from_qpos(index / clip.fps, clip.qpos[index]) for index in (row, row + 1))
        return replace(interpolate(first, second, time), name=name)

    @property
    def qpos(self) -> np.ndarray:
        """Return the MuJoCo position vector ``[7 + J]``."""
        return np.concatenate((self.root_pos, self.root_quat, self.joint_pos))

    @property
    def whole(self) -> bool:
        """Return whether the whole pose is commanded."""
        return self.commands is None or self.commands.whole

    def at(self, time: float) -> Keyframe:
        """Return the same pose at another time."""
        return replace(self, time=time)

    def checked(self, robot: RobotJoints) -> Keyframe:
        """Return this keyframe in float64 with a quaternion of exactly unit length.

        Its time may be that of a robot's clock, which runs for weeks; a sequence's is at most a day.

        Raises:
            KeyframeError: naming the field, for a wrong shape, a value that is not finite, a root where none can be, a
                quaternion that is not of unit length, a joint angle outside the joint's range, commands of another
                robot, or a name that is no text.
        """
        check_robot(robot)
        check_time(self.time, longest=math.inf)
        root_pos = _vector("root_pos", self.root_pos, 3, "x, y, z")
        _check_place(root_pos)
        root_quat = _vector("root_quat", self.root_quat, 4, "w, x, y, z")
        joint_pos = _vector("joint_pos", self.joint_pos, len(robot.joint_names), "one angle a joint")
        length = float(np.linalg.norm(root_quat))
        if abs(length - 1) > UNIT_TOLERANCE:
            raise KeyframeError(f"root_quat has length {length:.4g}, expected 1")
        limits = np.asarray(robot.joint_range, dtype=np.float64)
        excess = np.maximum(limits[:, 0] - joint_pos, joint_pos - limits[:, 1])
        worst = int(excess.argmax())
        if excess[worst] > _RANGE_TOLERANCE:
            low, high = limits[worst]
            doubt = ": in degrees?" if np.abs(joint_pos).max() > 2 * np.pi else ""
            raise KeyframeError(
                f"joint_pos: {robot.joint_names[worst]!r} is {joint_pos[worst]:.4g} rad, "
                f"expected {low:.4g} to {high:.4g} (its range){doubt}"
            )
        if not isinstance(self.commands, Parts | None):
            raise KeyframeError(f"commands is {short(self.commands)}, expected plat.keyframes.Parts")
        if self.commands is not None:
            self.commands.check(robot)
        if not isinstance(self.name, str | None) or readable(self.name or "") != (self.name or ""):
            raise KeyframeError(f"name is {short(self.name)}, expected a text")
        return Keyframe(float(self.time), root_pos, root_quat / length, joint_pos, self.name, self.commands)


def check_keyframe(what: str, given: object) -> None:
    """Raise an error for what is no keyframe.

    Raises:
        KeyframeError: beginning with ``what``.
    """
    if not isinstance(given, Keyframe):
        raise KeyframeError(f"{what} is {short(given)}, expected a Keyframe")


def check_keyframes(what: str, given: object) -> tuple[Keyframe, ...]:
    """Return keyframes as a tuple.

    Raises:
        KeyframeError: beginning with ``what``, for what is no sequence of them.
    """
    if isinstance(given, Keyframe):
        raise KeyframeError(f"{what} is a single one, expected a tuple of them")
    if not isinstance(given, Iterable):
        raise KeyframeError(f"{what} is {short(given)}, expected a tuple of keyframes")
    keyframes = tuple(given)
    for keyframe in keyframes:
        if not isinstance(keyframe, Keyframe):
            raise KeyframeError(f"{what} hold {short(keyframe)}, expected each to be a Keyframe")
    return keyframes


def check_time(time: float, what: str = "time", longest: float = _LONGEST) -> None:
    """Raise an error for what is no time of a keyframe (s).

    Args:
        time: to be checked.
        what: begins the message.
        longest: time (s); a day, unless it is that of a robot's clock.

    Raises:
        KeyframeError: when it is not finite, or later.
    """
    if not is_finite(time):
        raise KeyframeError(f"{what} is {short(time)}, expected a finite number of seconds")
    if abs(time) > longest:
        raise KeyframeError(f"{what} is {time:g} s, expected at most a day ({_LONGEST:g} s): in milliseconds?")


def check_whole(keyframes: Sequence[Keyframe], where: str, form: str) -> None:
    """Raise an error for a keyframe that commands parts of its pose, where a form of file has whole poses only.

    Args:
        keyframes: that are to be written.
        where: the file that the user knows them from, with its kind.
        form: of the file that is written.

    Raises:
        KeyframeError: naming the file and the number of its keyframe.
    """
    for number, keyframe in enumerate(keyframes):
        if not keyframe.whole:
            called = f" ({keyframe.name!r})" if keyframe.name else ""
            told = f"keyframe {number}{called} commands parts of a pose"
            raise KeyframeError(f"{where}: {told}, expected a whole one: {form} have no others")


def standing(robot: RobotJoints) -> Keyframe:
    """Return the robot's default pose at the origin, facing along x, at time 0."""
    check_robot(robot)
    return Keyframe.from_qpos(0.0, robot.default_qpos)


def interpolate(before: Keyframe, after: Keyframe, time: float) -> Keyframe:
    """Return the pose between two keyframes. The twin of ``plat.motions.resample``, which interpolates whole clips.

    Root position and joint angles are linear in time; the orientation goes along the shorter arc.

    Contacts are not considered: between two strides of a walk the feet slide.

    Args:
        before, after: keyframes of different times.
        time: seconds, from ``before.time`` to ``after.time``.

    Raises:
        KeyframeError: for times that are not finite, keyframes of one time, and poses of different sizes.

    >>> from plat.robots import G1
    >>> low = standing(G1)
    >>> high = Keyframe(1.0, low.root_pos + [0, 0, 0.1], low.root_quat, low.joint_pos)
    >>> interpolate(low, high, 0.25).root_pos
    array([0.   , 0.   , 0.785])
    """
    check_keyframe("before", before)
    check_keyframe("after", after)
    if not all(map(is_finite, (time, before.time, after.time))) or before.time == after.time:
        between = f"between {short(before.time)} and {short(after.time)} s"
        raise KeyframeError(f"time is {short(time)} s {between}, expected different times")
    time, begin, end = float(time), float(before.time), float(after.time)  # they may be arrays without axes
    weight = (time - begin) / (end - begin)
    joints = np.size(before.joint_pos)
    (first_pos, first_quat, first_joints), (last_pos, last_quat, last_joints) = (
        (
            _vector("root_pos", pose.root_pos, 3, "x, y, z"),
            _vector("root_quat", pose.root_quat, 4, "w, x, y, z"),
            _vector("joint_pos", pose.joint_pos, joints, "one angle a joint"),
        )
        for pose in (before, after)
    )
    return Keyframe(
        time,
        first_pos + weight * (last_pos - first_pos),
        quat_slerp(first_quat, last_quat, weight),
        first_joints + weight * (last_joints - first_joints),
    )


def _check_place(root_pos: np.ndarray) -> None:
    """Raise an error for a root that is where no robot in meters can be."""
    if abs(root_pos[2]) > HIGHEST:
        raise KeyframeError(
            f"root_pos puts the root at a height of {root_pos[2]:g} m, expected meters, at most {HIGHEST:g}; "
            "is it in centimeters or millimeters?"
        )
    if (farthest := np.abs(root_pos[:2]).max()) > _FARTHEST:
        raise KeyframeError(
            f"root_pos puts the root {farthest:g} m away from the origin, expected meters, at most {_FARTHEST:g}"
        )


def _vector(field: str, value: np.ndarray, size: int, content: str) -> np.ndarray:
    try:
        vector = np.array(value, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise KeyframeError(f"{field} is {short(value)}, expected {size} numbers ({content})") from None
    if vector.shape != (size,):
        raise KeyframeError(f"{field} has shape {vector.shape}, expected ({size},) ({content})")
    if not np.isfinite(vector).all():
        index = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise KeyframeError(f"{field}[{index}] is {vector[index]}, expected a finite number")
    return vector
