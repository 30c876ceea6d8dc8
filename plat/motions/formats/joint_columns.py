"""Which of the columns that a file names are joints of the robot."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.formats.spellings import match_joint, tokens
from plat.motions.formats.unnamed_joints import OPTIONAL
from plat.robots.robot import Robot

__all__ = ["is_root", "listed_joints", "robot_columns", "texts"]

# what files call the joint between world and robot
_ROOT_WORDS = frozenset(("root", "floating", "base", "free", "freejoint", "joint", "pelvis", "floatingbase", "world"))
# names of the first G1, whose elbows count from another zero
_OLD = frozenset(("elbow", "roll"))
# fields whose names are not those of joints, whatever they are
_OF_OTHERS = frozenset(("body", "bodies", "link", "links", "site", "sites", "geom", "geoms", "keypoint", "keypoints"))
# as many names as a field has, of which the robot's joints are at least this share
_MOST = 0.5


def is_root(name: str) -> bool:
    """Return whether a name is that of the joint between world and robot.

    >>> is_root("floating_base_joint"), is_root("left_knee_joint")
    (True, False)
    """
    return set(tokens(name)) <= _ROOT_WORDS


def texts(value: Any) -> list[str]:
    """Return the texts in a list, a tuple or an array of texts alone; nothing of anything else.

    >>> texts(np.array(["a", "b"])), texts((b"a",)), texts("ab"), texts([1, "a"])
    (['a', 'b'], ['a'], [], [])
    """
    if isinstance(value, np.ndarray):
        value = value.ravel().tolist() if value.dtype.kind in "SU" else []
    if not isinstance(value, (list, tuple)) or not all(isinstance(one, (str, bytes)) for one in value):
        return []
    return [one.decode("utf-8", "replace") if isinstance(one, bytes) else one for one in value]


def listed_joints(fields: Mapping[Any, Any], counts: Collection[int], robot: Robot) -> list[str] | None:
    """Return the names of joints that some field lists, whatever it is called, or None.

    Args:
        fields: of a file, by name; those of dictionaries in it count as well.
        counts: numbers of columns that may be joints. The root may have a name besides.
        robot: whose joints they are.

    Raises:
        MotionError: where several fields list joints in different orders.

    >>> from plat.robots import G1
    >>> listed_joints({"joint_order": G1.joint_names, "bodies": ["pelvis"]}, [29], G1) == list(G1.joint_names)
    True
    """
    found: dict[str, list[str]] = {}
    inner = [part for value in fields.values() if isinstance(value, dict) for part in value.items()]
    for field, value in (*fields.items(), *inner):
        names = texts(value)
        if not names or not isinstance(field, str) or set(tokens(field)) & _OF_OTHERS:
            continue
        joints = [joint for name in names if (joint := match_joint(name, robot)) is not None]
        fits = len(names) in counts or (len(names) - 1 in counts and any(map(is_root, names)))
        if fits and len(set(joints)) > _MOST * robot.num_joints and names not in found.values():
            found[field] = names
    if len(found) > 1:
        raise MotionError(
            f"{' and '.join(map(short, found))} list joints in different orders; name the right one 'joint_names'"
        )
    return next(iter(found.values()), None)


def robot_columns(names: Sequence[str], count: int, robot: Robot) -> tuple[list[int], list[str], list[str]]:
    """Return the columns of the robot's joints, the names of these joints, and the names that were left out.

    Names beside a whole robot, such as those of hands, of a door or of the root, are left out. Where all are links of
    the robot, as in the settings of ASAP, their joints are meant.

    Args:
        names: as the file lists them.
        count: of the columns that they name; the root's name may have no column.
        robot: whose joints are looked for.

    Raises:
        MotionError: for joints that are missing, named twice, or not as many as columns.
    """
    listed = list(names)
    roots = [name for name in listed if is_root(name)]
    if len(listed) == count + 1 and len(roots) == 1:
        listed.remove(roots[0])
    model = robot.shared_model
    moved = {model.body(model.jnt_bodyid[joint + 1]).name: name for joint, name in enumerate(robot.joint_names)}
    if set(listed) <= set(moved):
        listed = [moved[link] for link in listed]
    matched = [match_joint(name, robot) for name in listed]
    # another robot may have such a joint itself
    unmatched = [name for name, joint in zip(listed, matched, strict=True) if joint is None]
    if old := sorted(name for name in unmatched if set(tokens(name)) >= _OLD):
        raise MotionError(
            f"it has the joint names {old} of the first G1, whose elbows count from another angle; retarget it to "
            f"{robot.name!r} anew"
        )
    found = [joint for joint in matched if joint is not None]
    if twice := sorted({joint for joint in found if found.count(joint) > 1}):
        raise MotionError(f"'joint_names' has {_some(twice)} twice, expected each joint once")
    missing = sorted(set(robot.joint_names) - set(found))
    unknown = sorted(unmatched)
    expected = f"the {robot.num_joints} joints of {robot.name!r}"
    # a name that shares a word with a missing joint may be that joint, and so may one that makes up the number
    words = {word for joint in missing for word in tokens(joint)}
    others = set(unknown) - set(roots)
    in_doubt = any(words & set(tokens(name)) for name in others) or (bool(others) and count == robot.num_joints)
    if missing and (in_doubt or not all("wrist" in name or name in OPTIONAL for name in missing)):
        told = f"'joint_names' lacks {_some(missing)} and has the unknown {_some(unknown)}"
        another = ", as another body" if len(found) < robot.num_joints // 3 else ""
        raise MotionError(f"{told}{another}; expected {expected}")
    if len(listed) != count:
        raise MotionError(f"'joint_names' has {len(listed)} names, expected one for each of {count} joints")
    return [column for column, joint in enumerate(matched) if joint is not None], found, unknown


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(short(name) for name in names[:8])
    return f"[{shown}]" + (f" and {len(names) - 8} more" if len(names) > 8 else "")
