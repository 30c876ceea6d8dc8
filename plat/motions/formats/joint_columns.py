"""Which of the columns that a file names are joints of the robot."""

from collections.abc import Sequence

from plat.errors import MotionError
from plat.json_file import short
from plat.motions.formats.spellings import match_joint, tokens
from plat.motions.formats.unnamed_joints import OPTIONAL
from plat.robots.robot import Robot

__all__ = ["is_root", "robot_columns"]

# what files call the joint between world and robot
_ROOT_WORDS = frozenset(("root", "floating", "base", "free", "freejoint", "joint", "pelvis", "floatingbase", "world"))
# names of the first G1, whose elbows count from another zero
_OLD = frozenset(("elbow", "roll"))


def is_root(name: str) -> bool:
    """Return whether a name is that of the joint between world and robot.

    >>> is_root("floating_base_joint"), is_root("left_knee_joint")
    (True, False)
    """
    return set(tokens(name)) <= _ROOT_WORDS


def robot_columns(names: Sequence[str], count: int, robot: Robot) -> tuple[list[int], list[str], list[str]]:
    """Return the columns of the robot's joints, the names of these joints, and the names that were left out.

    Names beside a whole robot, such as those of hands, of a door or of the root, are left out.

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
