"""Keyframe files in JSON."""

import json
import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plat.bounds import check_robot
from plat.errors import KeyframeError
from plat.files import replace_file
from plat.json_file import read_json, short, version_fault
from plat.keyframes.keyframe import Keyframe, RobotJoints, check_keyframe, check_time
from plat.spec.parts import Parts, joint_called

__all__ = [
    "holds_keyframes",
    "is_keyframe_file",
    "keyframe_from_json",
    "keyframe_json",
    "keyframe_to_json",
    "keyframes_of",
    "read_keyframes",
    "refuse_other_kinds",
    "write_keyframes",
]

_FORMAT = "plat-keyframes"
# version 2 adds the field "commands" of partial keyframes; files without one are written as version 1
_VERSION = 2
_POSE_FIELDS = ("root_pos", "root_quat", "joint_pos")
# positions of w, x, y, z in a quaternion of each order
_QUATERNION_ORDERS = {"wxyz": [0, 1, 2, 3], "xyzw": [3, 0, 1, 2]}


# what becomes keyframes, by the ending of its file
_INSTEAD = {
    ".npz .npy .csv .tsv .pkl .pickle .joblib .bvh .amc": "plat keyframes from-motion makes keyframes of a motion",
    ".xml .mjcf": "plat keyframes convert makes keyframes of a model's keys",
}


def read_keyframes(path: Path, robot: RobotJoints) -> tuple[Keyframe | None, tuple[Keyframe, ...]]:
    """Read the start (None where there is none) and the keyframes of a file, joints in the robot's order.

    Raises:
        KeyframeError: naming file, keyframe and field, for content outside the format, a pose beyond the limits,
            or another robot. Inconsistent times are found by :class:`plat.keyframes.KeyframeSequence`.
    """
    check_robot(robot)
    return keyframes_of(keyframe_json(path), path, robot)


def keyframe_json(path: Path) -> Any:
    """Return the JSON of a file of keyframes, or of constraints; :func:`keyframes_of` reads it.

    Raises:
        KeyframeError: naming the file, for content that is no JSON.
    """
    label = f"keyframe file {str(path)!r}"
    refuse_other_kinds(path, label)
    return read_json(path, KeyframeError, label, constants=True)


def keyframes_of(content: Any, path: Path, robot: RobotJoints) -> tuple[Keyframe | None, tuple[Keyframe, ...]]:
    """Return the keyframes of a file's JSON as :func:`read_keyframes` does; ``path`` is for messages."""
    try:
        return _parse(content, robot)
    except KeyframeError as error:
        raise KeyframeError(f"keyframe file {str(path)!r}: {error}") from None


def refuse_other_kinds(path: Path, label: str) -> None:
    """Raise an error for a file whose ending says that keyframes are yet to be made of it.

    Raises:
        KeyframeError: saying what makes them.
    """
    made_by = next((how for endings, how in _INSTEAD.items() if path.suffix.lower() in endings.split()), "")
    if made_by and path.is_file():
        raise KeyframeError(f"{label}: not one, expected JSON; {made_by}")


def is_keyframe_file(path: Path) -> bool:
    """Return whether a file declares that it holds keyframes; its content is not checked."""
    try:
        return holds_keyframes(read_json(path, KeyframeError, "", constants=True))
    except KeyframeError:
        return False


def holds_keyframes(content: Any) -> bool:
    """Return whether a file's JSON declares the same."""
    return isinstance(content, dict) and content.get("format") == _FORMAT


