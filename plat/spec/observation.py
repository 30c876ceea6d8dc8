"""Observation table: every entry of the observation, from which environments, networks and exports derive theirs."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeVar

from plat.bounds import as_names, check_robot, shown
from plat.errors import ObservationError

__all__ = [
    "COMMAND_KEYS",
    "OBSERVATION",
    "OPTIONAL_GROUPS",
    "ROBOT_KEYS",
    "STUDENT_GROUPS",
    "STUDENT_KEYS",
    "Entry",
    "ObservationTable",
    "RobotSizes",
    "as_entries",
    "as_observed",
    "command_keys",
    "entries_of",
    "entry_shapes",
    "goal_keys",
    "is_goal",
    "observation_size",
    "observed",
    "observing",
    "optional_groups",
    "privileged_keys",
    "quantities",
    "robot_keys",
    "student_keys",
    "table",
]

Key = tuple[str, str]
_Value = TypeVar("_Value")
_View = TypeVar("_View")

STUDENT_GROUPS = ("robot", "goal", "command")
"""Groups that a deployed policy observes, in this order: ``o_t = [s_t, g_{t+Delta}, tau_t]``."""

OPTIONAL_GROUPS = ("parts", "clock")
"""Groups that some policies observe after those: what a partial keyframe commands, and the end of the time to it."""

# "goal" is what the policy is to reach; "goal_6" the reference six frames ahead; "dense_goal", "dense_goal_6" the same
# beside a keyframe; "keyframe" a keyframe beside a dense goal; "led_..." any of them, moved ahead by a lead;
# "near_goal" one that is brought within reach
_GOAL = re.compile(r"(led_|near_)?((dense_)?goal(_[1-9]\d*)?|keyframe)")


class RobotSizes(Protocol):
    """Protocol of the robot data that widths of entries depend on; :class:`plat.robots.Robot` is one."""

    @property
    def num_joints(self) -> int:
        """Return the number of joints J."""
        ...

    @property
    def keypoints(self) -> Sequence[str]:
        """Return the names of the K keypoint bodies."""
        ...


@dataclass(frozen=True)
class Entry:
    """Entry of an observation, of width ``size + per_joint * J + per_body * K``.

    Args:
        name: of the entry in its group.
        unit: of the quantity.
        frame: that the quantity is expressed in, or what it is relative to.
        size: width that does not depend on the robot.
        per_joint: width for each joint.
        per_body: width for each keypoint body.
        scale: factor from the quantity in its unit to the value that policies observe.
        commanded_by: part of a keyframe that a goal's entry belongs to; None for every other entry.
        mirrored: what becomes of it where left and right change places: ``"same"``; ``"joints"`` of the other side,
            with the sign of their axes; ``"sides"``, values of the other side; ``"vector"``, also one for each body,
            with y reversed; ``"axis"`` of a rotation, with x and z reversed; ``"rotation"``, two columns of a matrix.
            None where nobody has said.
    """

    name: str
    unit: str
    frame: str
    size: int = 0
    per_joint: int = 0
    per_body: int = 0
    scale: float = 1.0
    commanded_by: Literal["joints", "root", "bodies"] | None = None
    mirrored: Literal["same", "joints", "sides", "vector", "axis", "rotation"] | None = None

    def width(self, num_joints: int, num_keypoints: int) -> int:
        """Return the number of values for a robot.

        >>> Entry("keypoint_pos_b", "m", "root frame", per_body=3).width(num_joints=29, num_keypoints=14)
        42
        """
        return self.size + self.per_joint * num_joints + self.per_body * num_keypoints

    def observed(self, quantity: Any) -> Any:
        """Return what policies observe of a quantity, or of an error of it, in the entry's unit: it times the scale.

        >>> Entry("root_height", "m", "world", size=1, scale=10.0).observed(0.76)
        7.6
        """
        return quantity if self.scale == 1.0 else self.scale * quantity

    def quantity(self, observed: Any) -> Any:
        """Return the quantity in the entry's unit that policies observe as this value, see :meth:`observed`.

        >>> Entry("root_height", "m", "world", size=1, scale=10.0).quantity(7.6)
        0.76
        """
        return observed if self.scale == 1.0 else observed / self.scale


@dataclass(frozen=True)
class ObservationTable:
    """Entries of every group of observations, in the order in which networks observe them.

    Args:
        groups: entries of ``"robot"``, ``"goal"``, ``"command"``, ``"parts"``, ``"clock"`` and ``"privileged"``. Every
            goal group (:func:`is_goal`) has the entries of ``"goal"``.

    Raises:
        ObservationError: when a group has two entries of one name.

    >>> [entry.name for entry in OBSERVATION.entries("dense_goal")]
    ['joint_pos', 'root_pos_b', 'root_rot6d_b', 'keypoint_pos_b']
    """

    groups: Mapping[str, tuple[Entry, ...]]

    def __post_init__(self) -> None:
        for group, entries in self.groups.items():
            names = [entry.name for entry in entries]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ObservationError(f"observation group {group!r}: {twice[0]!r} is in it twice")
        object.__setattr__(self, "groups", MappingProxyType(dict(self.groups)))

    def entries(self, group: str) -> tuple[Entry, ...]:
        """Return the entries of a group.

        Raises:
            ObservationError: when there is no such group.
        """
        kind = "goal" if is_goal(group) else group
        if kind not in self.groups:
            raise ObservationError(f"unknown observation group {group!r}, expected one of {[*self.groups]}")
        return self.groups[kind]

    def entry(self, group: str, name: str) -> Entry:
        """Return one entry.

        Raises:
            ObservationError: when there is no such group or entry.
        """
        entries = {entry.name: entry for entry in self.entries(group)}
        if name not in entries:
            raise ObservationError(f"unknown entry {name!r} of observation group {group!r}, expected {[*entries]}")
        return entries[name]

    def keys(self, *groups: str) -> tuple[Key, ...]:
        """Return the keys of groups, one group after the other."""
        return tuple((group, entry.name) for group in groups for entry in self.entries(group))

    def with_entry(self, group: str, entry: Entry) -> "ObservationTable":
        """Return this table with one more entry at the end of a group."""
        return ObservationTable({**self.groups, group: (*self.entries(group), entry)})


_TARGET = "from the robot's root to the target's, in the robot's root frame"

OBSERVATION = ObservationTable(
    {
        "robot": (
            Entry("joint_pos", "rad", "relative to the default pose", per_joint=1, mirrored="joints"),
            Entry("joint_vel", "rad/s", "joint", per_joint=1, mirrored="joints"),
            Entry("root_ang_vel_b", "rad/s", "root frame", size=3, mirrored="axis"),
            Entry("root_lin_vel_b", "m/s", "root frame", size=3, mirrored="vector"),
            Entry(
                "gravity_b", "1", "direction of gravity, a unit vector, in the root frame", size=3, mirrored="vector"
            ),
            Entry(
                "last_action",
                "action",
                "(joint position target - default pose) / action scale",
                per_joint=1,
                mirrored="joints",
            ),
        ),
        "goal": (
            Entry(
                "joint_pos",
                "rad",
                "absolute joint angles of the target",
                per_joint=1,
                commanded_by="joints",
                mirrored="joints",
            ),
            Entry("root_pos_b", "m", _TARGET, size=3, commanded_by="root", mirrored="vector"),
            Entry(
                "root_rot6d_b",
                "1",
                "first two columns of the matrix that turns target root into robot root frame",
                size=6,
                commanded_by="root",
                mirrored="rotation",
            ),
            Entry(
                "keypoint_pos_b",
                "m",
                "from the robot's root to the target's keypoints, root frame",
                per_body=3,
                commanded_by="bodies",
                mirrored="vector",
            ),
        ),
        "command": (Entry("horizon", "1", "tau", size=1, mirrored="same"),),
        "parts": (
            Entry("joints", "1", "1 for every commanded joint angle", per_joint=1, mirrored="sides"),
            Entry("bodies", "1", "1 for every commanded body position", per_body=1, mirrored="sides"),
            Entry(
                "root",
                "1",
                "1 for a commanded horizontal position, height, orientation of the root",
                size=3,
                mirrored="same",
            ),
        ),
        "clock": (
            Entry("soon", "1", "time to the keyframe, in 0.2 s, at most 1", size=1, mirrored="same"),
            Entry("in_window", "1", "1 where the step ends in the arrival window", size=1, mirrored="same"),
        ),
        "privileged": (
            Entry("keypoint_pos_b", "m", "from the robot's root to its keypoints, root frame", per_body=3),
            Entry("keypoint_lin_vel_b", "m/s", "velocity in the world, root frame", per_body=3),
            Entry("root_height", "m", "world", size=1),
            Entry("root_velocity_error_b", "m/s, rad/s", "next reference frame minus robot, root frame", size=6),
            Entry("joint_vel_error", "rad/s", "next reference frame minus robot", per_joint=1),
        ),
    }
)
"""The observation of the policies that plat ships."""

_table = OBSERVATION


def table() -> ObservationTable:
    """Return the table that environments, policies and builders derive from."""
    return _table


@contextmanager
def observing(changed: ObservationTable) -> Iterator[ObservationTable]:
    """Derive everything that is created and used in this context from another table.

    A new entry needs the function that computes it: in ``plat.envs.goals.GOAL_ENTRIES`` for environments, and in
    ``plat.deploy.goals.GOAL_ENTRIES`` for robots.

    >>> with observing(OBSERVATION.with_entry("goal", Entry("root_height", "m", "world", size=1, commanded_by="root"))):
    ...     len(goal_keys())
    5
    >>> len(goal_keys())
    4
    """
    global _table
    before, _table = _table, changed
    try:
        yield changed
    finally:
        _table = before


def is_goal(group: str) -> bool:
    """Return whether a group of this name is a goal.

    >>> [is_goal(group) for group in ("goal", "goal_6", "dense_goal", "led_dense_goal_6", "keyframe", "robot")]
    [True, True, True, True, True, False]
    """
    return _GOAL.fullmatch(group) is not None


def entries_of(keys: Iterable[Any]) -> tuple[Entry, ...]:
    """Return the entries of the table that keys name; for one that names none, an entry that is its quantity.

    >>> [entry.unit for entry in entries_of((("dense_goal", "joint_pos"), "residual"))]
    ['rad', '1']
    """
    groups, found = table().groups, []
    for key in keys:
        group, name = key if isinstance(key, tuple) and len(key) == 2 else ("", str(key))
        kind = "goal" if is_goal(group) else group
        found.append(next((entry for entry in groups.get(kind, ()) if entry.name == name), Entry(name, "1", "")))
    return tuple(found)


def quantities(entries: Iterable[Entry], observed: Iterable[Any]) -> tuple[Any, ...]:
    """Return the quantities, in their units, that are observed as these values of entries.

    >>> quantities([Entry("root_height", "m", "world", size=1, scale=10.0)], [7.6])
    (0.76,)
    """
    return tuple(entry.quantity(value) for entry, value in zip(entries, observed, strict=True))


def as_entries(entries: Iterable[Entry], values: Iterable[Any]) -> tuple[Any, ...]:
    """Return what policies observe of quantities of the first entries.

    >>> as_entries([Entry("root_height", "m", "world", size=1, scale=10.0)], [0.76])
    (7.6,)
    """
    return tuple(entry.observed(value) for entry, value in zip(entries, values, strict=False))


def entry_shapes(group: str, robot: RobotSizes) -> dict[str, tuple[int, ...]]:
    """Return the shape of each entry of a group, in the order in which networks observe them.

    Raises:
        ObservationError: when there is no such group.

    >>> from plat.robots import G1
    >>> entry_shapes("goal", G1)
    {'joint_pos': (29,), 'root_pos_b': (3,), 'root_rot6d_b': (6,), 'keypoint_pos_b': (42,)}
    """
    joints, bodies = robot.num_joints, len(robot.keypoints)
    return {entry.name: (entry.width(joints, bodies),) for entry in table().entries(group)}


def robot_keys() -> tuple[Key, ...]:
    """Return the keys of the robot's own state ``s_t``."""
    return table().keys("robot")


