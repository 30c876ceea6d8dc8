"""Parts of a pose that a keyframe commands: joints, bodies and components of the root."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from plat.bounds import as_names, check_robot, shown
from plat.errors import KeyframeError

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ROOT_PARTS", "WHOLE_ONLY", "Parts", "RobotParts", "joint_called", "whole_only"]

ROOT_PARTS = ("horizontal", "height", "orientation")
"""Components of the root that a keyframe commands apart from each other."""

WHOLE_ONLY = (
    "this policy was trained on whole poses: command all of it, or use a policy that sees which parts are commanded"
)
"""What to tell those who give a partial keyframe to a policy that does not see parts."""


def whole_only(keyframe: object) -> str:
    """Return the same with the time and the name of the keyframe, as far as it has them."""
    time, name = getattr(keyframe, "time", None), getattr(keyframe, "name", None)
    label = ("" if time is None else f" at {time:g} s") + (f" ({name!r})" if name else "")
    return f"the keyframe{label} commands a part of its pose, but {WHOLE_ONLY}"


class RobotParts(Protocol):
    """Protocol of the robot data that parts are named by; :class:`plat.robots.Robot` has it."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Return the names of the J joints."""
        ...

    @property
    def keypoints(self) -> tuple[str, ...]:
        """Return the names of the K keypoint bodies."""
        ...


@dataclass(frozen=True)
class Parts:
    """Parts of a pose that a keyframe commands; the policy chooses the others.

    Args:
        joints: for each of the J joints, whether its angle is commanded.
        bodies: for each of the K keypoint bodies, whether its position in the world is commanded.
        root: whether the root's horizontal position, height and orientation are.

    Raises:
        KeyframeError: when nothing is commanded, or the root has not three flags.

    Source: the masks of MaskedMimic, arXiv 2409.14393, and of HOVER, arXiv 2410.21229.

    >>> from plat.robots import G1
    >>> hands = Parts.only(G1, bodies=("left_wrist_yaw_link", "right_wrist_yaw_link"))
    >>> hands.whole, sum(hands.values()), len(hands.values())
    (False, 2, 46)
    """

    joints: tuple[bool, ...]
    bodies: tuple[bool, ...]
    root: tuple[bool, bool, bool]

    def __post_init__(self) -> None:
        for field in ("joints", "bodies", "root"):
            flags = getattr(self, field)
            if not isinstance(flags, tuple | list) or not all(isinstance(flag, bool | np.bool_) for flag in flags):
                raise KeyframeError(f"parts: {field} is {shown(flags)}, expected True or False each; see Parts.only")
            # the same flags are equal and have one hash, however they were given
            object.__setattr__(self, field, tuple(map(bool, flags)))
        if len(self.root) != len(ROOT_PARTS):
            raise KeyframeError(f"root: {len(self.root)} flags, expected {len(ROOT_PARTS)} ({', '.join(ROOT_PARTS)})")
        if not any(self.values()):
            raise KeyframeError("parts: nothing is commanded, expected a joint, a body or a part of the root")

    @classmethod
    def all(cls, robot: RobotParts) -> Parts:
        """Return the parts of a whole pose."""
        return cls((True,) * len(robot.joint_names), (True,) * len(robot.keypoints), (True, True, True))

    @classmethod
    def only(
        cls, robot: RobotParts, joints: Iterable[str] = (), bodies: Iterable[str] = (), root: Iterable[str] = ()
    ) -> Parts:
        """Return the parts with these names.

        Args:
            robot: gives the names.
            joints: names of joints, also as in robots' own files (``left_knee_joint``).
            bodies: names of keypoint bodies.
            root: some of :data:`ROOT_PARTS`.

        Raises:
            KeyframeError: naming what does not exist, or when nothing is commanded.
        """
        check_robot(robot)
        return cls(
            _flags(
                [joint_called(name, robot.joint_names) for name in _names(joints, "joints")],
                robot.joint_names,
                "joints",
            ),
            _flags(bodies, robot.keypoints, "bodies"),
            _flags(root, ROOT_PARTS, "root"),  # type: ignore[arg-type]  # three flags
        )

    @classmethod
    def of_values(cls, values: Iterable[float], num_joints: int) -> Parts:
        """Return the parts of flags as :meth:`values` returns them."""
        flags = tuple(bool(value) for value in values)
        return cls(flags[:num_joints], flags[num_joints:-3], flags[-3:])  # type: ignore[arg-type]

    @property
    def whole(self) -> bool:
        """Return whether everything is commanded."""
        return all(self.values())

    @property
    def root_place(self) -> tuple[bool, bool, bool]:
        """Return whether x, y and z of the root are commanded; as a body, or as parts of the root."""
        horizontal, height, _ = self.root
        root = self.bodies[0]  # it is the first of the bodies
        return horizontal or root, horizontal or root, height or root

    def values(self) -> tuple[bool, ...]:
        """Return all flags ``[J + K + 3]``: joints, bodies, root."""
        return (*self.joints, *self.bodies, *self.root)

    def mask(self) -> NDArray[np.float64]:
        """Return all flags as numbers ``[J + K + 3]``."""
        return np.array(self.values(), dtype=np.float64)

    def check(self, robot: RobotParts) -> None:
        """Raise an error when the flags are not those of a robot.

        Raises:
            KeyframeError: naming the field.
        """
        for field, names in (("joints", robot.joint_names), ("bodies", robot.keypoints)):
            if len(getattr(self, field)) != len(names):
                raise KeyframeError(f"parts: {field} has {len(getattr(self, field))} flags, expected {len(names)}")

    def names(self, robot: RobotParts) -> dict[str, list[str]]:
        """Return the names of what is commanded, by ``joints``, ``bodies`` and ``root``.

        Raises:
            KeyframeError: for flags of another robot.
        """
        self.check(robot)
        groups = (("joints", robot.joint_names), ("bodies", robot.keypoints), ("root", ROOT_PARTS))
        return {
            field: [name for name, flag in zip(names, getattr(self, field), strict=True) if flag]
            for field, names in groups
        }


def joint_called(name: str, joint_names: Collection[str]) -> str:
    """Return the name of a joint that may be called as in robots' own files; a name of none as it is.

    >>> [joint_called(name, ["left_knee"]) for name in ("left_knee_joint", "left_knee", "left_tail")]
    ['left_knee', 'left_knee', 'left_tail']
    """
    plain = name.removesuffix("_joint")
    return plain if name not in joint_names and plain in joint_names else name


def _names(chosen: Iterable[str], field: str) -> tuple[str, ...]:
    if not isinstance(chosen, Iterable):
        raise KeyframeError(f"parts: {field} is {shown(chosen)}, expected names")
    return as_names(chosen)


def _flags(chosen: Iterable[str], names: Collection[str], field: str) -> tuple[bool, ...]:
    wanted = _names(chosen, field)
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise KeyframeError(f"parts: {field} has {unknown[0]!r}, expected some of {', '.join(names)}")
    return tuple(name in wanted for name in names)
