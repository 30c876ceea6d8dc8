"""Names of columns and joints as files spell them, and what they mean."""

import re
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

from plat.motions.formats.units import Units
from plat.robots.robot import Robot

__all__ = [
    "Column",
    "SaidUnits",
    "array_meaning",
    "classify_columns",
    "different_words",
    "is_generic",
    "is_time",
    "match_joint",
    "stated_length",
    "stating",
    "tokens",
    "units_in_comments",
]

_SIDES = {"l": "left", "r": "right", "lt": "left", "rt": "right", "lft": "left", "rgt": "right"}


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# words that say no more than that a column is the position of a joint, and what stands before Unitree's own names
_NOISE = _words(
    "joint joints state states dof dofs pos position positions q qpos angle angles rad radian radians deg degrees leg "
    "arm k observation"
)
# what LeRobot puts before the names of a state, and its numbers of what a frame is part of
_STATE = _words("observation state")
_PARTS = (_words("episode index"), _words("task index"))
_ROOT = _words("root base pelvis body free freejoint floating world global torso trunk link odom odometry pose")
_DERIVED = _words(
    "vel velocity velocities qvel speed acc acceleration tau torque torques force contact effort current action"
)
_PLACE = _words("pos position trans translation translate t p location xyz")
_TURN = _words("quat quaternion q rot rotation rotate orientation orient ori r euler angle")
# words of the names of whole arrays
_ROOT_ALONE, _JOINTS = _words("root base pelvis"), _words("joint joints dof dofs")
_PLACES = _words("pos position positions trans translation translations xyz")
_TURNS = _words("quat quaternion quaternions quats rot rotation rotations orientation orient ori wxyz xyzw")
_ANGLES = _words("pos position positions angle angles q")
_EULER = {"roll": "x", "pitch": "y", "yaw": "z"}
_FUSED = re.compile(r"(q|quat|rot|r|p|pos|t|trans)([wxyz])")
_COUNTS = _words(
    "frame frames index idx step steps id number no nr num unnamed i n row seq count counter tick ticks sample iter"
)
# what frames are counted within, and in whose header of a message the count stands
_WITHIN = _words("in of episode clip motion take trial traj trajectory sequence header field 0")
_FRAMES = _words("frame frames step steps")
_LENGTHS: dict[str, Units] = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("ft", "foot", "feet"), "ft"),
}
_ANGLE_UNITS = {
    **dict.fromkeys(("deg", "degree", "degrees"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
}
_UNITS = {*_ANGLE_UNITS, *_LENGTHS}
_ANY_UNIT = re.compile(rf"(?<![a-z])({'|'.join(sorted(_UNITS, key=len, reverse=True))})(?![a-z]|\s*/)")
# in a sentence: behind "in", a bracket or a sign
_SAID = re.compile(rf"(?:\bin\s+|[\[(:=,]\s*){_ANY_UNIT.pattern}")
# letters of a column's name in a spreadsheet
_LONGEST_COLUMN = 2
_UNIT_BEHIND = re.compile(rf"\s+\[({'|'.join(_UNITS)})\]$")
# words that mean other things than units, where the line does not speak of units
_OTHERWISE = _words("in foot feet")
_OF_ROOT = _ROOT_ALONE | _words("orientation rotation euler roll pitch yaw rpy")
_TIMES = _words(
    "time times t timestamp timestamps stamp stamps sec secs seconds s ms msec millis milliseconds us usec "
    "microseconds timecode tc ns nsec nsecs nanosec nanosecs nanoseconds dt timestep"
)
# what says whose or since when a time is
_OF_TIMES = _words(
    "from start since begin elapsed in of unix epoch sim simulation ros rosbag bag wall clock system host device "
    "sensor recv received receive recorded recording record log msg message header field relative rel absolute abs "
    "mocap step delta code"
)
_OF_MOTION = _words("motion clip episode take trial traj trajectory sequence frame play playback video reference ref")


class Column(NamedTuple):
    """What a column of a table holds.

    Attributes:
        kind: a joint's angle, a part of the root's position or orientation, a counter, the time, something derived
            such as a velocity, or nothing that is known.
        part: name of the joint, or axis (``w``, ``x``, ``y``, ``z``).
    """

    kind: Literal["joint", "place", "quat", "euler", "count", "time", "derived", "unknown"]
    part: str = ""


class SaidUnits(NamedTuple):
    """Units that a file's comments state; None where they state none or several.

    Attributes:
        length: of lengths.
        root: of angles of the root, ``deg`` or ``rad``.
        joints: of joint angles.
    """

    length: str | None
    root: str | None
    joints: str | None


def tokens(name: str) -> tuple[str, ...]:
    """Return the words of a name in small letters, split at case, digits' ends and separators.

    >>> tokens("joint/LeftHipPitch"), tokens("L_KNEE")
    (('joint', 'left', 'hip', 'pitch'), ('left', 'knee'))
    """
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name.strip("\"' \t"))
    words = (word for word in re.split(r"[^a-z0-9]+", name.lower()) if word)
    return tuple(_SIDES.get(word, word) for word in words)


def match_joint(name: str, robot: Robot) -> str | None:
    """Return the joint of the robot that a name means, or None.

    Case, separators, the order of words, prefixes such as ``q_`` and suffixes such as ``_joint_pos`` do not matter.

    >>> from plat.robots import G1
    >>> [match_joint(name, G1) for name in ("LEFT_KNEE", "q_left_knee_joint", "RightHipPitch", "left_tail")]
    ['left_knee', 'left_knee', 'right_hip_pitch', None]
    >>> match_joint("kLeftWristyaw", G1)
    'left_wrist_yaw'
    """
    words = set(tokens(name))
    if words & _DERIVED:
        return None
    keys = {frozenset(tokens(joint)): joint for joint in robot.joint_names}
    for wanted in (words, words - _NOISE, words - _NOISE - {"pitch"}):
        if joint := keys.get(frozenset(wanted)):
            return joint
    joined = "".join(word for word in tokens(name) if word not in _NOISE)
    return next((joint for joint in robot.joint_names if "".join(tokens(joint)) == joined), None)


def is_generic(name: str) -> bool:
    """Return whether a name only numbers a column: ``col7``, ``joint_0``, ``dof[3]``, ``12``, ``q1 [rad]``.

    >>> [is_generic(name) for name in ("col7", "joint_0", "dof[3]", "", "q1 [rad]", "left_tail")]
    [True, True, True, True, True, False]
    """
    name = _UNIT_BEHIND.sub("", name)
    return re.fullmatch(r"[a-z]*[\s_/.:\[(#-]*([a-z]|\d*(\.\d+)?)[\])]*", name.strip("\"' \t").lower()) is not None


def different_words(names: Sequence[str]) -> set[str]:
    """Return the names that are words without a number, where there are several: they name columns, and number none.

    >>> different_words(["joint", "joint.1"]), sorted(different_words(["Huefte", "Knie", "AB", "q1"]))
    (set(), ['Huefte', 'Knie'])
    """
    words = {name for name in names if name.isalpha() and len(name) > _LONGEST_COLUMN}
    return words if len(words) > 1 else set()


def stated_length(names: Sequence[str]) -> Units | None:
    """Return the unit of lengths that all names of some columns state, or None.

    >>> stated_length(["root_x [cm]", "root_y [cm]"]), stated_length(["x in m"]), stated_length(["x [m]", "y"])
    ('cm', 'm', None)
    """
    found = {next((_LENGTHS[word] for word in reversed(tokens(name)) if word in _LENGTHS), None) for name in names}
    return found.pop() if len(found) == 1 else None


def units_in_comments(comments: Sequence[str]) -> SaidUnits:
    """Return the units that comments state.

    >>> tuple(units_in_comments(["root position in cm, angles in deg"])), tuple(units_in_comments(["units: m rad"]))
    (('cm', 'deg', 'deg'), ('m', 'rad', 'rad'))
    >>> tuple(units_in_comments(["root rotation in degrees; joints in radians", "turns by 60 deg"]))
    (None, 'deg', 'rad')
    """
    said = [each for line in comments for each in _units_said(line.lower())]
    lengths = {_LENGTHS[word] for word, _ in said if word in _LENGTHS}
    root, joints = (
        {_ANGLE_UNITS[word] for word, about in said if word in _ANGLE_UNITS and (about & own or not about & others)}
        for own, others in ((_OF_ROOT, _JOINTS), (_JOINTS, _OF_ROOT))
    )
    return SaidUnits(*(found.pop() if len(found) == 1 else None for found in (lengths, root, joints)))


def _units_said(line: str) -> Iterator[tuple[str, set[str]]]:
    """Yield the units that a line states, each with the words before it."""
    of_units = bool({"unit", "units"} & set(tokens(line)))
    for match in (_ANY_UNIT if of_units else _SAID).finditer(line):
        before, behind = line[: match.start(1)], line[match.end() :]
        named = of_units and (match[1] != "in" or not behind.strip())
        if match[1] not in _OTHERWISE or named or re.search(r"\bin\s+$", before):
            yield match[1], set(tokens(re.split("[,;]", before)[-1]))


def stating(names: Sequence[str], unit: str | None) -> list[str]:
    """Return the names of columns with a unit behind those that state none.

    >>> stating(["root_x", "root_y [m]"], "cm")
    ['root_x [cm]', 'root_y [m]']
    """
    return [name if unit is None or set(tokens(name)) & _UNITS else f"{name} [{unit}]" for name in names]


def array_meaning(name: str) -> str:
    """Return what an array is by its name: ``root_pos``, ``root_quat`` or ``joint_pos``; or nothing.

    >>> [array_meaning(name) for name in ("base_position", "root_orientation_xyzw", "joint_angles", "joint_vel", "q")]
    ['root_pos', 'root_quat', 'joint_pos', '', '']
    """
    words = set(tokens(name))
    words -= {"robot", "ref", "reference", "motion", "frame", "w", "world", "rad", "deg"}
    if words & _ROOT_ALONE and words <= _ROOT_ALONE | _PLACES:
        return "root_pos" if words & _PLACES else ""
    if words & _ROOT_ALONE and words <= _ROOT_ALONE | _TURNS:
        return "root_quat"
    angles = words in ({"joints"}, {"dofs"}) or (words & _JOINTS and words & _ANGLES)
    return "joint_pos" if angles and words <= _JOINTS | _ANGLES else ""


def classify_columns(header: Sequence[str], robot: Robot) -> list[Column]:
    """Return what every column of a header is."""
    words = [tokens(name) for name in header]
    has_w = any(_root_part(row)[1] == "w" for row in words)
    columns = []
    for name, row in zip(header, words, strict=True):
        joint = match_joint(name, robot)
        place, part = _root_part(row)
        if set(row) & _DERIVED or set(row) in _PARTS:
            columns.append(Column("derived"))
        elif joint is not None:
            columns.append(Column("joint", joint))
        elif place == "turn":
            columns.append(Column("quat" if has_w and part in "wxyz" else "euler", _EULER.get(part, part)))
        elif place == "place":
            columns.append(Column("place", part))
        elif is_time(name):
            columns.append(Column("time", next((word for word in row[::-1] if word in ("ms", "us", "ns", "s")), "")))
        elif not name.strip("\"' \t") or _is_count(set(row)):
            columns.append(Column("count"))
        else:
            columns.append(Column("unknown"))
    return columns


def is_time(name: str) -> bool:
    """Return whether a column or array of this name holds times.

    >>> [is_time(name) for name in ("sim_time", "header.stamp.nanosec", "time_since_start", "time_left", "ms")]
    [True, True, True, False, True]
    """
    words = set(tokens(name))
    return bool(words & _TIMES) and words <= _TIMES | _OF_TIMES | _OF_MOTION


def _is_count(words: set[str]) -> bool:
    """Return whether a column counts: rows, or frames within a motion, and no motions."""
    within = _COUNTS | _WITHIN if words & (_FRAMES | {"header"}) else _COUNTS | {"0"}
    return bool(words & _COUNTS) and words <= within


def _root_part(words: tuple[str, ...]) -> tuple[str, str]:
    """Return ``place`` or ``turn`` and the axis, for the name of a column of the root; else two empty texts."""
    rest = [word for word in words if word not in _ROOT | _UNITS | _STATE]
    if rest and (fused := _FUSED.fullmatch(rest[-1])):
        rest[-1:] = fused.groups()
    if not rest:
        return "", ""
    *what, axis = rest
    if axis in _EULER and set(what) <= _TURN:
        return ("turn", axis) if len(words) > len(rest) or what or len(words) == 1 else ("", "")
    if axis not in "wxyz" or len(axis) != 1:
        return "", ""
    if axis == "w":
        return ("turn", axis) if set(what) <= _TURN else ("", "")
    if what and set(what) <= _TURN and not set(what) <= _PLACE:
        return "turn", axis
    return ("place", axis) if set(what) <= _PLACE else ("", "")