def goal_keys(group: str = "goal") -> tuple[Key, ...]:
    """Return the keys of a goal group.

    Raises:
        ObservationError: when a group of this name is no goal.
    """
    if not is_goal(group):
        raise ObservationError(f"observation group {group!r} is no goal, expected a name such as 'goal' or 'goal_6'")
    return table().keys(group)


def command_keys() -> tuple[Key, ...]:
    """Return the keys of the command beside its goal: the normalized horizon ``tau``."""
    return table().keys("command")


def privileged_keys() -> tuple[Key, ...]:
    """Return the keys that only a critic observes."""
    return table().keys("privileged")


def student_keys(also: Sequence[str] = ()) -> tuple[Key, ...]:
    """Return the keys of all that a deployed policy observes.

    Args:
        also: those of :data:`OPTIONAL_GROUPS` that it observes as well, in the order of that tuple; or one of them.

    Raises:
        ObservationError: for a group that is not optional, and for what holds no names.
    """
    if not isinstance(also, Iterable):
        raise ObservationError(f"also is {shown(also)}, expected some of {OPTIONAL_GROUPS}")
    also = as_names(also)
    unknown = [group for group in also if group not in OPTIONAL_GROUPS]
    if unknown:
        raise ObservationError(f"observation group {unknown[0]!r}: expected some of {OPTIONAL_GROUPS}")
    return table().keys(*STUDENT_GROUPS, *(group for group in OPTIONAL_GROUPS if group in also))


