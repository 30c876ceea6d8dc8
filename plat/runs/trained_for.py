"""What a policy depends on of its robot: kept with a run, and compared with the robot of that name at its loading."""

import math
import sys
from pathlib import Path
from typing import Any

from plat.errors import CheckpointError
from plat.json_file import short
from plat.robots.robot import Robot
from plat.words import counted

__all__ = ["TRAINED_FOR", "check_trained_for", "trained_for"]

TRAINED_FOR = "trained_for"
"""Entry of a policy's description that holds this; descriptions of before it have none."""

_NAMES = ("joints", "keypoints")
_NUMBERS = ("default_pose", "stiffness", "damping", "effort_limit", "action_scale")
# Numbers are written with this many digits, and differ where they do by more than rounding.
_DIGITS = 6
_ROUNDING = 1e-4


def trained_for(robot: Robot) -> dict[str, Any]:
    """Return what observations and actions of a robot mean, as plain lists.

    Returns:
        ``joints`` and ``keypoints``: names in order. ``default_pose`` (rad), ``stiffness`` (N m/rad), ``damping``
        (N m s/rad), ``effort_limit`` (N m) and ``action_scale`` (rad): a number for each joint.

    >>> from plat.robots import G1
    >>> kept = trained_for(G1)
    >>> [kept[name][0] for name in ("joints", "keypoints", "default_pose", "stiffness", "effort_limit")]
    ['left_hip_pitch', 'pelvis', -0.312, 40.1792, 88.0]
    """
    values = (robot.default_joint_pos, robot.stiffness, robot.damping, robot.effort_limit, robot.action_scale)
    return {
        "joints": list(robot.joint_names),
        "keypoints": list(robot.keypoints),
        **{
            name: [float(f"{number:.{_DIGITS}g}") for number in value.tolist()]
            for name, value in zip(_NUMBERS, values, strict=True)
        },
    }


def check_trained_for(spec: Any, robot: Robot, path: Path) -> None:
    """Check that a robot is still the one that a policy was trained for; nothing is asked of a run that does not say.

    Args:
        spec: description of the policy, see :func:`plat.runs.policy_spec`.
        robot: the robot that has its name now.
        path: file of the description, for messages.

    Raises:
        CheckpointError: naming the first field that differs and both values, or a field that is damaged.
    """
    if not isinstance(spec, dict) or spec.get("robot") != robot.name or TRAINED_FOR not in spec:
        return
    kept, now = spec[TRAINED_FOR], trained_for(robot)
    where = f"{str(path)!r}: policy.{TRAINED_FOR}"
    if not isinstance(kept, dict):
        raise CheckpointError(f"{where} is {short(kept)}, expected an object")
    for name in (*_NAMES, *_NUMBERS):
        fits = _is_name if name in _NAMES else _is_number
        values = kept.get(name)
        if not isinstance(values, list) or not all(map(fits, values)):
            what = "names" if name in _NAMES else "numbers"
            raise CheckpointError(f"{where}.{name} is {short(values)}, expected a list of {what}")
        if difference := _difference(name, values, now[name], now["joints"]):
            raise CheckpointError(
                f"{where}: {difference} as robot {robot.name!r} is now: give the changed robot another name, or remove "
                f"{TRAINED_FOR!r} from the file if the policy is to drive it as it is"
            )


def _is_name(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    # a whole number may be too large for a float
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < sys.float_info.max


def _difference(name: str, was: list[Any], now: list[Any], joints: list[str]) -> str:
    """Return the first difference in words; empty where there is none."""
    if len(was) != len(now):
        told = f"{len(was)} {name}, and" if name in _NAMES else f"{name} of {counted(len(was), 'joint')}, and of"
        return f"{told} {len(now)}"
    for index, (old, new) in enumerate(zip(was, now, strict=True)):
        if name in _NAMES and old != new:
            return f"{name}[{index}] is {old!r}, and {new!r}"
        if name in _NUMBERS and not math.isclose(old, new, rel_tol=_ROUNDING, abs_tol=_ROUNDING**2):
            return f"{name} of {joints[index]!r} is {old:g}, and {new:g}"
    return ""
