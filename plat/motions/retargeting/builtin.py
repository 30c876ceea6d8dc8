"""The skeleton maps that come with plat, and which of them fits a capture."""

import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import resources

import numpy as np

from plat.errors import MotionError
from plat.motions.retargeting.capture_axes import rest_pitches
from plat.motions.retargeting.mocap import Mocap
from plat.motions.retargeting.propose import propose_map
from plat.motions.retargeting.skeletons import SIDES, SkeletonMap, load_map

__all__ = ["UnknownSkeletonError", "builtin_maps", "find_map", "joint_keys", "with_joints"]

_SUFFIX = re.compile(r"[ _.-]?(?:jnt|joint|bone|bn|jt)(?=(?:_end)?$)", re.IGNORECASE)
# Lengths below this share of a leg give no direction.
_SHORT = 0.01


class UnknownSkeletonError(MotionError):
    """A capture whose joints no map that comes with plat has.

    Attributes:
        proposed: a map to be confirmed, where one can be told from names and tree.
    """

    def __init__(self, message: str, proposed: SkeletonMap | None = None):
        super().__init__(message, proposed)
        self.proposed = proposed

    def __str__(self) -> str:
        return str(self.args[0])


@cache
def builtin_maps() -> tuple[SkeletonMap, ...]:
    """Return the maps that come with plat.

    >>> [skeleton.name for skeleton in builtin_maps()][:3]
    ['amass', 'amp', 'animated_drawings']
    """
    folder = resources.files("plat.motions.retargeting") / "skeletons"
    with resources.as_file(folder) as path:
        return tuple(load_map(file) for file in sorted(path.glob("*.yaml")))


def joint_keys(names: Sequence[str], prefix: str = "") -> list[str]:
    """Return joint names in small letters and digits alone, without a prefix and what stands before a colon.

    >>> joint_keys(["mixamorig:Hips", "mixamorig:LeftUpLeg"]), joint_keys(["Bip01 Pelvis", "Bip01 L Thigh"], "Bip01 ")
    (['hips', 'leftupleg'], ['pelvis', 'lthigh'])
    """
    short = [re.split(r"[:|]", name)[-1].removeprefix(prefix) for name in names]
    bare = [_SUFFIX.sub("", name) for name in short]
    # a rig whose joints nearly all end in the same word; end sites follow it
    if sum(one != other for one, other in zip(short, bare, strict=True)) > len(short) // 2:
        short = bare
    return [re.sub(r"[^a-z0-9]", "", name.lower()) for name in short]


def find_map(mocap: Mocap, where: str) -> SkeletonMap:
    """Return the map that comes with plat and fits, with the joints named as the capture names them.

    Prefixes, case and separators do not matter. Of several maps that fit, exact names count most, then the one whose
    chest is highest. A map whose trunk would have no length does not fit. How the trunk's lines lean in upright
    standing is what the capture's rest pose says, and the map where that one does not stand.

    Raises:
        MotionError: when none fits; ``where`` is for its message.
    """
    found = []
    files = [joint_keys(mocap.names, prefix) for prefix in _prefixes(mocap.names)]
    for skeleton in builtin_maps():
        names = list(skeleton.joints.values())
        maps = [joint_keys(names, prefix) for prefix in _prefixes(names)]
        for keys, wanted in itertools.product(files, maps):
            if set(wanted) <= set(keys):
                joints = {role: mocap.names[keys.index(key)] for role, key in zip(skeleton.joints, wanted, strict=True)}
                exact = set(names) <= set(mocap.names)
                if _has_lengths(mocap, joints):
                    found.append((exact, _depth(mocap, joints["chest"]), replace(skeleton, joints=joints)))
                break
    if found:
        fitting = max(found, key=lambda row: row[:2])[2]
        stated = fitting.pelvis_pitch, fitting.torso_pitch
        pelvis, torso = rest_pitches(mocap, fitting.joints) or stated
        return replace(fitting, pelvis_pitch=pelvis, torso_pitch=torso)
    known = ", ".join(skeleton.name for skeleton in builtin_maps())
    raise UnknownSkeletonError(
        f"{where}: its joints are those of none of the known skeletons ({known}); write a map for them (plat motions "
        f"retarget --map), see docs/retargeting.md. Its joints are: {', '.join(mocap.names[:60])}",
        propose_map(mocap, "proposed"),
    )


def with_joints(skeleton: SkeletonMap, mocap: Mocap, where: str) -> SkeletonMap:
    """Return a map whose joints a capture has.

    Raises:
        MotionError: naming the joints that it lacks; ``where`` is for its message.
    """
    missing = sorted(set(skeleton.joints.values()) - set(mocap.names))
    if missing:
        raise MotionError(f"{where}: lacks the joints {missing} of skeleton map {skeleton.name!r}")
    return skeleton


def _prefixes(names: Sequence[str]) -> list[str]:
    """Return none, and the words that many of the names begin with."""
    short = [re.split(r"[:|]", name)[-1] for name in names]
    words = Counter(match[0] for name in short if (match := re.match(r"[A-Za-z0-9]+[ _.-]+(?=.)", name)))
    return ["", *(word for word, count in words.items() if count >= len(SIDES) * 7)]


def _has_lengths(mocap: Mocap, joints: dict[str, str]) -> bool:
    at = {role: mocap.positions[-1, mocap.names.index(name)] for role, name in joints.items()}
    leg = np.linalg.norm(at["left_hip"] - at["left_ankle"])
    pairs = [("hips", "spine"), ("chest", "neck"), *((f"{side}_ankle", f"{side}_toe") for side in SIDES)]
    return all(np.linalg.norm(at[start] - at[end]) > _SHORT * leg for start, end in pairs)


def _depth(mocap: Mocap, name: str) -> int:
    index, steps = mocap.names.index(name), 0
    while (index := mocap.parents[index]) >= 0:
        steps += 1
    return steps