def optional_groups(keys: Iterable[Any]) -> tuple[str, ...]:
    """Return those of :data:`OPTIONAL_GROUPS` that a policy with these input keys observes.

    >>> optional_groups(student_keys(("clock",)))
    ('clock',)
    """
    seen = {key[0] for key in keys if isinstance(key, tuple)}
    return tuple(group for group in OPTIONAL_GROUPS if group in seen)


ROBOT_KEYS = robot_keys()
""":func:`robot_keys` of :data:`OBSERVATION`."""

COMMAND_KEYS = command_keys()
""":func:`command_keys` of :data:`OBSERVATION`."""

STUDENT_KEYS = student_keys()
""":func:`student_keys` of :data:`OBSERVATION`."""


def observation_size(keys: Iterable[Any], robot: RobotSizes) -> int:
    """Return the number of values of entries side by side.

    Args:
        keys: pairs of group and entry.
        robot: the robot.

    Raises:
        ObservationError: when there is no such group or entry.

    >>> from plat.robots import G1
    >>> observation_size(STUDENT_KEYS, G1)
    177
    """
    return sum(observation_widths(keys, robot))


def observation_widths(keys: Iterable[Any], robot: RobotSizes) -> list[int]:
    """Return the width of each of some entries, see :func:`observation_size`.

    >>> from plat.robots import G1
    >>> observation_widths([("robot", "joint_pos"), ("command", "horizon")], G1)
    [29, 1]
    """
    check_robot(robot)
    joints, bodies = robot.num_joints, len(robot.keypoints)
    return [table().entry(group, name).width(joints, bodies) for group, name in keys]