def write_keyframes(path: Path, robot: RobotJoints, start: Keyframe, keyframes: Sequence[Keyframe]) -> None:
    """Write a keyframe file; it is replaced atomically or not at all. The start commands nothing.

    Raises:
        KeyframeError: when the disk does not take it.
    """
    content = {
        "format": _FORMAT,
        "version": 1 if all(keyframe.whole for keyframe in keyframes) else 2,
        "robot": robot.name,
        "quaternion_order": "wxyz",
        "start": _entry(replace(start, commands=None), robot),
        "keyframes": [{"time": keyframe.time, **_entry(keyframe, robot)} for keyframe in keyframes],
    }
    try:
        replace_file(path, lambda part: part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8"))
    except OSError as error:
        raise KeyframeError(f"keyframe file {str(path)!r} could not be written ({error.strerror or error})") from error


def keyframe_to_json(keyframe: Keyframe, robot: RobotJoints) -> dict[str, Any]:
    """Return a keyframe as it stands in files, for messages between programs.

    Raises:
        KeyframeError: naming the field, for a pose that is none of the robot's: :func:`keyframe_from_json` would not
            take it either.
    """
    check_keyframe("keyframe", keyframe)
    checked = keyframe.checked(robot)
    return {"time": checked.time, **_entry(checked, robot)}


def keyframe_from_json(entry: Any, robot: RobotJoints) -> Keyframe:
    """Return the keyframe that :func:`keyframe_to_json` wrote.

    Raises:
        KeyframeError: naming the field.
    """
    check_robot(robot)
    return _keyframe(entry, "keyframe", ("time", *_POSE_FIELDS), "wxyz", robot, version=2)


def _parse(content: Any, robot: RobotJoints) -> tuple[Keyframe | None, tuple[Keyframe, ...]]:
    if not holds_keyframes(content):
        constraints = isinstance(content, list) and any(
            isinstance(entry, dict) and "type" in entry for entry in content
        )
        instead = "; plat keyframes convert makes keyframes of constraints" if constraints else ""
        raise KeyframeError(f"not a keyframe file, expected an object with 'format': {_FORMAT!r}{instead}")
    version = content.get("version")
    if fault := version_fault(version, _VERSION):
        raise KeyframeError(f"version {fault}")
    required = ("format", "version", "robot", "quaternion_order", "keyframes")
    _check_fields(content, required, ("start",))
    if content["robot"] != robot.name:
        raise KeyframeError(
            f"robot is {short(content['robot'])}, expected {robot.name!r}; for another give --robot PATH"
        )
    order = content["quaternion_order"]
    if not isinstance(order, str) or order not in _QUATERNION_ORDERS:
        raise KeyframeError(f"quaternion_order is {short(order)}, expected 'wxyz' or 'xyzw'")
    if not isinstance(content["keyframes"], list):
        raise KeyframeError("keyframes: expected a list")
    start = _keyframe(content["start"], "start", _POSE_FIELDS, order, robot) if "start" in content else None
    keyframes = tuple(
        _keyframe(entry, f"keyframe {index}", ("time", *_POSE_FIELDS), order, robot, version)
        for index, entry in enumerate(content["keyframes"])
    )
    for index, keyframe in enumerate(keyframes):
        check_time(keyframe.time, f"keyframe {index}: time")
    return start, keyframes


def _keyframe(
    entry: Any, label: str, required: Sequence[str], order: str, robot: RobotJoints, version: int = 1
) -> Keyframe:
    """Return the keyframe of a JSON object; one without a time is at 0."""
    if not isinstance(entry, dict):
        raise KeyframeError(f"{label} is {short(entry)}, expected an object")
    name = entry.get("name")
    if isinstance(name, str):
        label += f" ({short(name)})"
    try:
        if version == 1 and "time" in required and "commands" in entry:
            raise KeyframeError("commands is a field of version 2, and version is 1")
        _check_fields(entry, required, ("name",) if version == 1 else ("name", "commands"))
        if not isinstance(name, (str, type(None))):
            raise KeyframeError(f"name is {short(name)}, expected a text")
        return Keyframe(
            _number(entry.get("time", 0.0), "time"),
            _numbers(entry["root_pos"], "root_pos", 3, "xyz"),
            _numbers(entry["root_quat"], "root_quat", 4, order)[_QUATERNION_ORDERS[order]],
            _joints(entry["joint_pos"], robot),
            name,
            _commands(entry["commands"], robot) if "commands" in entry else None,
        ).checked(robot)
    except KeyframeError as error:
        raise KeyframeError(f"{label}: {error}") from None


def _commands(content: Any, robot: RobotJoints) -> Parts:
    """Return the parts that lists of names say."""
    if not isinstance(content, dict):
        raise KeyframeError(f"commands is {short(content)}, expected an object of lists of names")
    fields = ("joints", "bodies", "root")
    unknown = [field for field in content if field not in fields]
    if unknown:
        raise KeyframeError(f"commands: unknown field {short(unknown[0])}, expected {', '.join(fields)}")
    for field, names in content.items():
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise KeyframeError(f"commands: {field} is {short(names)}, expected a list of names")
    try:
        return Parts.only(robot, **content)
    except KeyframeError as error:
        raise KeyframeError(f"commands: {error}") from None


def _joints(content: Any, robot: RobotJoints) -> np.ndarray:
    """Return joint angles in the robot's order."""
    if not isinstance(content, dict):
        raise KeyframeError("joint_pos: expected an object of joint names and angles")
    # robots' own files say left_knee_joint
    names = [joint_called(name, robot.joint_names) for name in content]
    if twice := [name for name in content if name not in robot.joint_names and names.count(name[:-6]) > 1]:
        raise KeyframeError(
            f"joint_pos: {short(twice[0])} and {short(twice[0][:-6])} are one joint, expected one of them"
        )
    content = dict(zip(names, content.values(), strict=True))
    unknown = [name for name in content if name not in robot.joint_names]
    missing = [name for name in robot.joint_names if name not in content]
    if unknown or missing:
        raise KeyframeError(
            f"joint_pos: unknown joints {short(unknown[:3])} and missing joints {missing[:3]} ({len(unknown)} unknown, "
            f"{len(missing)} missing), expected the {len(robot.joint_names)} of {robot.name!r}"
        )
    return np.array([_number(content[name], f"joint_pos: {name!r}") for name in robot.joint_names])


def _numbers(content: Any, field: str, size: int, letters: str) -> np.ndarray:
    if not isinstance(content, list) or len(content) != size:
        raise KeyframeError(f"{field} is {short(content)}, expected a list of {size} numbers ({', '.join(letters)})")
    return np.array([_number(value, f"{field}[{index}]") for index, value in enumerate(content)])


def _number(content: Any, field: str) -> float:
    # true and false are numbers to Python only; 1e999 and a whole number of 400 digits are too large for a float
    try:
        number = math.nan if isinstance(content, bool) or not isinstance(content, (int, float)) else float(content)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise KeyframeError(f"{field} is {short(content)}, expected a finite number")
    return number


def _check_fields(entry: dict[str, Any], required: Collection[str], optional: Collection[str] = ()) -> None:
    missing = [field for field in required if field not in entry]
    if missing:
        raise KeyframeError(f"{missing[0]} is missing")
    unknown = [field for field in entry if field not in (*required, *optional)]
    if unknown:
        raise KeyframeError(f"unknown field {short(unknown[0])}, expected {', '.join((*required, *optional))}")


def _entry(keyframe: Keyframe, robot: RobotJoints) -> dict[str, Any]:
    """Return the JSON object of a keyframe without its time."""
    return {
        **({} if keyframe.name is None else {"name": keyframe.name}),
        "root_pos": keyframe.root_pos.tolist(),
        "root_quat": keyframe.root_quat.tolist(),
        "joint_pos": dict(zip(robot.joint_names, keyframe.joint_pos.tolist(), strict=True)),
        **({} if keyframe.commands is None or keyframe.whole else {"commands": _names(keyframe.commands, robot)}),
    }


def _names(commands: Parts, robot: RobotJoints) -> dict[str, list[str]]:
    """Return the names of what is commanded, without empty lists."""
    return {field: names for field, names in commands.names(robot).items() if names}
