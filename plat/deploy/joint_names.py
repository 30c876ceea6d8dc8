"""Joint names and motor tables of a robot's software against those of a policy."""

import re
from collections.abc import Iterable, Mapping, Sequence

from plat.bounds import shown
from plat.errors import BundleError
from plat.json_file import short
from plat.words import counted

__all__ = ["check_joints", "plain_joint"]


def plain_joint(name: str) -> str:
    """Return a joint's name without ``_joint`` and in small letters, as plat spells it.

    >>> [plain_joint(name) for name in ("left_hip_pitch_joint", "LeftHipPitch", "kLeftHipPitch", "left_hip_pitch")]
    ['left_hip_pitch', 'left_hip_pitch', 'left_hip_pitch', 'left_hip_pitch']
    """
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", re.sub(r"^k(?=[A-Z])", "", name))
    return words.lower().removesuffix("_joint")


def check_joints(where: str, ours: Sequence[str], given: Sequence[str] | Mapping[str, int]) -> None:
    """Check that the caller's joint vectors are in the order of a policy's.

    Args:
        where: for messages.
        ours: the policy's joints.
        given: the caller's in their order; or a table of motors, names with their place. A table may have more
            motors, and several names for one.

    Raises:
        BundleError: naming the first joint that is another, is missing, or has another place or two.
    """
    if not isinstance(given, Iterable) or isinstance(given, str | bytes | set | frozenset):
        raise BundleError(f"{where}: joint_names is {short(given)}, expected names in order, or a table of motors")
    if not isinstance(given, Mapping):
        given = tuple(given)
    if other := [name for name in given if not isinstance(name, str)]:
        raise BundleError(f"{where}: joint_names has {short(other[0])}, expected names")
    if isinstance(given, Mapping):
        for index, name in enumerate(ours):
            places = [place for other, place in given.items() if plain_joint(other) == plain_joint(name)]
            if not places:
                raise BundleError(f"{where}: joint {name!r} is not in this robot's table of {len(given)} motors")
            if any(place != index for place in places):
                found = " and ".join(map(shown, dict.fromkeys(places)))
                raise BundleError(f"{where}: joint {name!r} is number {index} in the bundle and {found} on this robot")
        return
    for index, (expected, name) in enumerate(zip(ours, given, strict=False)):
        if plain_joint(expected) != plain_joint(name):
            raise BundleError(f"{where}: joint {index} is {expected!r} in the bundle and {name!r} on this robot")
    if len(ours) != len(given):
        raise BundleError(f"{where}: {counted(len(ours), 'joint')} in the bundle, {len(given)} on this robot")