def as_observed(group: str, quantities: Mapping[str, _Value]) -> dict[str, _Value]:
    """Return computed quantities in the order of the table, each times its scale.

    Args:
        group: of the entries.
        quantities: in the units of the table, one for each entry; arrays or tensors.

    Raises:
        ObservationError: when an entry is not computed.

    >>> as_observed("command", {"horizon": 0.5})
    {'horizon': 0.5}
    """
    return {entry.name: entry.observed(_computed(group, entry.name, quantities)) for entry in table().entries(group)}


def observed(group: str, functions: Mapping[str, Callable[[_View], _Value]], view: _View) -> dict[str, _Value]:
    """Return the entries of a group in the order of the table, each computed by its function, times its scale.

    Args:
        group: of the entries.
        functions: by name; those of no entry in the table are not called.
        view: what the functions compute from.

    Raises:
        ObservationError: when an entry has no function.

    >>> observed("command", {"horizon": lambda steps: steps / 50}, 25)
    {'horizon': 0.5}
    """
    return {
        entry.name: entry.observed(_computed(group, entry.name, functions)(view)) for entry in table().entries(group)
    }


def _computed(group: str, name: str, source: Mapping[str, _Value]) -> _Value:
    if name not in source:
        raise ObservationError(f"nothing computes {name!r} of observation group {group!r}, only {sorted(source)}")
    return source[name]
