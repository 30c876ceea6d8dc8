"""Names, order and sizes of what networks see: one place, for environments, modules and exports alike."""

from collections.abc import Sequence
from math import prod

from tensordict import NestedKey

from plat.robots import G1, Robot

__all__ = ["COMMAND_KEYS", "ROBOT_KEYS", "entry_shapes", "goal_keys", "observation_size", "privileged_keys"]

Key = tuple[str, str]


def entry_shapes(group: str, robot: Robot) -> dict[str, tuple[int, ...]]:
    """Shape of each entry of a group of observations, in the order in which networks see them.

    Args:
        group: ``"robot"``, ``"goal"`` (any goal group has these entries), ``"command"`` or ``"privileged"``.

    >>> from plat.robots import G1
    >>> entry_shapes("goal", G1)
    {'joint_pos': (29,), 'root_pos_b': (3,), 'root_rot6d_b': (6,), 'keypoint_pos_b': (42,)}
    """
    joints, points = (robot.num_joints,), (3 * len(robot.keypoints),)
    groups: dict[str, dict[str, tuple[int, ...]]] = {
        "robot": {
            "joint_pos": joints,
            "joint_vel": joints,
            "root_ang_vel_b": (3,),
            "root_lin_vel_b": (3,),
            "gravity_b": (3,),
            "last_action": joints,
        },
        "goal": {"joint_pos": joints, "root_pos_b": (3,), "root_rot6d_b": (6,), "keypoint_pos_b": points},
        "command": {"horizon": (1,)},
        "privileged": {
            "keypoint_pos_b": points,
            "keypoint_lin_vel_b": points,
            "root_height": (1,),
            "root_velocity_error_b": (6,),
            "joint_vel_error": joints,
        },
    }
    return groups[group]


def _keys(group: str, as_group: str | None = None) -> tuple[Key, ...]:
    # names and order are the same for every robot
    return tuple((as_group or group, name) for name in entry_shapes(group, G1))


def goal_keys(group: str = "goal") -> tuple[Key, ...]:
    """Entries of a goal group."""
    return _keys("goal", group)


def privileged_keys() -> tuple[Key, ...]:
    """Entries that only a critic sees."""
    return _keys("privileged")


ROBOT_KEYS: tuple[Key, ...] = _keys("robot")
"""Entries of the robot's own state ``s_t``."""

COMMAND_KEYS: tuple[Key, ...] = _keys("command")
"""Entries of the command beside its goal: the normalised horizon ``tau``."""


def observation_size(keys: Sequence[NestedKey], robot: Robot) -> int:
    """Number of features of some entries side by side; groups of other names are goals.

    >>> from plat.robots import G1
    >>> observation_size(ROBOT_KEYS + goal_keys() + COMMAND_KEYS, G1)
    177
    """
    known = ("robot", "command", "privileged")
    return sum(prod(entry_shapes(group if group in known else "goal", robot)[name]) for group, name in keys)
