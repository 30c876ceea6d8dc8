"""Registry of robots by name, for saved policies, recipes and the command line."""

import dataclasses
import sys
from pathlib import Path
from typing import Any

from plat.bounds import check_robot
from plat.errors import RobotError
from plat.files import expand_home
from plat.json_file import read_json, short
from plat.robots.g1 import G1
from plat.robots.mjcf import Capsule
from plat.robots.robot import Robot
from plat.words import perhaps

__all__ = ["get_robot", "register_robot", "registered_robots"]

_ROBOTS: dict[str, Robot] = {G1.name: G1}


def register_robot(robot: Robot) -> Robot:
    """Register a robot under its name, so that policies trained for it can be loaded.

    Args:
        robot: the robot; registering an equal one again does nothing.

    Returns:
        The robot.

    Raises:
        RobotError: when another robot has that name.

    >>> register_robot(G1) is get_robot("g1")
    True
    """
    check_robot(robot)
    if _ROBOTS.setdefault(robot.name, robot) != robot:
        raise RobotError(f"robot {robot.name!r} is registered already with other settings; choose another name")
    return _ROBOTS[robot.name]


def registered_robots() -> tuple[Robot, ...]:
    """Return all robots that are registered: a process of its own knows the G1 alone, and is given them.

    >>> G1 in registered_robots()
    True
    """
    return tuple(_ROBOTS.values())


def get_robot(name_or_path: str | Path) -> Robot:
    """Return a robot by its name, or from a description file, which registers it.

    What is read otherwise than its MJCF file says (:attr:`plat.robots.Robot.notes`) is printed on standard error.

    Args:
        name_or_path: name of a registered robot, or path of a JSON file that holds the fields of
            :class:`plat.robots.Robot`. Its ``asset`` is relative to that file.

    Raises:
        RobotError: when there is no such robot or file, or a field of the file is missing, unknown or wrong.

    >>> get_robot("g1").num_joints
    29
    """
    if not isinstance(name_or_path, (str, Path)):
        raise RobotError(f"robot {short(name_or_path)} is unknown, expected a name or the path of a JSON description")
    if str(name_or_path) in _ROBOTS:
        return _ROBOTS[str(name_or_path)]
    path = expand_home(Path(name_or_path))
    if path.suffix != ".json":
        raise RobotError(
            f"robot {short(str(name_or_path))} is unknown, expected one of {sorted(_ROBOTS)}, one that "
            "plat.robots.register_robot was given, or the path of a JSON description (--robot PATH)"
        )
    robot = _read(path)
    if robot.name not in _ROBOTS:
        for note in robot.notes:
            print(note, file=sys.stderr)
    return register_robot(robot)


def _read(path: Path) -> Robot:
    values = read_json(path, RobotError, repr(str(path)))
    if not isinstance(values, dict):
        raise RobotError(f"{str(path)!r}: holds {short(values)}, expected an object with the fields of a robot")
    if "format" in values:  # keyframe files have one
        raise RobotError(f"{str(path)!r}: is of format {short(values['format'])}, expected a robot's description")
    try:
        fields = _fields(Robot, values, "")
        capsules = fields.get("sole_capsules", ())
        if isinstance(capsules, tuple):
            fields["sole_capsules"] = tuple(
                Capsule(**_fields(Capsule, one, f"sole_capsules[{index}]: ")) for index, one in enumerate(capsules)
            )
        robot = Robot(**fields).with_asset_in(path.parent)
        # as it was, it was looked at already
        return robot if _ROBOTS.get(robot.name) == robot else robot.check()
    except RobotError as error:
        raise RobotError(f"{str(path)!r}: {error}") from None


def _fields(kind: type, values: Any, where: str) -> dict[str, Any]:
    """Return the fields of a dataclass by name, with tuples in the place of lists."""
    if not isinstance(values, dict):
        raise RobotError(f"{where}holds {short(values)}, expected an object")
    fields = dataclasses.fields(kind)
    known = [field.name for field in fields]
    if unknown := [name for name in values if name not in known]:
        near = perhaps(unknown[0], known) or f", expected {', '.join(known)}"
        raise RobotError(f"{where}unknown field {short(unknown[0])}{near}")
    required = [field.name for field in fields if field.default is dataclasses.MISSING]
    if missing := [name for name in required if name not in values]:
        raise RobotError(f"{where}{missing[0]} is missing")
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
